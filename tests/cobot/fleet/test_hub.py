"""What a hub makes of the answers of cells. Oracle: docs/fleet.md, "Look and stop"."""

from __future__ import annotations

import importlib.util
import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest

if importlib.util.find_spec("zenoh") is None:
    pytest.skip("Zenoh is not installed: it is in the extra fleet", allow_module_level=True)
from cobot.fleet.hub import Hub, _is_open, _worst
from cobot.fleet.messages import CommandAnswer, FleetState
from cobot.fleet.names import FleetKeys

if TYPE_CHECKING:
    import zenoh

INSTANCE = "0123456789abcdef"


def answer(code: str, robot: str = "arm") -> CommandAnswer:
    return CommandAnswer(id="12345678", cell="cell", robot=robot, code=code, text="")


@pytest.mark.parametrize("codes", [("ok", "execution"), ("execution", "ok")])
def test_of_two_cells_with_one_name_the_one_that_does_not_rest_counts(codes: tuple[str, str]) -> None:
    found = _worst([*map(answer, codes), answer("ok", "other")])
    assert {name: each.code for name, each in found.items()} == {
        ("cell", "arm"): "execution",
        ("cell", "other"): "ok",
    }


@pytest.mark.parametrize(
    ("code", "again"),
    [("ok", False), ("conflict", False), ("input", False), ("busy", True), ("unavailable", True)],
)
def test_what_may_succeed_later_is_tried_again(code: str, again: bool) -> None:
    assert _is_open(answer(code)) is again
    assert _is_open(None)


class Session:
    """A session in which a cell answers to each query for states with these contents."""

    def __init__(self, *contents: bytes) -> None:
        self._contents = contents

    def get(self, *_: Any, **__: Any) -> list[Any]:
        return [SimpleNamespace(ok=SimpleNamespace(payload=each)) for each in self._contents]


def test_a_cell_does_not_answer_for_another_one() -> None:
    """Oracle: docs/fleet.md: a cell can neither command another one nor speak for it."""
    hub = Hub.__new__(Hub)
    hub._keys, hub._lock, hub._tiles = FleetKeys("hall"), threading.Lock(), {}
    hub._instances = {"good": {INSTANCE}, "evil": {INSTANCE}}
    own, forged = (
        FleetState(
            cell=cell, robot="arm", instance=INSTANCE, version="1", configuration="", state="ready"
        ).model_dump_json()
        for cell in ("evil", "good")
    )
    hub._session = cast("zenoh.Session", Session(forged.encode(), own.encode()))
    hub._ask_states("evil")
    assert list(hub._tiles) == [("evil", "arm")]
