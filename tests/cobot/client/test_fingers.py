"""Fingers that follow the last number of an action. Oracle: the commands that a stand-in was asked for."""

from __future__ import annotations

from typing import Any

import pytest

from cobot.client.fingers import UNKNOWN_FORCE_N, ServedFingers
from cobot.errors import NotSupportedError


class Commands:
    """Of a gripper.

    Attributes:
        widths: that it was asked for.
    """

    def __init__(self, **able: Any) -> None:
        self.able = {"width_m": [0.0, 0.08], "force_n": [1, 60], "continuous": True, **able}
        self.widths: list[float] = []

    def state(self) -> dict[str, Any]:
        return {"capabilities": self.able}

    def move(self, width: float, *, wait: bool) -> None:
        assert not wait
        self.widths.append(width)


def fingers_of(commands: Any) -> ServedFingers:
    found = ServedFingers.of(commands)
    assert found is not None
    return found


def test_a_width_is_commanded_when_it_changes_and_within_the_range() -> None:
    commands = Commands()
    fingers = fingers_of(commands)
    assert (fingers.width_m, fingers.max_force_n) == ((0.0, 0.08), 60.0)
    for width in (0.04, 0.0401, 0.0404, 0.0406, 1.0, 0.08, -1.0):
        fingers.aim(width)
    assert commands.widths == [0.04, 0.0406, 0.08, 0.0]


def test_fingers_with_two_positions_go_to_the_nearer_one() -> None:
    commands = Commands(continuous=False, force_n=None)
    fingers = fingers_of(commands)
    assert fingers.max_force_n == UNKNOWN_FORCE_N
    for width in (0.03, 0.01, 0.05, 0.08):
        fingers.aim(width)
    assert commands.widths == [0.0, 0.08]


def test_a_robot_without_a_gripper_has_no_fingers() -> None:
    class Bare(Commands):
        def state(self) -> dict[str, Any]:
            raise NotSupportedError("this robot has no gripper")

    bare: Any = Bare()
    assert ServedFingers.of(bare) is None


def test_a_command_that_is_rejected_is_given_again() -> None:
    commands = Commands()
    fingers = fingers_of(commands)
    taken, commands.move = commands.move, reject  # type: ignore[method-assign]
    with pytest.raises(NotSupportedError):
        fingers.aim(0.02)
    commands.move = taken  # type: ignore[method-assign]
    fingers.aim(0.02)
    assert commands.widths == [0.02]


def reject(width: float, *, wait: bool) -> None:
    raise NotSupportedError("no")


def test_a_suction_cup_has_no_width_that_a_policy_could_command() -> None:
    cup: Any = Commands(width_m=None)
    assert ServedFingers.of(cup) is None
