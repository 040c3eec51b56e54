"""Seeded problems in clutter for the benchmark and the tests: tables, shelves, cages and bins.

Each is the shipped arm among boxes, a start and a goal, both poses that a task would ask for; the straight
joint motion between them is not free.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from cobot.config import load_settings
from cobot.robot.clearance import Clearance
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import solve_near
from cobot.robot.model import RobotModel
from cobot.types import Array, Pose

KINDS = ("table", "shelf", "cage", "bin")
SPARE_M = 0.002
"""Starts and goals have so much more room than the margin."""
DOWN, AHEAD = (0.0, np.pi, 0.0), (0.0, np.pi / 2.0, 0.0)
TRIES = 12
Box = tuple[float, float, float, float, float, float]
"""x, y, z of the middle and half the edges, m."""


@dataclass(frozen=True, slots=True)
class Problem:
    """A motion that must be found.

    Attributes:
        robot: the arm in its scene.
        start, goal: shape (dof,), rad.
        pose: of the TCP at the goal.
    """

    name: str
    robot: RobotDescription
    start: Array
    goal: Array
    pose: Pose


def problems(robot: RobotDescription, kind: str, count: int, seed: int = 1) -> Iterator[Problem]:
    """This number of problems of a kind, two in each scene."""
    random = np.random.default_rng([seed, KINDS.index(kind)])
    made = 0
    while made < count:
        there = among(robot, BOXES[kind](random))
        for _ in range(2):
            problem = _problem(there, kind, random)
            if problem is not None and made < count:
                made += 1
                yield replace(problem, name=f"{kind} {made}")


def among(robot: RobotDescription, boxes: list[Box]) -> RobotDescription:
    """The arm among boxes. The boxes are fixed in the world of the base frame."""
    mj = _with_boxes(robot, boxes)
    model = RobotModel(mj, robot.limits, robot.base_frame, mj.site(robot.model.tcp_site).name)
    return replace(robot, model=model, collision=CollisionChecker(model, robot.collision.margin_m))


def _with_boxes(robot: RobotDescription, boxes: list[Box]) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_file(str(load_settings(None).robot.model))
    for index, box in enumerate(boxes):
        spec.worldbody.add_geom(
            name=f"box{index + 1}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=list(box[:3]), size=list(box[3:])
        )
    return spec.compile()


def _table(random: np.random.Generator) -> list[Box]:
    top = random.uniform(0.1, 0.3)
    boxes: list[Box] = [(0.62, 0.0, top - 0.02, 0.3, 0.6, 0.02)]
    for _ in range(7):
        half = random.uniform(0.03, [0.07, 0.07, 0.18])
        x, y = random.uniform([0.42, -0.5], [0.85, 0.5])
        boxes.append((x, y, top + half[2], *half))
    return boxes


def _shelf(random: np.random.Generator) -> list[Box]:
    x, width = random.uniform(0.72, 0.8), random.uniform(0.35, 0.45)
    boards = 0.1 + np.cumsum([0.0, *random.uniform(0.3, 0.4, 3)])
    middle, half = 0.5 * (boards[0] + boards[-1]), 0.5 * (boards[-1] - boards[0])
    boxes: list[Box] = [(x, 0.0, board, 0.15, width, 0.01) for board in boards]
    boxes += [(x, side * width, middle, 0.15, 0.01, half) for side in (-1.0, 0.0, 1.0)]
    return [*boxes, (x + 0.16, 0.0, middle, 0.01, width, half)]


def _cage(random: np.random.Generator) -> list[Box]:
    radius, phase = random.uniform(0.45, 0.55), random.uniform(0.0, 2.0 * np.pi)
    posts = phase + np.linspace(0.0, 2.0 * np.pi, 7)[:-1]
    boxes: list[Box] = [(radius * np.cos(a), radius * np.sin(a), 0.45, 0.025, 0.025, 0.45) for a in posts]
    for side in (-1.0, 1.0):
        boxes.append((side * radius, 0.0, 0.92, 0.02, radius, 0.02))
        boxes.append((0.0, side * radius, 0.92, radius, 0.02, 0.02))
    return boxes


def _bin(random: np.random.Generator) -> list[Box]:
    boxes: list[Box] = []
    for side in (-1.0, 1.0):
        x, y, high = 0.6, side * random.uniform(0.28, 0.36), random.uniform(0.1, 0.17)
        boxes += [(x, y, 0.01, 0.2, 0.16, 0.01)]
        boxes += [(x + dx, y, high, 0.01, 0.16, high) for dx in (-0.2, 0.2)]
        boxes += [(x, y + dy, high, 0.2, 0.01, high) for dy in (-0.16, 0.16)]
    return boxes


BOXES = {"table": _table, "shelf": _shelf, "cage": _cage, "bin": _bin}
REGIONS = {
    "table": ([0.42, -0.5, 0.2], [0.8, 0.5, 0.5], DOWN),
    "shelf": ([0.5, -0.4, 0.2], [0.8, 0.4, 1.05], AHEAD),
    "cage": ([-0.7, -0.7, 0.2], [0.7, 0.7, 0.8], None),
    "bin": ([0.45, 0.2, 0.08], [0.75, 0.42, 0.3], DOWN),
}


def _problem(robot: RobotDescription, kind: str, random: np.random.Generator) -> Problem | None:
    with robot.collision.keeping(robot.collision.margin_m + SPARE_M) as clearance:
        for _ in range(TRIES):
            start = _somewhere(robot, clearance, kind, random, -1.0)
            goal = None if start is None else _somewhere(robot, clearance, kind, random, 1.0)
            if start is not None and goal is not None and not clearance.is_edge_free(start, goal):
                return Problem(kind, robot, start, goal, robot.model.forward(goal))
    return None


def _somewhere(
    robot: RobotDescription, clearance: Clearance, kind: str, random: np.random.Generator, side: float
) -> Array | None:
    """Collision-free joint angles at a pose that the task requires. If there are two bins, the pose is in the
    bin on this side.
    """
    low, high, turn = REGIONS[kind]
    limits = robot.limits
    for _ in range(TRIES):
        x, y, z = random.uniform(low, high)
        turned = random.uniform(-np.pi, np.pi, 3)
        if turn is not None:
            turned[1:] = turn[1:]
            turned[0] *= turn is DOWN
        pose = Pose.from_abc(x, y * (side if kind == "bin" else 1.0), z, *turned)
        for _ in range(3):
            seed = random.uniform(limits.min_position, limits.max_position)
            descent = solve_near(robot.model, pose, seed)
            if descent.solved and clearance.is_free(descent.joints):
                return descent.joints
    return None
