"""FollowJointTrajectory: goals read and checked, followed on the stepped cycle, cancelled, preempted.

Oracles: scipy's piecewise polynomials for what happens between the points; the cycle itself
(tests/support/rig.py) for where the arm was; the error codes of control_msgs' FollowJointTrajectory.action;
for the rules the behaviour of ros2_control's joint_trajectory_controller as its documentation states it.
"""

from __future__ import annotations

import asyncio
import json
import math
import re
from collections.abc import Coroutine, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cobot_run import WAIT_S
from foreign_trajectories import totg
from goal_handle import ToldHandle
from rig import Rig
from scipy.interpolate import BPoly, CubicHermiteSpline, CubicSpline
from virtual_service import Cycle, PlanningHere
from virtual_time import VirtualClock, VirtualLoop

from app.actions.fjt import FollowJointTrajectory
from app.actions.fjt_goal import FjtGoal, GoalError, read_goal
from app.graph.actions import GoalStatus
from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.rights.claims import Caller
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from app.services.streaming.servo import ServoService
from app.services.streaming.sessions import StreamService
from benchmarks.arms import carrying
from cobot.config import Settings
from cobot.errors import ConflictError, InputError, NotReadyError
from cobot.ipc.layout import ServoMode
from cobot.planners import WaypointRequest, plan_waypoints
from cobot.robot.description import RobotDescription
from cobot.robot.tool import Tool
from cobot.ros.failures import FjtError
from cobot.ros.messages import Messages
from cobot.servo.protocol import FjtControl
from cobot.trajectory import Trajectory
from cobot.types import JointLimits, LoopMode

NAMES = [f"joint{number}" for number in range(1, 8)]
TYPE = "control_msgs/action/FollowJointTrajectory"
MESSAGES = Messages()
NOW_S = 1_000_000.0


def duration(seconds: float) -> dict[str, int]:
    sec = math.floor(seconds)
    return {"sec": sec, "nanosec": round((seconds - sec) * 1e9)}


def point(positions: Any, time_s: float, velocities: Any = (), accelerations: Any = ()) -> dict[str, Any]:
    return {
        "positions": [float(value) for value in positions],
        "velocities": [float(value) for value in velocities],
        "accelerations": [float(value) for value in accelerations],
        "time_from_start": duration(float(time_s)),
    }


def goal(points: list[dict[str, Any]], names: list[str] = NAMES, **fields: Any) -> dict[str, Any]:
    """A complete message, as the graph hands it to the action."""
    stamp = fields.pop("stamp", 0.0)
    trajectory = {
        "header": {"stamp": duration(stamp)},
        "joint_names": names,
        "points": points,
    }
    return MESSAGES.checked(f"{TYPE}_Goal", {"trajectory": trajectory, **fields})


def tolerance(name: str, position: float = 0.0, velocity: float = 0.0, acceleration: float = 0.0) -> Any:
    return {"name": name, "position": position, "velocity": velocity, "acceleration": acceleration}


def read(message: dict[str, Any], limits: JointLimits) -> FjtGoal:
    return read_goal(message, limits, NOW_S)


HERE = [0.0] * 7
THERE = [0.1] * 7


# Reading


def test_joints_may_stand_in_any_order(robot: RobotDescription) -> None:
    order = [3, 0, 6, 1, 2, 5, 4]
    positions = np.arange(7.0) / 10.0
    read_ = read(goal([point(positions[order], 1.0)], [NAMES[joint] for joint in order]), robot.limits)
    assert read_.points[0].positions == positions.tolist()


