"""lin and circ. Oracle: pinocchio's TCP along dense samples, against a line, a circle and scipy's Slerp."""

from __future__ import annotations

import re

import numpy as np
import pytest
from independent_models import largest_rates, rate_limits, second_robot
from scipy.spatial.transform import Rotation, Slerp

from cobot.errors import InputError, PlanningError, UnreachableError
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

SEED = 20261121
SAMPLES = 400
DEVIATION_M = 5e-5
DEVIATION_RAD = np.radians(0.01)
FULL = Scaling(1.0)


def pose_of(joints: Array) -> Pose:
    """By pinocchio."""
    position, turn = second_robot().forward(joints)
    return Pose(position, Rotation.from_matrix(turn).as_quat(scalar_first=True))


def orientation(pose: Pose) -> Rotation:
    return Rotation.from_quat(pose.quaternion, scalar_first=True)


def moved(pose: Pose, across: Array, turn: Array) -> Pose:
    """A pose further on by a vector and a rotation vector."""
    return Pose(
        pose.position + across, (Rotation.from_rotvec(turn) * orientation(pose)).as_quat(scalar_first=True)
    )


def work(robot: RobotDescription) -> Array:
    return np.array(robot.positions["work"].joints)


def planned(
    robot: RobotDescription, start: Array, goal: Pose, scaling: Scaling = FULL, via: Array | None = None
) -> Trajectory:
    planner = PlannerName.LIN if via is None else PlannerName.CIRC
    trajectory = plan(robot, MotionRequest(start, goal, planner, scaling, via))
    assert trajectory is not None
    return trajectory


def tcp_path(trajectory: Trajectory) -> tuple[Array, Rotation]:
    """By pinocchio."""
    return second_robot().path(trajectory.sample(np.linspace(0.0, trajectory.duration_s, SAMPLES)))


def require_slerp(turns: Rotation, shares: Array, start: Pose, goal: Pose) -> None:
    """The orientation is that of a slerp at the share of the way that the position has made."""
    ends = Rotation.concatenate([orientation(start), orientation(goal)])
    expected = Slerp([0.0, 1.0], ends)(np.clip(shares, 0.0, 1.0))
    assert (expected.inv() * turns).magnitude().max() <= DEVIATION_RAD


def require_line(trajectory: Trajectory, start: Pose, goal: Pose) -> None:
    positions, turns = tcp_path(trajectory)
    across = goal.position - start.position
    shares = (positions - start.position) @ across / (across @ across)
    beside = positions - start.position - shares[:, None] * across
    assert np.linalg.norm(beside, axis=1).max() <= DEVIATION_M
    assert shares.min() > -1e-6
    assert shares.max() < 1.0 + 1e-6
    assert np.diff(shares).min() > -1e-6, "goes back"
    require_slerp(turns, shares, start, goal)
    assert positions[-1] == pytest.approx(goal.position, abs=1e-6)
    assert (orientation(goal).inv() * turns[-1]).magnitude() < 1e-6


def test_lin_stays_on_the_line_and_turns_evenly(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED)
    tries, found = 40, 0
    for _ in range(tries):
        joints = work(robot) + random.uniform(-0.3, 0.3, 7)
        start = pose_of(joints)
        goal = moved(start, random.uniform(-0.2, 0.2, 3), random.uniform(-0.4, 0.4, 3))
        scaling = Scaling(random.uniform(0.1, 1.0))
        try:
            motion = planned(robot, joints, goal, scaling)
        except PlanningError as exc:
            assert re.match(r"lin: at \d+ % of the path", str(exc)), exc  # noqa: PT017 - either outcome is good
            continue
        found += 1
        require_line(motion, start, goal)
    assert found >= 0.8 * tries


