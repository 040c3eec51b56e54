"""Verdicts about random configurations: of the spheres, of exact distances and of MuJoCo; and verdicts with
point clouds.

The scenes are those of `motion_bench_maker`. Half of the configurations are anywhere within the limits, and
half are near a goal.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator
from dataclasses import dataclass, field

import mujoco
import numpy as np

from benchmarks.planning.clouds import cloud_of, points_on
from benchmarks.planning.motion_bench_maker import ARMS, Problem, unpacked
from benchmarks.table import Row, row
from cobot.robot.clearance import INSTRUCTIONS, Clearance
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene
from cobot.types import Array

BLOCK = 4096
SPREAD_RAD = 0.3
ITERATION_M = 1e-6
"""Accuracy of MuJoCo's distances."""
POINTS = 10_000
VOXELS_M = (0.005, 0.01, 0.02, 0.04)
FINE_M = 1e-4
"""Edge of the voxels that stand for the points themselves: their distance is too small by at most 0.17 mm."""
FAR_M = 0.3


@dataclass(slots=True)
class Tally:
    """Numbers of configurations. A verdict is "too near" or "free". Each oracle gives its own verdict."""

    total: int = 0
    too_near: int = 0
    free_but_near: int = 0
    free_but_near_by_mujoco: int = 0
    near_but_free: int = 0
    near_but_free_by_mujoco: int = 0
    undecided: int = 0
    undecided_and_free: int = 0
    lost_m: list[Array] = field(default_factory=list)
    """Distance beyond the margin, m, of configurations that are free and that the spheres do not decide."""