@pytest.mark.parametrize(
    ("message", "code", "words"),
    [
        (goal([]), FjtError.INVALID_GOAL, "no points"),
        (
            goal([point(HERE, 1.0)], NAMES[:6]),
            FjtError.INVALID_JOINTS,
            "joint_names must be joint1.* in any order: missing: 'joint7'$",
        ),
        (
            goal([point(HERE, 1.0)], [*NAMES[:6], "joint1"]),
            FjtError.INVALID_JOINTS,
            "missing: 'joint7'; listed twice: 'joint1'",
        ),
        (goal([point(HERE, 1.0)], [*NAMES, "joint8"]), FjtError.INVALID_JOINTS, "unknown: 'joint8'"),
        (goal([point(HERE, 1.0)], []), FjtError.INVALID_JOINTS, "joint_names"),
        (
            goal([point(HERE[:6], 1.0)]),
            FjtError.INVALID_GOAL,
            r"points\[0\]: positions must be 7 numbers, got 6",
        ),
        (goal([point(HERE, 1.0), point([], 2.0)]), FjtError.INVALID_GOAL, r"points\[1\]: positions"),
        (goal([point([], 1.0, HERE)]), FjtError.INVALID_GOAL, "positions are missing"),
        (
            goal([point(HERE, 1.0, HERE), point(HERE, 2.0)]),
            FjtError.INVALID_GOAL,
            r"points\[1\] has no velocities, but points\[0\] does: give velocities at all points or at none",
        ),
        (goal([point(HERE, 1.0, [], HERE)]), FjtError.INVALID_GOAL, "accelerations without velocities"),
        (
            goal([point(HERE, 1.0), point(HERE, 1.0)]),
            FjtError.INVALID_GOAL,
            (
                r"points\[1\]: time_from_start must increase strictly, but it is 1 s after 1 s; leave the "
                r"point out"
            ),
        ),
        (
            goal([point(HERE, 0.0)] * 2),
            FjtError.INVALID_GOAL,
            "all times are 0: add a time parameterization",
        ),
        (
            goal([point(HERE, 2.0), point(HERE, 1.0)]),
            FjtError.INVALID_GOAL,
            "order the points by their times",
        ),
        (goal([point(HERE, -1.0)]), FjtError.INVALID_GOAL, "must not be negative"),
        (goal([point([*HERE[:6], math.nan], 1.0)]), FjtError.INVALID_GOAL, r"positions\[6\] is not a finite"),
        (goal([{**point(HERE, 1.0), "effort": HERE}]), FjtError.INVALID_GOAL, "effort"),
        (
            goal([point(HERE, 1.0)], stamp=NOW_S - 10.0),
            FjtError.OLD_HEADER_TIMESTAMP,
            "should have ended 10.000 s",
        ),
        (goal([point(HERE, 60.0)], stamp=NOW_S - 10.0), FjtError.OLD_HEADER_TIMESTAMP, "should have begun"),
        (goal([point(HERE, 1.0)], stamp=NOW_S + 3600.0), FjtError.INVALID_GOAL, "3600 s in the future"),
        (
            goal([point(HERE, 1.0)], path_tolerance=[tolerance("joint9", 1.0)]),
            FjtError.INVALID_JOINTS,
            r"path_tolerance\[0\]: there is no joint 'joint9'",
        ),
        (
            goal([point(HERE, 1.0)], goal_tolerance=[tolerance("joint1", -2.0)]),
            FjtError.INVALID_GOAL,
            r"goal_tolerance\[0\]: position must be -1, 0 or a positive number, got -2",
        ),
        (
            goal([point(HERE, 1.0)], path_tolerance=[tolerance("joint1", acceleration=1.0)]),
            FjtError.INVALID_GOAL,
            "accelerations are not measured",
        ),
        (
            goal([point(HERE, 1.0)], component_path_tolerance=[{"joint_name": "joint1"}]),
            FjtError.INVALID_GOAL,
            "component_path_tolerance",
        ),
        (
            goal([point(HERE, 1.0)], multi_dof_trajectory={"joint_names": ["base"]}),
            FjtError.INVALID_GOAL,
            "multi_dof_trajectory",
        ),
    ],
)
def test_a_goal_that_makes_no_sense_is_named(
    robot: RobotDescription, message: dict[str, Any], code: FjtError, words: str
) -> None:
    with pytest.raises(GoalError, match=words) as found:
        read(message, robot.limits)
    assert found.value.error_code is code


def test_tolerances_of_0_and_minus_1_leave_the_default(robot: RobotDescription) -> None:
    given = [tolerance("joint1"), tolerance("joint2", -1.0, -1.0, -1.0), tolerance("joint7", 0.25, 0.5)]
    made = read(goal([point(HERE, 1.0)], path_tolerance=given), robot.limits).path
    np.testing.assert_array_equal(made.position, [np.inf] * 6 + [0.25])
    np.testing.assert_array_equal(made.velocity, [np.inf] * 6 + [0.5])


@pytest.mark.parametrize(("given", "late_s"), [(0.0, math.inf), (-1.0, math.inf), (0.5, 0.5)])
def test_no_goal_time_tolerance_means_any_time(robot: RobotDescription, given: float, late_s: float) -> None:
    made = read(goal([point(HERE, 1.0)], goal_time_tolerance=duration(given)), robot.limits)
    assert made.late_s == late_s


@pytest.mark.parametrize(
    ("stamp", "start_s"), [(0.0, None), (NOW_S + 2.5, NOW_S + 2.5), (NOW_S - 0.5, NOW_S - 0.5)]
)
def test_the_stamp_is_when_to_begin(robot: RobotDescription, stamp: float, start_s: float | None) -> None:
    assert read(goal([point(HERE, 1.0)], stamp=stamp), robot.limits).start_s == start_s


# Interpolating


def planned(robot: RobotDescription, message: dict[str, Any], start: Any) -> Trajectory:
    request = WaypointRequest(np.array(start), read(message, robot.limits).points, 0.01)
    return plan_waypoints(robot, request)


