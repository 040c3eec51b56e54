"""Servo modes on the virtual clock: what becomes of points, and what they cannot do.

Oracle: the reference that the points are taken from; numpy's finite differences of all that was commanded,
against joint_limits.yaml; scipy's simulation of the servo law's transfer function; MuJoCo's contact force.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from rig import Rig
from scipy import linalg

from cobot.config import Settings
from cobot.ipc.layout import POINTS, ServoMode, Stream
from cobot.ipc.stream_writer import PointWriter
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.types import Array, LoopMode, Pose
from rtloop.sources.servo_law import ServoLaw, transition

JOINT_MODES = [mode for mode in ServoMode if 1 <= mode <= 5]
MODES = [mode for mode in ServoMode if mode]
FORCE_MODES = (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)
EVERY = 10
LAW = (0.1, 200.0)
Reference = Callable[[float], Array]


def begin(rig: Rig, mode: int, watchdog_s: float = 0.5, **wishes: object) -> PointWriter:
    """Open a session; what writes its points."""
    stream = Stream.CARTESIAN if mode in FORCE_MODES else Stream.JOINT_IMPEDANCE
    assert rig.stream(stream, servo_mode=mode, watchdog_s=watchdog_s, **wishes) == ""
    writer = PointWriter(rig.memory)
    writer.begin(int(rig.memory.session.data["number"]))
    return writer


def feed(
    rig: Rig,
    writer: PointWriter,
    reference: Reference,
    cycles: int,
    every: int = EVERY,
    law: tuple[float, float] = (0.0, 0.0),
    begin: int = 0,
) -> Array:
    """Send points of a reference as a client would; what was commanded, shape (cycles, dof)."""
    for cycle in range(begin, begin + cycles):
        if cycle % every == 0:
            assert writer.put(reference(cycle * 1e-3), every * 1e-3, *law)
        rig.step()
    return np.array(rig.commanded[-cycles:])


def wave(rig: Rig, size_rad: float = 0.2, rate_hz: float = 0.4) -> Reference:
    """From rest and smooth to the third derivative: some 0.3 rad/s and 0.7 rad/s² at the most."""

    def at(time_s: float) -> Array:
        ease = np.clip(0.5 * time_s, 0.0, 1.0)
        ease = ease**4 * (35.0 - 84.0 * ease + 70.0 * ease**2 - 20.0 * ease**3)
        return rig.home + ease * size_rad * 0.5 * np.sin(2.0 * np.pi * rate_hz * time_s)

    return at


def error_of(commanded: Array, reference: Reference, longest_ms: int = 400) -> tuple[float, int]:
    """The RMS error at the delay at which the commanded fits best, rad, and that delay, ms."""
    wanted = np.array([reference(cycle * 1e-3) for cycle in range(len(commanded))])
    past = longest_ms + 600
    errors = [
        float(np.sqrt(np.mean((commanded[past:] - wanted[past - lag : len(commanded) - lag]) ** 2)))
        for lag in range(longest_ms)
    ]
    lag = int(np.argmin(errors))
    return errors[lag], lag


def counts(rig: Rig) -> dict[str, int]:
    names = "point_seen", "points_taken", "points_dropped", "points_buffered", "underruns"
    state = rig.memory.state.read()
    return {name: int(state[name]) for name in names}


def require_limits(rig: Rig) -> None:
    for share in rig.rates():
        assert share.max() <= 1.011


@pytest.mark.parametrize(
    ("mode", "every", "error_rad", "lag_ms"),
    [
        (ServoMode.REPLANNED, 10, 1e-3, 20),
        (ServoMode.DIRECT, 1, 1e-3, 5),
        (ServoMode.DIRECT, 10, 2e-3, 20),
        (ServoMode.BUFFERED, 10, 1e-3, 40),
        (ServoMode.BUFFERED, 2, 1e-3, 20),
        (ServoMode.BUFFERED_1MS, 1, 1e-3, 20),
        (ServoMode.THROUGH, 10, 4e-3, 350),
        (ServoMode.THROUGH, 2, 4e-3, 350),
        (ServoMode.REPLANNED_FORCE, 10, 2e-3, 25),
        (ServoMode.THROUGH_FORCE, 10, 5e-3, 350),
    ],
)
def test_every_mode_follows_the_same_reference(
    rig: Rig, mode: ServoMode, every: int, error_rad: float, lag_ms: int
) -> None:
    reference = wave(rig)
    commanded = feed(rig, begin(rig, mode), reference, 4000, every)
    error, lag = error_of(commanded, reference)
    assert error <= error_rad
    assert lag <= lag_ms
    assert rig.mode is (LoopMode.CARTESIAN if mode in FORCE_MODES else LoopMode.JOINT_IMPEDANCE)
    assert counts(rig)["points_dropped"] == 0
    require_limits(rig)


@pytest.mark.parametrize("mode", MODES)
def test_no_points_break_a_limit(rig: Rig, mode: ServoMode) -> None:
    random = np.random.default_rng(int(mode))
    writer = begin(rig, mode, 5.0)
    target = rig.home.copy()
    for _ in range(1500):
        if random.random() < 0.1:
            step = random.normal(0.0, random.choice([1e-4, 1e-2, 0.1]), 7)
            target = np.clip(target + step, rig.limits.min_position, rig.limits.max_position)
            writer.put(target, random.choice([0.001, 0.0025, 0.02, 0.1]), *random.choice([(0, 0), LAW]))
        rig.step()
    require_limits(rig)
    rig.end_stream()
    rig.run()
    require_limits(rig)


@pytest.mark.parametrize("mode", MODES)
def test_without_points_the_watchdog_ends_the_session_at_rest(rig: Rig, mode: ServoMode) -> None:
    feed(rig, begin(rig, mode, watchdog_s=0.2), wave(rig), 700)
    assert np.abs(rig.loop.controller.safety.velocity).max() > 0.05
    rig.step(195)
    assert rig.loop.controller.streaming.session
    rig.run()
    assert (rig.mode, rig.reason) == (LoopMode.HOLD, "servo watchdog: no point for 0.2 s")
    assert rig.counted()["COMMAND_TIMEOUT"] == 1
    assert not rig.loop.controller.streaming.session
    require_limits(rig)


def test_a_session_that_never_gets_a_point_ends_too(rig: Rig) -> None:
    begin(rig, ServoMode.REPLANNED, watchdog_s=0.1)
    rig.step(110)
    rig.run()
    assert rig.reason == "servo watchdog: no point for 0.1 s"


@pytest.mark.parametrize("mode", MODES)
def test_a_stop_in_motion_ends_the_session_within_the_limits(rig: Rig, mode: ServoMode) -> None:
    feed(rig, begin(rig, mode), wave(rig), 900)
    rig.request("stops")
    rig.run()
    assert (rig.mode, rig.reason) == (LoopMode.HOLD, "stop requested")
    require_limits(rig)


@pytest.mark.parametrize("mode", JOINT_MODES)
def test_a_mode_follows_another_without_a_jump(rig: Rig, mode: ServoMode) -> None:
    for one in (ServoMode.REPLANNED, mode):
        feed(rig, begin(rig, one), lambda t, at=rig.commanded[-1:] or [rig.home]: at[0] + 0.05 * t, 800)
        rig.end_stream()
        rig.run()
    require_limits(rig)


@pytest.mark.parametrize("mode", [ServoMode.BUFFERED, ServoMode.BUFFERED_1MS])
def test_buffered_points_are_passed_through_in_their_order(rig: Rig, mode: ServoMode) -> None:
    reference = wave(rig)
    points = [reference(number * 1e-3) for number in range(500)]
    writer = begin(rig, mode, 2.0)
    for point in points:
        assert writer.put(point, 1e-3, 0.0, 0.0)
    rig.step(600)
    assert rig.counted().keys() <= {"VELOCITY", "ACCELERATION", "JERK"}  # of the sudden end
    assert counts(rig) == {
        "point_seen": 500,
        "points_taken": 500,
        "points_dropped": 0,
        "points_buffered": 0,
        "underruns": 1,  # at their end
    }
    begun = next(i for i, joints in enumerate(rig.commanded) if np.abs(joints - rig.home).max() > 0.0)
    moved = next(i for i, joints in enumerate(points) if np.abs(joints - rig.home).max() > 0.0)
    # What has not to be caught passes as it is.
    np.testing.assert_allclose(rig.commanded[begun : begun + 500 - moved], points[moved:], atol=1e-12)


def test_points_whose_time_is_no_whole_cycles_keep_their_pace(rig: Rig) -> None:
    writer = begin(rig, ServoMode.BUFFERED, 2.0)
    for number in range(400):
        assert writer.put(rig.home + 2.5e-3 * number * 0.1, 2.5e-3, 0.0, 0.0)
    rig.step(50)
    before = counts(rig)["points_taken"]
    rig.step(500)
    assert counts(rig)["points_taken"] - before == 200
    rig.step(500)
    assert counts(rig)["points_taken"] == 400


@pytest.mark.parametrize("mode", [ServoMode.BUFFERED, ServoMode.THROUGH, ServoMode.THROUGH_FORCE])
def test_an_empty_buffer_holds_the_arm_until_the_next_point(rig: Rig, mode: ServoMode) -> None:
    reference = wave(rig)
    writer = begin(rig, mode, 5.0)
    feed(rig, writer, reference, 1000)
    rig.step(1500)
    assert counts(rig)["underruns"] == 1
    held = rig.commanded[-1]
    np.testing.assert_allclose(held, reference(0.990), atol=1e-4)
    np.testing.assert_allclose(rig.commanded[-100], held, atol=1e-4)
    feed(rig, writer, reference, 1000, begin=1000)
    rig.step(1500)
    np.testing.assert_allclose(rig.commanded[-1], reference(1.990), atol=1e-4)
    assert counts(rig)["underruns"] == 2
    assert rig.loop.controller.streaming.session
    require_limits(rig)


def test_a_sender_that_jitters_by_less_than_a_period_causes_no_underrun(rig: Rig) -> None:
    random = np.random.default_rng(3)
    reference, writer, number = wave(rig), begin(rig, ServoMode.BUFFERED), 0
    due = 0.0
    for cycle in range(3000):
        while cycle >= due:
            writer.put(reference(number * 0.02), 0.02, 0.0, 0.0)
            number += 1
            due = number * 20 + random.uniform(-9, 9)
        rig.step()
    assert counts(rig)["underruns"] == 0
    assert counts(rig)["points_taken"] >= number - 3


def test_a_full_buffer_takes_no_point_and_loses_none(rig: Rig) -> None:
    writer = begin(rig, ServoMode.BUFFERED, 60.0)
    accepted = [writer.put(rig.home + 1e-5 * number, 0.01, 0.0, 0.0) for number in range(POINTS + 50)]
    assert accepted == [True] * POINTS + [False] * 50
    rig.step(200)
    assert writer.put(rig.home + 1e-5 * POINTS, 0.01, 0.0, 0.0)
    rig.step(11_000)
    assert counts(rig)["points_taken"] == POINTS + 1
    np.testing.assert_allclose(rig.commanded[-1], rig.home + 1e-5 * POINTS, atol=1e-9)


@pytest.mark.parametrize("kind", ["walk", "corners", "noise"])
def test_mode_5_goes_through_every_point_in_order_however_wild_they_are(rig: Rig, kind: str) -> None:
    random = np.random.default_rng(5)
    steps = {
        "walk": random.normal(0.0, 0.01, (60, 7)),
        "corners": np.repeat(random.uniform(-0.02, 0.02, (6, 7)), 10, axis=0),
        "noise": np.diff(random.normal(0.0, 3e-4, (61, 7)), axis=0) + 0.004,
    }[kind]
    points = rig.home + np.cumsum(steps, axis=0)
    writer = begin(rig, ServoMode.THROUGH, 60.0)
    for point in points:
        assert writer.put(point, 0.02, 0.0, 0.0)
    before = len(rig.commanded)
    while counts(rig)["points_buffered"] or counts(rig)["underruns"] == 0:
        rig.step(50)
        assert len(rig.commanded) < 60_000
    commanded = np.array(rig.commanded[before:])
    fastest = np.abs(np.diff(commanded, axis=0)).max()  # what lies between two cycles
    at = 0
    for point in points:
        near = np.abs(commanded[at:] - point).max(axis=1) <= fastest + 1e-9
        assert near.any()
        at += int(near.argmax())
    np.testing.assert_allclose(commanded[-1], points[-1], atol=1e-9)
    assert rig.counted() == {}  # nothing had to be caught
    require_limits(rig)


def test_mode_5_takes_as_long_as_the_points_say_where_the_limits_permit(rig: Rig) -> None:
    reference = wave(rig, 0.1)
    writer = begin(rig, ServoMode.THROUGH, 60.0)
    for number in range(100):
        assert writer.put(reference(number * 0.02), 0.02, 0.0, 0.0)
    rig.step(3500)
    moving = np.flatnonzero(np.abs(np.diff(np.array(rig.commanded), axis=0)).max(axis=1) > 1e-9)
    assert 1900 <= moving[-1] - moving[0] <= 2400


@pytest.mark.parametrize("mode", [ServoMode.DIRECT, ServoMode.BUFFERED, ServoMode.BUFFERED_1MS])
def test_a_jump_in_a_pass_through_mode_is_dropped_and_counted(rig: Rig, mode: ServoMode) -> None:
    reference = wave(rig)
    writer = begin(rig, mode, 5.0)
    feed(rig, writer, reference, 800)
    outlier = reference(0.8)
    outlier[2] += 0.5
    assert writer.put(outlier, 0.01, 0.0, 0.0)
    rig.step(10)
    feed(rig, writer, reference, 800, begin=810)
    rig.step(1000)
    assert counts(rig)["points_dropped"] == 1
    assert rig.counted()["JUMP"] == 1
    np.testing.assert_allclose(rig.commanded[-1], reference(1.600), atol=1e-6)
    require_limits(rig)


@pytest.mark.parametrize("mode", [ServoMode.BUFFERED, ServoMode.BUFFERED_1MS])
def test_a_slow_stream_is_no_series_of_jumps_and_goes_on_after_one(rig: Rig, mode: ServoMode) -> None:
    """50 Hz, as in the manual's examples of mode 4: the steps are large for a millisecond, not for 20."""
    writer = begin(rig, mode, 5.0)
    target = rig.home.copy()
    for number in range(60):
        target[6] += 0.025
        outlier = target + (0.5 if number == 20 else 0.0)
        assert writer.put(outlier, 0.02, 0.0, 0.0)
        rig.step(20)
    rig.step(1000)
    assert counts(rig)["points_dropped"] == 1
    np.testing.assert_allclose(rig.commanded[-1], target, atol=1e-6)
    require_limits(rig)


