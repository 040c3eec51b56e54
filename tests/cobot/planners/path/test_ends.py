"""Paths that end in the joints they began with, and lines that end in joints that are given.

Oracles: pinocchio's kinematics of the iiwa, and the product of the joints' turns in numpy for the small arms
(`few_joint_arms`).
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise

import few_joint_arms
import numpy as np
import pytest
from few_joint_arms import FIVE, SEVEN, SIX, Chain
from planner_sentences import only
from scipy.spatial.transform import Rotation

from benchmarks.arms import SHIPPED, arm
from benchmarks.stress.judge import Judge
from cobot.errors import InputError, LimitError, PlanningError, UnreachableError
from cobot.motions.requests import Arc, MotionRequest
from cobot.planners import plan
from cobot.planners.explain import explain
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_limits
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

NEAR_M, NEAR_RAD = 5e-5, np.radians(0.01)
TIMES = 1000
FULL = Scaling(1.0)
BENT = np.array([0.2, 0.5, -0.3, -1.3, 0.4, 0.9, 0.1])
NOWHERE = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
Tcp = Callable[[Array], tuple[Array, Array]]


@pytest.fixture(scope="module")
def iiwa() -> tuple[RobotDescription, Tcp]:
    given = arm(SHIPPED)
    return given.robot, Judge(given, given.robot).tcp


def moved(robot: RobotDescription, request: MotionRequest) -> Trajectory:
    trajectory = plan(robot, request)
    assert trajectory is not None
    return trajectory


def at(tcp: Tcp, joints: Array) -> Pose:
    place, turn = tcp(joints)
    return Pose(place, Rotation.from_matrix(turn).as_quat(scalar_first=True))


def circle(start: Array, tcp: Tcp, radius_m: float, turns: float = 1.0) -> MotionRequest:
    """About the base's z axis through a point beside the TCP."""
    centre = tcp(start)[0] + np.array([-radius_m, 0.0, 0.0])
    arc = Arc(centre, np.array([0.0, 0.0, 1.0]), 2.0 * np.pi * turns)
    return MotionRequest(start, NOWHERE, PlannerName.CIRC, FULL, arc=arc)


def require_circle(tcp: Tcp, request: MotionRequest, trajectory: Trajectory) -> None:
    """The TCP keeps to the circle, and its orientation."""
    assert request.arc is not None
    first, turn = tcp(request.start)
    radius_m = np.linalg.norm(first - request.arc.centre)
    for joints in trajectory.sample(np.linspace(0.0, trajectory.duration_s, 100)):
        place, rotation = tcp(joints)
        away = place - request.arc.centre
        assert abs(np.linalg.norm(away[:2]) - radius_m) < NEAR_M
        assert abs(away[2]) < NEAR_M
        assert Rotation.from_matrix(turn.T @ rotation).magnitude() < NEAR_RAD


def square(tcp: Tcp, start: Array) -> tuple[Pose, ...]:
    """Three corners beside the TCP; the fourth is where it is."""
    here = at(tcp, start)
    ways = ((0.0, 0.12, 0.0), (0.0, 0.12, 0.1), (0.0, 0.0, 0.1))
    return tuple(Pose(here.position + np.array(way), here.quaternion) for way in ways)


def require_lines(tcp: Tcp, corners: list[Array], trajectory: Trajectory, within_m: float = NEAR_M) -> None:
    """The TCP keeps to the lines between the corners, visits each, and keeps its orientation."""
    samples = trajectory.sample(np.linspace(0.0, trajectory.duration_s, 400))
    places, turns = (np.array(each) for each in zip(*(tcp(joints) for joints in samples), strict=True))
    away = []
    for begin, end in pairwise(corners):
        way = end - begin
        share = np.clip((places - begin) @ way / (way @ way), 0.0, 1.0)
        away.append(np.linalg.norm(places - begin - share[:, None] * way, axis=1))
    assert np.min(away, axis=0).max() < within_m
    visited = [np.linalg.norm(places - corner, axis=1).min() for corner in corners]
    assert max(visited) < max(within_m, 1e-3), "samples are up to a millimetre apart there"
    assert Rotation.from_matrix(turns[0].T @ turns).magnitude().max() < NEAR_RAD


def test_a_full_circle_ends_in_the_joints_it_began_with_and_one_that_need_not_does_not(
    iiwa: tuple[RobotDescription, Tcp],
) -> None:
    robot, tcp = iiwa
    request = circle(BENT, tcp, 0.12)
    trajectory = moved(robot, request)
    assert np.abs(trajectory.end - BENT).max() < 1e-9
    assert trajectory.note == ""
    require_circle(tcp, request, trajectory)
    drifted = moved(robot, replace(request, cyclic=False))
    assert np.abs(drifted.end - BENT).max() > 1e-3