def path(robot: RobotDescription, seed: int) -> tuple[np.ndarray, CubicSpline]:
    """Random points near home that the limits permit, and the curve they are of."""
    random = np.random.default_rng(seed)
    home = np.array(robot.positions["home"].joints)
    times = np.concatenate([[0.0], np.cumsum(random.integers(800, 1500, 6))]) / 1000.0
    positions = home + random.uniform(-0.15, 0.15, (7, 7))
    positions[0] = home
    return times, CubicSpline(times, positions, bc_type=((2, np.zeros(7)), (2, np.zeros(7))))


@pytest.mark.parametrize("seed", range(5))
def test_positions_velocities_and_accelerations_are_met_by_quintics(
    robot: RobotDescription, seed: int
) -> None:
    times, curve = path(robot, seed)
    random = np.random.default_rng(seed)
    velocities, accelerations = random.uniform(-0.05, 0.05, (2, 7, 7))
    velocities[[0, -1]] = accelerations[[0, -1]] = 0.0
    rows = zip(curve(times), times, velocities, accelerations, strict=True)
    made = planned(robot, goal([point(*row) for row in rows]), curve(0.0))
    values = np.stack([curve(times), velocities, accelerations], axis=1)
    expected = BPoly.from_derivatives(times, values)
    samples = np.linspace(0.0, times[-1], 997)
    np.testing.assert_allclose(made.sample(samples), expected(samples), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_positions_and_velocities_of_a_smooth_curve_give_that_curve(
    robot: RobotDescription, seed: int
) -> None:
    """Where cubics through the points meet smoothly, they are what joint_trajectory_controller follows."""
    times, curve = path(robot, seed)
    lead_in, lead_out = curve(times, 1).copy(), curve(times)
    positions = np.vstack([lead_out, lead_out[-1] + 0.02])
    all_times = np.append(times, times[-1] + 1.5)
    velocities = np.vstack([lead_in, np.zeros(7)])
    velocities[0] = 0.0
    rows = zip(positions, all_times, velocities, strict=True)
    made = planned(robot, goal([point(*row) for row in rows]), positions[0])
    expected = CubicHermiteSpline(all_times, positions, velocities)
    inside = np.linspace(all_times[2], all_times[-3], 997)
    np.testing.assert_allclose(made.sample(inside), expected(inside), atol=1e-10)


def test_accelerations_at_both_ends_are_those_of_an_arm_at_rest(robot: RobotDescription) -> None:
    """MoveIt's TimeOptimalTrajectoryGeneration begins and ends with the largest ones (moveit2 issue 3014)."""
    rows = [
        point(HERE, 0.0, HERE, [0.5] * 7),
        point(THERE, 1.0, THERE, THERE),
        point(HERE, 2.0, HERE, [-1.0] * 7),
    ]
    points = read(goal(rows), robot.limits).points
    assert [each.accelerations for each in points] == [HERE, THERE, HERE]


def test_positions_alone_give_the_clamped_spline(robot: RobotDescription) -> None:
    times, curve = path(robot, 7)
    rows = zip(curve(times), times, strict=True)
    made = planned(robot, goal([point(*row) for row in rows]), curve(0.0))
    expected = CubicSpline(times, curve(times), bc_type="clamped")
    inside = np.linspace(times[1], times[-2], 997)
    np.testing.assert_allclose(made.sample(inside), expected(inside), atol=1e-10)


# Following


class Handle(ToldHandle):
    """What it is told has to be a message."""

    def feedback(self, values: dict[str, Any]) -> None:
        super().feedback(MESSAGES.checked(f"{TYPE}_Feedback", values))


class Stand:
    """The action beside a cycle, both on virtual time."""

    def __init__(
        self, rig: Rig, robot: RobotDescription, settings: Settings, planning: PlanningService
    ) -> None:
        self.loop = VirtualLoop()
        self.clock = VirtualClock(self.loop)
        self.rig = rig
        self.cycle = Cycle(rig, self.loop, self.clock)
        self.clock.sleep(0.03)
        self.link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0, clock=self.clock)
        self.ownership = Ownership(self.link)
        self.motion = MotionService(robot, self.link, planning)
        self.streams = StreamService(self.link, self.ownership, self.motion, rig.settings.streaming)
        info = self.streams.info
        info["stiffness"], info["cartesian_stiffness"] = 500.0, [3000.0] * 3 + [200.0] * 3
        info["min_position"], info["max_position"] = rig.limits.min_position, rig.limits.max_position
        # No mode with force control in here.
        self.force = SimpleNamespace(settings=None, take_back=lambda: asyncio.sleep(0))
        self.servo = ServoService(robot, self.link, self.streams, self.force)  # type: ignore[arg-type]
        ros = settings.ros.model_copy(update={"enable_fjt_action": True})
        self.action = FollowJointTrajectory(
            robot,
            self.link,
            self.ownership,
            self.motion,
            self.servo,
            ros,
            0.01,
            settings.planning.smoothing_rad,
        )

    def run(self, work: Coroutine[Any, Any, None]) -> None:
        self.loop.run_until_complete(work)

    def close(self) -> None:
        self.servo.close()
        self.streams.close()
        self.cycle.close()
        self.clock.sleep(0.0)
        self.loop.close()
        self.link.close()

    async def step_until(self, *tasks: asyncio.Task[Any]) -> None:
        async with asyncio.timeout(WAIT_S):
            while not all(task.done() for task in tasks):
                await asyncio.sleep(0.005)

    async def send(self, message: dict[str, Any], handle: Handle) -> dict[str, Any]:
        """The result of a goal, the cycle stepped meanwhile."""
        task = asyncio.create_task(self.action.execute(message, handle))  # type: ignore[arg-type]
        await self.step_until(task)
        return MESSAGES.checked(f"{TYPE}_Result", task.result())

    async def until_moving(self) -> None:
        async with asyncio.timeout(WAIT_S):
            while self.rig.mode is not LoopMode.TRAJECTORY:
                await asyncio.sleep(0.001)
            for _ in range(30):
                await asyncio.sleep(0.01)

    async def until_free(self) -> None:
        """Until nobody owns the arm any more."""
        async with asyncio.timeout(WAIT_S):
            while self.ownership.owner is not None or self.rig.mode is not LoopMode.HOLD:
                await asyncio.sleep(0.005)

    def to(self, offset: float, time_s: float = 2.0, **fields: Any) -> dict[str, Any]:
        return goal([point(self.rig.home + offset, time_s)], **fields)