def test_mode_1_goes_to_a_single_point_far_away_at_the_limits_and_without_overshoot(rig: Rig) -> None:
    writer = begin(rig, ServoMode.REPLANNED, 10.0)
    assert writer.put(rig.home + 0.3, 0.02, 0.0, 0.0)
    rig.step(2500)
    joints = np.array(rig.commanded)
    assert (joints <= rig.home + 0.3 + 1e-9).all()
    np.testing.assert_allclose(joints[-1], rig.home + 0.3, atol=1e-9)
    require_limits(rig)


@pytest.mark.parametrize("poison", [np.nan, np.inf])
@pytest.mark.parametrize("field", ["joints", "time_s", "lookahead_s", "gain"])
@pytest.mark.parametrize("mode", [ServoMode.REPLANNED, ServoMode.BUFFERED, ServoMode.THROUGH])
def test_a_point_that_is_no_number_latches_an_estop(
    rig: Rig, mode: ServoMode, field: str, poison: float
) -> None:
    writer = begin(rig, mode)
    feed(rig, writer, wave(rig), 700)
    values: dict[str, object] = {"joints": rig.home, "time_s": 0.01, "lookahead_s": 0.0, "gain": 0.0}
    values[field] = np.full(7, poison) if field == "joints" else poison
    assert writer.put(**values)  # type: ignore[arg-type]
    for _ in range(30):
        writer.put(rig.home, 0.01, 0.0, 0.0)
    rig.step(100)
    rig.run()
    assert rig.mode is LoopMode.ESTOP
    assert "not finite" in rig.reason
    require_limits(rig)


