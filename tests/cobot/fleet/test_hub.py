"""What a hub makes of the answers to a stop. Oracle: docs/fleet.md, "Look and stop"."""

from __future__ import annotations

import pytest

from cobot.fleet.hub import _is_open, _worst
from cobot.fleet.messages import CommandAnswer


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
