"""The nearest parts of an arm to each other and to its surroundings, and the nearest points of these
parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import numpy.typing as npt

from cobot.types import Array, Numbers3

if TYPE_CHECKING:
    from cobot.robot.collision import CollisionChecker

FARTHEST_M = 1.0
"""Largest distance that is computed. Objects farther away do not matter."""
TURNS = 17
"""Number of angles at which the distance of a pair is compared if only one joint moves the pair. It is a
prime, so that few symmetric shapes look the same at all of these angles.
"""
SAME_M = 1e-6


@dataclass(frozen=True, slots=True)
class Nearest:
    """Two parts and the distance between them.

    Attributes:
        distance_m: distance of the parts; negative if they overlap.
        points: the nearest points of the first and of the second part, in the base frame, m.
        row: index of the configuration among those that were given.
    """

    first: str
    second: str
    distance_m: float
    points: tuple[Numbers3, Numbers3]
    row: int


class NearestParts:
    """Finds the nearest parts, for one scene and one tool. Not thread safe.

    Pairs whose distance no joint changes, such as a turret over a floor, are left out. Their distance says
    nothing about a motion, and it would hide the distances of other pairs.
    """

    def __init__(self, checker: CollisionChecker, base: str) -> None:
        self._checker, self._base = checker, base
        self._data = mujoco.MjData(checker.mj)
        own = np.array(checker.are_own(), dtype=bool)
        changes = self._find_changing()
        self._own, self._around = np.flatnonzero(own & changes), np.flatnonzero(~own & changes)

    def at(self, joints: Array) -> tuple[Nearest | None, Nearest | None]:
        """The result of `among` for one configuration, shape (dof,)."""
        return self.among(np.asarray(joints, dtype=float)[None])

    def distances(self, rows: Array, farthest_m: float = FARTHEST_M) -> Array:
        """The distance of each pair at each row of joints, at most `farthest_m`. Shape: (n, pairs), in m."""
        if not self._checker.pairs:
            return np.zeros((len(rows), 0))
        return self._checker.clearance.distances(rows, farthest_m)

    def among(self, rows: Array) -> tuple[Nearest | None, Nearest | None]:
        """The nearest pairs of parts over all rows of joints, shape (n, dof). The first pair is within the
        robot; the second is between the robot and its surroundings. A pair that is farther apart than
        `FARTHEST_M` is None.
        """
        return self._least(rows, self._own), self._least(rows, self._around)

    def _least(self, rows: Array, chosen: npt.NDArray[np.intp]) -> Nearest | None:
        found = self._checker.clearance.nearest(rows, chosen, FARTHEST_M)
        if found is None:
            return None
        row, pair, distance_m = found
        points = self._points(rows[row], pair, distance_m)
        return Nearest(*self._checker.names(pair), distance_m, points, row)

    def _points(self, joints: Array, pair: int, distance_m: float) -> tuple[Numbers3, Numbers3]:
        mj, data = self._checker.mj, self._data
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        ends = np.zeros(6)
        geom, other = self._checker.pairs[pair]
        within_m = distance_m + SAME_M + FARTHEST_M
        cube = self._checker.clearance.nearest_cube(joints, pair, within_m)
        if cube is not None:
            other += 1  # the geom that represents one cube, see `Clearance`
            data.geom_xpos[other] = cube
        mujoco.mj_geomDistance(mj, data, geom, other, within_m, ends)
        base = data.body(self._base)
        first, second = (ends.reshape(2, 3) - base.xpos) @ base.xmat.reshape(3, 3)
        return _point(first), _point(second)

    def _find_changing(self) -> npt.NDArray[np.bool_]:
        """Whether each pair's distance changes with the joints. Only joints that move exactly one of the
        pair's two parts can change it.
        """
        mj, pairs = self._checker.mj, self._checker.pairs
        joints_of = [self._joints_of(body) for body in range(mj.nbody)]
        joints_of_geom = [joints_of[body] for body in mj.geom_bodyid.tolist()]
        moving = [joints_of_geom[first] ^ joints_of_geom[second] for first, second in pairs]
        changes = np.array([bool(joints) for joints in moving], dtype=bool)
        for joint in range(self._checker.clearance.dof):
            alone = [pair for pair, joints in enumerate(moving) if joints == {joint}]
            if not alone:
                continue
            rows = np.tile(mj.qpos0, (TURNS, 1))
            low, high = mj.jnt_range[joint] if mj.jnt_limited[joint] else (-np.pi, np.pi)
            rows[:, joint] = np.linspace(float(low), float(high), TURNS)
            distances = self.distances(rows)[:, alone]
            # A pair that is far apart at all these angles may be nearer at angles between them.
            changes[alone] = (np.ptp(distances, axis=0) > SAME_M) | (distances.min(axis=0) >= FARTHEST_M)
        return changes

    def _joints_of(self, body: int) -> set[int]:
        """The joints that move a body."""
        mj, found = self._checker.mj, set[int]()
        while body:
            begin = int(mj.body_jntadr[body])
            found |= set(range(begin, begin + int(mj.body_jntnum[body])))
            body = int(mj.body_parentid[body])
        return found


def _point(point: Sequence[float] | Array) -> Numbers3:
    x, y, z = (float(each) for each in point)
    return x, y, z