def test_points_that_a_wild_writer_spoils_are_given_up_and_counted(rig: Rig) -> None:
    writer = begin(rig, ServoMode.BUFFERED, 10.0)
    for number in range(20):
        assert writer.put(rig.home, 0.01, 0.0, 0.0)
        if number == 5:
            rig.memory.points[writer.number % POINTS]._shared[:] = b"\xff" * len(rig.memory.points[0]._shared)
    rig.step(1000)
    assert counts(rig)["points_taken"] == 19
    assert counts(rig)["points_dropped"] == 1


def test_points_of_an_older_session_are_not_followed(rig: Rig) -> None:
    old = begin(rig, ServoMode.BUFFERED)
    for _ in range(100):
        assert old.put(rig.home + 0.01, 0.01, 0.0, 0.0)
    rig.end_stream()
    rig.run()
    at = rig.commanded[-1]
    begin(rig, ServoMode.BUFFERED)
    rig.step(300)
    np.testing.assert_array_equal(rig.commanded[-1], at)
    assert counts(rig)["points_taken"] == 0


@pytest.mark.parametrize(
    ("wishes", "why"),
    [
        ({"servo_mode": 8}, "there is no servo mode 8"),
        ({"servo_mode": 6}, "there is no servo mode 6"),
        ({"servo_mode": 1, "stream": Stream.CARTESIAN}, "there is no servo mode 1"),
        ({"servo_mode": 1, "watchdog_s": 0.0}, "watchdog_s must be above 0"),
        ({"servo_mode": 1, "watchdog_s": np.nan}, "watchdog_s must be above 0"),
        ({"servo_mode": 1, "watchdog_s": 1e6}, "watchdog_s must be above 0"),
    ],
)
def test_a_session_that_makes_no_sense_is_refused(rig: Rig, wishes: dict[str, object], why: str) -> None:
    wishes = {"watchdog_s": 0.5, "stream": Stream.JOINT_IMPEDANCE} | wishes
    stream = Stream(int(wishes.pop("stream")))  # type: ignore[call-overload]
    assert why in rig.stream(stream, **wishes)


