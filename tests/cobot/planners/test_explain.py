"""The facts of errors, and what is said to work.

Oracles: the numbers that a motion was asked for with, MuJoCo's mj_geomDistance, the trajectory's own samples;
what works is planned again. tests/app/api/routers/test_explain.py asks for it over REST.
"""

from __future__ import annotations

import pickle
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from cobot_run import WAIT_S
from franka_settings import franka_settings
from independent_models import MJCF

from cobot.errors import CollisionError, LimitError, PlanningError, UnreachableError
from cobot.findings import Finding
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.explain import explain
from cobot.robot.collision import geom_pairs
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.feasibility import check_efforts, check_limits
from cobot.robot.inverse_kinematics.reach import row_of
from cobot.robot.scene import Scene, SceneObject
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, PlannerName, Pose, Scaling

FULL = Scaling(1.0)
THROUGH_THE_FLOOR = (
    np.array([-1.0, -2.1, -1.4, 1.8, -0.6, -1.3, 1.9]),
    np.array([-2.0, -0.5, 2.7, 1.4, -2.2, -1.4, -2.7]),
)


def home(robot: RobotDescription) -> Array:
    return np.array(robot.positions["home"].joints)


def request(start: Array, goal: Array | Pose, planner: str = "ptp", scaling: Scaling = FULL) -> MotionRequest:
    return MotionRequest(start, goal, PlannerName(planner), scaling)


def refused(robot: RobotDescription, asked: MotionRequest) -> PlanningError | LimitError:
    with pytest.raises((PlanningError, LimitError)) as caught:
        plan(robot, asked)
    return caught.value


def test_facts_come_through_a_pickle_and_through_other_words() -> None:
    found = Finding("limit", "position", 9.0, 2.97, "rad", 1.0, ("joint1",))
    error = UnreachableError("it is far", findings=[found])
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.findings) == (UnreachableError, "it is far", (found,))
    assert again.with_message("motion 2: it is far").findings == (found,)
    assert found.excess == pytest.approx(6.03)


def test_a_goal_beyond_limits_says_each_joint_and_the_nearest_goal_works(robot: RobotDescription) -> None:
    goal = home(robot)
    goal[0], goal[2] = 3.5, -3.0
    asked = request(home(robot), goal)
    error = refused(robot, asked)
    assert [(f.check, f.of, f.value, f.limit, f.share) for f in error.findings] == [
        ("limit", ("joint1",), 3.5, 2.97, 1.0),
        ("limit", ("joint3",), -3.0, -2.97, 1.0),
    ]
    works = {each.kind: each for each in explain(robot, asked, error, WAIT_S).works}
    nearest = works["goal"].change["goal"]
    np.testing.assert_allclose(nearest[[0, 2]], [2.97, -2.97])
    np.testing.assert_array_equal(np.delete(nearest, [0, 2]), np.delete(goal, [0, 2]))


def test_a_collision_says_which_pair_where_and_how_near(robot: RobotDescription) -> None:
    start, goal = THROUGH_THE_FLOOR
    asked = request(start, goal)
    error = refused(robot, asked)
    assert isinstance(error, CollisionError)
    model = mujoco.MjModel.from_xml_path(str(MJCF))
    data = mujoco.MjData(model)
    # What was to be run: the same motion where nothing is looked at.
    with robot.collision.keeping(-10.0):
        trajectory = plan(robot, asked)
    assert trajectory is not None
    for found in error.findings:
        assert found.share is not None
        data.qpos[:] = trajectory.sample([found.share * trajectory.duration_s])[0]
        mujoco.mj_kinematics(model, data)
        least_m = min(mujoco.mj_geomDistance(model, data, *pair, 1.0, None) for pair in geom_pairs(model))
        assert found.value == pytest.approx(least_m, abs=2e-3)
        assert found.limit == robot.collision.margin_m
    works = {each.kind: each for each in explain(robot, asked, error, WAIT_S).works}
    assert works["planner"].change["planner"] is PlannerName.AUTO


def test_what_nothing_can_help_says_what_was_tried(robot: RobotDescription) -> None:
    far = Pose(np.array([3.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0]))
    asked = MotionRequest(home(robot), far, PlannerName.POLYLINE, FULL, through=(far,))
    found = explain(robot, asked, refused(robot, asked), WAIT_S)
    assert found.works == ()


def test_out_of_reach_says_by_how_much_and_the_nearest_goal_works(robot: RobotDescription) -> None:
    far = Pose(np.array([1.5, 0.0, 0.5]), np.array([0.0, 0.0, 1.0, 0.0]))
    asked = request(home(robot), far)
    error = refused(robot, asked)
    by = {found.quantity: found.excess for found in error.findings}
    assert 0.3 < by["distance beyond the reach"] < 0.9
    works = {each.kind: each for each in explain(robot, asked, error, WAIT_S).works}
    nearest = works["goal"].change["goal"]
    assert np.linalg.norm(nearest.position - far.position) >= by["distance beyond the reach"] - 0.02


