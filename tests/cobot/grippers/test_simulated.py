"""The driver of the cell's hand. Oracle: a hand on six points that stops at its part."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot import cell
from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.grippers import Grasp, GripperError, HeldObject, make_gripper
from cobot.grippers.point_rigs import HandRig
from cobot.grippers.simulated import SimulatedGripper

HAND = cell.Hand()


@pytest.fixture
def hand() -> HandRig:
    return HandRig(HAND)


@pytest.fixture
def gripper(hand: HandRig) -> SimulatedGripper:
    made = SimulatedGripper(HAND, hand, hand)
    made.connect()
    return made


def test_it_holds_a_part_and_releases_it(hand: HandRig, gripper: SimulatedGripper) -> None:
    hand.object_m = 0.04
    gripper.grasp(Grasp(0.04, 0.005, 0.005, force=30.0))
    assert gripper.state().moving
    hand.step(0.5)
    state = gripper.state()
    assert (state.moving, state.object) == (False, HeldObject.HELD_INSIDE)
    assert (state.width, state.force) == (0.04, 30.0)
    gripper.release(None)
    hand.step(0.5)
    assert (gripper.state().object, gripper.state().width) == (HeldObject.NONE, 0.08)


def test_a_grasp_of_nothing_holds_nothing(hand: HandRig, gripper: SimulatedGripper) -> None:
    gripper.grasp(Grasp(0.04, 0.005, 0.005))
    hand.step(0.5)
    assert gripper.state().object is HeldObject.NONE


def test_a_stop_on_the_way_stays_where_it_is(hand: HandRig, gripper: SimulatedGripper) -> None:
    gripper.move(0.0, 0.02, None)
    hand.step(1.0)
    gripper.stop()
    hand.step(1.0)
    assert gripper.state().width == pytest.approx(0.06)


def test_a_robot_without_a_cell_has_no_hand(hand: HandRig) -> None:
    del hand.values["hand.speed"]
    gripper = SimulatedGripper(HAND, hand, hand)
    with pytest.raises(GripperError, match=r"hand\.speed"):
        gripper.connect()


def made_for(folder: Path, hand: HandRig, robot: str) -> SimulatedGripper:
    config = folder / "config.yaml"
    config.write_text(f"robot: {{{robot}gripper: {{type: simulated}}}}\n", encoding="utf-8")
    made = make_gripper(load_settings(config), hand)
    assert isinstance(made, SimulatedGripper)
    return made


def test_it_can_do_what_the_hand_of_the_cell_file_can(tmp_path: Path, hand: HandRig) -> None:
    (tmp_path / "cell.yaml").write_text("hand: {stroke_m: 0.05, max_force_n: 20.0, max_speed_m_s: 0.1}\n")
    able = made_for(tmp_path, hand, f"cell: {tmp_path}, ").capabilities
    assert able.width_m == (0.0, 0.05)
    assert able.force_n is not None
    assert able.speed_m_s is not None
    assert (able.force_n[1], able.speed_m_s[1]) == (20.0, 0.1)


@pytest.mark.parametrize(
    ("content", "why"), [(None, "cobot run --cell FILE"), ("floor_m: 0.0\n", r"has no hand; add `hand: {}`")]
)
def test_without_a_hand_in_a_cell_the_start_says_what_to_do(
    tmp_path: Path, hand: HandRig, content: str | None, why: str
) -> None:
    if content is not None:
        (tmp_path / "cell.yaml").write_text(content)
    with pytest.raises(ConfigError, match=why):
        made_for(tmp_path, hand, "" if content is None else f"cell: {tmp_path}, ")


def test_the_weakest_hand_detects_what_it_holds(hand: HandRig) -> None:
    gripper = SimulatedGripper(cell.Hand(max_force_n=1.0), hand, hand)
    hand.object_m = 0.04
    gripper.grasp(Grasp(None, 0.0, 0.0, force=0.8))
    hand.step(0.5)
    assert gripper.state().object is HeldObject.HELD_INSIDE


def test_it_moves_until_the_cell_has_reported_the_command(hand: HandRig, gripper: SimulatedGripper) -> None:
    before = dict(hand.values)
    gripper.move(0.02, None, None)
    commanded, hand.values = hand.values, before  # the cell still reports what was before
    assert gripper.state().moving
    hand.values = commanded
    hand.step(0.5)
    assert not gripper.state().moving
    assert gripper.state().width == pytest.approx(0.02)


def test_a_command_that_another_client_has_replaced_ends(hand: HandRig, gripper: SimulatedGripper) -> None:
    gripper.move(0.02, None, None)
    hand.values["hand.width"] = 0.06
    hand.step(0.5)
    assert gripper.state().moving
    hand.step(0.6)
    assert not gripper.state().moving


class LateRig(HandRig):
    """A hand whose commands are reported only when `report` is called, as rtloop needs a few cycles."""

    def __init__(self) -> None:
        super().__init__(HAND)
        self._told: dict[str, float] = {}

    def set(self, name: str, value: float) -> None:
        self._told[name] = value

    def report(self) -> None:
        self.values |= self._told


def test_a_command_counts_although_the_one_before_is_not_reported_yet() -> None:
    hand = LateRig()
    gripper = SimulatedGripper(HAND, hand, hand)
    gripper.connect()
    gripper.move(0.02, None, None)
    gripper.move(HAND.stroke_m, None, None)  # what is still reported, from before the first command
    hand.report()
    hand.step(1.0)
    assert gripper.state().width == HAND.stroke_m