def test_points_that_lead_into_the_floor_end_the_session_before_it(
    settings: Settings, robot: RobotDescription
) -> None:
    home = np.array(robot.positions["home"].joints)
    pose = robot.model.forward(home)
    start = inverse(robot.model, Pose(np.array([0.5, 0.0, 0.25]), pose.quaternion), home)
    end = inverse(robot.model, Pose(np.array([0.5, 0.0, 0.0]), pose.quaternion), start)
    rig = Rig(settings, robot, start=start)
    writer = begin(rig, ServoMode.BUFFERED)
    feed(rig, writer, lambda t: start + min(t / 3.0, 1.0) * (end - start), 2990)
    rig.run()
    assert (rig.mode, rig.counted()["COLLISION"]) == (LoopMode.HOLD, 1)
    what, _, names = rig.reason.partition(": ")
    assert what == "the points lead the arm into itself or its surroundings"
    assert "floor" in names
    assert robot.model.forward(rig.commanded[-1]).position[2] > 0.0
    require_limits(rig)
    rig.close()


@pytest.mark.parametrize(("lookahead_s", "gain"), [(0.1, 200.0), (0.03, 100.0), (0.2, 2000.0), (0.1, 400.0)])
def test_the_law_is_that_of_its_transfer_function(lookahead_s: float, gain: float) -> None:
    time_s = np.arange(3000) * 1e-3
    target = np.where(time_s > 0.5, 0.1, 0.0) + 0.2 * np.clip(time_s - 1.5, 0.0, None)
    law, positions = ServoLaw(1, 1e-3), []
    law.begin(np.zeros((3, 1)))
    law.tune(lookahead_s, gain)
    for value in target:
        law.follow(np.array([[value], [0.0], [0.0]]))
        positions.append(law.reference[0, 0])
    from scipy import signal  # takes half a second, in which whoever collects the tests would wait

    system = signal.cont2discrete(signal.tf2ss([gain], [1.0, gain * lookahead_s, gain]), 1e-3, method="zoh")
    _, wanted, _ = signal.dlsim(system, np.append(target, target[-1]))
    np.testing.assert_allclose(positions, wanted[1:, 0], atol=1e-9)
    if lookahead_s * lookahead_s * gain > 1.0:  # the others still swing
        assert target[-1] - positions[-1] == pytest.approx(0.2 * lookahead_s, abs=2e-4)  # behind a ramp


