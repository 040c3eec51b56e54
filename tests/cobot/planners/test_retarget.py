"""A new goal for a motion under way.

Oracles: the old motion's own polynomials until the change; differences of dense samples for continuity and
limits; Ruckig's time-optimal way from the moving state as the shortest time; MuJoCo's forward kinematics for
the goal.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import ruckig

from cobot.errors import CobotError, InputError, PlanningError
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.retarget import retarget
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_efforts, check_limits
from cobot.robot.scene import Scene, SceneObject
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

FULL = Scaling(1.0)
COLD = """
import sys
import numpy as np
from cobot.config import load_settings
from cobot.motions.requests import MotionRequest
from cobot.planners import plan, retarget
from cobot.robot.description import load_robot
from cobot.robot.scene import Scene, SceneObject
from cobot.types import PlannerName, Scaling

robot = load_robot(load_settings(None))
home = np.array(robot.positions["home"].joints)
end = home + 1.5 * np.eye(len(home))[0]
motion = plan(robot, MotionRequest(home, end, PlannerName.PTP, Scaling(0.3)))
retarget.load_search()
known = set(sys.modules)
place = robot.model.forward(0.25 * home + 0.75 * end).position
ball = SceneObject("sphere", (0.05,), (*place, 1.0, 0.0, 0.0, 0.0))
robot.collision.surround(Scene(objects={"ball": ball}, version=1))
retarget.retarget(robot, MotionRequest(home, end, PlannerName.OMPL, Scaling(0.3)), motion, 0.4, 0.5)
assert set(sys.modules) == known, set(sys.modules) - known
"""
SEEDS = range(12)


def moving(robot: RobotDescription, random: np.random.Generator) -> tuple[Trajectory, Array]:
    """A motion between two free positions, and a third free position."""
    while True:
        start, end, goal = random.uniform(0.6 * robot.limits.min_position, 0.6 * robot.limits.max_position,
                                          (3, robot.limits.dof))  # fmt: skip
        try:
            robot.collision.check_position(goal, "the goal", 0.0)
            motion = plan(robot, MotionRequest(start, end, PlannerName.PTP, FULL))
        except CobotError:
            continue
        if motion is not None:
            return motion, goal


def shortest_s(robot: RobotDescription, state: list[Array], goal: Array) -> float:
    """Ruckig's duration from a moving state to rest at the goal, at all limits."""
    problem, limits = ruckig.InputParameter(robot.limits.dof), robot.limits
    problem.current_position, problem.current_velocity, problem.current_acceleration = map(list, state)
    problem.target_position = list(goal)
    problem.max_velocity, problem.max_acceleration = list(limits.max_velocity), list(limits.max_acceleration)
    problem.max_jerk = list(limits.max_jerk)
    found = ruckig.Trajectory(limits.dof)
    ruckig.Ruckig(limits.dof).calculate(problem, found)
    return float(found.duration)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_motion_is_the_old_one_then_leads_smoothly_to_the_new_goal(
    robot: RobotDescription, seed: int
) -> None:
    random = np.random.default_rng(seed)
    while True:
        motion, goal = moving(robot, random)
        now_s, from_s = motion.duration_s * np.sort(random.uniform(0.05, 0.95, 2))
        try:
            found = retarget(robot, MotionRequest(goal, goal, PlannerName.PTP, FULL), motion, now_s, from_s)
        except PlanningError:
            continue
        break
    new, limits = found.trajectory, robot.limits
    assert found.offset_s <= now_s, "where the arm is now"
    assert found.begin_s == pytest.approx(from_s - found.offset_s)
    times_s = np.linspace(0.0, found.begin_s, 200)
    for order in range(3):
        before = motion.sample(times_s + found.offset_s, order)
        np.testing.assert_allclose(new.sample(times_s, order), before, atol=1e-9)
    count = int(np.searchsorted(new.breakpoints_s, found.begin_s - 1e-6))
    old = [each.tobytes() for each in motion.coefficients]
    assert all(each.tobytes() in old for each in new.coefficients[:count]), "bit for bit"
    np.testing.assert_allclose(new.end, goal, atol=1e-6)
    step_s = 1e-4
    samples = new.sample(np.arange(0.0, new.duration_s, step_s))
    for bounds in (limits.max_velocity, limits.max_acceleration, limits.max_jerk):
        samples = np.diff(samples, axis=0) / step_s
        # Differences of third order lose digits: a share of 1 % is what rounding leaves of the last.
        assert (np.abs(samples) <= 1.01 * bounds).all()
    state = [motion.sample([from_s], order)[0] for order in range(3)]
    takes_s = new.duration_s - found.begin_s
    assert takes_s >= shortest_s(robot, state, goal) - 1e-6
    after = plan(robot, MotionRequest(new.sample([found.end_s])[0], goal, PlannerName.PTP, FULL))
    assert after is None or takes_s <= (found.end_s - found.begin_s) + 2.0 * after.duration_s + 1.0


