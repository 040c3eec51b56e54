"""Scenes as point clouds: the time until a point cloud can be used, and planning among its voxels.

The problems are those of `motion_bench_maker`; the points are on the surfaces of their solids.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from benchmarks.planning.motion_bench_maker import Problem, unpacked
from benchmarks.table import Row, row
from cobot.errors import CobotError
from cobot.planners import MotionRequest, plan
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.geometry.cells import boxes_of, packed
from cobot.robot.scene import Scene, SceneObject
from cobot.types import Array, PlannerName, Pose, Scaling

COUNTS = (1000, 10_000, 100_000)
VOXEL_M = 0.01
SPREAD_RAD = 0.3
ROWS = 320
TIMEOUT_S = 5.0
COLUMNS = ("p50", "p95", "max")


def clouds(every: int) -> Iterator[Row]:
    """Every so-manyth problem of each scene, with so many points."""
    for each in unpacked("clouds", ["panda"], every):
        robot, chosen = each.robot, each.problems
        usual = _plans(robot, chosen, lambda problem: problem.scene)
        for count in COUNTS:
            yield from _rows(robot, chosen, count, usual)


def _rows(robot: RobotDescription, chosen: list[Problem], count: int, usual: list[float]) -> Iterator[Row]:
    random = np.random.default_rng(count)
    usable, checks, edges = [], [], []
    for problem in chosen[:7]:
        points = points_on(problem.scene, count, random)
        begun_ns = time.process_time_ns()
        cloud = cloud_of(points, VOXEL_M)
        checker = robot.collision.among(Scene(1, {"cloud": cloud}))
        checker.clearance.enclose()
        usable.append((time.process_time_ns() - begun_ns) / 1e6)
        boxes = robot.collision.among(Scene(1, {"cloud": replace(cloud, cells="", voxel=0.0)}))
        near = problem.goal + SPREAD_RAD * random.normal(size=(ROWS, robot.limits.dof))
        near = np.clip(near, robot.limits.min_position, robot.limits.max_position)
        times = [_checks(each, near) for each in (checker, boxes)]
        checks.append([each[0] for each in times])
        edges.append([each[1] for each in times])
    yield row(
        f"{count} points, voxels of 1 cm: from the points to a scene that planners can use, CPU", "ms",
        _three(usable), "nothing", (0.0, 0.0, 0.0), columns=COLUMNS,
    )  # fmt: skip
    for name, found in (("a configuration", checks), ("an edge between free ones", edges)):
        ours, theirs = np.transpose(found)
        yield row(
            f"{count} points: a check of {name} near the goal", "µs", _three(ours),
            "the boxes that streams check, at most 500", _three(theirs), columns=COLUMNS,
        )  # fmt: skip
    planned = _plans(
        robot,
        chosen,
        lambda problem: Scene(1, {"cloud": cloud_of(points_on(problem.scene, count, random), VOXEL_M)}),
    )
    yield row(
        f"{count} points: ompl, {len(planned)} of {len(chosen)} solved", "ms", _three(planned),
        "the solids themselves", _three(usual), columns=COLUMNS,
    )  # fmt: skip


def _checks(checker: CollisionChecker, near: Array) -> tuple[float, float]:
    """CPU time of a check of a configuration, and of an edge between two free ones, µs."""
    clearance = checker.clearance
    clearance.enclose()
    begun_ns = time.process_time_ns()
    free = near[clearance.are_free(near)]
    single_us = (time.process_time_ns() - begun_ns) / 1e3 / len(near)
    begun_ns = time.process_time_ns()
    for ends in pairwise(free):
        clearance.is_edge_free(*ends)
    return single_us, (time.process_time_ns() - begun_ns) / 1e3 / max(1, len(free) - 1)


def _plans(
    robot: RobotDescription, chosen: list[Problem], scene_of: Callable[[Problem], Scene]
) -> list[float]:
    found = []
    for problem in chosen:
        there = replace(robot, collision=robot.collision.among(scene_of(problem)))
        there.collision.clearance.enclose()
        request = MotionRequest(
            problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=TIMEOUT_S
        )
        begun_ns = time.process_time_ns()
        try:
            plan(there, request)
        except CobotError:
            continue
        found.append((time.process_time_ns() - begun_ns) / 1e6)
    return found


def cloud_of(points: Array, voxel_m: float) -> SceneObject:
    """The voxels that contain these points, shape (n, 3), m."""
    cells = packed(points, voxel_m)
    boxes, beyond_m = boxes_of(cells, voxel_m)
    return SceneObject(
        "point_cloud",
        tuple(np.ptp(points, axis=0).tolist()),
        (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0),
        boxes=tuple(map(tuple, boxes.tolist())),
        tolerance=beyond_m,
        cells=cells,
        voxel=voxel_m,
    )


def points_on(scene: Scene, count: int, random: np.random.Generator) -> Array:
    """This number of points on the surfaces of the boxes and cylinders. The solids are first made smaller by
    one voxel on all sides, so that the voxels stay within the original solids and the problem keeps its
    solution.
    """
    areas = np.array([_area(each) for each in scene.objects.values()])
    counts = np.maximum(1, (count * areas / areas.sum()).astype(int))
    return np.vstack(
        [
            _on(each, each_count, random)
            for each, each_count in zip(scene.objects.values(), counts, strict=True)
        ]
    )


def _area(each: SceneObject) -> float:
    if each.shape == "box":
        x, y, z = each.size
        return 2.0 * (x * y + y * z + z * x)
    radius, length = each.size
    return 2.0 * np.pi * radius * (radius + length)


def _on(each: SceneObject, count: int, random: np.random.Generator) -> Array:
    if each.shape == "box":
        half = np.maximum(0.5 * np.array(each.size) - VOXEL_M, 0.0)
        faces = np.array([half[1] * half[2], half[2] * half[0], half[0] * half[1]]) + 1e-9
        points = random.uniform(-1.0, 1.0, (count, 3))
        axes = random.choice(3, count, p=faces / faces.sum())
        points[np.arange(count), axes] = random.choice([-1.0, 1.0], count)
        points *= half
    else:
        radius, half_m = (max(0.0, size - VOXEL_M) for size in (each.size[0], 0.5 * each.size[1]))
        angles = random.uniform(0.0, 2.0 * np.pi, count)
        on_side = random.uniform(size=count) * (2.0 * half_m + radius) < 2.0 * half_m
        out = np.where(on_side, radius, radius * np.sqrt(random.uniform(size=count)))
        ends = random.choice([-half_m, half_m], count)
        height = np.where(on_side, random.uniform(-half_m, half_m, count), ends)
        points = np.column_stack([out * np.cos(angles), out * np.sin(angles), height])
    return Pose.from_numbers(each.pose).apply(points)


def _three(values: Array | list[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in np.percentile(values, (50.0, 95.0, 100.0)))