def test_the_laws_step_is_the_exponential_of_its_matrix() -> None:
    for lookahead_s, gain in ((0.1, 200.0), (0.2, 100.0), (0.2, 2000.0), (0.1, 400.0)):
        matrix = np.array([[0.0, 1.0], [-gain, -gain * lookahead_s]])
        np.testing.assert_allclose(transition(lookahead_s, gain, 0.01), linalg.expm(0.01 * matrix), rtol=1e-9)


@pytest.mark.parametrize("mode", [ServoMode.DIRECT, ServoMode.BUFFERED, ServoMode.BUFFERED_1MS])
def test_the_pass_through_modes_follow_a_ramp_with_a_lag_of_the_lookahead_time(
    rig: Rig, mode: ServoMode
) -> None:
    writer = begin(rig, mode)
    every = 1 if mode is ServoMode.BUFFERED_1MS else 5
    feed(rig, writer, lambda t: rig.home + 0.2 * max(t - 0.1, 0.0), 2000, every, LAW)
    lag_s = (rig.home[0] + 0.2 * 1.9 - rig.commanded[-1][0]) / 0.2
    assert lag_s == pytest.approx(LAW[0] + 0.01, abs=0.015)


@pytest.mark.parametrize("mode", [ServoMode.REPLANNED, ServoMode.THROUGH])
def test_the_planned_modes_take_no_notice_of_the_law(
    settings: Settings, robot: RobotDescription, mode: ServoMode
) -> None:
    runs = []
    for law in ((0.0, 0.0), LAW):
        rig = Rig(settings, robot)
        runs.append(feed(rig, begin(rig, mode), wave(rig), 600, law=law))
        rig.close()
    np.testing.assert_array_equal(*runs)


