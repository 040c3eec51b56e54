"""ompl and chomp around a post. Oracle: MuJoCo's contact list at dense samples; differences of samples."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cobot_run import WAIT_S
from few_joint_arms import Chain, Z, robot_of
from independent_models import Contacts, changed_world, largest_rates, rate_limits, robot_in

from benchmarks.planning import scenes
from cobot.errors import CollisionError, PlanningError, PlanningTimeout
from cobot.planners import MotionRequest, plan
from cobot.planners.rrt_connect import connect
from cobot.planners.search import sampling, spline
from cobot.planners.timing.path import JointCurve
from cobot.planners.timing.time_law import Timed, time_optimal
from cobot.robot.collision import RESOLUTION_M
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneObject
from cobot.trajectory import Trajectory
from cobot.types import Algorithm, Array, JointLimits, PlannerName, Pose, Scaling

SEED = 20261121
POSTS = {
    "low": (0.6, 0.0, 0.25, 0.05, 0.05, 0.25),
    "thin": (0.65, 0.0, 0.35, 0.03, 0.03, 0.35),
    "high": (0.6, 0.0, 0.5, 0.04, 0.04, 0.5),
}
AROUND = ["ompl", "chomp"]


def sides(robot: RobotDescription) -> tuple[Array, Array]:
    """The work position, turned to the left and to the right of the post."""
    left, right = np.array([robot.positions["work"].joints] * 2)
    left[0], right[0] = -0.9, 0.9
    return left, right


def planned(
    robot: RobotDescription, planner: str, start: Array, goal: Array | Pose, speed: float = 1.0
) -> Trajectory:
    trajectory = plan(
        robot, MotionRequest(start, goal, PlannerName(planner), Scaling(speed), timeout_s=WAIT_S)
    )
    assert trajectory is not None
    return trajectory


@pytest.mark.parametrize("post", POSTS)
def test_ptp_does_not_plan_around_a_post_and_says_what_it_would_hit(
    robot: RobotDescription, tmp_path: Path, post: str
) -> None:
    there = robot_in(changed_world(tmp_path, post=POSTS[post]), robot)
    with pytest.raises(CollisionError, match=r"collision of link\d and post at -?\d+ mm after \d+ %"):
        planned(there, "ptp", *sides(robot))


@pytest.mark.parametrize("planner", AROUND)
@pytest.mark.parametrize("post", POSTS)
def test_ompl_and_chomp_lead_around_a_post_without_touching_anything(
    robot: RobotDescription, tmp_path: Path, planner: str, post: str
) -> None:
    world = changed_world(tmp_path, post=POSTS[post])
    motion = planned(robot_in(world, robot), planner, *sides(robot))
    contacts = Contacts(file=world)
    straight = np.linspace(*sides(robot), 100)
    assert any(contacts.bodies(joints) for joints in straight), "the post stands in the way"
    for joints in motion.sample(np.linspace(0.0, motion.duration_s, 2000)):
        assert not contacts.bodies(joints), joints


def test_a_motion_is_proven_even_if_the_samples_of_its_path_miss_what_it_touches(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spline, "SAMPLES", 2)
    for problem in scenes.problems(robot, "shelf", 4, SEED):
        checker = problem.robot.collision
        request = MotionRequest(
            problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), seed=1, timeout_s=WAIT_S
        )
        corners = sampling.find_path(problem.robot, request, problem.goal[None])
        curve, _ = spline.smooth_curve(spline.resampled(corners, spline.FIRST_POINTS))
        on_curve = curve.at(np.linspace(0.0, 1.0, 2000))
        assert checker.clearance.distances(on_curve, 0.1).min() < checker.margin_m
        motion = spline.smooth_motion(problem.robot, corners, request.scaled_limits(problem.robot))
        in_motion = motion.sample(np.linspace(0.0, motion.duration_s, 2000))
        assert checker.clearance.distances(in_motion, 0.1).min() >= checker.margin_m - RESOLUTION_M


def test_a_path_that_cannot_be_timed_ends_the_plan_only_if_it_is_collision_free(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spline, "SAMPLES", 2)
    problem = next(scenes.problems(robot, "shelf", 1, SEED))
    clearance = problem.robot.collision.clearance
    request = MotionRequest(
        problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), seed=1, timeout_s=WAIT_S
    )
    corners = sampling.find_path(problem.robot, request, problem.goal[None])
    are_free: list[bool] = []

    def time_no_more_than(free_curves: int) -> None:
        """From now on, so many collision-free curves can be timed and no other curve."""
        are_free.clear()

        def time_or_fail(robot: RobotDescription, curve: JointCurve, limits: JointLimits) -> Timed:
            are_free.append(bool(clearance.are_free(curve.at(np.linspace(0.0, 1.0, 2000))).all()))
            if not are_free[-1] or sum(are_free) > free_curves:
                raise PlanningError("no motion along the path")
            return time_optimal(robot, curve, limits)

        monkeypatch.setattr(spline, "time_optimal", time_or_fail)

    limits = request.scaled_limits(problem.robot)
    time_no_more_than(1)
    motion = spline.smooth_motion(problem.robot, corners, limits)
    assert np.allclose(motion.end, problem.goal, rtol=0.0, atol=1e-12)
    assert are_free[0] is False
    assert are_free[-1] is True
    time_no_more_than(0)
    with pytest.raises(PlanningError, match="no motion along the path"):
        spline.smooth_motion(problem.robot, corners, limits)
    assert are_free.count(True) == 1
    assert are_free[-1] is True


@pytest.mark.parametrize("planner", AROUND)
@pytest.mark.parametrize("speed", [0.2, 1.0])
def test_their_motions_keep_the_limits_and_go_from_rest_to_rest(
    robot: RobotDescription, tmp_path: Path, planner: str, speed: float
) -> None:
    there = robot_in(changed_world(tmp_path, post=POSTS["low"]), robot)
    left, right = sides(robot)
    request = MotionRequest(left, right, PlannerName(planner), Scaling(speed), timeout_s=WAIT_S)
    motion = plan(there, request)
    assert motion is not None
    assert motion.start == pytest.approx(left, abs=1e-9)
    assert motion.end == pytest.approx(right, abs=1e-9)
    for derivative in (1, 2):
        ends = motion.sample([0.0, motion.duration_s], derivative)
        assert ends == pytest.approx(np.zeros((2, 7)), abs=1e-9)
    used = largest_rates(motion) / rate_limits(request.scaled_limits(robot))
    assert used.max() <= 1.0 + 1e-5
    positions = motion.sample(np.linspace(0.0, motion.duration_s, 2000))
    assert (positions >= robot.limits.min_position).all()
    assert (positions <= robot.limits.max_position).all()


@pytest.mark.parametrize("planner", AROUND)
def test_where_nothing_is_in_the_way_they_go_straight(robot: RobotDescription, planner: str) -> None:
    start, goal = sides(robot)
    goal += np.array([0.0, 0.1, 0.2, -0.1, 0.3, 0.1, -0.4])
    motion = planned(robot, planner, start, goal)
    way = (motion.sample(np.linspace(0.0, motion.duration_s, 300)) - start) / (goal - start)
    assert np.ptp(way, axis=1).max() < 0.01
    assert np.diff(way, axis=0).min() > -1e-6


@pytest.mark.parametrize("planner", AROUND)
def test_they_go_to_a_pose_too(robot: RobotDescription, planner: str) -> None:
    left, right = sides(robot)
    pose = robot.model.forward(right)
    end = robot.model.forward(planned(robot, planner, left, pose).end)
    assert end.position == pytest.approx(pose.position, abs=1e-6)


def test_random_pairs_that_ptp_cannot_join_are_joined_by_ompl_without_contact(
    robot: RobotDescription,
) -> None:
    random = np.random.default_rng(SEED)
    limits, contacts = robot.limits, Contacts()
    joined = tries = 0
    while tries < 6:
        start, goal = random.uniform(limits.min_position, limits.max_position, (2, limits.dof))
        if not (robot.collision.is_free(start) and robot.collision.is_free(goal)):
            continue
        try:
            planned(robot, "ptp", start, goal)
            continue
        except CollisionError:
            tries += 1
        motion = planned(robot, "ompl", start, goal)
        joined += 1
        for joints in motion.sample(np.linspace(0.0, motion.duration_s, 1000)):
            assert not contacts.bodies(joints), joints
    assert joined == tries


def wall(robot: RobotDescription, folder: Path) -> RobotDescription:
    """With no way past it near the straight line: only over it."""
    return robot_in(changed_world(folder, post=(0.75, 0.0, 0.7, 0.4, 0.02, 0.7)), robot)


def test_chomp_that_finds_nothing_names_the_bodies_and_does_not_become_another_planner(
    robot: RobotDescription, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def find_none(*_: object) -> Array:
        raise PlanningTimeout("there is none")

    monkeypatch.setattr(sampling, "find_path", find_none)
    with pytest.raises(PlanningError) as caught:
        planned(wall(robot, tmp_path), "chomp", *sides(robot))
    pattern = r"chomp found no free path near the straight line: .* still at a distance of -?\d+ mm; try ompl"
    assert re.match(pattern, str(caught.value))
    assert re.search(r"after \d+ % of the path link\d and post are still at", str(caught.value))


def test_chomp_that_finds_nothing_near_the_straight_path_starts_from_one_of_ompls_and_says_so(
    robot: RobotDescription, tmp_path: Path
) -> None:
    there = wall(robot, tmp_path)
    motion = planned(there, "chomp", *sides(robot))
    assert motion.note == "chomp started from a path of ompl: it found none near the straight line"
    contacts = Contacts(file=tmp_path / "changed.xml")
    for joints in motion.sample(np.linspace(0.0, motion.duration_s, 2000)):
        assert not contacts.bodies(joints), joints


def test_ompl_without_time_says_so(robot: RobotDescription, tmp_path: Path) -> None:
    there = robot_in(changed_world(tmp_path, post=POSTS["high"]), robot)
    request = MotionRequest(*sides(robot), PlannerName.OMPL, Scaling(1.0), timeout_s=1e-9)
    with pytest.raises(PlanningTimeout, match=r"ompl: no free path within 0\.0 s"):
        plan(there, request)


def test_chomp_without_time_says_so(robot: RobotDescription, tmp_path: Path) -> None:
    there = robot_in(changed_world(tmp_path, post=POSTS["high"]), robot)
    request = MotionRequest(*sides(robot), PlannerName.CHOMP, Scaling(1.0), timeout_s=0.0)
    with pytest.raises(PlanningTimeout, match=r"chomp: not finished within 0\.0 s"):
        plan(there, request)


def bar_and_post(gap_mm: float) -> RobotDescription:
    """A bar that turns about one joint, and a post at this distance from its way."""
    arm = robot_of(Chain((Z,), ((0.3, 0.0, 0.0),)))
    tip_m, side_m = 0.7 * 0.3 + 0.03, 0.02
    post = SceneObject(
        "box", (side_m,) * 3, (tip_m + 1e-3 * gap_mm + 0.5 * side_m, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    )
    return replace(arm, collision=arm.collision.among(Scene(1, {"post": post})))


def test_a_count_and_not_a_time_ends_the_search_that_keeps_more_than_the_margin(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Otherwise the speed of the computer would decide between two paths."""
    limits: list[tuple[float, int]] = []

    def searched(*args: Any) -> Array | None:
        limits.append((args[6], args[9]))
        return connect(*args)

    monkeypatch.setattr(sampling, "connect", searched)
    monkeypatch.setattr(sampling, "SPARE_ATTEMPTS", 10)
    goal = np.array([1.0])
    request = MotionRequest(np.array([-1.0]), goal, PlannerName.OMPL, Scaling(1.0), timeout_s=WAIT_S)
    sampling.find_path(bar_and_post(5.8), request, goal[None])
    (left_s, attempts), (later_s, unlimited) = limits
    assert left_s == pytest.approx(WAIT_S, rel=0.1)
    assert attempts == 10 * WAIT_S
    assert later_s > 0.5 * WAIT_S
    assert unlimited == 0


