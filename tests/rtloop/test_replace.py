"""A motion under way goes on with another trajectory, in the real cycle, stepped in robot time.

Oracle: the same motion without a replacement, bit by bit; numpy's samples of the trajectories.
"""

from __future__ import annotations

import numpy as np
import pytest
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import Command, MotionResult
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import LoopMode, PlannerName, Scaling

MOVE = np.array([0.6, 0.2, -0.3, 0.4, 0.2, -0.3, 0.5])
OTHER = 1
"""The slot for what replaces."""


def motion(rig: Rig) -> Trajectory:
    here = rig.loop.controller.safety.position.copy()
    request = MotionRequest(here, here + MOVE, PlannerName.PTP, Scaling(0.5))
    return plan_ptp(rig.robot, request, here + MOVE)


def in_pieces(whole: Trajectory, pieces: int) -> Trajectory:
    times = np.linspace(0.0, whole.duration_s, pieces + 1)
    return from_hermite(times, *(whole.sample(times, order) for order in range(3)))


def within_limits(rig: Rig) -> None:
    for rate in rig.rates():
        assert rate.max() <= 1.005


def from_breakpoint(whole: Trajectory, index: int) -> tuple[Trajectory, float]:
    """What begins at a breakpoint of a motion, and when that is."""
    offset_s = float(whole.breakpoints_s[index])
    return Trajectory(whole.breakpoints_s[index:] - offset_s, whole.coefficients[index:]), offset_s


def with_more(rig: Rig, whole: Trajectory, by: np.ndarray = MOVE) -> Trajectory:
    """A motion, and after it another one."""
    goal = whole.end + by
    request = MotionRequest(whole.end, goal, PlannerName.PTP, Scaling(0.5))
    return whole.followed_by(plan_ptp(rig.robot, request, goal))


def deviating(whole: Trajectory, from_index: int) -> Trajectory:
    """The same until a breakpoint, a little beside it from there on, smoothly."""
    times = whole.breakpoints_s
    width_s = times[-1] - times[from_index]
    bump = np.polynomial.Polynomial([0.0, 0.0, 0.0, 0.064, -0.192, 0.192, -0.064])
    share = np.clip((times - times[from_index]) / width_s, 0.0, 1.0)
    rows = [
        whole.sample(times, order) + (bump.deriv(order)(share) / width_s**order)[:, None]
        for order in range(3)
    ]
    changed = from_hermite(times, *rows)
    kept = whole.coefficients[:from_index]
    return Trajectory(times, np.concatenate([kept, changed.coefficients[from_index:]]))


def begun(rig: Rig, cycles: int = 400, pieces: int = 300) -> Trajectory:
    whole = in_pieces(motion(rig), pieces)
    assert rig.start(whole) == ""
    rig.step(cycles)
    return whole


def replace(rig: Rig, trajectory: Trajectory, offset_s: float = 0.0, **fields: float) -> str:
    motion_id = int(fields.pop("motion_id", rig.loop.controller.motion_id))
    rig.memory.slots[OTHER].write(motion_id, trajectory)
    fields = {"slot": OTHER, "motion_id": motion_id, "value": offset_s, **fields}
    return rig.answer(rig.send(Command.REPLACE, **fields))


def test_the_arm_goes_on_with_what_replaces_its_motion_bit_for_bit(
    settings: Settings, robot: RobotDescription
) -> None:
    plain, replaced = Rig(settings, robot), Rig(settings, robot)
    try:
        whole = begun(plain, 200)
        begun(replaced, 200)
        longer = with_more(replaced, whole)
        assert replace(replaced, longer) == ""
        assert replaced.loop.controller.slot == OTHER
        for rig in (plain, replaced):
            rig.run()
            assert rig.result is MotionResult.ARRIVED
        end = int(whole.duration_s / settings.rt.period_s) - 1
        np.testing.assert_array_equal(plain.commanded[:end], replaced.commanded[:end])
        np.testing.assert_allclose(replaced.commanded[-1], longer.end, atol=1e-12)
        assert replaced.loop.controller.motion_id == 1
        within_limits(replaced)
    finally:
        plain.close()
        replaced.close()