@pytest.fixture(scope="module")
def planning(robot: RobotDescription) -> Iterator[PlanningService]:
    made = PlanningHere(robot)
    yield made
    made.close()


@pytest.fixture
def stand(
    rig: Rig, robot: RobotDescription, settings: Settings, planning: PlanningService
) -> Iterator[Stand]:
    made = Stand(rig, robot, settings, planning)
    yield made
    made.close()


def test_a_goal_is_followed_through_its_points_and_told_about(stand: Stand) -> None:
    async def live() -> None:
        home, handle = stand.rig.home, Handle()
        offsets = [(0.0, 0.0), (0.1, 1.0), (0.15, 1.7), (0.05, 3.0)]
        message = goal([point(home + offset, time_s) for offset, time_s in offsets])
        result = await stand.send(message, handle)
        assert result == {"error_code": 0, "error_string": ""}
        assert (handle.accepted, handle.status) == (True, GoalStatus.SUCCEEDED)
        for offset, _ in offsets:
            nearest = np.abs(np.array(stand.rig.commanded) - (home + offset)).max(axis=1).min()
            assert nearest < 2e-4
        np.testing.assert_allclose(stand.rig.commanded[-1], home + 0.05, atol=1e-9)
        assert stand.ownership.owner is None
        assert max(share.max() for share in stand.rig.rates()) <= 1.0 + 1e-6

    stand.run(live())


def test_a_goal_is_not_late_in_the_slow_motion_of_a_simulation(stand: Stand) -> None:
    """It takes eight seconds of the clock of the service, which would be five too many."""

    async def live() -> None:
        stand.rig.clock.scale(0.25)
        message = stand.to(0.2, 2.0, goal_time_tolerance=duration(1.0))
        begun_s, result = stand.clock.now_s(), await stand.send(message, Handle())
        assert result == {"error_code": 0, "error_string": ""}
        assert stand.clock.now_s() - begun_s > 7.9

    stand.run(live())


def test_feedback_holds_desired_actual_and_error(stand: Stand) -> None:
    async def live() -> None:
        handle = Handle()
        await stand.send(stand.to(0.2, 3.0), handle)
        assert len(handle.told) > 2
        reached = [told["desired"]["positions"][0] for told in handle.told]
        assert reached == sorted(reached)
        for told in handle.told:
            assert told["joint_names"] == NAMES
            assert told["header"]["stamp"]["sec"] > 0
            desired, actual, error = (
                np.array(told[key]["positions"]) for key in ("desired", "actual", "error")
            )
            np.testing.assert_allclose(error, desired - actual, atol=1e-12)
            assert told["desired"]["time_from_start"] == told["actual"]["time_from_start"]
            assert told["multi_dof_joint_names"] == []
        np.testing.assert_allclose(handle.told[-1]["desired"]["velocities"], 0.0)

    stand.run(live())