@pytest.mark.parametrize("algorithm", ["RRTConnect", "RRT"])
@pytest.mark.parametrize(("gap_mm", "is_wide_enough"), [(4.8, False), (5.2, True), (5.8, True), (6.5, True)])
def test_a_passage_that_leaves_the_margin_and_little_more_is_found(
    monkeypatch: pytest.MonkeyPatch, algorithm: Algorithm, gap_mm: float, is_wide_enough: bool
) -> None:
    """Oracle: geometry. A bar that turns about one joint passes a post at exactly the distance of the gap."""
    monkeypatch.setattr(sampling, "SPARE_SHARE", 0.002)
    monkeypatch.setattr(sampling, "SPARE_ATTEMPTS", 10)
    among = bar_and_post(gap_mm)
    start, goal = np.array([-1.0]), np.array([1.0])
    timeout_s = WAIT_S if is_wide_enough else 0.2
    request = MotionRequest(
        start, goal, PlannerName.OMPL, Scaling(1.0), timeout_s=timeout_s, algorithm=algorithm
    )
    if not is_wide_enough:
        with pytest.raises(PlanningTimeout):
            sampling.find_path(among, request, goal[None])
        return
    corners = sampling.find_path(among, request, goal[None])
    assert all(among.collision.clearance.is_edge_free(*pair) for pair in pairwise(corners))
    assert np.array_equal(corners[[0, -1]], [start, goal])
