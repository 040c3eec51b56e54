"""Motions through clutter: seeded problems, ways out of a collision, the choice of auto.

Oracles: MuJoCo's contact list at dense samples; random search.
"""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import mujoco
import numpy as np
import pytest
from cobot_run import WAIT_S
from thorough import few

from benchmarks.planning import scenes
from cobot.errors import CollisionError, PlanningError, PlanningTimeout
from cobot.planners import MotionRequest, plan
from cobot.planners.escape import leave_invalid_start
from cobot.planners.search import sampling
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.trajectory import Notice, Trajectory
from cobot.types import Algorithm, Array, PlannerName, Pose, Scaling

SEED = 20261122
IN_THE_FLOOR = np.array([0.0, 1.9, 0.0, -0.2, 0.0, 0.0, 0.0])
ON_THE_BASE = np.array([1.8, -2.0, 0.3, 2.0, -0.9, 1.8, -0.3])
SEARCHING = ["ompl", "chomp", "auto"]


class World:
    """MuJoCo's contact list in a robot's scene, without cobot's distances."""

    def __init__(self, robot: RobotDescription) -> None:
        self.mj = robot.model.mj
        self.data = mujoco.MjData(self.mj)

    def deepest(self, joints: Array) -> float:
        """The deepest contact, m, negative; 0 without one."""
        self.data.qpos[:] = joints
        mujoco.mj_kinematics(self.mj, self.data)
        mujoco.mj_collision(self.mj, self.data)
        return float(self.data.contact.dist.min(initial=0.0))

    def along(self, motion: Trajectory, count: int = 1000) -> Array:
        return np.array([self.deepest(q) for q in motion.sample(np.linspace(0.0, motion.duration_s, count))])


def home(robot: RobotDescription) -> Array:
    return np.array(robot.positions["home"].joints)


def planned(
    robot: RobotDescription, planner: str, start: Array, goal: Array | Pose, **fields: object
) -> Trajectory:
    request = MotionRequest(start, goal, PlannerName(planner), Scaling(1.0), timeout_s=WAIT_S)
    motion = plan(robot, replace(request, **fields))  # type: ignore[arg-type]
    assert motion is not None
    assert motion.start == pytest.approx(start, abs=1e-9)
    return motion


@pytest.mark.parametrize("kind", scenes.KINDS)
def test_problems_in_clutter_are_solved_without_contact_by_every_planner_that_searches(
    robot: RobotDescription, kind: str
) -> None:
    for problem in scenes.problems(robot, kind, 2, SEED):
        for planner in SEARCHING:
            motion = planned(problem.robot, planner, problem.start, problem.goal)
            assert motion.end == pytest.approx(problem.goal, abs=1e-9)
            assert World(problem.robot).along(motion).min() == 0.0, (problem.name, planner)


@pytest.mark.parametrize("kind", few(scenes.KINDS))
def test_chomp_solves_ten_problems_of_each_kind(robot: RobotDescription, kind: str) -> None:
    for problem in scenes.problems(robot, kind, 10, SEED + 1):
        motion = planned(problem.robot, "chomp", problem.start, problem.goal)
        assert motion.end == pytest.approx(problem.goal, abs=1e-9)
        assert World(problem.robot).along(motion, 100).min() == 0.0, problem.name


def test_a_problem_is_the_same_for_the_same_seed(robot: RobotDescription) -> None:
    first, again = (next(scenes.problems(robot, "bin", 1, SEED)) for _ in range(2))
    assert (first.start == again.start).all()
    assert (first.goal == again.goal).all()


def test_the_same_seed_gives_the_same_motion_and_another_one_another(robot: RobotDescription) -> None:
    problem = next(scenes.problems(robot, "cage", 1, SEED))
    motions = [
        planned(problem.robot, "ompl", problem.start, problem.goal, seed=seed).coefficients
        for seed in (1, 1, 2)
    ]
    assert np.array_equal(motions[0], motions[1])
    assert not np.array_equal(motions[0], motions[2])


@pytest.mark.parametrize("algorithm", get_args(Algorithm))
def test_a_planner_of_ompl_is_chosen_by_its_name(
    robot: RobotDescription, algorithm: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sampling, "IMPROVING_S", 0.05)
    there = scenes.among(robot, [(0.6, 0.0, 0.25, 0.05, 0.05, 0.25)])
    left, right = np.array([robot.positions["work"].joints] * 2)
    left[0], right[0] = -0.9, 0.9
    motion = planned(there, "ompl", left, right, algorithm=algorithm)
    assert World(there).along(motion).min() == 0.0


@pytest.mark.parametrize("planner", SEARCHING)
@pytest.mark.parametrize("start", [IN_THE_FLOOR, ON_THE_BASE], ids=["floor", "base"])
def test_a_start_in_collision_is_left_without_getting_deeper_and_the_plan_says_how(
    robot: RobotDescription, planner: str, start: Array
) -> None:
    motion = planned(robot, planner, start, home(robot))
    assert "the start is in collision: " in motion.note
    assert "the motion first takes the shortest way out, 0." in motion.note
    assert "left_start" in [each.kind for each in motion.notices]
    depths = World(robot).along(motion)
    out = int(np.argmax(depths == 0.0))
    assert depths[0] < -0.05
    assert (depths >= depths[0] - 1e-3).all()
    assert (np.diff(depths[: out + 1]) > -1e-3).all(), "it only gets shallower"
    assert (depths[out:] == 0.0).all(), "and touches nothing any more"
    assert motion.end == pytest.approx(home(robot), abs=1e-9)