def test_a_line_that_ends_on_its_way_says_where_and_works_up_to_there(robot: RobotDescription) -> None:
    here = robot.model.forward(home(robot))
    far = Pose(here.position + np.array([0.6, 0.0, 0.0]), here.quaternion)
    asked = request(home(robot), far, "lin")
    error = refused(robot, asked)
    share = error.findings[0].share
    assert share is not None
    works = {each.kind: each for each in explain(robot, asked, error, WAIT_S).works}
    shorter = works["goal"].change["goal"]
    gone = (shorter.position - here.position)[0] / 0.6
    assert 0.15 * share < gone < share


def test_nothing_is_tried_without_time(robot: RobotDescription) -> None:
    asked = request(*THROUGH_THE_FLOOR)
    found = explain(robot, asked, refused(robot, asked), 0.0)
    assert (found.works, found.tried) == ((), ())


def test_a_rate_beyond_its_limit_says_the_share_of_the_motion(robot: RobotDescription) -> None:
    positions = np.tile(home(robot), (3, 1))
    positions[1, 0], positions[2, 0] = 0.1, 0.9
    velocities = np.zeros((3, 7))
    velocities[1, 0] = 0.2
    motion = from_hermite(np.array([0.0, 0.5, 1.0]), positions, velocities, np.zeros((3, 7)))
    with pytest.raises(LimitError, match=r"its limit is .*, at \d+ % of the motion$") as caught:
        check_limits(motion, robot.limits)
    (found,) = caught.value.findings
    times = np.linspace(0.0, 1.0, 200_001)
    order = ("position", "velocity", "acceleration", "jerk").index(found.quantity)
    rates = np.abs(motion.sample(times, order)[:, 0])
    limit = (robot.limits.max_velocity, robot.limits.max_acceleration, robot.limits.max_jerk)[order - 1][0]
    assert (found.check, found.of, found.limit) == ("limit", ("joint1",), pytest.approx(limit))
    assert found.share is not None
    assert abs(found.value) <= rates.max() + 1e-9
    at = np.abs(motion.sample([found.share - 1e-12], order)[0, 0])
    assert at == pytest.approx(abs(found.value), rel=0.05)


def test_an_effort_beyond_its_limit_says_where_and_how_much(robot: RobotDescription) -> None:
    positions = np.tile(home(robot), (2, 1))
    positions[1, 0] = 2.0
    motion = from_hermite(np.array([0.0, 0.08]), positions, np.zeros((2, 7)), np.zeros((2, 7)))
    with pytest.raises(LimitError) as caught:
        check_efforts(robot.model, motion, robot.limits)
    (found,) = caught.value.findings
    assert found.check == "effort"
    assert found.share is not None
    joint = robot.limits.names.index(found.of[0])
    rows = [motion.sample([found.share * motion.duration_s], order) for order in range(3)]
    needed = robot.model.dynamics.inverse(*rows)[0, joint]
    assert found.value == pytest.approx(abs(needed))
    assert found.limit == robot.limits.max_effort[joint]


def test_an_acceleration_of_all_but_nothing_works_with_more(robot: RobotDescription) -> None:
    goal = home(robot)
    goal[0] = 0.5
    asked = request(home(robot), goal, scaling=Scaling(0.5, 1e-12))
    found = explain(robot, asked, refused(robot, asked), WAIT_S)
    assert [each.kind for each in found.works] == ["faster"]


def test_a_start_beyond_a_limit_that_cannot_be_left_says_why(robot: RobotDescription) -> None:
    """The straight way back within the limits leads through the floor."""
    random, limits = np.random.default_rng(5), robot.limits
    said: list[PlanningError] = []
    for _ in range(4000):
        start = random.uniform(limits.min_position, limits.max_position)
        start[1] = limits.max_position[1] + 1.0
        inside = np.clip(start, limits.min_position, limits.max_position)
        if not robot.collision.is_free(inside) or robot.collision.is_free(start):
            continue
        try:
            plan(robot, request(start, home(robot), "auto"))
        except PlanningError as exc:
            if "straight way back" in str(exc):
                said.append(exc)
                break
    (error,) = said
    assert str(error).startswith("the start: joint2 is 1.0000 rad beyond its limit")
    assert error.findings[0].check == "collision"


