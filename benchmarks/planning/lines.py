"""lin motions from random postures: the share of the motions found by an exhaustive search over the arm angle
that cobot finds, too, and cobot's computing time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.planning.scenes import BOXES, among
from benchmarks.table import Row, percentiles, row
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.path.lin import straight_line
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array, PlannerName, Pose, Scaling

ANGLES, PLACES, WINDOW, STEP_RAD = 240, 120, 20, 0.3
"""Of the search: so many arm angles in a turn and places on the line; from place to place no joint turns
further than the last, and the arm angle by so many steps at the most."""
LINE_M = 0.3
FULL = Scaling(1.0)


def lines(requests: int) -> Iterator[Row]:
    """Lines of 0.1 to 0.6 m from random postures, with rotations of up to 0.5 rad; and the computing time for
    lines of 0.3 m.
    """
    robot = load_robot(load_settings(None))
    for name, arm in (
        ("the empty workspace", robot),
        ("a shelf", among(robot, BOXES["shelf"](np.random.default_rng(3)))),
    ):
        random = np.random.default_rng(17)
        ours = theirs = both = 0
        solved_ms: list[float] = []
        refused_ms: list[float] = []
        for _ in range(requests):
            start, goal = _request(arm, random, random.uniform(0.1, 0.6), 0.1)
            duration_ms, solved = _planned(arm, start, goal)
            (solved_ms if solved else refused_ms).append(duration_ms)
            path = straight_line(arm.model.forward(start), goal)
            exists = exhaustive(arm, start, path.poses(np.linspace(0.0, 1.0, PLACES + 1)[1:]))
            ours, theirs, both = ours + solved, theirs + exists, both + (solved and exists)
        found = 100.0 / max(theirs, 1)
        yield row(
            f"lin in {name}, {requests} requests: found of what an exhaustive search finds",
            "",
            (found * both, float(ours)),
            "the search",
            (100.0, float(theirs)),
            columns=("found, %", "solved"),
            aim="99 %",
        )
        yield row(
            f"CPU time of lin in {name}, solved",
            "ms",
            percentiles(solved_ms),
            "refused",
            percentiles(refused_ms),
        )
    random = np.random.default_rng(19)
    times = [_planned(robot, *_request(robot, random, LINE_M, 0.0)) for _ in range(requests)]
    solved = percentiles([duration_ms for duration_ms, is_solved in times if is_solved])
    yield row("CPU time of a lin of 0.3 m, anywhere, all checks", "ms", solved, "aim", (5.0,) * 3, aim="5 ms")


def exhaustive(robot: RobotDescription, start: Array, poses: Array) -> bool:
    """Whether joint positions within the limits lead along all poses, with no collision at any of them."""
    arm = robot.model.inverse_kinematics.arm_angle
    assert arm is not None
    rows = arm.grid(poses, np.linspace(-np.pi, np.pi, ANGLES, endpoint=False))
    sources = (np.arange(ANGLES)[:, None] + np.arange(-WINDOW, WINDOW + 1)) % ANGLES
    nodes = rows[:, :, arm.of(start)[1]]  # another branch would be a flip
    good = np.asarray(~np.isnan(nodes).any(axis=2))
    good[good] = robot.collision.clearance.are_free(nodes[good])
    reached = good[0] & (np.abs(nodes[0] - start).max(axis=1) <= STEP_RAD)
    for place in range(1, len(nodes)):
        near = np.abs(nodes[place][:, None] - nodes[place - 1][sources]).max(axis=2) <= STEP_RAD
        reached = (near & reached[sources]).any(axis=1) & good[place]
    return bool(reached.any())


def _request(
    robot: RobotDescription, random: np.random.Generator, way_m: float, turn: float
) -> tuple[Array, Pose]:
    """A collision-free configuration, and a goal that the arm can reach."""
    limits, arm = robot.limits, robot.model.inverse_kinematics.arm_angle
    assert arm is not None
    while True:
        start = random.uniform(limits.min_position, limits.max_position)
        here, across = robot.model.forward(start), random.normal(size=3)
        way = way_m * across / np.linalg.norm(across)
        goal = Pose(here.position + way, here.quaternion + turn * random.normal(size=4))
        pose = np.concatenate([goal.position, goal.quaternion])[None]
        reached = not np.isnan(arm.grid(pose, np.linspace(-np.pi, np.pi, 60))).all()
        if reached and robot.collision.is_free(start):
            return start, goal


def _planned(robot: RobotDescription, start: Array, goal: Pose) -> tuple[float, bool]:
    begun = time.process_time()
    try:
        plan(robot, MotionRequest(start, goal, PlannerName.LIN, FULL))
    except CobotError:
        return 1e3 * (time.process_time() - begun), False
    return 1e3 * (time.process_time() - begun), True