def test_no_random_configuration_is_free_that_is_nearer_than_the_way_out(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED)
    for start in (IN_THE_FLOOR, ON_THE_BASE):
        first = leave_invalid_start(robot, MotionRequest(start, home(robot), PlannerName.OMPL, Scaling(1.0)))
        assert first is not None
        length_rad = float(np.linalg.norm(first.end - start))
        directions = random.normal(size=(20_000, 7))
        directions *= 0.95 * length_rad / np.linalg.norm(directions, axis=1)[:, None]
        assert not robot.collision.clearance.are_free(start + directions).any()


@pytest.mark.parametrize("planner", SEARCHING)
def test_a_start_beyond_a_limit_is_left_the_straight_way_and_the_plan_says_so(
    robot: RobotDescription, planner: str
) -> None:
    start = home(robot)
    start[3] = robot.limits.min_position[3] - 0.012
    motion = planned(robot, planner, start, home(robot))
    assert motion.note.startswith(
        "joint4 is 0.0120 rad beyond its limit; the motion first takes the shortest way out"
    )
    beyond = robot.limits.min_position[3] - motion.sample(np.linspace(0.0, motion.duration_s, 500))[:, 3]
    assert beyond.max() <= 0.012 + 1e-9


def test_a_start_that_no_short_motion_frees_is_refused_with_what_it_touches(robot: RobotDescription) -> None:
    buried = scenes.among(robot, [(0.0, 0.0, 0.9, 0.5, 0.5, 0.5)])
    with pytest.raises(
        CollisionError, match=r"the start is in collision: .* no straight joint motion leads out"
    ):
        planned(buried, "ompl", np.zeros(7), home(robot))


def test_auto_goes_straight_where_that_is_free_and_says_so(robot: RobotDescription) -> None:
    goal = home(robot) + 0.2
    motion = planned(robot, "auto", home(robot), goal)
    assert motion.note == "auto used ptp: the direct joint motion is free"
    assert motion.notices == (Notice("auto", {"planner": "ptp"}),)
    assert np.array_equal(motion.coefficients, planned(robot, "ptp", home(robot), goal).coefficients)


def test_auto_says_why_it_did_not_go_straight(robot: RobotDescription) -> None:
    problem = next(scenes.problems(robot, "table", 1, SEED))
    motion = planned(problem.robot, "auto", problem.start, problem.goal)
    assert motion.notices == (Notice("auto", {"planner": "ompl"}),)
    assert motion.note.startswith("auto used ompl (RRTConnect): ptp: collision of link")
    with pytest.raises(CollisionError):
        planned(problem.robot, "ptp", problem.start, problem.goal)


def test_auto_that_finds_nothing_gives_the_reason_of_each(robot: RobotDescription) -> None:
    problem = next(scenes.problems(robot, "table", 1, SEED))
    with pytest.raises(PlanningTimeout) as caught:
        planned(problem.robot, "auto", problem.start, problem.goal, timeout_s=1e-9)
    assert str(caught.value).startswith("auto found no motion: ptp: collision of link")
    assert str(caught.value).endswith("; ompl: no free path within 0.0 s (RRTConnect found none)")


def test_a_pose_is_reached_in_a_free_configuration_where_the_nearest_one_touches_something(
    robot: RobotDescription,
) -> None:
    random, seen = np.random.default_rng(SEED), 0
    for problem in scenes.problems(robot, "cage", 6, SEED):
        there, limits = problem.robot, robot.limits
        for seed in random.uniform(limits.min_position, limits.max_position, (40, 7)):
            if seen == 3:
                return
            if not there.collision.is_free(seed):
                continue
            nearest = inverse(there.model, problem.pose, seed)
            if there.collision.is_free(nearest):
                continue
            seen += 1
            end = planned(there, "ompl", seed, problem.pose).end
            assert World(there).deepest(end) == 0.0
            assert np.abs(end - nearest).max() > 0.1
            assert there.model.forward(end).position == pytest.approx(problem.pose.position, abs=1e-6)
    pytest.fail("no such pose")


def test_a_pose_whose_configurations_all_touch_something_says_so(robot: RobotDescription) -> None:
    problem = next(scenes.problems(robot, "table", 1, SEED))
    x, y, z = problem.pose.position
    blocked = scenes.among(robot, [(x, y, z, 0.02, 0.02, 0.02)])
    with pytest.raises(CollisionError, match=r"the goal in the nearest configuration, as in the other \d"):
        planned(blocked, "ompl", home(robot), problem.pose)


def test_no_planner_is_another_ones_deputy_but_auto(robot: RobotDescription) -> None:
    problem = next(scenes.problems(robot, "table", 1, SEED))
    with pytest.raises(PlanningError):
        planned(problem.robot, "ptp", problem.start, problem.goal)
