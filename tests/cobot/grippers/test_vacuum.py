"""Suction cups at outputs. Oracle: a cup whose pressure the test sets, on a clock that it moves."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pydantic import ValidationError

from cobot.grippers import GripperError, HeldObject
from cobot.grippers.protocol import Grasp, GripperState
from cobot.grippers.vacuum import VacuumGripper, VacuumOptions

ANY = Grasp(None, 0.0, 0.0)
FULL = {"output": "ejector", "blow_output": "blow", "sensor": "kPa", "threshold": 60.0, "hysteresis": 10.0}


class Cup:
    """A robot's points and a clock."""

    def __init__(self) -> None:
        self.values = {"ejector": 0.0, "blow": 0.0, "kPa": 0.0}
        self.seconds = 100.0
        self.set_points: list[tuple[str, float]] = []

    def now_s(self) -> float:
        return self.seconds

    def read(self, name: str) -> float:
        if name not in self.values:
            raise GripperError(f"the robot has no input or output {name!r}")
        return self.values[name]

    def set(self, name: str, value: float) -> None:
        self.read(name)
        self.values[name] = value
        self.set_points.append((name, value))


@pytest.fixture
def cup() -> Cup:
    return Cup()


def gripper(cup: Cup, **options: Any) -> VacuumGripper:
    made = VacuumGripper(VacuumOptions.model_validate(options or FULL), cup, cup)
    made.connect()
    return made


def seen(made: VacuumGripper, cup: Cup, pressure: float, after_s: float = 0.03) -> tuple[bool, HeldObject]:
    """Whether a command is under way, and the object, some time later at a pressure."""
    cup.values["kPa"], cup.seconds = pressure, cup.seconds + after_s
    state = made.state()
    assert state.object is not None
    return state.moving, state.object


def test_a_grasp_ends_at_the_threshold_and_the_part_is_lost_below_the_hysteresis(cup: Cup) -> None:
    made = gripper(cup)
    made.grasp(ANY)
    assert cup.values["ejector"] == 1.0
    assert made.state().moving
    assert seen(made, cup, 59.9) == (True, HeldObject.NONE)
    assert seen(made, cup, 60.0) == (False, HeldObject.HELD_INSIDE)
    assert seen(made, cup, 50.0, 100.0) == (False, HeldObject.HELD_INSIDE)
    assert seen(made, cup, 49.9) == (False, HeldObject.NONE)
    assert seen(made, cup, 55.0) == (False, HeldObject.NONE)


def test_without_vacuum_in_time_nothing_is_held(cup: Cup) -> None:
    made = gripper(cup)
    made.grasp(ANY)
    assert seen(made, cup, 30.0, 0.99) == (True, HeldObject.NONE)
    assert seen(made, cup, 30.0, 0.02) == (False, HeldObject.NONE)
    assert cup.values["ejector"] == 1.0, "a part that comes later is held"
    assert seen(made, cup, 80.0) == (False, HeldObject.HELD_INSIDE)


def test_an_absolute_pressure_holds_below_its_threshold(cup: Cup) -> None:
    made = gripper(cup, output="ejector", sensor="kPa", threshold=40.0, hysteresis=5.0, inverted_sensor=True)
    made.grasp(ANY)
    for pressure, found in ((101.3, "none"), (40.0, "held_inside"), (45.0, "held_inside"), (45.1, "none")):
        assert seen(made, cup, pressure, 1.0)[1] == found


def test_a_release_blows_for_its_time_and_ends_when_the_vacuum_has_gone(cup: Cup) -> None:
    made = gripper(cup)
    made.grasp(ANY)
    seen(made, cup, 80.0)
    cup.set_points.clear()
    made.release(None)
    assert cup.set_points == [("ejector", 0.0), ("blow", 1.0)], "never both at once"
    assert seen(made, cup, 70.0, 0.1) == (True, HeldObject.NONE)
    assert seen(made, cup, 0.0, 0.05) == (True, HeldObject.NONE), "it still blows"
    assert cup.values["blow"] == 1.0
    assert seen(made, cup, 0.0, 0.06) == (False, HeldObject.NONE)
    assert cup.values["blow"] == 0.0


def test_a_grasp_during_the_blow_off_ends_it_first(cup: Cup) -> None:
    made = gripper(cup)
    made.release(None)
    cup.set_points.clear()
    made.grasp(ANY)
    assert cup.set_points == [("blow", 0.0), ("ejector", 1.0)]


