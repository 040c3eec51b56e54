"""ptp, and the rules that all planners share.

Oracle: ruckig called directly, one joint at a time; differences of dense samples; MuJoCo's contacts.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ruckig
from cobot_run import WAIT_S
from independent_models import Contacts, changed_world, largest_rates, rate_limits, robot_in, second_robot
from planner_sentences import only
from scipy.spatial.transform import Rotation

from cobot.errors import CobotError, CollisionError, InputError, LimitError, PlanningError, UnreachableError
from cobot.motions.constraints import Cone, Constraints
from cobot.motions.planners import PLANNERS
from cobot.motions.stretches import Leg
from cobot.planners import MotionRequest, plan
from cobot.planners.blending.joined import joined
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling, Synchronization

SEED = 20261121
ROUNDING = 1e-5
FULL = Scaling(1.0)
ON_THE_FLOOR = np.array([0.0, 1.9, 0.0, -0.2, 0.0, 0.0, 0.0])
ON_THE_BASE = np.array([1.8, -2.0, 0.3, 2.0, -0.9, 1.8, -0.3])
THROUGH_THE_ARM = [
    ([2.6, 1.2, 0.6, -2.0, -1.4, 1.1, -0.4], [-2.1, 1.9, -0.6, -2.0, 1.9, 0.8, 1.3], "link7"),
    ([1.6, -2.0, -0.7, 2.0, 2.9, -1.3, -1.2], [0.3, -1.8, 0.9, 2.0, 1.1, 1.0, -0.2], "link6"),
    ([-2.6, 2.0, -1.0, -1.9, 0.8, 1.1, 1.9], [-2.7, 2.0, 2.7, -2.0, -1.9, -1.3, 2.0], "link5"),
]
THROUGH_THE_FLOOR = (
    np.array([-1.0, -2.1, -1.4, 1.8, -0.6, -1.3, 1.9]),
    np.array([-2.0, -0.5, 2.7, 1.4, -2.2, -1.4, -2.7]),
)


def home(robot: RobotDescription) -> Array:
    return np.array(robot.positions["home"].joints)


def work(robot: RobotDescription) -> Array:
    return np.array(robot.positions["work"].joints)


def ptp(
    robot: RobotDescription, start: Array, goal: Array | Pose, scaling: Scaling = FULL, planner: str = "ptp"
) -> Trajectory:
    trajectory = plan(robot, MotionRequest(start, goal, PlannerName(planner), scaling, timeout_s=WAIT_S))
    assert trajectory is not None
    return trajectory


def free_pairs(robot: RobotDescription, count: int) -> list[tuple[Array, Array, Trajectory]]:
    """Random starts and goals between which ptp is free of collisions, and the motion."""
    random = np.random.default_rng(SEED)
    limits = robot.limits
    found: list[tuple[Array, Array, Trajectory]] = []
    while len(found) < count:
        start, goal = random.uniform(limits.min_position, limits.max_position, (2, limits.dof))
        try:
            found.append((start, goal, ptp(robot, start, goal)))
        except CollisionError:
            continue
    return found


def shortest_duration_s(robot: RobotDescription, start: Array, goal: Array, scaling: Scaling) -> float:
    """What the slowest joint needs on its own, by ruckig."""
    limits = MotionRequest(start, goal, PlannerName.PTP, scaling).scaled_limits(robot)
    durations = []
    for joint in range(robot.limits.dof):
        problem = ruckig.InputParameter(1)
        problem.current_position, problem.target_position = [float(start[joint])], [float(goal[joint])]
        problem.max_velocity = [float(limits.max_velocity[joint])]
        problem.max_acceleration = [float(limits.max_acceleration[joint])]
        problem.max_jerk = [float(limits.max_jerk[joint])]
        solution = ruckig.Trajectory(1)
        ruckig.Ruckig(1).calculate(problem, solution)
        durations.append(float(solution.duration))
    return max(durations)


def test_ptp_goes_from_rest_at_the_start_to_rest_at_the_goal(robot: RobotDescription) -> None:
    for start, goal, motion in free_pairs(robot, 50):
        assert motion.start == pytest.approx(start, abs=1e-9)
        assert motion.end == pytest.approx(goal, abs=1e-9)
        for derivative in (1, 2):
            ends = motion.sample([0.0, motion.duration_s], derivative)
            assert ends == pytest.approx(np.zeros((2, 7)), abs=1e-6)


def test_ptp_keeps_velocity_acceleration_and_jerk_limits_at_any_scaling(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED)
    for start, goal, _ in free_pairs(robot, 30):
        scaling = Scaling(random.uniform(0.05, 1.0), random.choice([0.0, random.uniform(0.05, 1.0)]))
        request = MotionRequest(start, goal, PlannerName.PTP, scaling)
        motion = plan(robot, request)
        assert motion is not None
        used = largest_rates(motion) / rate_limits(request.scaled_limits(robot))
        assert used.max() <= 1.0 + ROUNDING, f"seed {SEED}: {start} to {goal}"
        assert used.max() > 0.98, "slower than any limit asks for"


def test_ptp_takes_as_long_as_its_slowest_joint_needs_alone(robot: RobotDescription) -> None:
    for start, goal, motion in free_pairs(robot, 50):
        assert motion.duration_s == pytest.approx(shortest_duration_s(robot, start, goal, FULL), rel=1e-6)


def test_ptp_joints_all_start_and_end_together_and_never_turn_back(robot: RobotDescription) -> None:
    for start, goal, motion in free_pairs(robot, 30):
        way = (motion.sample(np.linspace(0.0, motion.duration_s, 201)) - start) / (goal - start)
        assert np.diff(way, axis=0).min() > -1e-9
        assert way[2].min() > 0.0, "a joint starts later than others"
        assert way[-3].max() < 1.0, "a joint ends earlier than others"


def test_ptp_in_phase_is_straight_in_joint_space_and_no_faster_than_in_time(robot: RobotDescription) -> None:
    longer = 0
    for start, goal, motion in free_pairs(robot, 20):
        request = MotionRequest(start, goal, PlannerName.PTP, FULL, synchronization=Synchronization.PHASE)
        try:
            straight = plan(robot, request)
        except CollisionError:
            continue
        assert straight is not None
        offsets = straight.sample(np.linspace(0.0, straight.duration_s, 300)) - start
        way = goal - start
        shares = offsets @ way / (way @ way)
        assert np.abs(offsets - shares[:, None] * way).max() < 1e-9
        assert np.diff(shares).min() > -1e-12
        assert straight.end == pytest.approx(goal, abs=1e-12)
        limits = request.scaled_limits(robot)
        used = largest_rates(straight) / rate_limits(limits)
        assert 0.98 < used.max() <= 1.0 + ROUNDING
        assert straight.duration_s > motion.duration_s * (1.0 - 1e-9)
        longer += straight.duration_s > motion.duration_s * 1.001
    assert longer > 0


@pytest.mark.parametrize("planner", ["lin", "circ", "ompl", "chomp"])
def test_only_ptp_takes_a_synchronization(robot: RobotDescription, planner: str) -> None:
    via = np.array([0.4, 0.1, 0.4]) if planner == "circ" else None
    request = MotionRequest(
        home(robot), robot.model.forward(work(robot)), PlannerName(planner), FULL, via, timeout_s=WAIT_S
    )
    with pytest.raises(InputError, match=f"synchronization: phase {only('synchronization', planner)}"):
        plan(robot, replace(request, synchronization=Synchronization.PHASE))


@pytest.mark.parametrize("held", [False, True], ids=["free", "upright"])
@pytest.mark.parametrize("planner", PlannerName)
def test_no_planner_exceeds_a_limit_by_more_than_rounding(
    robot: RobotDescription, planner: PlannerName, held: bool
) -> None:
    start = work(robot)
    pose = robot.model.forward(start)
    goal = Pose(pose.position + np.array([0.05, 0.2, 0.1]), pose.quaternion)
    more: dict[str, Any] = {"constraints": Constraints(Cone(np.array([0.0, 0.0, 1.0]), 0.5))} if held else {}
    traits = PLANNERS[planner]
    if "via" in traits.needs:
        more["via"] = pose.position + np.array([0.0, 0.1, 0.02])
    if "through" in traits.needs:
        more["through"] = (Pose(pose.position + np.array([0.05, 0.1, -0.1]), pose.quaternion),)
    if "radius_m" in traits.fields:
        more["radius_m"] = 0.04
    for speed in (1.0, 0.37):
        request = MotionRequest(start, goal, planner, Scaling(speed), timeout_s=WAIT_S, **more)
        motion = plan(robot, request)
        assert motion is not None
        back = plan(robot, replace(request, start=motion.end, goal=pose))
        assert back is not None
        limits = request.scaled_limits(robot)
        there_and_back = joined(robot, [Leg(motion, limits, None), Leg(back, limits, None)], [0.05])
        for each in (motion, back, there_and_back.trajectory):
            for order, limit in enumerate(rate_limits(limits), 1):
                assert (np.maximum(*np.abs(each.extrema(order))) <= limit * (1.0 + 1e-9)).all()


def test_a_joint_that_has_nothing_to_do_stands_still(robot: RobotDescription) -> None:
    goal = home(robot)
    goal[0] += 1.0
    low, high = ptp(robot, home(robot), goal).extrema()
    assert high[0] - low[0] == pytest.approx(1.0)
    assert (high - low)[1:] == pytest.approx(np.zeros(6), abs=1e-12)


@pytest.mark.parametrize("distance", [2e-6, 1e-5, 1e-4, 1e-3, 0.01])
def test_ptp_plans_the_smallest_motions_too(robot: RobotDescription, distance: float) -> None:
    goal = home(robot) + distance * np.array([1.0, -0.5, 0.3, 0.2, -1.0, 0.7, 0.1])
    motion = ptp(robot, home(robot), goal)
    assert motion.end == pytest.approx(goal, abs=1e-10)
    assert motion.duration_s == pytest.approx(shortest_duration_s(robot, home(robot), goal, FULL), rel=1e-5)


def test_ptp_to_a_pose_puts_the_tcp_there(robot: RobotDescription) -> None:
    position, turn = second_robot().forward(work(robot) + 0.1)
    pose = Pose(position, Rotation.from_matrix(turn).as_quat(scalar_first=True))
    motion = ptp(robot, home(robot), pose)
    reached, reached_turn = second_robot().forward(motion.end)
    assert reached == pytest.approx(position, abs=1e-6)
    assert reached_turn == pytest.approx(turn, abs=1e-6)


@pytest.mark.parametrize("planner", ["ptp", "ompl", "chomp", "lin"])
def test_where_the_arm_already_is_there_is_nothing_to_do(robot: RobotDescription, planner: str) -> None:
    here = home(robot)
    goals: list[Array | Pose] = [robot.model.forward(here)]
    if planner != "lin":
        goals += [here.copy(), here + 5e-7]
    for goal in goals:
        assert plan(robot, MotionRequest(here, goal, PlannerName(planner), FULL, timeout_s=WAIT_S)) is None


def test_half_the_speed_halves_velocity_acceleration_and_jerk(robot: RobotDescription) -> None:
    goal = home(robot)
    goal[0] = 2.5
    for speed, accel_scale, shares in (
        (0.5, 0.0, (0.5, 0.5, 0.5)),
        (0.1, 0.0, (0.1, 0.1, 0.1)),
        (0.5, 0.2, (0.5, 0.2, 0.2)),
        (0.3, 0.6, (0.3, 0.6, 0.6)),
        (1.0, 0.0, (1.0, 1.0, 0.8)),  # planned motions leave a fifth of the jerk for a stop
        (1.0, 0.9, (1.0, 0.9, 0.8)),
    ):
        motion = ptp(robot, home(robot), goal, Scaling(speed, accel_scale))
        used = [np.abs(motion.sample(np.linspace(0.0, motion.duration_s, 5000), k)).max() for k in (1, 2, 3)]
        expected = np.array(shares) * rate_limits(robot.limits)[:, 0]
        assert used == pytest.approx(expected, rel=1e-3), (speed, accel_scale)


@pytest.mark.parametrize("planner", ["lin", "circ", "ompl", "chomp"])
def test_every_planner_obeys_speed_and_accel_scale(robot: RobotDescription, planner: str) -> None:
    start = work(robot)
    pose = robot.model.forward(start)
    goal = Pose(pose.position + np.array([0.05, 0.2, 0.1]), pose.quaternion)
    via = pose.position + np.array([0.0, 0.1, 0.02]) if planner == "circ" else None
    durations = {}
    for scaling in (Scaling(0.9), Scaling(0.3), Scaling(0.3, 0.05), Scaling(0.1)):
        request = MotionRequest(start, goal, PlannerName(planner), scaling, via, timeout_s=WAIT_S)
        motion = plan(robot, request)
        assert motion is not None
        used = largest_rates(motion) / rate_limits(request.scaled_limits(robot))
        assert used.max() <= 1.0 + ROUNDING, scaling
        durations[scaling] = motion.duration_s
    assert durations[Scaling(0.9)] < durations[Scaling(0.3)] < durations[Scaling(0.1)]
    assert durations[Scaling(0.3)] < durations[Scaling(0.3, 0.05)]


@pytest.mark.parametrize(
    ("speed", "accel_scale", "message"),
    [
        (0.0, 0.0, "speed must be from 0.01 to 1.0, got 0.0"),
        (1.01, 0.0, "speed must be from 0.01 to 1.0, got 1.01"),
        (-0.5, 0.0, "speed must be from 0.01 to 1.0, got -0.5"),
        (float("nan"), 0.0, "speed must be from 0.01 to 1.0, got nan"),
        (0.5, 1.5, "accel_scale must be from 0 to 1.0, got 1.5"),
        (0.5, -0.1, "accel_scale must be from 0 to 1.0, got -0.1"),
        (0.5, float("nan"), "accel_scale must be from 0 to 1.0, got nan"),
    ],
)
def test_scalings_out_of_range_are_refused(speed: float, accel_scale: float, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        Scaling(speed, accel_scale)


@pytest.mark.parametrize("planner", ["ptp", "ompl", "chomp"])
def test_a_goal_in_the_floor_is_refused_with_both_bodies(robot: RobotDescription, planner: str) -> None:
    assert frozenset({"world", "link7"}) in Contacts().bodies(ON_THE_FLOOR)
    with pytest.raises(CollisionError, match=r"the goal is in collision: floor and link\d at -\d+ mm"):
        ptp(robot, home(robot), ON_THE_FLOOR, planner=planner)


@pytest.mark.parametrize("planner", ["ptp", "ompl", "chomp"])
def test_a_goal_in_the_arm_itself_is_refused_with_both_bodies(
    robot: RobotDescription, tmp_path: Path, planner: str
) -> None:
    without_floor = changed_world(tmp_path, floor=False)
    assert Contacts(file=without_floor).bodies(ON_THE_BASE) == {
        frozenset({"base_link", "link5"}),
        frozenset({"base_link", "link6"}),
    }
    with pytest.raises(CollisionError, match=r"the goal is in collision: link5 and base_link at -8 mm"):
        ptp(robot_in(without_floor, robot), home(robot), ON_THE_BASE, planner=planner)


@pytest.mark.parametrize(("start", "goal", "link"), THROUGH_THE_ARM)
def test_a_motion_through_the_arm_itself_is_refused_with_both_bodies(
    robot: RobotDescription, tmp_path: Path, start: list[float], goal: list[float], link: str
) -> None:
    floating = robot_in(changed_world(tmp_path, floor=False), robot)
    with pytest.raises(CollisionError, match=rf"({link} and base_link|base_link and {link}) at .* mm after"):
        ptp(floating, np.array(start), np.array(goal))


@pytest.mark.parametrize("planner", ["ptp", "lin", "circ"])
def test_a_start_in_collision_is_refused_by_planners_whose_path_is_given(
    robot: RobotDescription, planner: str
) -> None:
    via = np.array([0.4, 0.1, 0.4]) if planner == "circ" else None
    goal = robot.model.forward(home(robot))
    with pytest.raises(CollisionError, match=r"the start is in collision: .*link"):
        plan(robot, MotionRequest(ON_THE_BASE, goal, PlannerName(planner), FULL, via))


def test_a_motion_through_the_floor_is_refused_with_bodies_time_share_and_joints(
    robot: RobotDescription,
) -> None:
    start, goal = THROUGH_THE_FLOOR
    assert not Contacts().bodies(start) | Contacts().bodies(goal)
    with pytest.raises(CollisionError) as caught:
        ptp(robot, start, goal)
    found = re.fullmatch(
        r"collision of floor and (link\d) at -?\d+ mm after (\d+) % of the motion \(([\d.]+) s\), at "
        r"joints \[(.*)\] rad; the deepest contact is floor and link\d at -\d+ mm after \d+ %; allowed: "
        r"5 mm",
        str(caught.value),
    )
    assert found, caught.value
    joints = np.array([float(value) for value in found[4].split(", ")])
    assert frozenset({"world", found[1]}) in Contacts(robot.collision.margin_m).bodies(joints)
    way = (joints - start) / (goal - start)
    assert np.ptp(way) < 1e-2


def test_lin_into_the_floor_is_refused_with_the_bodies(robot: RobotDescription) -> None:
    pose = robot.model.forward(work(robot))
    below = Pose(np.array([pose.position[0], 0.0, -0.02]), pose.quaternion)
    with pytest.raises(CollisionError, match=r"collision of floor and link7 at"):
        ptp(robot, work(robot), below, planner="lin")


def test_no_accepted_motion_touches_anything(robot: RobotDescription) -> None:
    contacts = Contacts()
    for start, goal, motion in free_pairs(robot, 60):
        for joints in motion.sample(np.linspace(0.0, motion.duration_s, 200)):
            assert not contacts.bodies(joints), f"{start} to {goal} at {joints}"


@pytest.mark.parametrize(
    ("joint", "value", "message"),
    [
        (0, 2.98, "joint angle of joint1 is 2.98 rad, allowed: -2.97 to 2.97 rad"),
        (3, -2.11, "joint angle of joint4 is -2.11 rad, allowed: -2.1 to 2.1 rad"),
        (6, float("nan"), "joint angle of joint7 is nan rad, allowed: -3.05 to 3.05 rad"),
    ],
)
def test_a_goal_beyond_the_limits_is_refused_with_joint_value_and_range(
    robot: RobotDescription, joint: int, value: float, message: str
) -> None:
    goal = home(robot)
    goal[joint] = value
    for planner in ("ptp", "ompl", "chomp"):
        with pytest.raises(LimitError, match=re.escape(message)):
            ptp(robot, home(robot), goal, planner=planner)


def test_an_arm_that_was_pushed_beyond_a_limit_may_move_back_but_not_further_out(
    robot: RobotDescription,
) -> None:
    start = home(robot)
    start[1] = -2.11
    motion = ptp(robot, start, home(robot))
    assert motion.extrema()[0][1] == pytest.approx(-2.11, abs=1e-9)
    further = start - np.eye(7)[1] * 0.005
    with pytest.raises(LimitError, match=r"joint angle of joint2 is -2\.115 rad, allowed: -2\.1 to 2\.1"):
        ptp(robot, start, further)


@pytest.mark.parametrize("planner", ["ptp", "ompl", "chomp"])
def test_a_pose_out_of_reach_is_an_error_of_joint_planners_too(robot: RobotDescription, planner: str) -> None:
    far = Pose(np.array([1.5, 0.0, 0.5]), np.array([1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(UnreachableError, match=r"the TCP cannot reach x 1\.5, y 0, z 0\.5 m in this"):
        ptp(robot, home(robot), far, planner=planner)


@pytest.mark.parametrize("planner", ["lin", "ptp", "ompl"])
def test_a_goal_far_away_is_out_of_reach_by_a_length(robot: RobotDescription, planner: str) -> None:
    # The tool points down: the wrist is 0.126 m above it, the shoulder at 0.36 m, the arm 0.82 m long.
    far = Pose(np.array([0.0, 0.0, 3.0]), np.array([0.0, 1.0, 0.0, 0.0]))
    with pytest.raises(UnreachableError, match=r"out of reach by 1\.95 m"):
        ptp(robot, home(robot), far, planner=planner)


def test_a_pose_whose_nearest_joints_touch_something_is_gone_to_with_others(
    robot: RobotDescription, tmp_path: Path
) -> None:
    crowded = robot_in(changed_world(tmp_path, post=[0.45, 0.0, 0.5, 0.15, 0.15, 0.5]), robot)
    random, limits, start = np.random.default_rng(SEED), robot.limits, np.zeros(7)
    start[1] = -1.2
    touching, refusals = 0, []
    for joints in random.uniform(limits.min_position, limits.max_position, (400, 7)):
        pose = robot.model.forward(joints)
        nearest = inverse(robot.model, pose, start)
        if not crowded.collision.is_free(joints) or crowded.collision.is_free(nearest):
            continue
        touching += 1
        try:
            motion = ptp(crowded, start, pose)
        except CollisionError as error:  # on the way, which another planner would go round
            refusals.append(str(error))
        else:
            assert second_robot().forward(motion.end)[0] == pytest.approx(pose.position, abs=1e-9)
    assert not any(refusal.startswith("the goal") for refusal in refusals)
    assert touching > 5


@pytest.mark.parametrize(
    ("planner", "goal", "via", "message"),
    [
        ("lin", "joints", None, "lin needs a pose as its goal, not joint angles"),
        ("circ", "joints", (0.5, 0.1, 0.5), "circ needs a pose as its goal, not joint angles"),
        ("circ", "pose", None, "via: is missing; planner circ needs a point on its arc"),
        ("lin", "pose", (0.5, 0.1, 0.5), f"via: {only('via', 'lin')}"),
        ("ptp", "pose", (0.5, 0.1, 0.5), f"via: {only('via', 'ptp')}"),
        ("ompl", "joints", (0.5, 0.1, 0.5), f"via: {only('via', 'ompl')}"),
        ("chomp", "pose", (0.5, 0.1, 0.5), f"via: {only('via', 'chomp')}"),
    ],
)
def test_what_a_planner_cannot_do_is_an_error_and_never_anothers_work(
    robot: RobotDescription, planner: str, goal: str, via: tuple[float, float, float] | None, message: str
) -> None:
    there = work(robot)
    target = there if goal == "joints" else robot.model.forward(there)
    point = None if via is None else np.array(via)
    with pytest.raises(InputError, match=message):
        MotionRequest(home(robot), target, PlannerName(planner), FULL, point)
    assert ptp(robot, home(robot), target).duration_s > 0.0, "which ptp could have done"


def test_a_line_that_cannot_be_followed_is_an_error_where_ptp_would_arrive(robot: RobotDescription) -> None:
    # From in front of the base to behind it: a straight line would lead through the arm's own column.
    behind = robot.model.forward(np.array([np.pi - 0.3, *work(robot)[1:]]))
    with pytest.raises(PlanningError, match=r"^lin: at \d+ % of the path"):
        ptp(robot, work(robot), behind, planner="lin")
    assert ptp(robot, work(robot), behind).duration_s > 0.0


def test_every_refusal_is_an_error_of_this_library(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED)
    planned = refused = 0
    for number in range(60):
        start = home(robot) if number % 2 else random.uniform(-2.2, 2.2, 7)
        joints = random.uniform(-2.2, 2.2, 7)
        goal = joints if number % 3 == 0 else robot.model.forward(joints)
        planner = random.choice(["ptp", "lin", "circ", "chomp"])
        via = random.uniform(-0.8, 0.8, 3) if planner == "circ" else None
        try:
            motion = plan(robot, MotionRequest(start, goal, PlannerName(planner), FULL, via, timeout_s=0.5))
        except CobotError:
            refused += 1
        else:
            assert motion is not None
            planned += 1
    assert min(planned, refused) > 5