@pytest.mark.parametrize("turn", [(0.0, 0.0, 1.5), (0.0, 0.0, -1.5), (0.4, 0.0, 0.0), (0.2, -0.3, 0.5)])
def test_lin_turns_in_place(robot: RobotDescription, turn: tuple[float, float, float]) -> None:
    start = pose_of(work(robot))
    motion = planned(robot, work(robot), moved(start, np.zeros(3), np.array(turn)))
    positions, turns = tcp_path(motion)
    assert np.linalg.norm(positions - start.position, axis=1).max() <= DEVIATION_M
    made = (turns * orientation(start).inv()).as_rotvec()
    axis = np.array(turn) / np.linalg.norm(turn)
    assert np.linalg.norm(made - np.outer(made @ axis, axis), axis=1).max() <= DEVIATION_RAD
    assert made[-1] == pytest.approx(turn, abs=1e-6)


@pytest.mark.parametrize("distance_m", [2e-5, 2e-4, 1e-3, 0.01])
def test_lin_goes_the_smallest_ways_too(robot: RobotDescription, distance_m: float) -> None:
    start = pose_of(work(robot))
    goal = moved(start, np.array([0.0, distance_m, 0.0]), np.zeros(3))
    positions, _ = tcp_path(planned(robot, work(robot), goal))
    assert positions[-1] == pytest.approx(goal.position, abs=1e-6)


def test_lin_and_circ_start_and_end_at_rest(robot: RobotDescription) -> None:
    start = pose_of(work(robot))
    goal = moved(start, np.array([0.0, 0.2, 0.1]), np.zeros(3))
    for via in (None, start.position + np.array([0.05, 0.1, 0.0])):
        motion = planned(robot, work(robot), goal, FULL, via)
        assert motion.start == pytest.approx(work(robot), abs=1e-12)
        for derivative in (1, 2):
            ends = motion.sample([0.0, motion.duration_s], derivative)
            assert ends == pytest.approx(np.zeros((2, 7)), abs=1e-9)


@pytest.mark.parametrize("speed", [0.05, 0.4, 1.0])
def test_the_tcp_and_the_joints_keep_their_limits(robot: RobotDescription, speed: float) -> None:
    start = pose_of(work(robot))
    across, turn = np.array([0.05, 0.4, 0.1]), np.array([0.0, 0.0, 0.6])
    via = start.position + np.array([0.05, 0.2, 0.05])
    limits = robot.cartesian_limits
    for planner in ("lin", "circ"):
        scaling = Scaling(speed)
        goal = moved(start, across, turn)
        request = MotionRequest(
            work(robot), goal, PlannerName(planner), scaling, via if planner == "circ" else None
        )
        motion = plan(robot, request)
        assert motion is not None
        used = largest_rates(motion) / rate_limits(request.scaled_limits(robot))
        assert used.max() <= 1.0 + 1e-5
        times = np.linspace(0.0, motion.duration_s, SAMPLES)
        twists = np.array(
            [
                second_robot().jacobian(joints) @ velocity
                for joints, velocity in zip(motion.sample(times), motion.sample(times, 1), strict=True)
            ]
        )
        assert np.linalg.norm(twists[:, :3], axis=1).max() <= 1.01 * speed * limits.max_linear_velocity
        assert np.linalg.norm(twists[:, 3:], axis=1).max() <= 1.01 * speed * limits.max_angular_velocity


@pytest.mark.parametrize("across", [(0.0, 0.3, 0.0), (-0.2, 0.0, 0.0), (0.0, 0.0, 0.3)])
def test_a_long_slow_line_uses_what_the_tcp_or_a_joint_may(
    robot: RobotDescription, across: tuple[float, float, float]
) -> None:
    goal = moved(pose_of(work(robot)), np.array(across), np.zeros(3))
    request = MotionRequest(work(robot), goal, PlannerName.LIN, Scaling(0.1))
    motion = plan(robot, request)
    assert motion is not None
    times = np.linspace(0.0, motion.duration_s, SAMPLES)
    speeds = [
        float(np.linalg.norm((second_robot().jacobian(joints) @ velocity)[:3]))
        for joints, velocity in zip(motion.sample(times), motion.sample(times, 1), strict=True)
    ]
    of_the_tcp = max(speeds) / (0.1 * robot.cartesian_limits.max_linear_velocity)
    of_a_joint = (largest_rates(motion) / rate_limits(request.scaled_limits(robot)))[0].max()
    assert 0.9 < max(of_the_tcp, of_a_joint) <= 1.0 + 1e-5


