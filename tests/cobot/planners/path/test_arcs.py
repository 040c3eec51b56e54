"""Arcs about a centre, full circles, helices and polylines. Oracle: pinocchio's TCP, circles chosen first."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from independent_models import largest_rates, rate_limits, second_robot
from planner_sentences import only
from scipy.spatial.transform import Rotation

from cobot.errors import InputError, PlanningError
from cobot.motions.requests import Arc, TcpSpeed
from cobot.planners import MotionRequest, plan
from cobot.planners.path.joint_path import MAX_DEVIATION_M, MAX_DEVIATION_RAD
from cobot.planners.path.polyline import rounded
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

FULL = Scaling(1.0)
ANY = TcpSpeed()
Z = np.array([0.0, 0.0, 1.0])


def work(robot: RobotDescription) -> tuple[Array, Pose]:
    joints = np.array(robot.positions["work"].joints)
    return joints, robot.model.forward(joints)


def circ(robot: RobotDescription, arc: Arc, goal: Pose | None = None, **more: object) -> Trajectory:
    joints, here = work(robot)
    request = MotionRequest(joints, goal or here, PlannerName.CIRC, FULL, arc=arc, **more)  # type: ignore[arg-type]
    motion = plan(robot, request)
    assert motion is not None
    assert (largest_rates(motion) / rate_limits(robot.limits)).max() <= 1.0 + 1e-6
    return motion


def tcp(motion: Trajectory, samples: int = 600) -> tuple[Array, Rotation]:
    return second_robot().path(motion.sample(np.linspace(0.0, motion.duration_s, samples)))


@pytest.mark.parametrize(("turns", "rise_m"), [(1.0, 0.0), (-1.0, 0.0), (2.5, 0.1), (-0.3, -0.05)])
def test_circles_and_helices_turn_about_their_axis_and_rise_evenly(
    robot: RobotDescription, turns: float, rise_m: float
) -> None:
    _, here = work(robot)
    centre, angle = here.position + np.array([-0.08, 0.0, 0.3]), 2.0 * np.pi * turns
    motion = circ(robot, Arc(centre, Z, angle, rise_m))
    positions, turned = tcp(motion)
    flat = positions[:, :2] - centre[:2]
    assert np.abs(np.linalg.norm(flat, axis=1) - 0.08).max() <= MAX_DEVIATION_M
    angles = np.unwrap(np.arctan2(flat[:, 1], flat[:, 0]))
    assert angles[-1] - angles[0] == pytest.approx(angle, abs=1e-5)
    assert (np.diff(angles) * turns).min() > -1e-9, "goes back"
    rise = here.position[2] + rise_m * (angles - angles[0]) / angle
    assert np.abs(positions[:, 2] - rise).max() <= MAX_DEVIATION_M
    assert (turned[0].inv() * turned).magnitude().max() <= MAX_DEVIATION_RAD


def test_the_hand_turns_with_the_arc_where_that_is_asked_for(robot: RobotDescription) -> None:
    _, here = work(robot)
    motion = circ(robot, Arc(here.position + np.array([-0.1, 0.0, 0.0]), Z, 1.2, turns_tool=True))
    _, turned = tcp(motion)
    assert (turned[-1] * turned[0].inv()).as_rotvec() == pytest.approx([0.0, 0.0, 1.2], abs=1e-5)


def test_a_centre_and_a_goal_make_the_short_arc_and_with_an_axis_the_one_by_the_right_hand(
    robot: RobotDescription,
) -> None:
    _, here = work(robot)
    centre = here.position + np.array([-0.1, 0.0, 0.0])
    goal = Pose(centre + 0.1 * np.array([0.0, 1.0, 0.0]), here.quaternion)
    for axis, angle in ((None, 0.5 * np.pi), (Z, 0.5 * np.pi), (-Z, 1.5 * np.pi)):
        positions, _ = tcp(circ(robot, Arc(centre, axis), goal))
        assert np.linalg.norm(np.diff(positions, axis=0), axis=1).sum() == pytest.approx(
            0.1 * angle, rel=1e-4
        )
        assert positions[-1] == pytest.approx(goal.position, abs=1e-6)


@pytest.mark.parametrize(
    ("centre", "axis", "angle", "goal", "message"),
    [
        (
            (-0.1, 0, 0),
            None,
            None,
            (-0.1, 0.12, 0),
            r"start is 100\.00 mm from the centre, and the goal 120\.00",
        ),
        ((-0.1, 0, 0), None, None, (-0.2, 0, 0), "on one line; send an axis"),
        ((-0.1, 0, 0), (1, 0, 0), None, (-0.1, 0.1, 0), r"the start is 100\.00 mm outside the plane"),
        ((0, 0, 0.1), (0, 0, 1), 1.0, None, r"the TCP is 0\.00 mm from the axis"),
        ((-0.1, 0, 0), None, 1.0, None, "axis: is missing"),
    ],
)
def test_what_makes_no_arc_is_refused(
    robot: RobotDescription,
    centre: tuple[float, ...],
    axis: tuple[float, ...] | None,
    angle: float | None,
    goal: tuple[float, ...] | None,
    message: str,
) -> None:
    _, here = work(robot)
    end = None if goal is None else Pose(here.position + goal, here.quaternion)
    arc = Arc(here.position + centre, None if axis is None else np.array(axis, dtype=float), angle)
    with pytest.raises(PlanningError, match=message):
        circ(robot, arc, end)


def polyline(robot: RobotDescription, radius_m: float, speed: TcpSpeed = ANY) -> tuple[Trajectory, Array]:
    joints, here = work(robot)
    ways = np.array([[0.0, 0.1, 0.0], [0.0, 0.1, 0.15], [-0.1, -0.05, 0.15]])
    poses = [Pose(here.position + way, here.quaternion) for way in ways]
    request = MotionRequest(
        joints,
        poses[-1],
        PlannerName.POLYLINE,
        FULL,
        through=tuple(poses[:-1]),
        radius_m=radius_m,
        tcp_speed=speed,
    )
    motion = plan(robot, request)
    assert motion is not None
    return motion, here.position + np.concatenate([np.zeros((1, 3)), ways])


def test_a_polyline_stops_at_its_corners_or_goes_round_them_within_the_radius(
    robot: RobotDescription,
) -> None:
    stopping, corners = polyline(robot, 0.0)
    flowing, _ = polyline(robot, 0.03)
    assert flowing.duration_s < 0.85 * stopping.duration_s
    for motion, radius_m in ((stopping, 0.0), (flowing, 0.03)):
        positions, _ = tcp(motion)
        nearest = np.full(len(positions), np.inf)
        for begin, end in pairwise(corners):
            way = end - begin
            share = np.clip((positions - begin) @ way / (way @ way), 0.0, 1.0)
            nearest = np.minimum(nearest, np.linalg.norm(positions - begin - share[:, None] * way, axis=1))
        away = np.linalg.norm(positions[:, None] - corners[None, 1:-1], axis=2).min(axis=1)
        assert (nearest <= MAX_DEVIATION_M)[away > radius_m + MAX_DEVIATION_M].all()
        assert nearest.max() <= max(radius_m, MAX_DEVIATION_M)
        assert positions[-1] == pytest.approx(corners[-1], abs=1e-6)


def test_a_round_polyline_is_twice_continuously_differentiable() -> None:
    random = np.random.default_rng(7)
    poses = [Pose(random.normal(size=3), random.normal(size=4)) for _ in range(5)]
    path = rounded(poses, 0.3)
    rows = path.poses(np.linspace(0.0, 1.0, 200_001))
    second = np.diff(rows, 2, axis=0) * 200_000.0**2
    assert np.abs(np.diff(second, axis=0)).max() < 2e-2 * np.abs(second).max()


def test_the_tcp_keeps_the_speed_in_metres_per_second(robot: RobotDescription) -> None:
    motion, _ = polyline(robot, 0.03, TcpSpeed(0.1, 0.5))
    times = np.linspace(0.0, motion.duration_s, 400)
    twists = robot.model.chain.twists(motion.sample(times), motion.sample(times, 1))
    speeds = np.linalg.norm(twists[:, :3], axis=1)
    assert 0.098 < speeds.max() <= 0.1 * (1.0 + 2e-3)
    assert np.median(speeds) > 0.097


@pytest.mark.parametrize("speed", [TcpSpeed(1.5), TcpSpeed(None, 2.5), TcpSpeed(0.0)])
def test_a_speed_beyond_the_limit_is_refused_by_name(robot: RobotDescription, speed: TcpSpeed) -> None:
    with pytest.raises(InputError, match=r"speed_(m|rad)_s: is .* allowed: above 0 and up to [12] "):
        polyline(robot, 0.03, speed)
    joints, here = work(robot)
    with pytest.raises(InputError, match=only("tcp_speed", "ptp")):
        plan(robot, MotionRequest(joints, here, PlannerName.PTP, FULL, tcp_speed=TcpSpeed(0.1)))