def test_vacuum_that_a_release_leaves_is_a_fault_until_it_has_gone(cup: Cup) -> None:
    made = gripper(cup)
    made.grasp(ANY)
    seen(made, cup, 80.0)
    made.release(None)
    assert seen(made, cup, 70.0, 0.85) == (True, HeldObject.NONE)
    assert seen(made, cup, 70.0, 0.1) == (False, HeldObject.NONE)
    assert "still vacuum 0.9 s after the release: kPa" in made.state().fault
    seen(made, cup, 0.0)
    assert made.state().fault == ""


def test_without_a_sensor_the_times_count_and_nothing_is_claimed_of_a_part(cup: Cup) -> None:
    made = gripper(cup, output="ejector", grasp_time_s=0.5, release_time_s=0.2)
    assert not made.capabilities.object_detection
    for command, duration_s in ((lambda: made.grasp(ANY), 0.5), (lambda: made.release(None), 0.2)):
        command()
        cup.seconds += duration_s - 0.01
        assert made.state().moving
        cup.seconds += 0.02
        assert made.state() == GripperState(None, None, moving=False)


def test_analog_outputs_have_their_values(cup: Cup) -> None:
    made = gripper(cup, output="ejector", on_value=8.5, off_value=1.5, blow_output="blow", blow_value=4.0)
    made.grasp(ANY)
    assert cup.values == {"ejector": 8.5, "blow": 0.0, "kPa": 0.0}
    made.release(None)
    assert cup.values == {"ejector": 1.5, "blow": 4.0, "kPa": 0.0}


def test_a_stop_keeps_the_vacuum_and_ends_the_blow_off(cup: Cup) -> None:
    made = gripper(cup)
    made.grasp(ANY)
    seen(made, cup, 80.0)
    made.stop()
    assert seen(made, cup, 80.0) == (False, HeldObject.HELD_INSIDE)
    made.release(None)
    made.stop()
    assert (cup.values["ejector"], cup.values["blow"]) == (0.0, 0.0)
    assert seen(made, cup, 0.0) == (False, HeldObject.NONE)


def test_a_new_driver_finds_the_grip_and_ends_a_blow_off_that_the_one_before_has_begun(cup: Cup) -> None:
    first = gripper(cup)
    first.grasp(ANY)
    cup.values["kPa"] = 80.0
    before = dict(cup.values)
    again = gripper(cup)
    assert again.state().object is HeldObject.HELD_INSIDE
    assert cup.values == before
    again.release(None)
    cup.values["kPa"] = 0.0
    last = gripper(cup)
    assert cup.values["blow"] == 1.0, "to connect moves nothing"
    assert not last.state().moving
    assert cup.values["blow"] == 0.0


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_sensor_without_a_number_is_an_error_and_no_loss(cup: Cup, value: float) -> None:
    made = gripper(cup)
    made.grasp(ANY)
    seen(made, cup, 80.0)
    with pytest.raises(GripperError, match="the sensor kPa reports"):
        seen(made, cup, value)
    assert seen(made, cup, 55.0) == (False, HeldObject.HELD_INSIDE)


def test_a_width_is_rejected_because_a_cup_has_none(cup: Cup) -> None:
    with pytest.raises(GripperError, match="no width; use grasp and release"):
        gripper(cup).move(0.0, None, None)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "output"),
        ({"output": "a", "blow_output": "a"}, "the same output"),
        ({"output": "a", "on_value": 2.0, "off_value": 2.0}, "on_value and off_value are both 2"),
        ({"output": "a", "on_value": math.nan}, "finite"),
        ({"output": "a", "blow_output": "b", "blow_value": 0.0}, "blow_value is 0"),
        ({"output": "a", "threshold": 3.0}, "threshold needs sensor"),
        ({"output": "a", "blow_time_s": 1.0}, "blow_time_s needs blow_output"),
        ({"output": "a", "sensor": "s", "threshold": math.inf}, "finite"),
        ({"output": "a", "sensor": "s", "hysteresis": -1.0}, "hysteresis"),
        ({"output": "a", "grasp_time_s": 0.0}, "grasp_time_s"),
        ({"output": "a", "colour": "red"}, "colour"),
    ],
)
def test_options_that_make_no_gripper_are_rejected(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        VacuumOptions.model_validate(options)


def test_a_point_that_the_robot_does_not_have_is_named(cup: Cup) -> None:
    with pytest.raises(GripperError, match="no input or output 'pump7'"):
        gripper(cup, output="pump7")