def test_a_goal_that_makes_no_sense_ends_with_its_code_and_leaves_the_running_one_alone(stand: Stand) -> None:
    async def live() -> None:
        first, second = Handle(), Handle()
        task = asyncio.create_task(stand.action.execute(stand.to(0.2), first))  # type: ignore[arg-type]
        await stand.until_moving()
        result = await stand.send(goal([point(HERE, 1.0)], ["a"]), second)
        assert result["error_code"] == FjtError.INVALID_JOINTS
        assert "joint_names" in result["error_string"]
        assert (second.accepted, second.status) == (True, GoalStatus.ABORTED)
        await stand.step_until(task)
        assert task.result()["error_code"] == 0

    stand.run(live())


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (
            [(0.3, 0.0), (0.4, 1.0)],
            r"points\[0\]: starts with joint.*; move there first, or give the first point a time_from_start",
        ),
        ([(9.0, 100.0)], r"points\[0\]: angle of joint1"),
        ([(0.3, 0.0)], "the only point is at time 0"),
    ],
)
def test_a_goal_that_is_no_motion_for_the_arm_is_aborted(stand: Stand, points: Any, words: str) -> None:
    async def live() -> None:
        handle = Handle()
        message = goal([point(stand.rig.home + offset, time_s) for offset, time_s in points])
        result = await stand.send(message, handle)
        assert result["error_code"] == FjtError.INVALID_GOAL
        assert re.search(words, result["error_string"]), result
        assert handle.status is GoalStatus.ABORTED
        np.testing.assert_array_equal(stand.rig.commanded[-1], stand.rig.home)

    stand.run(live())


@pytest.mark.parametrize("mode", [0, 1])
def test_a_single_point_at_time_0_is_where_the_arm_is_or_no_goal(stand: Stand, mode: int) -> None:
    """What MoveIt sends when the arm starts at its goal (moveit issue 2052)."""

    async def live() -> None:
        stand.servo.rules.fjt = FjtControl(mode=ServoMode(mode))
        result = await stand.send(stand.to(0.002, 0.0), Handle())
        assert result["error_code"] == 0, result
        np.testing.assert_allclose(stand.rig.commanded[-1], stand.rig.home + 0.002, atol=0.005)
        await stand.until_free()
        result = await stand.send(stand.to(0.3, 0.0), Handle())
        assert result["error_code"] == FjtError.INVALID_GOAL
        assert "the only point is at time 0, but joint" in result["error_string"]
        assert max(share.max() for share in stand.rig.rates()) <= 1.0 + 1e-6

    stand.run(live())


def test_too_fast_a_goal_is_slowed_down_if_it_may_be_late(stand: Stand) -> None:
    async def live() -> None:
        fast = stand.to(0.5, 0.2)
        assert (await stand.send(fast, Handle()))["error_code"] == 0
        np.testing.assert_allclose(stand.rig.commanded[-1], stand.rig.home + 0.5, atol=1e-9)
        assert max(share.max() for share in stand.rig.rates()) <= 1.0 + 1e-6
        bound = stand.to(0.0, 0.2, goal_time_tolerance=duration(0.1))
        result = await stand.send(bound, Handle())
        assert result["error_code"] == FjtError.INVALID_GOAL
        sentence = result["error_string"]
        advice = re.search(r"raise goal_time_tolerance to ([0-9.]+) s, or set it to 0", sentence)
        assert advice, sentence
        assert "its limit is" in sentence
        assert "move_to_start" not in sentence
        followed = stand.to(0.0, 0.2, goal_time_tolerance=duration(float(advice[1])))
        assert (await stand.send(followed, Handle()))["error_code"] == 0

    stand.run(live())


def test_what_is_too_heavy_for_a_drive_is_slowed_down_or_refused_by_name(
    rig: Rig, robot: RobotDescription, settings: Settings
) -> None:
    heavy = carrying(robot, Tool(mass=14.0, centre=(0.0, 0.0, 0.2)))
    stand = Stand(rig, heavy, settings, PlanningHere(heavy))
    out = np.array([*rig.home[:5], 0.5, 0.0])
    end = out + np.array([0.0, 0.0, 0.0, -0.4, 0.0, -0.3, 0.0])
    beyond = rig.home + np.array([0.0, -0.4, 0.0, 0.4, 0.0, -0.4, 0.0])

    async def live() -> None:
        held = await stand.send(goal([point(beyond, 3.0)]), Handle())
        assert held["error_code"] == FjtError.INVALID_GOAL
        assert "joint6 needs 42" in held["error_string"]
        assert "slowing down does not help" in held["error_string"]
        assert (await stand.send(goal([point(out, 3.0)]), Handle()))["error_code"] == 0
        late = await stand.send(goal([point(end, 0.8)], goal_time_tolerance=duration(0.1)), Handle())
        assert late["error_code"] == FjtError.INVALID_GOAL
        assert "joint6 needs 45" in late["error_string"]
        slowed = await stand.send(goal([point(end, 0.8)]), Handle())
        assert slowed["error_code"] == 0
        assert "joint6 needs 45" in slowed["error_string"]
        assert 1.3 < stand.link.state().path_duration_s < 1.45

    try:
        stand.run(live())
    finally:
        stand.close()


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_what_moveit_plans_without_jerk_takes_its_time_and_the_result_says_what_was_smoothed(
    stand: Stand, robot: RobotDescription, share: float
) -> None:
    """MoveIt's execution monitor gives up what takes longer than 1.2 times as planned and 0.5 s."""

    async def live() -> None:
        goal_joints = stand.rig.home + 0.3
        limits = stand.rig.limits
        line = np.array([stand.rig.home, stand.rig.home + np.eye(7)[0] * 0.2, goal_joints])
        rows = totg(line, share * limits.max_velocity, share * limits.max_acceleration, 0.1)
        times_s, *columns = np.split(rows, [1, 8, 15], axis=1)
        columns[0][0, 0] += 1e-5
        columns[1][[0, -1]] = 0.0
        sent = zip(columns[0], times_s[:, 0], *columns[1:], strict=True)
        message = goal([point(*each) for each in sent])
        begun_s, handle = stand.clock.now_s(), Handle()
        result = await stand.send(message, handle)
        taken_s, planned_s = stand.clock.now_s() - begun_s, float(times_s[-1, 0])
        assert (result["error_code"], handle.status) == (0, GoalStatus.SUCCEEDED), result
        assert taken_s < 1.2 * planned_s + 0.5
        motion_s = stand.link.state().path_duration_s
        assert motion_s <= (1.2 if share == 1.0 else 1.05) * planned_s
        said = result["error_string"]
        assert "1.0e-05 rad away from the first point; this is blended out within" in said
        assert "rad from the curve through the points" in said
        assert ("takes" in said) == (motion_s > 1.002 * planned_s), said
        np.testing.assert_allclose(stand.rig.commanded[-1], goal_joints, atol=1e-9)
        assert max(share.max() for share in stand.rig.rates()) <= 1.0 + 1e-6

    stand.run(live())


