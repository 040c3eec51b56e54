"""lin through the redundancy. Oracle: an exhaustive search of ours over the arm angle on a grid."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from independent_models import largest_rates, rate_limits, second_robot
from scipy.spatial.transform import Rotation

from cobot.errors import CobotError, CollisionError, UnreachableError
from cobot.planners import MotionRequest, plan
from cobot.planners.path import joint_path
from cobot.planners.path.joint_path import MAX_DEVIATION_M, MAX_DEVIATION_RAD
from cobot.planners.path.lin import straight_line
from cobot.planners.path.redundancy import ENCLOSING, MESHES, RedundancyGraph
from cobot.robot import quaternion
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

SEED = 20261123
PLACES, ANGLES, WINDOW, STEP_RAD = 100, 180, 15, 0.3


def exists(robot: RobotDescription, start: Array, poses: Array) -> bool:
    """Whether joints within the limits lead along all poses that nowhere turn far from one to the next."""
    arm = robot.model.inverse_kinematics.arm_angle
    assert arm is not None
    rows = arm.grid(poses, np.linspace(-np.pi, np.pi, ANGLES, endpoint=False))
    sources = (np.arange(ANGLES)[:, None] + np.arange(-WINDOW, WINDOW + 1)) % ANGLES
    nodes = rows[:, :, arm.of(start)[1]]  # another branch would be a flip
    good = ~np.isnan(nodes).any(axis=2)
    good[good] = robot.collision.clearance.are_free(nodes[good])
    reached = good[0] & (np.abs(nodes[0] - start).max(axis=1) <= STEP_RAD)
    for before, here, free in zip(nodes, nodes[1:], good[1:], strict=False):
        near = np.abs(here[:, None] - before[sources]).max(axis=2) <= STEP_RAD
        reached = (near & reached[sources]).any(axis=1) & free
    return bool(reached.any())


def problems(robot: RobotDescription, count: int) -> list[tuple[Array, Pose]]:
    """Free configurations anywhere within the limits, and goals 0.1 to 0.6 m from there, turned."""
    random, limits = np.random.default_rng(SEED), robot.limits
    found: list[tuple[Array, Pose]] = []
    while len(found) < count:
        start = random.uniform(limits.min_position, limits.max_position)
        here, across = robot.model.forward(start), random.normal(size=3)
        way = random.uniform(0.1, 0.6) * across / np.linalg.norm(across)
        goal = Pose(here.position + way, here.quaternion + 0.1 * random.normal(size=4))
        if robot.collision.is_free(start):
            found.append((start, goal))
    return found


def lin(robot: RobotDescription, start: Array, goal: Pose, speed: float = 1.0) -> Trajectory:
    motion = plan(robot, MotionRequest(start, goal, PlannerName.LIN, Scaling(speed)))
    assert motion is not None
    return motion


@pytest.mark.thorough
def test_lin_finds_what_an_exhaustive_search_over_the_arm_angle_finds(robot: RobotDescription) -> None:
    both = missed = 0
    for start, goal in problems(robot, 50):
        line = straight_line(robot.model.forward(start), goal)
        try:
            motion = lin(robot, start, goal)
        except CobotError:
            missed += exists(robot, start, line.poses(np.linspace(0.0, 1.0, PLACES + 1)[1:]))
            continue
        both += 1
        places, turns = second_robot().path(motion.sample(np.linspace(0.0, motion.duration_s, 150)))
        begin, way = line.pose_at(0.0).position, goal.position - line.pose_at(0.0).position
        shares = (places - begin) @ way / (way @ way)
        beside = places - begin - shares[:, None] * way
        assert np.linalg.norm(beside, axis=1).max() <= MAX_DEVIATION_M, start
        wanted = Rotation.from_quat(line.poses(shares)[:, 3:], scalar_first=True)
        assert (wanted.inv() * turns).magnitude().max() <= MAX_DEVIATION_RAD, start
        used = largest_rates(motion) / rate_limits(robot.limits)
        assert used.max() <= 1.0 + 1e-6
    assert missed == 0
    assert both >= 20


def test_the_line_that_took_22_s_takes_little_more_than_one(robot: RobotDescription) -> None:
    start = np.array([2.66, 1.0181, -1.3849, 0.0279, -2.3634, 0.7365, -0.7479])
    goal = Pose(np.array([-0.776, 0.3592, 0.507]), np.array([0.61633, 0.29657, -0.16455, -0.71071]))
    assert lin(robot, start, goal).duration_s < 1.25


def test_the_hand_turns_on_where_its_own_joint_is_at_its_limit(robot: RobotDescription) -> None:
    start = np.array(robot.positions["work"].joints)
    start[6] = 2.9
    here = robot.model.forward(start)
    turned = quaternion.product(quaternion.exp((0.0, 0.0, -0.8)), here.quaternion.tolist())
    motion = lin(robot, start, Pose(here.position, np.array(turned)))
    assert (motion.extrema(0)[1] <= robot.limits.max_position).all()


def test_a_mesh_that_has_a_way_is_in_the_enclosing_one(robot: RobotDescription) -> None:
    ways = 0
    for start, goal in problems(robot, 12):
        line = straight_line(robot.model.forward(start), goal)
        enclosing = RedundancyGraph(robot, start, line, ENCLOSING, leading_on=True)
        for mesh in MESHES:
            if RedundancyGraph(robot, start, line, mesh).has_way(free=True):
                ways += 1
                assert enclosing.has_way(free=False), start
                assert enclosing.has_way(free=True), start
    assert ways >= 10


def test_a_line_without_any_way_is_refused_before_a_way_is_smoothed(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So a refusal takes no longer than an answer."""
    monkeypatch.setattr(RedundancyGraph, "profiles", lambda *_: pytest.fail("no way is there to be smoothed"))
    start = np.array(robot.positions["work"].joints)
    here = robot.model.forward(start)
    down = Pose(np.array([here.position[0], here.position[1], 0.0]), here.quaternion)
    with pytest.raises(CollisionError, match="collision of floor and link7"):
        lin(robot, start, down)
    start[6] = 2.9
    here = robot.model.forward(start)
    turned = quaternion.product(quaternion.exp((0.0, 0.0, -2.5)), here.quaternion.tolist())
    with pytest.raises(UnreachableError, match="joint7 reaches its limit"):
        lin(robot, start, Pose(here.position, np.array(turned)))