def test_the_arm_does_not_stop_on_the_way_to_a_goal_that_leads_on(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    by = np.eye(robot.limits.dof)[0]
    near, far = (MotionRequest(home, home + y * by, PlannerName.PTP, Scaling(0.3)) for y in (0.6, 1.2))
    motion = plan(robot, near)
    assert motion is not None
    found = retarget(robot, far, motion, 0.1, 0.6 * motion.duration_s)
    times_s = np.linspace(found.begin_s, found.trajectory.duration_s - 0.3, 500)
    assert found.trajectory.sample(times_s, 1)[:, 0].min() > 0.1, "rad/s"


def test_a_line_to_a_pose_ends_at_the_pose(robot: RobotDescription) -> None:
    home = np.array(robot.positions["home"].joints)
    here = robot.model.forward(home)
    goals = [Pose(here.position + np.array(by), here.quaternion) for by in ([0.1, 0.1, 0], [0.1, -0.15, 0])]
    first, second = (MotionRequest(home, goal, PlannerName.LIN, Scaling(0.5)) for goal in goals)
    motion = plan(robot, first)
    assert motion is not None
    found = retarget(robot, second, motion, 0.1, 0.3 * motion.duration_s)
    end = robot.model.forward(found.trajectory.end)
    np.testing.assert_allclose(end.position, goals[1].position, atol=1e-5)


def test_a_motion_that_has_ended_goes_on_from_its_end(robot: RobotDescription) -> None:
    motion, goal = moving(robot, np.random.default_rng(5))
    found = retarget(robot, MotionRequest(goal, goal, PlannerName.PTP, FULL), motion, 0.9, 99.0)
    assert found.begin_s == pytest.approx(motion.duration_s - found.offset_s)
    np.testing.assert_allclose(found.trajectory.end, goal, atol=1e-6)


def test_a_new_goal_where_the_arm_comes_to_rest_anyway_is_a_stop(robot: RobotDescription) -> None:
    motion, goal = moving(robot, np.random.default_rng(7))
    there = MotionRequest(goal, goal, PlannerName.PTP, FULL)
    rest = retarget(robot, there, motion, 0.0, 0.3 * motion.duration_s).trajectory
    again = retarget(robot, replace(there, goal=rest.end), rest, 0.0, rest.duration_s)
    np.testing.assert_allclose(again.trajectory.end, rest.end, atol=1e-9)


def test_a_goal_that_collides_is_an_error_with_the_contact(robot: RobotDescription) -> None:
    motion, goal = moving(robot, np.random.default_rng(9))
    box = SceneObject("box", (0.3, 0.3, 0.3), (*robot.model.forward(goal).numbers[:3], 1.0, 0.0, 0.0, 0.0))
    checker = robot.collision.among(Scene(objects={"box": box}, version=1))
    blocked = replace(robot, collision=checker)
    with pytest.raises((PlanningError, InputError), match="box"):
        retarget(blocked, MotionRequest(goal, goal, PlannerName.PTP, FULL), motion, 0.0, 0.2)


def test_a_way_around_passes_all_checks_as_a_whole(robot: RobotDescription) -> None:
    """Only its beginning is checked when it is joined, because the rest was proven before. The oracle is a
    proof of the whole, by a checker that has proven nothing. Without the check of the beginning, three of
    these seeds touch the ball.
    """
    home, found = np.array(robot.positions["home"].joints), 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        start, end, _ = home + random.uniform(-0.7, 0.7, (3, len(home)))
        try:
            motion = plan(robot, MotionRequest(start, end, PlannerName.PTP, FULL))
            assert motion is not None
            place = robot.model.forward(motion.sample([motion.duration_s * random.uniform(0.5, 0.9)])[0])
            ball = SceneObject("sphere", (0.06,), (*place.position, 1.0, 0.0, 0.0, 0.0))
            checker = robot.collision.among(Scene(objects={"ball": ball}, version=1))
            blocked = replace(robot, collision=checker)
            times_s = 0.15 * motion.duration_s, 0.2 * motion.duration_s
            request = MotionRequest(start, end, PlannerName.OMPL, FULL)
            changed = retarget(blocked, request, motion, *times_s).trajectory
        except CobotError:
            continue
        found += 1
        checker.twin().check_trajectory(Trajectory(changed.breakpoints_s, changed.coefficients.copy()))
        check_limits(changed, robot.limits)
        check_efforts(robot.model, changed, robot.limits)
    assert found >= 3


def test_a_process_that_is_ready_imports_nothing_for_the_way_around_an_obstacle() -> None:
    """Importing OMPL and scipy takes half a second; the arm would stop before."""
    ended = subprocess.run([sys.executable, "-c", COLD], capture_output=True, text=True, timeout=60.0)
    assert ended.returncode == 0, ended.stderr
