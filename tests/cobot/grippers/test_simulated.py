"""The driver of the cell's hand. Oracle: a hand on six points that stops at its part."""

from __future__ import annotations

import pytest

from cobot.grippers import Grasp, GripperError, HeldObject
from cobot.grippers.simulated import SimulatedGripper, SimulatedOptions


class Hand:
    """A port and a clock at once: `go_on` has time pass."""

    def __init__(self) -> None:
        self.points = {"hand.width": 0.08, "hand.speed": 0.2, "hand.force": 0.0}
        self.width, self.part, self.seconds = 0.08, 0.0, 10.0

    def now_s(self) -> float:
        return self.seconds

    def read(self, name: str) -> float:
        presses = self.width > self.points["hand.width"] and self.width == self.part
        measured = {
            "hand.measured_width": self.width,
            "hand.measured_force": self.points["hand.force"] * presses,
            "hand.moving": float(self.width != self.points["hand.width"] and not presses),
        }
        if name not in (found := {**self.points, **measured}):
            raise GripperError(f"the robot has no input or output {name!r}")
        return found[name]

    def set(self, name: str, value: float) -> None:
        assert name in self.points
        self.points[name] = value

    def go_on(self, seconds: float) -> None:
        self.seconds += seconds
        step, target = self.points["hand.speed"] * seconds, max(self.points["hand.width"], self.part)
        way = target - self.width
        self.width = target if abs(way) <= step else self.width + (step if way > 0 else -step)


@pytest.fixture
def hand() -> Hand:
    return Hand()


@pytest.fixture
def gripper(hand: Hand) -> SimulatedGripper:
    made = SimulatedGripper(SimulatedOptions(), hand, hand)  # type: ignore[arg-type]
    made.connect()
    return made


def test_it_holds_a_part_and_releases_it(hand: Hand, gripper: SimulatedGripper) -> None:
    hand.part = 0.04
    gripper.grasp(Grasp(0.04, 0.005, 0.005, force=30.0))
    assert gripper.state().moving
    hand.go_on(0.5)
    state = gripper.state()
    assert (state.moving, state.object) == (False, HeldObject.HELD_INSIDE)
    assert (state.width, state.force) == (0.04, 30.0)
    gripper.release(None)
    hand.go_on(0.5)
    assert (gripper.state().object, gripper.state().width) == (HeldObject.NONE, 0.08)


def test_a_grasp_of_nothing_holds_nothing(hand: Hand, gripper: SimulatedGripper) -> None:
    gripper.grasp(Grasp(0.04, 0.005, 0.005))
    hand.go_on(0.5)
    assert gripper.state().object is HeldObject.NONE


def test_a_stop_on_the_way_stays_where_it_is(hand: Hand, gripper: SimulatedGripper) -> None:
    gripper.move(0.0, 0.02, None)
    hand.go_on(1.0)
    gripper.stop()
    hand.go_on(1.0)
    assert gripper.state().width == pytest.approx(0.06)


def test_a_robot_without_a_cell_has_no_hand(hand: Hand) -> None:
    del hand.points["hand.speed"]
    gripper = SimulatedGripper(SimulatedOptions(), hand, hand)  # type: ignore[arg-type]
    with pytest.raises(GripperError, match=r"hand\.speed"):
        gripper.connect()