@pytest.mark.parametrize("kind", ["circle", "polyline", "round polyline", "there and back"])
def test_a_plan_runs_a_thousand_times_and_ends_where_it_began(
    iiwa: tuple[RobotDescription, Tcp], kind: str
) -> None:
    """The end of one run is the start of the next: the same plan, moved by what it misses."""
    robot, tcp = iiwa
    here = at(tcp, BENT)
    match kind:
        case "circle":
            plans = [moved(robot, circle(BENT, tcp, 0.1))]
        case "there and back":
            there = Pose(here.position + np.array([-0.1, 0.15, -0.1]), here.quaternion)
            line = MotionRequest(BENT, there, PlannerName.LIN, FULL)
            first = moved(robot, line)
            back = replace(line, start=first.end, goal=here, end_joints=BENT)
            plans = [first, moved(robot, back)]
        case _:
            radius_m = 0.03 if kind == "round polyline" else 0.0
            request = MotionRequest(BENT, here, PlannerName.POLYLINE, FULL, through=square(tcp, BENT))
            plans = [moved(robot, replace(request, radius_m=radius_m, cyclic=True))]
    joints = BENT.copy()
    for _ in range(TIMES):
        for each in plans:
            joints = joints + (each.end - each.start)
    assert np.abs(joints - BENT).max() < 1e-6
    for each in plans:
        check_limits(each, robot.limits)
        robot.collision.check_trajectory(each)
    match kind:
        case "circle":
            require_circle(tcp, circle(BENT, tcp, 0.1), plans[0])
        case "there and back":
            ends = [here.position, there.position]
            require_lines(tcp, ends, plans[0])
            require_lines(tcp, ends[::-1], plans[1])
        case _:
            corners = [here.position, *(pose.position for pose in square(tcp, BENT)), here.position]
            require_lines(tcp, corners, plans[0], max(radius_m, NEAR_M))


def test_a_circle_that_is_planned_anew_from_each_end_does_not_drift(
    iiwa: tuple[RobotDescription, Tcp],
) -> None:
    robot, tcp = iiwa
    joints = BENT
    for _ in range(30):
        joints = moved(robot, replace(circle(BENT, tcp, 0.08), start=joints)).end
    assert np.abs(joints - BENT).max() < 30.0 / TIMES * 1e-6


def test_random_circles_that_are_possible_are_closed(iiwa: tuple[RobotDescription, Tcp]) -> None:
    robot, tcp = iiwa
    random = np.random.default_rng(26)
    closed = 0
    for _ in range(25):
        start = BENT + random.uniform(-0.5, 0.5, 7)
        if not robot.collision.is_free(start):
            continue
        request = circle(start, tcp, float(random.uniform(0.03, 0.15)))
        try:
            moved(robot, replace(request, cyclic=False))
        except PlanningError:
            continue
        trajectory = moved(robot, replace(request, cyclic=True))
        assert np.abs(trajectory.end - start).max() < 1e-9
        require_circle(tcp, request, trajectory)
        closed += 1
    assert closed > 8


def test_a_circle_at_a_limit_turns_its_elbow_and_still_ends_where_it_began(
    iiwa: tuple[RobotDescription, Tcp],
) -> None:
    """The way of the nearest joints leads the sixth one beyond this limit."""
    robot, tcp = iiwa
    request = circle(BENT, tcp, 0.1)
    simple = moved(robot, request)
    rows = simple.sample(np.linspace(0.0, simple.duration_s, 400))
    joint = int((rows.max(axis=0) - BENT).argmax())
    high = robot.limits.max_position.copy()
    high[joint] = BENT[joint] + 0.6 * (rows[:, joint].max() - BENT[joint])
    before = deepcopy(robot.limits)
    robot.limits.take_over(replace(robot.limits, max_position=high))
    try:
        trajectory = moved(robot, replace(request, cyclic=True))
    finally:
        robot.limits.take_over(before)
    rows = trajectory.sample(np.linspace(0.0, trajectory.duration_s, 400))
    assert rows[:, joint].max() <= high[joint] + 1e-9
    assert np.abs(trajectory.end - BENT).max() < 1e-9
    require_circle(tcp, request, trajectory)


@pytest.mark.parametrize("chain", [SEVEN, SIX, FIVE], ids=["offset wrist", "six", "five"])
def test_arms_without_an_arm_angle_repeat_too(chain: Chain) -> None:
    robot = few_joint_arms.robot_of(chain, radius_m=0.01)
    start = np.resize([0.2, 0.4, 1.2, 0.9, 0.6, 0.7, 0.2], len(chain.axes))
    here = at(chain.tcp, start)
    free = ("rz",) if chain is FIVE else ()
    way = Pose(here.position + np.array([0.02, -0.03, 0.03]), here.quaternion)
    request = MotionRequest(
        start, here, PlannerName.POLYLINE, FULL, through=(way,), free_axes=free, cyclic=True
    )
    trajectory = moved(robot, request)
    assert np.abs(trajectory.end - start).max() < 1e-9
    turning = replace(circle(start, chain.tcp, 0.04), free_axes=free)
    assert np.abs(moved(robot, turning).end - start).max() < 1e-9


