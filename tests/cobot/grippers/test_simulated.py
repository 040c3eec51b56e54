"""The driver of the cell's hand. Oracle: a hand on six points that stops at its part."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot import cell
from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.grippers import Grasp, GripperError, HeldObject, make_gripper
from cobot.grippers.simulated import SimulatedGripper

HAND = cell.Hand()


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
    made = SimulatedGripper(HAND, hand, hand)  # type: ignore[arg-type]
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
    gripper = SimulatedGripper(HAND, hand, hand)  # type: ignore[arg-type]
    with pytest.raises(GripperError, match=r"hand\.speed"):
        gripper.connect()


def made_for(folder: Path, hand: Hand, robot: str) -> SimulatedGripper:
    config = folder / "config.yaml"
    config.write_text(f"robot: {{{robot}gripper: {{type: simulated}}}}\n", encoding="utf-8")
    made = make_gripper(load_settings(config), hand)
    assert isinstance(made, SimulatedGripper)
    return made


def test_it_can_do_what_the_hand_of_the_cell_file_can(tmp_path: Path, hand: Hand) -> None:
    (tmp_path / "cell.yaml").write_text("hand: {stroke_m: 0.05, max_force_n: 20.0, max_speed_m_s: 0.1}\n")
    able = made_for(tmp_path, hand, f"cell: {tmp_path}, ").capabilities
    assert able.width_m == (0.0, 0.05)
    assert able.force_n is not None
    assert able.speed_m_s is not None
    assert (able.force_n[1], able.speed_m_s[1]) == (20.0, 0.1)


@pytest.mark.parametrize(
    ("content", "why"), [(None, "cobot run --cell FILE"), ("floor_m: 0.0\n", r"has none: add `hand: {}`")]
)
def test_without_a_hand_in_a_cell_the_start_says_what_to_do(
    tmp_path: Path, hand: Hand, content: str | None, why: str
) -> None:
    if content is not None:
        (tmp_path / "cell.yaml").write_text(content)
    with pytest.raises(ConfigError, match=why):
        made_for(tmp_path, hand, "" if content is None else f"cell: {tmp_path}, ")


def test_the_weakest_hand_detects_what_it_holds(hand: Hand) -> None:
    gripper = SimulatedGripper(cell.Hand(max_force_n=1.0), hand, hand)  # type: ignore[arg-type]
    hand.part = 0.04
    gripper.grasp(Grasp(None, 0.0, 0.0, force=0.8))
    hand.go_on(0.5)
    assert gripper.state().object is HeldObject.HELD_INSIDE


def test_it_moves_until_the_cell_has_reported_the_command(hand: Hand, gripper: SimulatedGripper) -> None:
    before = dict(hand.points)
    gripper.move(0.02, None, None)
    commanded, hand.points = hand.points, before  # the cell still reports what was before
    assert gripper.state().moving
    hand.points = commanded
    hand.go_on(0.5)
    assert not gripper.state().moving
    assert gripper.state().width == pytest.approx(0.02)


def test_a_command_that_another_client_has_replaced_ends(hand: Hand, gripper: SimulatedGripper) -> None:
    gripper.move(0.02, None, None)
    hand.points["hand.width"] = 0.06
    hand.go_on(0.5)
    assert gripper.state().moving
    hand.go_on(0.6)
    assert not gripper.state().moving