def test_a_corridor_leaves_half_of_each_tolerance_to_the_arm(robot: RobotDescription) -> None:
    made = read(
        goal(
            [point(HERE, 1.0)],
            goal_tolerance=[tolerance("joint2", 0.0004), tolerance("joint3", 0.5)],
            path_tolerance=[tolerance("joint5", 0.0006)],
        ),
        robot.limits,
    )
    expected = [0.001, 0.0002, 0.001, 0.001, 0.0003, 0.001, 0.001]
    np.testing.assert_allclose(made.corridor_rad(0.001), expected)


def test_a_cancelled_goal_comes_to_rest_on_its_path(stand: Stand) -> None:
    async def live() -> None:
        handle = Handle()
        task = asyncio.create_task(stand.action.execute(stand.to(0.4, 4.0), handle))  # type: ignore[arg-type]
        await stand.until_moving()
        handle.cancel_requested.set()
        await stand.step_until(task)
        assert handle.status is GoalStatus.CANCELED
        assert task.result()["error_code"] == FjtError.INTERRUPTED
        assert "cancelled: the arm stopped on its path" in task.result()["error_string"]
        offsets = np.array(stand.rig.commanded) - stand.rig.home
        assert 0.001 < offsets[-1].max() < 0.4
        np.testing.assert_allclose(offsets, offsets[:, :1].repeat(7, axis=1), atol=1e-9)
        assert max(share.max() for share in stand.rig.rates()) <= 1.0 + 1e-6
        assert stand.ownership.owner is None

    stand.run(live())


def test_a_newer_goal_preempts_and_begins_where_the_arm_came_to_rest(stand: Stand) -> None:
    async def live() -> None:
        first, second, third = Handle(), Handle(), Handle()
        running = asyncio.create_task(stand.action.execute(stand.to(0.4, 4.0), first))  # type: ignore[arg-type]
        await stand.until_moving()
        elsewhere = goal([point(stand.rig.home + 0.4, 0.0), point(stand.rig.home, 3.0)])
        refused = await stand.send(elsewhere, second)
        assert running.done()
        assert first.status is GoalStatus.ABORTED
        assert running.result()["error_code"] == FjtError.INTERRUPTED
        assert "preempted by a newer goal" in running.result()["error_string"]
        assert refused["error_code"] == FjtError.INVALID_GOAL  # it begins where the arm is not
        assert (await stand.send(stand.to(0.0), third))["error_code"] == 0
        np.testing.assert_allclose(stand.rig.commanded[-1], stand.rig.home, atol=1e-9)

    stand.run(live())


def test_of_three_goals_the_newest_is_followed(stand: Stand) -> None:
    async def live() -> None:
        handles = [Handle() for _ in range(3)]
        tasks = []
        for handle, offset in zip(handles, (0.1, 0.2, 0.3), strict=True):
            work = stand.action.execute(stand.to(offset), handle)  # type: ignore[arg-type]
            tasks.append(asyncio.create_task(work))
            await asyncio.sleep(0.05)
        await stand.step_until(*tasks)
        assert [handle.status for handle in handles] == [
            GoalStatus.ABORTED,
            GoalStatus.ABORTED,
            GoalStatus.SUCCEEDED,
        ]
        np.testing.assert_allclose(stand.rig.commanded[-1], stand.rig.home + 0.3, atol=1e-9)

    stand.run(live())