def test_lin_out_of_reach_says_at_what_percentage_and_which_joint(robot: RobotDescription) -> None:
    # Straight out at the shoulder's height: the wrist, 0.126 m above the flange, is 0.82 m away at the most.
    start = pose_of(np.array([0.0, 0.6, 0.0, -1.4, 0.0, np.pi - 2.0, 0.0]))
    joints = np.array([0.0, 0.6, 0.0, -1.4, 0.0, np.pi - 2.0, 0.0])
    across = np.array([0.5, 0.0, 0.0])
    with pytest.raises(UnreachableError) as caught:
        planned(robot, joints, moved(start, across, np.zeros(3)))
    pattern = r"lin: at (\d+) % of the path the TCP cannot continue: .*with (joint\d) turning"
    found = re.match(pattern, str(caught.value))
    assert found, caught.value
    assert found[2] == "joint4"
    rise = start.position[2] + 0.126 - 0.36
    leaves = 100.0 * (np.sqrt(0.82**2 - rise**2) - start.position[0]) / 0.5
    assert leaves - 1.0 <= float(found[1]) <= leaves + 100.0 / 24.0 + 1.0


def test_lin_into_a_joints_limit_says_at_what_percentage_which_joint_and_limit(
    robot: RobotDescription,
) -> None:
    joints = work(robot)
    joints[6] = 2.9
    pose = pose_of(joints)
    with pytest.raises(UnreachableError, match=r"at \d+ % of the path joint7 reaches its limit of 3\.05"):
        planned(robot, joints, moved(pose, np.zeros(3), np.array([0.0, 0.0, -2.5])))


def test_lin_to_the_stretched_elbow_slows_down_and_beyond_it_is_refused(robot: RobotDescription) -> None:
    # Up along the axis until the arm is straight: joint 4 turns without bound by the way of the TCP.
    joints = np.array([0.0, 0.3, 0.0, -0.6, 0.0, 0.3, 0.0])
    start = pose_of(joints)
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    top = Pose(np.array([0.0, 0.0, 1.306]), upright)
    motion = planned(robot, joints, top)
    require_line(motion, start, top)
    assert motion.duration_s < 3.0
    beyond = Pose(np.array([0.0, 0.0, 1.32]), upright)
    with pytest.raises(PlanningError, match=r"^lin: at \d+ % of the path"):
        planned(robot, joints, beyond)


def circle_through(*points: Array) -> tuple[Array, float, Array]:
    """Centre, radius and unit normal, by least squares from the definition of a circle."""
    first, second, third = points
    normal = np.cross(second - first, third - first)
    normal /= np.linalg.norm(normal)
    rows = np.array([2 * (second - first), 2 * (third - first), normal])
    right = np.array([second @ second - first @ first, third @ third - first @ first, normal @ first])
    centre = np.linalg.lstsq(rows, right, rcond=None)[0]
    return centre, float(np.linalg.norm(first - centre)), normal


def require_arc(trajectory: Trajectory, start: Pose, via: Array, goal: Pose) -> None:
    positions, turns = tcp_path(trajectory)
    centre, radius, normal = circle_through(start.position, via, goal.position)
    assert np.abs(np.linalg.norm(positions - centre, axis=1) - radius).max() <= DEVIATION_M
    assert np.abs((positions - centre) @ normal).max() <= DEVIATION_M
    x = (start.position - centre) / radius
    y = np.cross(normal, x)
    angles = np.unwrap(np.arctan2((positions - centre) @ y, (positions - centre) @ x))
    at_via = np.arctan2((via - centre) @ y, (via - centre) @ x) % (2 * np.pi)
    assert angles[0] < at_via < angles[-1] < 2 * np.pi, "via lies on the way, which is no more than one turn"
    assert np.diff(angles).min() > -1e-6, "goes back"
    require_slerp(turns, angles / angles[-1], start, goal)
    assert positions[-1] == pytest.approx(goal.position, abs=1e-6)