def verdicts(count: int) -> Iterator[Row]:
    """Check this number of configurations of the arms in their scenes, and a thousandth of this number among
    points.
    """
    random = np.random.default_rng(count)
    for each in unpacked("verdicts", list(ARMS), 100):
        tally = Tally()
        for problem in each.problems:
            blocks = max(1, round(count / (len(ARMS) * len(each.problems) * BLOCK)))
            _judge(each.robot.collision.among(problem.scene), each.robot, problem, blocks, random, tally)
        yield from _rows(each.arm, tally)
        if each.arm == "panda":
            yield from _cloud_rows(each.robot, each.problems, max(200, count // 1000), random)


def _judge(
    checker: CollisionChecker,
    robot: RobotDescription,
    problem: Problem,
    blocks: int,
    random: np.random.Generator,
    tally: Tally,
) -> None:
    exact = _exact(robot, problem.scene)
    by_mujoco = _Contacts(checker)
    for _ in range(blocks):
        rows = _near(robot, problem, BLOCK, random)
        found = checker.clearance.sphere_verdicts(rows)
        assert found is not None
        hit, _, unsure, _ = found
        is_free = exact.are_free(rows)
        spare_m = by_mujoco.spare(rows)
        tally.total += len(rows)
        tally.too_near += int((~is_free).sum())
        tally.free_but_near += int((~unsure & ~hit & ~is_free).sum())
        tally.free_but_near_by_mujoco += int((~unsure & ~hit & (spare_m < -ITERATION_M)).sum())
        tally.near_but_free += int((hit & is_free).sum())
        tally.near_but_free_by_mujoco += int((hit & (spare_m > ITERATION_M)).sum())
        left = unsure & ~hit
        tally.undecided += int(left.sum())
        lost = rows[left & is_free]
        tally.undecided_and_free += len(lost)
        if len(lost):
            distances = exact.distances(lost, FAR_M)
            tally.lost_m.append(distances.min(axis=1) - checker.margin_m)


class _Contacts:
    """MuJoCo's own collision detection and kinematics, for the pairs that cobot checks."""

    def __init__(self, checker: CollisionChecker) -> None:
        self._mj = copy.deepcopy(checker.mj)
        self._mj.geom_margin[:] = self._mj.pair_margin[:] = checker.margin_m
        self._data = mujoco.MjData(self._mj)
        self._margin_m = checker.margin_m
        self._checked = np.zeros((self._mj.ngeom, self._mj.ngeom), dtype=bool)
        for first, second in checker.clearance.pairs:
            self._checked[first, second] = self._checked[second, first] = True

    def spare(self, rows: Array) -> Array:
        """Distance of the nearest contact beyond the margin, m, for each row; infinite if there is none."""
        found = np.full(len(rows), np.inf)
        for place, joints in enumerate(rows):
            self._data.qpos[: len(joints)] = joints
            mujoco.mj_kinematics(self._mj, self._data)
            mujoco.mj_collision(self._mj, self._data)
            if self._data.ncon:
                contact = self._data.contact
                checked = self._checked[contact.geom[:, 0], contact.geom[:, 1]]
                found[place] = contact.dist[checked].min(initial=np.inf) - self._margin_m
        return found


def _exact(robot: RobotDescription, scene: Scene) -> Clearance:
    """A check of this scene without spheres."""
    before = os.environ.get(INSTRUCTIONS)
    os.environ[INSTRUCTIONS] = "exact"
    try:
        clearance = robot.collision.among(scene).clearance
        clearance.enclose()
    finally:
        if before is None:
            del os.environ[INSTRUCTIONS]
        else:
            os.environ[INSTRUCTIONS] = before
    return clearance


def _near(robot: RobotDescription, problem: Problem, count: int, random: np.random.Generator) -> Array:
    limits = robot.limits
    rows = random.uniform(limits.min_position, limits.max_position, (count, limits.dof))
    rows[::2] = problem.goal + SPREAD_RAD * random.normal(size=rows[::2].shape)
    return np.clip(rows, limits.min_position, limits.max_position)


def _rows(arm: str, tally: Tally) -> Iterator[Row]:
    wrong = {
        "free, exact distances": tally.free_but_near,
        "free, MuJoCo": tally.free_but_near_by_mujoco,
        "too near, exact distances": tally.near_but_free,
        "too near, MuJoCo": tally.near_but_free_by_mujoco,
    }
    yield row(
        f"{arm}, {tally.total} configurations, {tally.too_near} too near: wrong verdicts of the spheres",
        "",
        list(wrong.values()),
        "none",
        (0.0,) * len(wrong),
        columns=tuple(wrong),
        aim="0",
    )
    lost_mm = 1e3 * np.concatenate(tally.lost_m) if tally.lost_m else np.zeros(1)
    yield row(
        f"{arm}: configurations that the spheres leave to exact distances, and those of them that are free",
        "",
        (100.0 * tally.undecided / tally.total, 100.0 * tally.undecided_and_free / tally.total),
        "how far these are beyond the margin at p50 and at most, mm",
        (float(np.median(lost_mm)), float(lost_mm.max())),
        columns=("% left", "% left and free"),
    )


def _cloud_rows(
    robot: RobotDescription, problems: list[Problem], count: int, random: np.random.Generator
) -> Iterator[Row]:
    wrong = dict.fromkeys(VOXELS_M, 0)
    lost_mm: dict[float, list[Array]] = {voxel_m: [] for voxel_m in VOXELS_M}
    free = missed = 0
    for problem in problems:
        points = points_on(problem.scene, POINTS, random)
        rows = _near(robot, problem, count // len(problems), random)
        fine = _among(robot, points, FINE_M)
        is_free, fine_m = fine.are_free(rows), _from_cloud(fine, rows)
        free += int(is_free.sum())
        for voxel_m in VOXELS_M:
            coarse = _among(robot, points, voxel_m)
            found = coarse.are_free(rows)
            wrong[voxel_m] += int((is_free & ~found).sum())
            missed += int((found & ~is_free).sum())
            coarse_m = _from_cloud(coarse, rows)
            apart = (coarse_m > 0.0) & (fine_m < FAR_M)
            lost_mm[voxel_m].append(1e3 * (fine_m - coarse_m)[apart])
    for voxel_m in VOXELS_M:
        found_mm = np.concatenate(lost_mm[voxel_m])
        least, most, largest = np.percentile(found_mm, (50.0, 95.0, 100.0))
        yield row(
            f"{POINTS} points in voxels of {1e3 * voxel_m:g} mm: share of {free} free configurations",
            "",
            (100.0 * wrong[voxel_m] / max(1, free),),
            f"loss of clearance: {least:.1f} / {most:.1f} / {largest:.1f} mm (p50 / p95 / max)",
            (0.0,),
            columns=("% rejected",),
        )
    yield row(
        "configurations too near to a point, but accepted with any voxels",
        "",
        (missed,),
        "none",
        (0.0,),
        columns=("number",),
        aim="0",
    )


def _among(robot: RobotDescription, points: Array, voxel_m: float) -> Clearance:
    clearance = robot.collision.among(Scene(1, {"cloud": cloud_of(points, voxel_m)})).clearance
    clearance.enclose()
    return clearance


def _from_cloud(clearance: Clearance, rows: Array) -> Array:
    """The distance of the arm from the voxels, m, at most `FAR_M`."""
    pairs = [index for index, pair in enumerate(clearance.pairs) if set(pair) & set(clearance.clouds)]
    return np.asarray(clearance.distances(rows, FAR_M)[:, pairs].min(axis=1))