@pytest.fixture
def above_floor(settings: Settings, robot: RobotDescription) -> Iterator[Rig]:
    """The tool points down, a little above the floor, in the simulation."""
    home = np.array(robot.positions["home"].joints)
    pose = Pose(np.array([0.5, 0.0, 0.05]), robot.model.forward(home).quaternion)
    made = Rig(settings, robot, simulated=True, start=inverse(robot.model, pose, home))
    made.step(50)
    yield made
    made.close()


@pytest.mark.parametrize("mode", FORCE_MODES)
def test_force_control_presses_while_points_move_the_tool_along(above_floor: Rig, mode: ServoMode) -> None:
    rig = above_floor
    axes = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    writer = begin(rig, mode, force_axes=axes, force_velocity=np.array([0.05] * 3 + [0.5] * 3))
    rig.aim(wrench=np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0]))
    start, forces = rig.commanded[-1].copy(), []
    orientation = rig.robot.model.forward(start).quaternion
    goal = rig.robot.model.forward(start).position + np.array([0.0, 0.08, 0.0])
    aside = inverse(rig.robot.model, Pose(goal, orientation), start)
    for cycle in range(7000):
        if cycle % EVERY == 0:
            share = np.clip((cycle - 3500) / 2000.0, 0.0, 1.0)
            share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            assert writer.put(start + share * (aside - start), 0.01, 0.0, 0.0)
        rig.step()
        forces.append(rig.floor_force())
    assert np.mean(forces[-500:]) == pytest.approx(10.0, abs=0.5)
    assert np.mean(forces[3500:5500]) == pytest.approx(10.0, abs=2.0)  # while it slips along, too
    measured = rig.robot.model.forward(rig.loop._measured.position).position
    assert measured[1] == pytest.approx(goal[1], abs=2e-3)
    require_limits(rig)