def test_an_arm_off_its_path_is_stopped(stand: Stand) -> None:
    async def live() -> None:
        handle = Handle()
        message = stand.to(0.4, 4.0, path_tolerance=[tolerance("joint3", 0.01)])
        task = asyncio.create_task(stand.action.execute(message, handle))  # type: ignore[arg-type]
        await stand.until_moving()
        for _ in range(40):  # not at once: no arm jumps
            stand.rig.loopback.offset[2] += 0.0005
            await asyncio.sleep(0.002)
        await stand.step_until(task)
        assert task.result()["error_code"] == FjtError.PATH_TOLERANCE_VIOLATED, task.result()
        assert "joint3 is off by" in task.result()["error_string"]
        assert "path_tolerance" in task.result()["error_string"]
        assert handle.status is GoalStatus.ABORTED
        assert stand.rig.commanded[-1][0] < stand.rig.home[0] + 0.4

    stand.run(live())


def test_an_arm_that_is_not_in_time_is_stopped(stand: Stand) -> None:
    """The motion goes on at a hundredth of its speed, so that it cannot be in time."""

    async def live() -> None:
        await stand.ownership.speed_override.set_fraction(0.01)
        result = await stand.send(stand.to(0.4, 1.5, goal_time_tolerance=duration(0.1)), Handle())
        assert result["error_code"] == FjtError.GOAL_TOLERANCE_VIOLATED
        assert "goal_time_tolerance (0.1 s)" in result["error_string"]

    stand.run(live())


def test_an_arm_that_arrives_beside_the_goal_violates_its_tolerance(stand: Stand) -> None:
    async def live() -> None:
        message = stand.to(
            0.1, goal_tolerance=[tolerance("joint2", 0.0005)], goal_time_tolerance=duration(0.3)
        )
        task = asyncio.create_task(stand.action.execute(message, Handle()))  # type: ignore[arg-type]
        await stand.until_moving()
        stand.rig.loopback.offset[1] = 0.0008  # less than what counts as arrived
        await stand.step_until(task)
        assert task.result()["error_code"] == FjtError.GOAL_TOLERANCE_VIOLATED
        assert "joint2 is off by 0.0008 rad, allowed: 0.0005" in task.result()["error_string"]

    stand.run(live())


def test_a_stop_interrupts_the_goal(stand: Stand) -> None:
    async def live() -> None:
        handle = Handle()
        task = asyncio.create_task(stand.action.execute(stand.to(0.4, 4.0), handle))  # type: ignore[arg-type]
        await stand.until_moving()
        stand.ownership.stop()
        await stand.step_until(task)
        assert task.result()["error_code"] == FjtError.INTERRUPTED
        assert "POST /stop" in task.result()["error_string"]
        assert handle.status is GoalStatus.ABORTED

    stand.run(live())


def test_a_stamp_ahead_is_waited_for_and_can_be_cancelled(stand: Stand) -> None:
    async def live() -> None:
        begin_s = stand.clock.wall_ns() * 1e-9 + 1.0
        task = asyncio.create_task(stand.action.execute(stand.to(0.1, stamp=begin_s), Handle()))  # type: ignore[arg-type]
        await stand.until_moving()
        assert stand.clock.wall_ns() * 1e-9 >= begin_s
        await stand.step_until(task)
        assert task.result()["error_code"] == 0
        handle = Handle()
        far = stand.to(0.2, stamp=stand.clock.wall_ns() * 1e-9 + 300.0)
        task = asyncio.create_task(stand.action.execute(far, handle))  # type: ignore[arg-type]
        while stand.ownership.owner is None:
            await asyncio.sleep(0.001)
        handle.cancel_requested.set()
        await stand.step_until(task)
        assert handle.status is GoalStatus.CANCELED

    stand.run(live())


@pytest.mark.parametrize("mode", [0, 1, 5])
@pytest.mark.parametrize("how", ["stop", "estop"])
def test_a_stop_ends_a_goal_that_waits_for_its_stamp(stand: Stand, how: str, mode: int) -> None:
    async def live() -> None:
        await stand.send(stand.to(0.02, 0.5), Handle())  # now the planner's process is there
        at, stand.servo.rules.fjt = stand.rig.commanded[-1], FjtControl(mode=ServoMode(mode))
        handle = Handle()
        soon = stand.to(0.2, stamp=stand.clock.wall_ns() * 1e-9 + 1.5)
        task = asyncio.create_task(stand.action.execute(soon, handle))  # type: ignore[arg-type]
        for _ in range(100):  # until it is planned
            await asyncio.sleep(0.001)
        if how == "stop":
            stand.link.request_stop()
            stand.ownership.stop()
            await asyncio.sleep(0.01)
            assert stand.ownership.owner is None  # at once, not when the stamp comes
        else:
            stand.link.request_estop()
            await asyncio.sleep(0.05)
            reset = asyncio.create_task(stand.link.commands.reset(1.0))
            await stand.step_until(reset)
            reset.result()
        await stand.step_until(task)
        assert task.result()["error_code"] == FjtError.INTERRUPTED
        assert "stop" in task.result()["error_string"]
        np.testing.assert_array_equal(stand.rig.commanded[-1], at)

    stand.run(live())


