"""Addresses of robots. Oracle: the table in the module's docstring, and urllib's way back."""

from __future__ import annotations

from urllib.parse import unquote, urlsplit

import pytest

from cobot.addresses import address, check_url, path_at, path_below
from cobot.errors import InputError


@pytest.mark.parametrize(
    ("plain", "below"),
    [
        ("/robot/pose", "/pose"),
        ("/robot/move/joints", "/move/joints"),
        ("/trajectory/send", "/trajectory/send"),
        ("/stop", "/stop"),
        ("/robots", "/robots"),  # no path of a robot's own
    ],
)
def test_a_plain_path_has_its_twin_below_the_name_of_a_robot(plain: str, below: str) -> None:
    assert path_below(plain) == below
    assert path_at("http://host:8000/robots/left", plain) == below
    assert path_at("http://host:8000", plain) == plain


@pytest.mark.parametrize("name", ["left", "right-2", "Müller & Sohn", "a/b", "?x#y"])
def test_any_name_is_one_part_of_the_path(name: str) -> None:
    path = urlsplit(address("http://host/", name)).path
    assert [unquote(part) for part in path.split("/")] == ["", "robots", name]


@pytest.mark.parametrize(
    "url", ["", "foo", "host:8007", "ws://host", "http:", "http://", "http://h:x", "http://[h"]
)
def test_what_is_no_url_is_told_what_one_looks_like(url: str) -> None:
    with pytest.raises(InputError, match="a valid one is http://localhost:8007"):
        check_url(url)
    for good in ("http://host", "https://[::1]:8007/robots/left"):
        check_url(good)