def test_without_force_axes_mode_6_moves_the_arm_as_mode_1_does(
    settings: Settings, robot: RobotDescription
) -> None:
    runs = []
    for mode in (ServoMode.REPLANNED, ServoMode.REPLANNED_FORCE):
        rig = Rig(settings, robot)
        runs.append(feed(rig, begin(rig, mode), wave(rig), 2500))
        rig.close()
    np.testing.assert_allclose(*runs, atol=3e-3)


def test_the_queue_holds_what_mode_5_cannot_take_yet(rig: Rig) -> None:
    writer = begin(rig, ServoMode.THROUGH, 60.0)
    reference = wave(rig)
    for number in range(POINTS):
        assert writer.put(reference(number * 0.002), 0.002, 0.0, 0.0)
    rig.step(3)
    assert counts(rig)["points_buffered"] >= POINTS - 10
    rig.step(3500)
    assert counts(rig)["points_buffered"] == 0
    np.testing.assert_allclose(rig.commanded[-1], reference((POINTS - 1) * 0.002), atol=1e-9)


@pytest.mark.parametrize("mode", [ServoMode.BUFFERED, ServoMode.THROUGH, ServoMode.THROUGH_FORCE])
def test_a_session_that_is_to_finish_goes_on_to_its_last_point(rig: Rig, mode: ServoMode) -> None:
    reference = wave(rig)
    writer = begin(rig, mode, watchdog_s=0.2)
    for number in range(50):
        assert writer.put(reference(number * 0.01), 0.01, 0.0, 0.0)
    rig.step(5)
    rig.memory.session.data["open"] = 2
    rig.memory.session.publish()
    rig.step(1005)
    rig.run()
    assert (rig.mode, rig.reason) == (LoopMode.HOLD, "the client has ended the session")
    np.testing.assert_allclose(rig.commanded[-1], reference(0.49), atol=5e-3)
    require_limits(rig)


@pytest.mark.parametrize("mode", [ServoMode.BUFFERED, ServoMode.THROUGH, ServoMode.REPLANNED_FORCE])
def test_a_service_that_hangs_moves_the_arm_no_further_than_its_heartbeat(rig: Rig, mode: ServoMode) -> None:
    reference = wave(rig)
    writer = begin(rig, mode, watchdog_s=60.0)
    for number in range(1000):
        assert writer.put(reference(number * 0.01), 0.01, 0.0, 0.0)
    rig.step(500)
    assert rig.loop.controller.streaming.session
    rig.beat(ahead_s=-0.1 - rig.settings.rt.service_timeout_s)
    rig.run(1000)
    assert (rig.mode, rig.counted()["SERVICE_TIMEOUT"]) == (LoopMode.HOLD, 1)
    assert "the service has been silent for" in rig.reason
    require_limits(rig)


def test_a_session_that_is_to_finish_does_so_within_a_second(rig: Rig) -> None:
    writer = begin(rig, ServoMode.BUFFERED)
    for number in range(1000):
        assert writer.put(rig.home + 1e-4 * number, 0.01, 0.0, 0.0)
    rig.step(5)
    rig.memory.session.data["open"] = 2
    rig.memory.session.publish()
    rig.step(1005)
    rig.run(300)
    assert rig.mode is LoopMode.HOLD
    np.testing.assert_allclose(rig.commanded[-1], rig.home + 0.01, atol=2e-3)
