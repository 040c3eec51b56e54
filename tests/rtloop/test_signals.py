"""Actions and conditions of a planned motion in the cycle.

The oracle of the cycle in which an action fires is the command itself: numpy finds how far along the planned
trajectory the arm was commanded in each cycle, without asking the path clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from rig import Rig
from scipy.optimize import brentq
from shortest_stop import rest_on_path
from thorough import few
from wired_arm import WiredArm

from benchmarks.handling.contact import approach
from cobot.config import Settings
from cobot.ipc.layout import Command, Firing, MotionResult, Waiting
from cobot.ipc.signal_record import SignalReport, signal_report
from cobot.motions.requests import MotionRequest, TcpSpeed
from cobot.motions.signal_places import TcpWay, place_signals, resting
from cobot.motions.signals import (
    FALSE,
    TRUE,
    Action,
    Condition,
    PathPlace,
    PathSignals,
    Placed,
    PlacedAction,
    Quantity,
    Until,
)
from cobot.planners import plan
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.trajectory_parts import remainder_at
from cobot.types import Array, LoopMode, PlannerName, Pose, Scaling

NOWHERE = PathPlace("time_s", 0.0)


@pytest.fixture
def arm(robot: RobotDescription) -> WiredArm:
    return WiredArm(robot.limits.dof)


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription, arm: WiredArm) -> Iterator[Rig]:
    made = Rig(settings, robot, backend=arm)
    yield made
    made.close()


@pytest.fixture
def motion(robot: RobotDescription) -> Trajectory:
    return planned(robot, np.array(robot.positions["home"].joints), 0.6)


def planned(robot: RobotDescription, start: Array, by_rad: float, speed: float = 0.5) -> Trajectory:
    goal = start + by_rad * np.array([1.0, 0.3, 0.0, 0.2, 0.0, 0.5, 1.0])
    found = plan(robot, MotionRequest(start, goal, PlannerName.PTP, Scaling(speed)))
    assert found is not None
    return found


def setting(number: int, path_time_s: float, value: float = 1.0, *, stops: bool = False) -> PlacedAction:
    """An output is set at a path time."""
    action = Action(f"actions[{number - 1}]", NOWHERE, "pressure", value, stops_on_failure=stops)
    return PlacedAction(number, path_time_s, action)


def settings_at(*path_times_s: float) -> Placed:
    return Placed(tuple(setting(n, time_s, n) for n, time_s in enumerate(path_times_s, start=1)))


def report(rig: Rig) -> SignalReport:
    reader = rig.memory.signals
    return signal_report(reader.data)


def path_times(trajectory: Trajectory, commanded: list[Array]) -> Array:
    """How far along a trajectory each command is, s. Joint 1 moves in one direction only: its position says
    it."""
    found = []
    for row in commanded:
        begin, end = trajectory.start[0], trajectory.end[0]
        share = (row[0] - begin) / (end - begin)
        if share <= 1e-12 or share >= 1.0 - 1e-12:
            found.append(0.0 if share < 0.5 else trajectory.duration_s)
            continue
        off = brentq(
            lambda time_s, row=row: trajectory.sample([time_s])[0, 0] - row[0], 0.0, trajectory.duration_s
        )
        found.append(off)
    return np.array(found)


def first_cycles(trajectory: Trajectory, commanded: list[Array], places_s: Array) -> list[int]:
    """The first command of each place that has reached it."""
    reached = path_times(trajectory, commanded)
    slack_s = 1e-7  # of the root that brentq finds; a cycle is 1e-3
    return [int(np.argmax(reached >= place_s - slack_s)) for place_s in places_s]


def test_outputs_are_set_in_the_cycle_in_which_the_path_reaches_their_place(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    places_s = np.sort(np.random.default_rng(1).uniform(0.05, motion.duration_s - 0.05, 40))
    before = arm.written
    assert rig.start(motion, signals=settings_at(*places_s)) == ""
    rig.run()
    commanded = rig.commanded[-(arm.written - before) :]
    fired = [each.cycle - before for each in arm.set]
    assert fired == first_cycles(motion, commanded, places_s)
    assert [each.value for each in arm.set] == list(range(1, 41))
    found = report(rig)
    assert all(each.firing is Firing.FIRED for each in found.fired.values())
    assert len(found.fired) == 40


@pytest.mark.parametrize("seed", few(range(6), 2))
def test_each_fires_once_in_its_cycle_under_overrides_and_pauses(
    rig: Rig, robot: RobotDescription, arm: WiredArm, motion: Trajectory, seed: int
) -> None:
    random = np.random.default_rng(seed)
    places_s = np.sort(random.uniform(0.05, motion.duration_s - 0.05, 30))
    before = arm.written
    assert rig.start(motion, signals=settings_at(*places_s)) == ""
    for _ in range(12):
        rig.step(int(random.integers(1, 300)))
        if rig.mode is not LoopMode.TRAJECTORY:
            break
        assert rig.answer(rig.send(Command.SET_RATE, value=random.choice([0.0, 0.1, 0.5, 1.0]))) == ""
    rig.answer(rig.send(Command.SET_RATE, value=1.0))
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    commanded = rig.commanded[-(arm.written - before) :]
    assert [each.cycle - before for each in arm.set] == first_cycles(motion, commanded, places_s)


def test_actions_at_the_ends_fire_in_the_first_and_the_last_cycle(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    assert rig.start(motion, signals=settings_at(0.0, motion.duration_s)) == ""
    assert [each.value for each in arm.set] == [1]
    rig.run()
    assert [each.value for each in arm.set] == [1, 2]
    assert report(rig).fired[2].path_time_s == motion.duration_s


def test_several_actions_fire_in_one_cycle_in_their_order(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    assert rig.start(motion, signals=settings_at(0.3, 0.3, 0.3001, 0.30019)) == ""
    rig.run()
    assert [each.value for each in arm.set] == [1, 2, 3, 4]
    assert len({each.cycle for each in arm.set}) <= 2
    assert arm.set[0].cycle == arm.set[1].cycle


@pytest.mark.parametrize("what", ["stops", "estops", "fast_stops"])
def test_what_lies_behind_a_stop_is_reported_as_not_fired(
    rig: Rig, arm: WiredArm, motion: Trajectory, what: str
) -> None:
    half_s = motion.duration_s / 2.0
    assert rig.start(motion, signals=settings_at(half_s - 0.1, half_s + 0.02, half_s + 0.5)) == ""
    while rig.loop.controller.clock.path_time_s < half_s:
        rig.step()
    rig.request("stops" if what == "fast_stops" else what)
    rig.run()
    assert rig.loop.controller.clock.path_time_s > half_s + 0.02  # it came by while it slowed down
    assert [each.value for each in arm.set] == [1]
    assert list(report(rig).fired) == [1]


def test_a_fault_in_between_fires_nothing_more(rig: Rig, arm: WiredArm, motion: Trajectory) -> None:
    half_s = motion.duration_s / 2.0
    assert rig.start(motion, signals=settings_at(0.1, half_s)) == ""
    rig.step(200)
    arm.fail_read = "the cable is off"
    rig.step(2000)
    assert rig.mode is LoopMode.FAULT
    assert list(report(rig).fired) == [1]


def test_a_rejected_output_is_reported_and_the_motion_goes_on(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    assert rig.start(motion, signals=settings_at(0.1, 0.2)) == ""
    arm.refuses = "the valve block is off"
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    assert [each.reason for each in report(rig).fired.values()] == ["the valve block is off"] * 2
    assert report(rig).fired[1].firing is Firing.REJECTED


def test_a_rejected_output_stops_the_motion_that_asks_for_it(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    arm.refuses = "the valve block is off"
    both = setting(1, 0.2, stops=True), setting(2, 0.2)
    assert rig.start(motion, signals=Placed(both)) == ""
    rig.run()
    assert rig.result is MotionResult.STOPPED
    assert rig.reason == "output pressure was rejected: the valve block is off"
    assert list(report(rig).fired) == [1]


def test_a_motion_waits_for_its_condition_and_then_goes_as_planned(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    signals = Placed(settings_at(0.0, 0.3).actions, start_when=Condition(Quantity.INPUT, *TRUE, name="part"))
    assert rig.start(motion, signals=signals) == ""
    rig.step(500)
    assert rig.mode is LoopMode.TRAJECTORY
    assert report(rig).waiting is Waiting.START
    assert not arm.set
    assert np.array_equal(rig.commanded[-1], rig.home)
    arm.inputs["part"], before = 1.0, arm.written
    rig.run()
    assert report(rig).waiting is Waiting.NO
    commanded = rig.commanded[-(arm.written - before) :]
    cycles = np.arange(1, len(commanded) + 1) * 1e-3
    assert np.abs(np.array(commanded) - motion.sample(cycles)).max() < 1e-9
    assert [each.cycle - before for each in arm.set] == first_cycles(
        motion, commanded, np.array([0.001, 0.3])
    )


def test_a_motion_that_waits_begins_at_the_speed_override_of_that_moment(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    assert rig.start(motion, signals=Placed(start_when=Condition(Quantity.INPUT, *TRUE, name="part"))) == ""
    rig.step(10)
    assert rig.answer(rig.send(Command.SET_RATE, value=0.5)) == ""
    arm.inputs["part"], before = 1.0, arm.written
    rig.run()
    commanded = rig.commanded[-(arm.written - before) :]
    cycles = np.arange(1, len(commanded) + 1) * 0.5e-3
    assert np.abs(np.array(commanded) - motion.sample(cycles)).max() < 1e-9


def test_a_stop_ends_a_motion_that_waits(rig: Rig, arm: WiredArm, motion: Trajectory) -> None:
    assert rig.start(motion, signals=Placed(start_when=Condition(Quantity.INPUT, *TRUE, name="part"))) == ""
    rig.step(10)
    rig.request()
    rig.run()
    assert rig.result is MotionResult.STOPPED
    assert np.array_equal(rig.commanded[-1], rig.home)
    arm.inputs["part"] = 1.0
    rig.step(100)
    assert np.array_equal(rig.commanded[-1], rig.home)


def test_a_motion_pauses_while_a_condition_holds_within_the_limits(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    signals = Placed(
        settings_at(motion.duration_s / 2.0).actions,
        pause_while=Condition(Quantity.INPUT, 0.8, name="distance"),
    )
    assert rig.start(motion, signals=signals) == ""
    rig.step(150)
    arm.inputs["distance"] = 0.9
    rig.step(1500)
    assert report(rig).waiting is Waiting.PAUSE
    assert not np.diff(rig.commanded[-100:], axis=0).any()
    assert rig.answer(rig.send(Command.SET_RATE, value=0.7)) == ""  # it stays where it is
    rig.step(300)
    assert not np.diff(rig.commanded[-100:], axis=0).any()
    arm.inputs["distance"] = 0.1
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    assert len(arm.set) == 1
    for rates in rig.rates():
        assert rates.max() <= 1.011


def test_a_stop_during_a_pause_ends_the_motion(rig: Rig, arm: WiredArm, motion: Trajectory) -> None:
    arm.inputs["part"] = 1.0
    assert rig.start(motion, signals=Placed(pause_while=Condition(Quantity.INPUT, *TRUE, name="part"))) == ""
    rig.step(500)
    rig.request()
    rig.run()
    assert rig.result is MotionResult.STOPPED


def test_a_condition_whose_input_cannot_be_read_stops_the_motion(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    assert rig.start(motion, signals=Placed(pause_while=Condition(Quantity.INPUT, *TRUE, name="part"))) == ""
    rig.step(100)
    arm.broken = "the field bus is silent"
    rig.run()
    assert rig.result is MotionResult.STOPPED
    assert rig.reason == "a condition of the motion cannot be checked: the field bus is silent"


@pytest.mark.parametrize("fast", [False, True])
def test_an_input_ends_a_motion_on_its_path_or_as_fast_as_possible(
    rig: Rig, arm: WiredArm, motion: Trajectory, fast: bool
) -> None:
    until = Until(Condition(Quantity.INPUT, *TRUE, name="part"), fast=fast)
    assert rig.start(motion, signals=Placed(until=until)) == ""
    rig.step(round(500 * motion.duration_s))
    path_time_s = rig.loop.controller.clock.path_time_s
    arm.inputs["part"] = 1.0
    rig.run()
    assert rig.result is MotionResult.MET
    assert rig.mode is LoopMode.HOLD
    met = report(rig).met
    assert met is not None
    assert met.path_time_s == path_time_s  # in the first cycle that could see it
    for rates in rig.rates():
        assert rates.max() <= 1.011


@pytest.mark.parametrize("seed", range(8))
def test_a_stop_on_the_path_is_as_short_as_the_limits_permit(
    rig: Rig, robot: RobotDescription, arm: WiredArm, seed: int
) -> None:
    """Oracle: `shortest_stop.rest_on_path`, the shortest stop with one bound for the jerk. Fast straight
    lines, on which the joints' speeds change.
    """
    random = np.random.default_rng(seed)
    speed_m_s = float(random.uniform(0.1, 0.25))
    x, y = random.uniform(0.45, 0.6), random.uniform(-0.2, 0.2)
    above, below = (Pose.from_abc(x, y, z, 0.0, np.pi, 0.0) for z in (0.55, 0.40))
    there = plan(robot, MotionRequest(rig.home, above, PlannerName.PTP, Scaling(1.0)))
    assert there is not None
    down = MotionRequest(
        there.end, below, PlannerName.LIN, Scaling(1.0), tcp_speed=TcpSpeed(linear_m_s=speed_m_s)
    )
    motion = plan(robot, down)
    assert motion is not None
    assert rig.start(there) == ""
    rig.run()
    until = Until(Condition(Quantity.INPUT, *TRUE, name="part"))
    assert rig.start(motion, signals=Placed(until=until)) == ""
    rig.step(round(500 * motion.duration_s))
    arm.inputs["part"] = 1.0
    rig.run()
    met = report(rig).met
    assert met is not None
    for rates in rig.rates():
        assert rates.max() <= 1.011
    forward = robot.model.forward
    rest = rest_on_path(motion, met.path_time_s, rig.limits)
    assert rest is not None
    shortest = forward(rest).position[2]
    assert shortest - forward(rig.commanded[-1]).position[2] <= speed_m_s * rig.settings.rt.period_s


@pytest.mark.parametrize("seed", [98, 118, 336])
def test_a_stop_on_the_path_is_short_where_gentler_ones_than_the_first_do_not_hold(seed: int) -> None:
    """Oracle: `shortest_stop.rest_on_path`. The shares of the steepest stop that hold have gaps here."""
    stop = approach(seed, fast=False)
    assert stop.met
    assert stop.excess <= 1.0


def test_an_edge_counts_only_from_outside(rig: Rig, arm: WiredArm, motion: Trajectory) -> None:
    arm.inputs["part"] = 1.0
    until = Until(Condition(Quantity.INPUT, *TRUE, name="part", edge=True))
    assert rig.start(motion, signals=Placed(until=until)) == ""
    rig.step(200)
    assert report(rig).met is None
    arm.inputs["part"] = 0.0
    rig.step()
    arm.inputs["part"] = 1.0
    rig.run()
    assert rig.result is MotionResult.MET


def test_a_force_counts_from_what_was_measured_at_the_start(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    arm.push = np.array([3.0, -40.0, 7.0, 0.0, 0.0, 0.0])
    until = Until(Condition(Quantity.FORCE, 10.0, direction=(0.0, 0.0, 1.0)))
    assert rig.start(motion, signals=Placed(until=until)) == ""
    rig.step(100)
    arm.push = np.array([300.0, 10.0, 16.9, 50.0, 0.0, 0.0])
    rig.step(100)
    assert report(rig).met is None
    arm.push = np.array([0.0, 0.0, -3.1, 0.0, 0.0, 0.0])  # in either sense
    rig.run()
    met = report(rig).met
    assert met is not None
    assert met.value == pytest.approx(10.1)
    assert met.wrench.tolist() == pytest.approx([-3.0, 40.0, -10.1, 0.0, 0.0, 0.0])


def test_a_direction_of_the_tool_turns_with_it(
    rig: Rig, robot: RobotDescription, arm: WiredArm, motion: Trajectory
) -> None:
    until = Until(Condition(Quantity.FORCE, 10.0, direction=(1.0, 0.0, 0.0), in_tool=True))
    assert rig.start(motion, signals=Placed(until=until)) == ""
    rig.step(400)
    axes = robot.model.forward(rig.commanded[-1]).rotation
    arm.push = np.concatenate([100.0 * axes[:, 1] + 9.5 * axes[:, 0], np.zeros(3)])
    rig.step(2)
    assert report(rig).met is None
    arm.push = np.concatenate([-10.5 * axes[:, 0], np.zeros(3)])
    rig.step()
    assert report(rig).met is not None


def test_conditions_of_a_part_of_the_motion_count_there_alone(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    half_s = motion.duration_s / 2.0
    until = Until(Condition(Quantity.INPUT, *FALSE, name="part"))
    assert rig.start(motion, signals=Placed(until=until, until_s=half_s)) == ""
    rig.run()
    met = report(rig).met
    assert met is not None
    assert half_s <= met.path_time_s < half_s + 1.1e-3


def test_a_replacement_goes_on_with_what_has_not_fired(rig: Rig, arm: WiredArm, motion: Trajectory) -> None:
    assert rig.start(motion, signals=settings_at(0.1, 0.6)) == ""
    rig.step(300)
    after = Placed((setting(1, 0.1), setting(2, 0.6, 2.0), setting(3, 0.9, 3.0)))
    rig.memory.slots[1].write(1, motion, signals=after)
    assert rig.answer(rig.send(Command.REPLACE, slot=1, motion_id=1, value=0.0)) == ""
    rig.run()
    assert [each.value for each in arm.set] == [1.0, 2.0, 3.0]
    assert sorted(report(rig).fired) == [1, 2, 3]


def test_an_arm_at_its_goal_fires_its_actions_all_the_same(
    rig: Rig, robot: RobotDescription, arm: WiredArm
) -> None:
    actions = (Action("actions[0]", PathPlace("distance_m", 0.0, True), "glue", 1.0),)
    trajectory = resting(rig.home)
    signals = place_signals(
        [PathSignals(actions)], [trajectory.duration_s], TcpWay(trajectory, robot.model.chain)
    )
    assert rig.start(trajectory, signals=signals) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    assert [each.name for each in arm.set] == ["glue"]


@pytest.mark.parametrize(
    ("field", "value", "refusal"),
    [
        ("count", 65, "the motion has 65 actions, at most 64 are possible"),
        ("path_times_s", [0.5, 0.2], "the path times of the motion's actions do not increase"),
        ("path_times_s", [0.5, np.nan], "the path times of the motion's actions do not increase"),
        ("numbers", [3, 3], "two actions of the motion have the same number"),
    ],
)
def test_what_are_no_actions_is_refused(
    rig: Rig, motion: Trajectory, field: str, value: object, refusal: str
) -> None:
    head = rig.memory.slots[0].head
    rig.memory.slots[0].write(1, motion, signals=settings_at(0.2, 0.5))
    signals = head.data["signals"]
    if field == "count":
        signals[field] = value
    else:
        signals[field][:2] = value
    head.publish()
    assert rig.answer(rig.send(Command.START, slot=0, motion_id=1)) == refusal
    assert rig.mode is LoopMode.HOLD


@pytest.mark.parametrize(
    ("field", "value", "refusal"),
    [
        ("quantity", 9, "9 is not a valid Quantity"),
        ("joint", 7, "a condition refers to joint 8, but there are only 7"),
        ("low", np.nan, "a condition has a bound that is not a number"),
    ],
)
def test_what_is_no_condition_is_refused(
    rig: Rig, motion: Trajectory, field: str, value: float, refusal: str
) -> None:
    head = rig.memory.slots[0].head
    signals = Placed(until=Until(Condition(Quantity.FORCE, 10.0)))
    rig.memory.slots[0].write(1, motion, signals=signals)
    head.data["signals"]["until"][field] = value
    head.publish()
    assert rig.answer(rig.send(Command.START, slot=0, motion_id=1)) == refusal
    assert rig.mode is LoopMode.HOLD


def replaced(rig: Rig, motion: Trajectory, signals: Placed) -> float:
    """Have the motion under way go on along what is left of it, with other signals; when that begins."""
    left, offset_s = remainder_at(motion, rig.loop.controller.clock.path_time_s)
    rig.memory.slots[1].write(1, left, signals=signals)
    assert rig.answer(rig.send(Command.REPLACE, slot=1, motion_id=1, value=offset_s)) == ""
    return offset_s


def test_what_fires_is_reported_at_path_times_since_the_start_of_the_motion(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    first_s, last_s = 0.2, motion.duration_s - 0.1
    before = arm.written
    assert rig.start(motion, signals=settings_at(first_s, last_s)) == ""
    rig.step(round(500.0 * motion.duration_s))
    _, offset_s = remainder_at(motion, rig.loop.controller.clock.path_time_s)
    assert offset_s > 0.1
    replaced(rig, motion, Placed((setting(1, first_s - offset_s), setting(2, last_s - offset_s, 2.0))))
    rig.run()
    assert [each.value for each in arm.set] == [1.0, 2.0]
    commanded = rig.commanded[-(arm.written - before) :]
    places_s = np.array([first_s, last_s])
    assert [each.cycle - before for each in arm.set] == first_cycles(motion, commanded, places_s)
    times_s = [each.path_time_s for each in report(rig).fired.values()]
    assert np.all((times_s - places_s >= 0.0) & (times_s - places_s < 1.1e-3))


def test_a_condition_comes_with_a_replacement_and_counts_in_its_part(
    rig: Rig, arm: WiredArm, motion: Trajectory
) -> None:
    assert rig.start(motion) == ""
    rig.step(200)
    from_s = 0.75 * motion.duration_s
    _, offset_s = remainder_at(motion, rig.loop.controller.clock.path_time_s)
    until = Until(Condition(Quantity.INPUT, *FALSE, name="part"))
    replaced(rig, motion, Placed(until=until, until_s=from_s - offset_s))
    rig.run()
    assert rig.result is MotionResult.MET
    met = report(rig).met
    assert met is not None
    assert from_s <= met.path_time_s < from_s + 1.1e-3


@pytest.mark.parametrize("goes_on", [True, False])
def test_a_pause_lasts_over_a_replacement_that_has_its_condition_and_no_other(
    rig: Rig, arm: WiredArm, motion: Trajectory, goes_on: bool
) -> None:
    pause = Placed(pause_while=Condition(Quantity.INPUT, *TRUE, name="part"))
    assert rig.start(motion, signals=pause) == ""
    rig.step(300)
    arm.inputs["part"] = 1.0
    rig.step(500)
    assert report(rig).waiting is Waiting.PAUSE
    replaced(rig, motion, replace(pause, pause_s=(0.0, 0.5 * motion.duration_s)) if goes_on else Placed())
    rig.step(500)
    assert (rig.mode is LoopMode.TRAJECTORY and not np.diff(rig.commanded[-100:], axis=0).any()) == goes_on
    arm.inputs["part"] = 0.0
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    for rates in rig.rates():
        assert rates.max() <= 1.011


def test_a_force_keeps_its_zero_over_a_replacement(rig: Rig, arm: WiredArm, motion: Trajectory) -> None:
    until = Placed(until=Until(Condition(Quantity.FORCE, 10.0)))
    arm.push = np.array([0.0, 0.0, 30.0, 0.0, 0.0, 0.0])
    assert rig.start(motion, signals=until) == ""
    rig.step(200)
    arm.push = np.array([0.0, 0.0, 36.0, 0.0, 0.0, 0.0])
    replaced(rig, motion, until)
    rig.step(50)
    assert report(rig).met is None
    arm.push = np.array([0.0, 0.0, 41.0, 0.0, 0.0, 0.0])
    rig.run()
    assert rig.result is MotionResult.MET
