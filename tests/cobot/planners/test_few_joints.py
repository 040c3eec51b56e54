"""Arms with five and fewer joints, free axes, and arms without shapes.

Oracle: the TCP by the product of the joints' turns, in numpy (`few_joint_arms`).
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import few_joint_arms
import numpy as np
import pytest
from few_joint_arms import DOWN, FIVE, FOUR, ROLLING, SCARA, SEVEN, SIX, Chain
from scipy.spatial.transform import Rotation

from cobot.errors import InputError, UnreachableError
from cobot.motions.planners import PLANNERS
from cobot.motions.requests import Arc, MotionRequest
from cobot.planners import plan
from cobot.planners.explain import explain
from cobot.planners.forecast import forecast
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.trajectory import Trajectory
from cobot.types import FREE_AXES, Array, PlannerName, Pose, Scaling

NEAR_M, NEAR_RAD = 5e-5, np.radians(0.01)
ROUNDING = 1.001
FULL = Scaling(1.0)
BENT = np.array([0.3, 0.4, 0.8, 0.2, 0.6])
SHORT_ARMS = {"five": FIVE, "rolling": ROLLING, "four": FOUR, "scara": SCARA}


def pose_at(chain: Chain, joints: Array) -> Pose:
    place, turn = chain.tcp(joints)
    return Pose(place, Rotation.from_matrix(turn).as_quat(scalar_first=True))


def written(pose: Pose, digits: int) -> Pose:
    """As a client reads it and writes it down."""
    angles = np.round(pose.abc, digits).tolist()
    return Pose.from_abc(*np.round(pose.position, digits).tolist(), *angles)


def apart(chain: Chain, joints: Array, pose: Pose) -> tuple[float, float]:
    """m and rad between the TCP and a pose."""
    place, turn = chain.tcp(joints)
    wanted = Rotation.from_quat(pose.quaternion, scalar_first=True)
    angle = (Rotation.from_matrix(turn).inv() * wanted).magnitude()
    return float(np.linalg.norm(place - pose.position)), float(angle)


def tilt(chain: Chain, joints: Array, pose: Pose, axis: int = 2) -> float:
    """Rad between an axis of the tool and that of a pose."""
    turn = chain.tcp(joints)[1][:, axis]
    wanted = Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix()[:, axis]
    return float(np.arctan2(np.linalg.norm(np.cross(turn, wanted)), turn @ wanted))


def moved(robot: RobotDescription, request: MotionRequest) -> Trajectory:
    trajectory = plan(robot, request)
    assert trajectory is not None
    return trajectory


@pytest.mark.parametrize("name", SHORT_ARMS)
@pytest.mark.parametrize("planner", [PlannerName.PTP, PlannerName.LIN])
def test_a_pose_that_was_read_from_the_arm_and_rounded_to_four_digits_is_reached(
    name: str, planner: PlannerName
) -> None:
    chain, robot = SHORT_ARMS[name], few_joint_arms.robot_of(SHORT_ARMS[name], radius_m=None)
    random, reached = np.random.default_rng(26), 0
    for _ in range(40):
        joints = random.uniform(-1.3, 1.3, len(chain.axes))
        goal = written(pose_at(chain, joints), 4)
        distance_m, angle_rad = apart(chain, joints, goal)
        if distance_m > NEAR_M or angle_rad > NEAR_RAD:
            continue  # Rounded along a diagonal, by up to 0.087 mm.
        reached += 1
        trajectory = plan(robot, MotionRequest(joints, goal, planner, FULL))
        end = joints if trajectory is None else trajectory.end
        distance_m, angle_rad = apart(chain, end, goal)
        assert distance_m <= ROUNDING * NEAR_M
        assert angle_rad <= ROUNDING * NEAR_RAD
        assert np.abs(end - joints).max() < 0.02
    assert reached > 15


def test_a_pose_further_away_than_the_tolerance_is_refused_with_its_cause_and_enough_digits() -> None:
    robot = few_joint_arms.robot_of(FIVE)
    here = pose_at(FIVE, BENT)
    for beside_rad in (3e-4, 1e-3, 0.1):
        turn = Rotation.from_rotvec([0.0, 0.0, beside_rad]) * Rotation.from_quat(
            here.quaternion, scalar_first=True
        )
        goal = Pose(here.position, turn.as_quat(scalar_first=True))
        for planner in (PlannerName.PTP, PlannerName.LIN, PlannerName.OMPL):
            with pytest.raises(UnreachableError, match="it has five joints") as caught:
                plan(robot, MotionRequest(BENT, goal, planner, FULL))
            said = str(caught.value)
            assert "this arm cannot turn its tool about the tool's" in said
            numbers = re.findall(r"([\d.e+-]+) (?:mm|degrees)", said)
            assert max(map(float, numbers[:2])) > 0.01


def test_what_works_instead_is_a_free_axis() -> None:
    robot, start = few_joint_arms.robot_of(FIVE), np.array([0.0, 0.5, 1.0, 0.0, 1.0])
    request = MotionRequest(start, Pose(np.array([0.4, 0.15, 0.25]), DOWN), PlannerName.PTP, FULL)
    with pytest.raises(UnreachableError, match=r'free_axes \["rz"\]') as caught:
        plan(robot, request)
    works = explain(robot, request, caught.value, 5.0).works
    change = next(remedy.change for remedy in works if remedy.kind == "free_axes")
    assert change == {"free_axes": ("rz",)}
    moved(robot, replace(request, **change))


@pytest.mark.parametrize("planner", [PlannerName.PTP, PlannerName.OMPL, PlannerName.CHOMP, PlannerName.AUTO])
@pytest.mark.parametrize("chain", [FIVE, ROLLING, FOUR, SIX, SEVEN], ids=["5", "5 rolling", "4", "6", "7"])
def test_with_a_free_axis_the_tool_points_down_anywhere(chain: Chain, planner: PlannerName) -> None:
    robot = few_joint_arms.robot_of(chain, radius_m=0.01)
    start = np.resize([0.2, 0.5, 0.9, 0.1, 0.7], len(chain.axes))
    for x, y in ((0.3, 0.1), (0.25, -0.2)):
        goal = Pose(np.array([x, y, 0.15]), DOWN)
        request = MotionRequest(start, goal, planner, FULL, free_axes=("rz",))
        end = moved(robot, request).end
        assert np.linalg.norm(chain.tcp(end)[0] - goal.position) < 1e-8
        assert tilt(chain, end, goal) < 1e-8


@pytest.mark.parametrize("chain", [FIVE, ROLLING, FOUR, SIX, SEVEN], ids=["5", "5 rolling", "4", "6", "7"])
def test_paths_with_a_free_axis_keep_to_the_path_and_to_the_direction_of_the_tool(chain: Chain) -> None:
    robot = few_joint_arms.robot_of(chain, radius_m=0.01)
    first, second = Pose(np.array([0.3, 0.1, 0.15]), DOWN), Pose(np.array([0.3, -0.1, 0.2]), DOWN)
    third = Pose(np.array([0.35, -0.05, 0.15]), DOWN)
    near = np.resize([0.2, 0.5, 0.9, 0.1, 0.7], len(chain.axes))
    start = inverse(robot.model, first, near, free=("rz",))
    line = MotionRequest(start, second, PlannerName.LIN, FULL, free_axes=("rz",))
    trajectory = moved(robot, line)
    way = second.position - first.position
    for joints in trajectory.sample(np.linspace(0.0, trajectory.duration_s, 200)):
        away = chain.tcp(joints)[0] - first.position
        assert np.linalg.norm(away - (away @ way) / (way @ way) * way) < NEAR_M
        assert tilt(chain, joints, first) < NEAR_RAD
    polyline = replace(line, planner=PlannerName.POLYLINE, through=(third,), radius_m=0.01)
    arc = replace(line, planner=PlannerName.CIRC, via=np.array([0.32, 0.01, 0.16]))
    for request in (polyline, arc):
        trajectory = moved(robot, request)
        assert np.linalg.norm(chain.tcp(trajectory.end)[0] - second.position) < 1e-6
        for joints in trajectory.sample(np.linspace(0.0, trajectory.duration_s, 100)):
            assert tilt(chain, joints, first) < NEAR_RAD


def test_where_all_rotations_are_free_the_position_alone_counts() -> None:
    robot = few_joint_arms.robot_of(SCARA)
    goal = Pose(np.array([0.2, 0.35, 0.1]), Rotation.from_rotvec([0.3, 1.0, 2.0]).as_quat(scalar_first=True))
    with pytest.raises(UnreachableError, match="it has three joints"):
        plan(robot, MotionRequest(np.zeros(3), goal, PlannerName.PTP, FULL))
    end = moved(robot, MotionRequest(np.zeros(3), goal, PlannerName.PTP, FULL, free_axes=FREE_AXES)).end
    assert np.linalg.norm(SCARA.tcp(end)[0] - goal.position) < 1e-8


def test_a_goal_that_differs_in_what_is_free_alone_needs_no_motion() -> None:
    robot = few_joint_arms.robot_of(ROLLING)
    here = pose_at(ROLLING, BENT)
    turn = Rotation.from_quat(here.quaternion, scalar_first=True) * Rotation.from_rotvec([0.0, 0.0, 1.2])
    goal = Pose(here.position, turn.as_quat(scalar_first=True))
    for planner in (PlannerName.PTP, PlannerName.LIN):
        assert plan(robot, MotionRequest(BENT, goal, planner, FULL, free_axes=("rz",))) is None


@pytest.mark.parametrize(
    ("free", "said"),
    [
        (("c",), r"free_axes\[0\]: there is no axis 'c'; valid names: rx, ry, rz"),
        (("rz", "rz"), r"free_axes\[1\]: rz is given twice"),
        (("rx", "rz"), "free_axes: rx and rz together already allow every orientation"),
    ],
)
def test_free_axes_that_mean_nothing_are_refused(free: tuple[str, ...], said: str) -> None:
    robot = few_joint_arms.robot_of(FIVE)
    request = MotionRequest(BENT, pose_at(FIVE, BENT), PlannerName.PTP, FULL)
    with pytest.raises(InputError, match=said):
        plan(robot, replace(request, free_axes=free))  # type: ignore[arg-type]


@pytest.mark.parametrize("limit_rad", [2.9, 2.0 * np.pi])
def test_a_path_that_ends_at_a_limit_names_the_joint_and_its_limit(limit_rad: float) -> None:
    """The hand turns about its own axis; it begins at the limit, and a little before it."""
    robot = few_joint_arms.robot_of(SIX, limit_rad)
    for before_rad in (0.0, 0.05):
        start = np.array([0.2, 0.3, 0.5, 0.4, 0.7, limit_rad - before_rad])
        here = pose_at(SIX, start)
        turn = Rotation.from_quat(here.quaternion, scalar_first=True) * Rotation.from_rotvec([0.0, 0.0, 0.3])
        goal = Pose(here.position, turn.as_quat(scalar_first=True))
        said = f"joint6 reaches its limit of {limit_rad:.4f} rad"
        with pytest.raises(UnreachableError, match=said) as caught:
            plan(robot, MotionRequest(start, goal, PlannerName.LIN, FULL))
        assert caught.value.findings[0].check == "limit"
        assert caught.value.findings[0].of == ("joint6",)


def test_a_goal_that_only_a_limit_keeps_from_being_reached_names_the_joint() -> None:
    robot = few_joint_arms.robot_of(SCARA, 1.0)
    with pytest.raises(
        UnreachableError,
        match=r"joint3 would have to go to 1\.2 rad, "
        r"but its limit is 1 rad",
    ):
        plan(
            robot,
            MotionRequest(np.zeros(3), pose_at(SCARA, np.array([0.5, 0.9, 1.2])), PlannerName.PTP, FULL),
        )


@pytest.mark.parametrize("planner", list(PlannerName))
@pytest.mark.parametrize("chain", [FIVE, SEVEN], ids=["5", "7"])
def test_an_arm_without_shapes_is_planned_for_and_forecast(chain: Chain, planner: PlannerName) -> None:
    robot = few_joint_arms.robot_of(chain, radius_m=None)
    assert robot.collision.pairs == []
    start = np.resize([0.1, 0.5, 0.8, 0.2, 0.6], len(chain.axes))
    goal = pose_at(chain, start + np.resize([0.02, -0.05, 0.06], len(chain.axes)))
    values: dict[str, Any] = {
        "arc": Arc(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.2),
        "through": (pose_at(chain, start + 0.02),),
    }
    needs = PLANNERS[planner].needs
    given = {name: values[name] for name in needs if name in values}
    assert bool(given) == bool(needs)
    request = MotionRequest(start, goal, planner, FULL, free_axes=FREE_AXES, **given)
    found = forecast(robot, request, 5)
    assert found.trajectory is not None
    assert found.closest_self is None
    assert found.closest_environment is None
