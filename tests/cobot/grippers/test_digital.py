"""Grippers at outputs of the robot. Oracle: a valve that does what its two outputs say, in a given time."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from cobot.grippers import GripperError, HeldObject
from cobot.grippers.digital import DigitalGripper, DigitalOptions
from cobot.grippers.protocol import Grasp

TWO = {"close_output": "close", "open_output": "open", "closed_input": "shut", "opened_input": "apart"}


class Time:
    """A clock that tests move."""

    def __init__(self) -> None:
        self.seconds = 100.0

    def now_s(self) -> float:
        return self.seconds


class Valve:
    """Fingers that take 0.3 s, with a part between them or none, as a port of the robot."""

    def __init__(self, time: Time) -> None:
        self.values = {"close": 0.0, "open": 0.0, "shut": 0.0, "apart": 1.0}
        self.part = False
        self.jammed = False
        self._time = time
        self._since_s = 0.0

    def read(self, name: str) -> float:
        if name not in self.values:
            raise GripperError(f"there is no input or output {name}")
        arrived = self._time.now_s() - self._since_s >= 0.3
        if name == "shut":
            return float(self.values["close"] and arrived and not self.part)
        if name == "apart":
            return float(not self.values["close"] and arrived and not self.jammed)
        return self.values[name]

    def set(self, name: str, value: float) -> None:
        assert not (name == "close" and value and self.values["open"]), "both coils are on"
        self.values[name] = value
        self._since_s = self._time.now_s()


@pytest.fixture
def time() -> Time:
    return Time()


@pytest.fixture
def valve(time: Time) -> Valve:
    return Valve(time)


def gripper(valve: Valve, time: Time, **options: object) -> DigitalGripper:
    made = DigitalGripper(DigitalOptions.model_validate(options or TWO), valve, time)  # type: ignore[arg-type]
    made.connect()
    return made


ANY = Grasp(None, 0.0, 0.0)


def test_a_grasp_of_a_part_holds_it_and_of_nothing_holds_none(valve: Valve, time: Time) -> None:
    fingers = gripper(valve, time)
    valve.part = True
    fingers.grasp(ANY)
    assert fingers.state().moving
    time.seconds += 0.31
    assert (fingers.state().moving, fingers.state().object) == (False, HeldObject.HELD_INSIDE)
    valve.part = False
    assert fingers.state().object is HeldObject.NONE
    fingers.release(None)
    time.seconds += 0.31
    assert (fingers.state().moving, fingers.state().width) == (False, 0.05)


def test_one_output_without_inputs_goes_by_the_time_and_does_not_claim_to_see_objects(
    valve: Valve, time: Time
) -> None:
    fingers = gripper(valve, time, close_output="close", close_time_s=0.5)
    assert not fingers.capabilities.object_detection
    fingers.close()
    time.seconds += 0.49
    assert fingers.state().moving
    time.seconds += 0.02
    state = fingers.state()
    assert (state.moving, state.object, state.width, state.commanded_width) == (False, None, None, 0.0)


def test_fingers_that_do_not_open_are_a_fault_that_names_the_input(valve: Valve, time: Time) -> None:
    fingers = gripper(valve, time)
    valve.jammed = True
    fingers.open()
    time.seconds += 0.8
    assert fingers.state().moving
    time.seconds += 0.2
    state = fingers.state()
    assert not state.moving
    assert "have not opened within 0.9 s: apart is off" in state.fault


def test_a_new_driver_finds_the_grip_of_the_one_before(valve: Valve, time: Time) -> None:
    valve.part = True
    gripper(valve, time).close()
    time.seconds += 5.0
    before = dict(valve.values)
    again = gripper(valve, time)
    assert again.state().object is HeldObject.HELD_INSIDE
    assert valve.values == before


def test_a_stop_on_the_way_switches_both_coils_off_and_a_grip_stays(valve: Valve, time: Time) -> None:
    fingers = gripper(valve, time)
    fingers.close()
    fingers.stop()
    assert (valve.values["close"], valve.values["open"]) == (0.0, 0.0)
    assert not fingers.state().moving
    fingers.close()
    time.seconds += 1.0
    fingers.stop()
    assert valve.values["close"] == 1.0


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "close_output or open_output is needed"),
        ({"close_output": "a", "open_output": "a"}, "the same output"),
        ({"close_output": "a", "open_width": 0.01, "closed_width": 0.02}, "must be below open_width"),
        ({"close_output": "a", "colour": "red"}, "colour"),
        ({"close_output": "a", "close_time_s": -1.0}, "close_time_s"),
    ],
)
def test_options_that_make_no_gripper_are_rejected(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        DigitalOptions.model_validate(options)


def test_an_output_that_the_robot_does_not_have_is_named(valve: Valve, time: Time) -> None:
    with pytest.raises(GripperError, match="no input or output valve7"):
        gripper(valve, time, close_output="valve7")