@pytest.mark.parametrize("rate", [1.0, 0.3, 0.0])
def test_what_is_passed_is_left_out_at_any_rate(rig: Rig, rate: float) -> None:
    whole = begun(rig, 300)
    assert rig.answer(rig.send(Command.SET_RATE, value=rate)) == ""
    rig.step(600)
    here_s = rig.loop.controller.clock.path_time_s
    index = int(np.searchsorted(whole.breakpoints_s, here_s, side="right")) - 3
    rest, offset_s = from_breakpoint(with_more(rig, whole), index)
    before = rig.commanded[-1]
    assert replace(rig, rest, offset_s) == ""
    state = rig.memory.state.read()
    assert state["path_duration_s"] == rest.duration_s
    assert 0.0 < state["path_time_s"] < 0.5
    assert np.abs(rig.commanded[-1] - before).max() < 5e-3
    assert rig.answer(rig.send(Command.SET_RATE, value=1.0)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    np.testing.assert_allclose(rig.commanded[-1], rest.end, atol=1e-12)
    assert np.diff(rig.path_times).min() > -offset_s - 1e-9
    within_limits(rig)


def test_one_that_differs_where_the_arm_is_is_refused_and_the_motion_goes_on(rig: Rig) -> None:
    whole = begun(rig, 500)
    here = int(np.searchsorted(whole.breakpoints_s, rig.loop.controller.clock.path_time_s)) - 1
    refusal = replace(rig, deviating(whole, here - 5))
    assert refusal.startswith("it differs from the current motion, which is already at 0.5")
    assert rig.loop.controller.slot == 0
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    np.testing.assert_allclose(rig.commanded[-1], whole.end, atol=1e-12)
    within_limits(rig)


def test_a_replacement_of_the_usual_length_is_loaded_within_three_cycles(rig: Rig) -> None:
    """A way around an object has 350 to 520 segments. The oracle is the count of cycles."""
    whole = begun(rig, 400, 500)
    before = len(rig.commanded)
    assert replace(rig, with_more(rig, whole)) == ""
    assert len(rig.commanded) - before <= 3 + 1, "and one that takes the command"
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    within_limits(rig)


def test_one_that_differs_ahead_is_taken(rig: Rig) -> None:
    whole = begun(rig, 300)
    ahead = int(np.searchsorted(whole.breakpoints_s, 0.6))
    changed = deviating(whole, ahead)
    assert replace(rig, changed) == ""
    rig.run()
    begin = np.array(rig.path_times)
    moving = np.flatnonzero((begin > 0.0) & (begin < whole.duration_s))
    np.testing.assert_allclose(
        np.array(rig.commanded)[moving], changed.sample(begin[moving]), atol=1e-12, rtol=0.0
    )


def test_while_the_rate_changes_nothing_may_differ_that_this_relies_on(rig: Rig) -> None:
    whole = begun(rig, 400)
    assert rig.answer(rig.send(Command.SET_RATE, value=0.2)) == ""
    rig.step(20)
    clock = rig.loop.controller.clock
    assert clock.slowing
    assert clock.committed_s > clock.path_time_s
    ahead = int(np.searchsorted(whole.breakpoints_s, clock.path_time_s + 0.02))
    assert whole.breakpoints_s[ahead] < clock.committed_s
    assert "it differs" in replace(rig, deviating(whole, ahead))
    beyond = int(np.searchsorted(whole.breakpoints_s, clock.committed_s + 0.05))
    assert replace(rig, deviating(whole, beyond)) == ""
    rig.step(300)
    rig.request("stops")
    rig.run()
    within_limits(rig)


@pytest.mark.parametrize(
    ("fields", "refusal"),
    [
        ({"motion_id": 7}, "motion 1 is running, not 7"),
        ({"slot": 2}, "there is no slot 2"),
        ({"tool": 3}, "the motion was planned with version 3 of the tool, the arm has version 0"),
        ({"value": 5.0}, "it would begin at 5.0 s of a motion that is at 0.40"),
        ({"value": -1.0}, "it would begin at -1.0 s of a motion"),
        ({"value": float("nan")}, "it would begin at nan s of a motion"),
        ({"stops": 9}, "a stop has been requested in the meantime"),
    ],
)
def test_what_does_not_fit_is_refused_and_the_motion_goes_on(
    rig: Rig, fields: dict[str, float], refusal: str
) -> None:
    whole = begun(rig)
    motion_id = int(fields.get("motion_id", 1))
    rig.memory.slots[OTHER].write(motion_id, with_more(rig, whole))
    sent = {"slot": OTHER, "motion_id": 1, "value": 0.0, **fields}
    assert rig.answer(rig.send(Command.REPLACE, **sent)).startswith(refusal)
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    np.testing.assert_allclose(rig.commanded[-1], whole.end, atol=1e-12)


def test_one_that_does_not_end_at_rest_is_refused(rig: Rig) -> None:
    whole = begun(rig)
    cut = Trajectory(whole.breakpoints_s[:-20], whole.coefficients[:-20])
    assert replace(rig, cut) == "the trajectory is not at rest at its end"


def test_without_a_motion_there_is_nothing_to_replace(rig: Rig) -> None:
    whole = in_pieces(motion(rig), 10)
    assert replace(rig, whole) == "no motion is following a path, the arm is in mode HOLD"
    assert rig.start(whole) == ""
    rig.request("stops")
    rig.step(30)
    assert rig.mode is LoopMode.STOPPING
    assert "the arm is in mode STOPPING" in replace(rig, with_more(rig, whole))


def long_one(rig: Rig, whole: Trajectory) -> Trajectory:
    """It takes rtloop some twenty cycles to load it."""
    longer = with_more(rig, whole)
    times = np.linspace(*longer.breakpoints_s[-2:], 1501)
    tail = from_hermite(times - times[0], *(longer.sample(times, order) for order in range(3)))
    return Trajectory(
        np.concatenate([longer.breakpoints_s[:-1], times[1:]]),
        np.concatenate([longer.coefficients[:-1], tail.coefficients]),
    )


def test_one_that_comes_too_late_is_refused(rig: Rig) -> None:
    whole = begun(rig, 100)
    while rig.loop.controller.clock.path_time_s < whole.duration_s - 0.008:
        rig.step()
    assert replace(rig, long_one(rig, whole)) == "the motion has already ended"
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    np.testing.assert_allclose(rig.commanded[-1], whole.end, atol=1e-12)


def test_a_stop_while_one_is_loaded_stops_on_the_path(rig: Rig) -> None:
    whole = begun(rig, 300)
    rig.memory.slots[OTHER].write(1, long_one(rig, whole))
    command = rig.send(Command.REPLACE, slot=OTHER, motion_id=1, value=0.0)
    rig.step(4)
    rig.request("stops")
    assert rig.answer(command) == "stop requested"
    rig.run()
    assert rig.result is MotionResult.STOPPED
    on_path = whole.sample([rig.path_times[-1]])[0]
    np.testing.assert_allclose(rig.commanded[-1], on_path, atol=1e-12)
    within_limits(rig)
