"""The Franka Hand through pylibfranka. Oracle: the hand server of franky-sim, which others have written.

It never answers a command that was stopped, and it holds thin air. Its time is the computer's, so nothing
here depends on how long something takes.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
from cobot_run import WAIT_S
from franky_run import FrankySimulator

from cobot.grippers import Grasp, GripperError, GripperState, HeldObject
from cobot.grippers.franka.driver import FrankaHand, FrankaHandOptions
from cobot.grippers.franka.link import CallResult, HandReading
from cobot.grippers.franka.rig import FrankaHandRig


class NoPort:
    """The driver needs no input or output of the robot."""

    def read(self, name: str) -> float:
        raise GripperError(name)

    def set(self, name: str, value: float) -> None:
        raise GripperError(name)


@pytest.fixture(scope="module")
def simulator() -> Iterator[FrankySimulator]:
    pytest.importorskip("pylibfranka")
    pytest.importorskip("franky_sim")
    with FrankySimulator() as made:
        yield made


@pytest.fixture
def hand(simulator: FrankySimulator) -> Iterator[FrankaHand]:
    made = FrankaHand(FrankaHandOptions(address=simulator.address), NoPort())
    try:
        made.connect()
        yield made
    finally:
        made.disconnect()


def until(hand: FrankaHand, condition: Callable[[GripperState], object]) -> GripperState:
    """The state when the condition first holds."""
    end_s = time.monotonic() + WAIT_S
    while not condition(state := hand.state()):
        assert time.monotonic() < end_s, state
        time.sleep(0.005)
    return state


def still(hand: FrankaHand) -> GripperState:
    return until(hand, lambda state: not state.moving)


def test_it_homes_moves_grasps_and_releases(hand: FrankaHand) -> None:
    hand.home()
    assert hand.state().moving
    assert still(hand).fault == ""
    hand.move(0.02, 0.1, None)
    state = still(hand)
    assert (state.width, state.commanded_width) == (pytest.approx(0.02, abs=0.003), 0.02)
    hand.grasp(Grasp(0.03, 0.005, 0.005, force=20.0))
    state = still(hand)
    assert (state.object, state.force, state.temperature) == (HeldObject.HELD_INSIDE, 20.0, 20)
    hand.stop()
    assert hand.state().object is HeldObject.HELD_INSIDE, "a stop keeps the grip"
    hand.release(None)
    state = still(hand)
    assert (state.object, state.width) == (HeldObject.NONE, pytest.approx(0.08, abs=0.003))


def test_a_new_command_replaces_the_one_that_blocks(hand: FrankaHand) -> None:
    """Its library call has not returned yet, and with this server never does."""
    hand.move(0.08, 0.1, None)
    still(hand)
    hand.move(0.0, 0.005, None)
    hand.move(0.07, 0.1, None)
    assert still(hand).width == pytest.approx(0.07, abs=0.003)


def test_a_stop_stops_a_command_that_blocks(hand: FrankaHand) -> None:
    hand.move(0.08, 0.1, None)
    still(hand)
    hand.move(0.0, 0.005, None)
    state = hand.state()
    assert (state.moving, "width" in state.ages_s) == (True, True)
    hand.stop()
    state = hand.state()
    assert not state.moving
    assert state.width is not None
    assert state.width > 0.01


def test_a_process_that_is_killed_is_an_error_and_a_new_connection_mends_it(hand: FrankaHand) -> None:
    hand._link._connected._process.kill()  # type: ignore[attr-defined, union-attr]
    hand._link._connected._process.wait()  # type: ignore[attr-defined, union-attr]
    with pytest.raises(GripperError, match="cannot be reached: the process of this connection has ended"):
        hand.state()
    hand.disconnect()
    hand.connect()
    assert hand.state().width is not None


def test_without_a_hand_at_the_address_it_says_so() -> None:
    pytest.importorskip("pylibfranka")
    hand = FrankaHand(FrankaHandOptions(address="127.0.0.99"), NoPort())
    with pytest.raises(GripperError, match=r"127\.0\.0\.99: the hand cannot be reached: .*check the network"):
        hand.connect()
    hand.disconnect()


class Rejecting(FrankaHandRig):
    """Rejects what is asked for."""

    def begin(self, call: str, *arguments: float) -> None:
        self._result = CallResult(good=False, failure="command rejected: it is not homed")


def test_what_the_hand_rejects_is_a_fault_until_the_next_command() -> None:
    options = FrankaHandOptions(address="x")
    rig = Rejecting(options)
    hand = rig.gripper(NoPort())
    hand.connect()
    hand.move(0.02, None, None)
    assert hand.state().fault == "the hand has not executed move: command rejected: it is not homed"
    hand.grasp(Grasp(None, 0.0, 0.0))
    assert (hand.state().fault, hand.state().object) == ("", HeldObject.NONE)


def test_closed_fingers_hold_nothing_whatever_the_hand_says() -> None:
    """A grasp of any width succeeds on nothing."""

    class Boasting(FrankaHandRig):
        def read(self) -> HandReading:
            return HandReading(0.0, 0.08, True, 20.0)

    hand = Boasting(FrankaHandOptions(address="x")).gripper(NoPort())
    assert hand.state().object is HeldObject.NONE


@pytest.mark.parametrize(
    ("options", "words"),
    [({}, "address"), ({"address": "x", "default_speed": 0.5}, "0.1"), ({"address": "x", "port": 1}, "port")],
)
def test_options_that_make_no_hand_are_rejected(options: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        FrankaHandOptions.model_validate(options)