def test_circ_stays_on_the_circle_through_its_three_points(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED)
    tries, found = 30, 0
    for _ in range(tries):
        joints = work(robot) + random.uniform(-0.2, 0.2, 7)
        start = pose_of(joints)
        goal = moved(start, random.uniform(-0.12, 0.12, 3), random.uniform(-0.3, 0.3, 3))
        half = 0.5 * (goal.position - start.position)
        sideways = np.cross(half, random.normal(size=3))
        via = start.position + half + sideways / np.linalg.norm(sideways) * np.linalg.norm(half)
        try:
            motion = planned(robot, joints, goal, Scaling(random.uniform(0.1, 1.0)), via)
        except PlanningError as exc:
            assert re.match(r"circ: at \d+ % of the path", str(exc)), exc  # noqa: PT017 - either is good
            continue
        found += 1
        require_arc(motion, start, via, goal)
    assert found >= 0.8 * tries


def test_circ_goes_the_long_way_round_when_via_lies_there(robot: RobotDescription) -> None:
    start = pose_of(work(robot))
    goal = moved(start, np.array([0.0, 0.06, 0.0]), np.zeros(3))
    via = start.position + np.array([0.1, 0.03, 0.0])
    motion = planned(robot, work(robot), goal, FULL, via)
    require_arc(motion, start, via, goal)
    positions, _ = tcp_path(motion)
    length = np.linalg.norm(np.diff(positions, axis=0), axis=1).sum()
    assert length > 0.2


@pytest.mark.parametrize(
    ("via", "goal", "message"),
    [
        ((0.0, 0.1, 0.0), (0.0, 0.2, 0.0), "circ: start, via and goal are on one line; use lin"),
        ((0.0, 0.3, 0.0), (0.0, 0.2, 0.0), "circ: start, via and goal are on one line; use lin"),
        ((0.0, -0.1, 0.0), (0.0, 0.2, 0.0), "circ: start, via and goal are on one line; use lin"),
        ((0.0, 0.0, 0.0), (0.0, 0.2, 0.0), r"circ: via and the start are 0\.00 mm apart"),
        ((0.1, 0.1, 0.0), (0.0, 0.0, 0.0), r"circ: the goal and the start are 0\.00 mm apart"),
        ((0.0, 0.2, 0.0), (0.0, 0.2, 0.0005), r"circ: via and the goal are 0\.50 mm apart"),
    ],
)
def test_points_that_make_no_circle_are_refused(
    robot: RobotDescription, via: tuple[float, float, float], goal: tuple[float, float, float], message: str
) -> None:
    start = pose_of(work(robot))
    with pytest.raises(PlanningError, match=message):
        planned(robot, work(robot), moved(start, np.array(goal), np.zeros(3)), FULL, start.position + via)


def test_circ_out_of_reach_says_at_what_percentage_of_the_arc(robot: RobotDescription) -> None:
    start = pose_of(work(robot))
    goal = moved(start, np.array([0.6, 0.6, 0.0]), np.zeros(3))
    with pytest.raises(UnreachableError, match=r"^circ: at \d+ % of the path .*joint\d"):
        planned(robot, work(robot), goal, FULL, start.position + np.array([0.5, 0.1, 0.0]))


def test_a_via_is_three_numbers_for_circ_only(robot: RobotDescription) -> None:
    goal = moved(pose_of(work(robot)), np.array([0.0, 0.1, 0.0]), np.zeros(3))
    with pytest.raises(InputError, match="via: is missing; planner circ needs a point on its arc"):
        plan(robot, MotionRequest(work(robot), goal, PlannerName.CIRC, FULL))