def test_a_mesh_is_filled_only_where_a_way_leads_through_it(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The enclosing mesh has ways along this line, but none of the others does."""
    start = np.array([3.0, -0.1, -1.2, 0.3, -0.8, -1.6, 0.1])
    filled = []
    init = RedundancyGraph.__init__

    def noted(graph: RedundancyGraph, *args: Any, leading_on: bool = False) -> None:
        filled.append(not leading_on)
        init(graph, *args, leading_on=leading_on)

    monkeypatch.setattr(RedundancyGraph, "__init__", noted)
    goal = Pose(np.array([-0.1, -0.4, 0.9]), robot.model.forward(start).quaternion)
    line = straight_line(robot.model.forward(start), goal)
    assert RedundancyGraph(robot, start, line, ENCLOSING, leading_on=True).has_way(free=False)
    with pytest.raises(UnreachableError, match="no arm angle reaches beyond"):
        lin(robot, start, goal)
    assert not any(filled)


@pytest.mark.parametrize(
    ("start", "goal", "is_planned"),
    [  # the elbow is nearly straight, so other arm angles begin with a jump; and joint2 is at its limit
        ((2.0643, -0.4029, 1.778, 0.0129, 1.7289, -0.733, 0.952), (-0.05, -0.01, 1.24), False),
        ((1.793, -2.1, -1.341, -0.985, -0.081, 0.847, -2.496), (0.318, -0.338, 0.262), True),
    ],
)
def test_places_are_added_only_while_they_help(
    robot: RobotDescription,
    monkeypatch: pytest.MonkeyPatch,
    start: tuple[float, ...],
    goal: tuple[float, ...],
    is_planned: bool,
) -> None:
    """Otherwise one line needs up to 1000 places, 21 times."""
    places: list[int] = []
    find_spoiled = joint_path._find_spoiled

    def counted(*args: Any) -> tuple[Array, float]:
        places.append(len(args[4]))
        return find_spoiled(*args)

    monkeypatch.setattr(joint_path, "_find_spoiled", counted)
    joints = np.array(start)
    end = Pose(np.array(goal), robot.model.forward(joints).quaternion)
    with nullcontext() if is_planned else pytest.raises(UnreachableError, match="joint3 reaches its limit"):
        lin(robot, joints, end)
    assert max(places) < 150
    assert len(places) < 150


def test_a_refusal_says_how_far_any_arm_angle_leads(robot: RobotDescription) -> None:
    start = np.array(robot.positions["work"].joints)
    start[6] = 2.9
    here = robot.model.forward(start)
    turned = quaternion.product(quaternion.exp((0.0, 0.0, -2.5)), here.quaternion.tolist())
    message = r"joint7 reaches its limit of 3\.0500 rad; no arm angle reaches beyond \d+ % of the path$"
    with pytest.raises(UnreachableError, match=message):
        lin(robot, start, Pose(here.position, np.array(turned)))
