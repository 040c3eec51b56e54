"""The extra that a fleet needs, and names. Oracle: a Python whose import system finds no Zenoh."""

from __future__ import annotations

import socket
from typing import Any

import pytest

from cobot.errors import ConfigError
from cobot.fleet.names import own_cell_name
from cobot.launch import fleet_extra


def test_without_zenoh_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet_extra, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"^fleet.connect: .*pip install 'cobot\[fleet\]'$"):
        fleet_extra.require_zenoh("fleet.connect")


@pytest.mark.parametrize(
    ("given", "host", "name"),
    [
        ("welding", "pc", "welding"),
        (None, "pc-7.plant.example", "pc-7-plant-example"),
        (None, "ünï", "n"),
        (None, "", "cell"),
    ],
)
def test_a_cell_without_a_name_has_that_of_its_computer(
    monkeypatch: pytest.MonkeyPatch, given: Any, host: str, name: str
) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: host)
    assert own_cell_name(given) == name