def test_a_circle_that_turns_a_joint_once_round_is_possible_but_does_not_end_where_it_began() -> None:
    """A six-axis arm about its first axis: nothing but that joint can turn, and it cannot turn back."""
    robot = few_joint_arms.robot_of(SIX, 4.0)
    start = np.array([-3.2, 0.6, 0.5, 0.3, 0.6, 0.2])
    arc = Arc(np.zeros(3), np.array([0.0, 0.0, 1.0]), 2.0 * np.pi, turns_tool=True)
    request = MotionRequest(start, NOWHERE, PlannerName.CIRC, FULL, arc=arc)
    trajectory = moved(robot, request)
    assert trajectory.end[0] == pytest.approx(start[0] + 2.0 * np.pi, abs=1e-6)
    assert trajectory.note.startswith(
        "the motion does not end in the joints in which it began: circ: the path"
    )
    with pytest.raises(UnreachableError, match=r"joint1 at 3\.0832 rad instead of -3\.2000 rad"):
        plan(robot, replace(request, cyclic=True))


@pytest.mark.parametrize("turns", [1.0, 6.2832 / (2.0 * np.pi), 6.28319 / (2.0 * np.pi), -2.0])
def test_an_angle_that_a_client_has_rounded_is_a_full_circle(
    iiwa: tuple[RobotDescription, Tcp], turns: float
) -> None:
    robot, tcp = iiwa
    assert np.abs(moved(robot, circle(BENT, tcp, 0.05, turns)).end - BENT).max() < 1e-9


def test_a_polyline_to_a_pose_that_was_rounded_is_closed(iiwa: tuple[RobotDescription, Tcp]) -> None:
    """Rounded to four digits: up to 0.087 mm from where the TCP is."""
    robot, tcp = iiwa
    here = at(tcp, BENT)
    goal = Pose(here.position + np.array([5e-5, -5e-5, 5e-5]), here.quaternion)
    request = MotionRequest(BENT, goal, PlannerName.POLYLINE, FULL, through=square(tcp, BENT), cyclic=True)
    assert np.abs(moved(robot, request).end - BENT).max() < 1e-9


def test_a_path_that_does_not_lead_back_is_refused_with_the_distance_and_what_to_do(
    iiwa: tuple[RobotDescription, Tcp],
) -> None:
    robot, tcp = iiwa
    here = at(tcp, BENT)
    goal = Pose(here.position + np.array([0.0, 0.2, 0.0]), here.quaternion)
    said = r"cyclic: the path of lin ends 200 mm and 0 degrees from where it begins, allowed: 0\.1 mm"
    with pytest.raises(PlanningError, match=said) as caught:
        plan(robot, MotionRequest(BENT, goal, PlannerName.LIN, FULL, cyclic=True))
    assert "end_joints" in str(caught.value)
    assert caught.value.findings[0].value == pytest.approx(0.2, abs=1e-9)
    half = replace(circle(BENT, tcp, 0.1, 0.5), cyclic=True)
    with pytest.raises(PlanningError, match="cyclic: the path of circ ends 200 mm"):
        plan(robot, half)


def test_end_joints_that_do_not_fit_are_refused(iiwa: tuple[RobotDescription, Tcp]) -> None:
    robot, tcp = iiwa
    here = at(tcp, BENT)
    goal = Pose(here.position + np.array([0.0, 0.1, 0.0]), here.quaternion)
    line = MotionRequest(BENT, goal, PlannerName.LIN, FULL)
    with pytest.raises(PlanningError, match="end_joints: their pose is 100 mm and 0 degrees from the goal"):
        plan(robot, replace(line, end_joints=BENT))
    with pytest.raises(LimitError, match="end_joints: the angle of joint2 is 9 rad"):
        plan(robot, replace(line, end_joints=np.array([0.0, 9.0, 0.0, 0.0, 0.0, 0.0, 0.0])))
    with pytest.raises(InputError, match="cyclic, end_joints: give one of them"):
        plan(robot, replace(line, end_joints=BENT, cyclic=True))
    for change, name in (({"cyclic": True}, "cyclic"), ({"end_joints": BENT}, "end_joints")):
        with pytest.raises(InputError, match=f"{name}: {only(name, 'ptp')}"):
            plan(robot, replace(line, planner=PlannerName.PTP, **change))


def test_what_works_where_a_path_cannot_end_in_its_joints_is_another_end() -> None:
    robot = few_joint_arms.robot_of(SIX, 4.0)
    start = np.array([-3.2, 0.6, 0.5, 0.3, 0.6, 0.2])
    arc = Arc(np.zeros(3), np.array([0.0, 0.0, 1.0]), 2.0 * np.pi, turns_tool=True)
    request = MotionRequest(start, NOWHERE, PlannerName.CIRC, FULL, arc=arc, cyclic=True)
    with pytest.raises(UnreachableError) as caught:
        plan(robot, request)
    works = explain(robot, request, caught.value, 5.0).works
    assert "end" in {remedy.kind for remedy in works}