def test_who_has_nothing_to_do_with_the_goal_refuses_it(stand: Stand) -> None:
    async def live() -> None:
        handle = Handle()
        other = Caller("POST /robot/move/joints", None, 0, 60.0, asyncio.Event())
        with stand.ownership.claim(other), pytest.raises(ConflictError, match="POST /robot/move/joints"):
            await stand.action.execute(stand.to(0.1), handle)  # type: ignore[arg-type]
        stand.servo.rules.fjt = FjtControl(enable=False)
        with pytest.raises(ConflictError, match="switched off"):
            await stand.action.execute(stand.to(0.1), handle)  # type: ignore[arg-type]
        stand.servo.rules.fjt = FjtControl()
        stand.rig.request("estops")
        await asyncio.sleep(0.01)
        with pytest.raises(NotReadyError, match="ESTOP"):
            await stand.action.execute(stand.to(0.1), handle)  # type: ignore[arg-type]
        assert not handle.accepted

    stand.run(live())


# As a servo session


@pytest.mark.parametrize("mode", [1, 2, 3, 4, 5])
def test_with_an_fjt_mode_the_points_of_a_servo_session_follow_the_same_curve(
    stand: Stand, mode: int
) -> None:
    async def live() -> None:
        stand.servo.rules.fjt = FjtControl(mode=ServoMode(mode), send_period_s=0.02)
        handle = Handle()
        result = await stand.send(stand.to(0.05, 1.0), handle)
        assert result["error_code"] == 0, result
        assert handle.status is GoalStatus.SUCCEEDED
        assert handle.told
        np.testing.assert_allclose(stand.rig.commanded[-1], stand.rig.home + 0.05, atol=0.006)
        assert stand.servo.feedback()["points_accepted"] > 10
        await stand.until_free()
        assert max(share.max() for share in stand.rig.rates()) <= 1.0 + 1e-6

    stand.run(live())


def test_a_cancelled_servo_session_comes_to_rest(stand: Stand) -> None:
    async def live() -> None:
        stand.servo.rules.fjt = FjtControl(mode=ServoMode.REPLANNED)
        handle = Handle()
        task = asyncio.create_task(stand.action.execute(stand.to(0.4, 5.0), handle))  # type: ignore[arg-type]
        while len(handle.told) < 5:
            await asyncio.sleep(0.005)
        handle.cancel_requested.set()
        await stand.step_until(task)
        assert handle.status is GoalStatus.CANCELED
        await stand.until_free()
        assert 0.0 < np.abs(stand.rig.commanded[-1] - stand.rig.home).max() < 0.4
        assert max(share.max() for share in stand.rig.rates()) <= 1.0 + 1e-6

    stand.run(live())


def test_nobody_else_puts_points_into_the_servo_session_of_a_goal(stand: Stand) -> None:
    async def live() -> None:
        stand.servo.rules.fjt = FjtControl(mode=ServoMode.REPLANNED)
        handle = Handle()
        task = asyncio.create_task(stand.action.execute(stand.to(0.05, 1.0), handle))  # type: ignore[arg-type]
        while not handle.told:
            await asyncio.sleep(0.005)
        foreign = (stand.rig.home - 0.5).tolist()
        stand.servo.receive(json.dumps({"point_id": 1, "position": foreign}))
        with pytest.raises(InputError, match="accepts only points of follow_joint_trajectory"):
            await stand.servo.point(foreign)
        assert stand.servo.feedback()["refused"] == {"session_id": 2}
        await stand.step_until(task)
        assert task.result()["error_code"] == 0
        assert (np.array(stand.rig.commanded) >= stand.rig.home - 1e-3).all()

    stand.run(live())


def test_a_servo_session_that_somebody_ends_interrupts_the_goal(stand: Stand) -> None:
    async def live() -> None:
        stand.servo.rules.fjt = FjtControl(mode=ServoMode.REPLANNED)
        handle = Handle()
        task = asyncio.create_task(stand.action.execute(stand.to(0.4, 5.0), handle))  # type: ignore[arg-type]
        while not handle.told:
            await asyncio.sleep(0.005)
        stand.servo.receive('{"type": "servo_control", "command": "stop"}')
        await stand.step_until(task)
        assert handle.status is GoalStatus.ABORTED
        assert task.result()["error_code"] == FjtError.INTERRUPTED
        assert "stopped by servo_control" in task.result()["error_string"]

    stand.run(live())


def test_a_curve_beyond_the_limits_is_no_servo_session(stand: Stand) -> None:
    async def live() -> None:
        stand.servo.rules.fjt = FjtControl(mode=ServoMode.REPLANNED)
        result = await stand.send(stand.to(3.5, 10.0), Handle())
        assert result["error_code"] == FjtError.INVALID_GOAL
        assert not stand.servo.active
        assert stand.servo.feedback()["points_received"] == 0

    stand.run(live())