def test_a_line_on_which_the_flange_touches_a_table_is_planned_from_no_other_start(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No start can help, because the flange is at the same place from every start."""
    here = robot.model.forward(home(robot))
    place = (here.position[0], here.position[1], 0.35, 1.0, 0.0, 0.0, 0.0)
    scene = Scene(1, {"table": SceneObject("box", (0.4, 0.4, 0.02), place)})
    robot = replace(robot, collision=robot.collision.among(scene))
    down = Pose(here.position * (1.0, 1.0, 0.0) + (0.0, 0.0, 0.355), here.quaternion)
    asked = request(home(robot), down, "lin")
    error = refused(robot, asked)
    starts = []

    def counted(robot: RobotDescription, changed: MotionRequest) -> Trajectory | None:
        starts.append(changed.start)
        return plan(robot, changed)

    monkeypatch.setattr("cobot.planners.explain.plan", counted)
    tried = {each.kind: each for each in explain(robot, asked, error, WAIT_S).tried}
    np.testing.assert_array_equal(starts, [asked.start] * len(starts))
    assert tried["start"].count > 10
    assert re.match(r"lin: the arm at \d+ % of the path is in collision: .*table", tried["start"].why)


def test_a_goal_out_of_reach_is_searched_by_no_planner(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No planner leads there. Only the part of the line within reach is planned."""
    here = robot.model.forward(home(robot))
    asked = request(home(robot), Pose(here.position + np.array([1.5, 0.0, 0.0]), here.quaternion), "lin")
    error = refused(robot, asked)
    planners = []

    def counted(robot: RobotDescription, changed: MotionRequest) -> Trajectory | None:
        planners.append(changed.planner)
        return plan(robot, changed)

    monkeypatch.setattr("cobot.planners.explain.plan", counted)
    found = explain(robot, asked, error, WAIT_S)
    assert ([each.kind for each in found.works], planners) == (["goal"], ["lin"])
    (tried,) = found.tried
    gap_m = re.fullmatch(r"the goal is out of reach by (\S+) m", tried.why)
    assert gap_m is not None
    assert float(gap_m[1]) == pytest.approx(error.findings[0].excess, rel=1e-2)


def test_a_pose_that_no_joints_reach_is_searched_by_no_planner(monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm without a closed form: a few descents show it."""
    robot = load_robot(franka_settings())
    start = home(robot)
    here = robot.model.forward(start)
    asked = request(start, Pose(here.position + np.array([0.0, 0.0, 0.4]), here.quaternion), "lin")
    assert robot.model.inverse_kinematics.solve(row_of(asked.goal), start, 0, 0) is None
    error = refused(robot, asked)
    planners = []

    def counted(robot: RobotDescription, changed: MotionRequest) -> Trajectory | None:
        planners.append(changed.planner)
        return plan(robot, changed)

    monkeypatch.setattr("cobot.planners.explain.plan", counted)
    works = {each.kind: each for each in explain(robot, asked, error, WAIT_S).works}
    assert 0.7 < (works["goal"].change["goal"].position[2] - here.position[2]) / 0.4 < 0.8
    assert planners == ["lin"]


def test_a_line_that_something_blocks_is_planned_up_to_there_at_once(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first shorter line that is planned leads nearly to the floor, and works."""
    start = np.array(robot.positions["work"].joints)
    here = robot.model.forward(start)
    down = Pose(here.position * (1.0, 1.0, 0.0) - (0.0, 0.0, 0.3), here.quaternion)
    asked = request(start, down, "lin")
    error = refused(robot, asked)
    ends = []

    def counted(robot: RobotDescription, changed: MotionRequest) -> Trajectory | None:
        if changed.planner is PlannerName.LIN and isinstance(changed.goal, Pose):
            ends.append(changed.goal.position[2])
        return plan(robot, changed)

    monkeypatch.setattr("cobot.planners.explain.plan", counted)
    works = {each.kind: each for each in explain(robot, asked, error, WAIT_S).works}
    assert works["goal"].change["goal"].position[2] == ends[0]
    assert 0.0 < ends[0] < 0.5 * here.position[2]


def test_the_first_other_start_of_a_line_works(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lines that a joint limit ends. The oracle is the plan from each start."""
    random, limits, helped = np.random.default_rng(1), robot.limits, 0
    starts: list[Array] = []

    def counted(robot: RobotDescription, changed: MotionRequest) -> Trajectory | None:
        starts.append(changed.start)
        return plan(robot, changed)

    monkeypatch.setattr("cobot.planners.explain.plan", counted)
    while helped < 5:
        start = random.uniform(limits.min_position, limits.max_position)
        if not robot.collision.is_free(start):
            continue
        here = robot.model.forward(start)
        asked = request(start, Pose(here.position + random.normal(size=3) * 0.15, here.quaternion), "lin")
        try:
            plan(robot, asked)
            continue
        except (PlanningError, LimitError) as exc:
            error = exc
        starts.clear()
        works = {each.kind: each for each in explain(robot, asked, error, WAIT_S).works}
        if "start" in works:
            others = [each for each in starts if np.abs(each - start).max() > 0.0]
            np.testing.assert_array_equal(others, [works["start"].change["start"]])
            helped += 1
