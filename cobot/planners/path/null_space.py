"""Joint paths along a TCP path, for redundant arms for which no arm angle is defined.

A particle filter carries a set of configurations along the path. At each point, neighbours are drawn from
their null space. Those that are collision-free and near a configuration at the previous point are kept, each
with the cheapest route to it (dynamic programming). The cheapest route to the end is then smoothed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from cobot.planners.lattice import link
from cobot.planners.path.joint_path import POSE_SHARE
from cobot.planners.path.tcp_path import TcpPath
from cobot.robot.description import RobotDescription
from cobot.types import Array

FEW, MANY = 120, 360
"""Number of configurations. The second number is used if the search with the first finds no collision-free
route.
"""
FINER = 4
"""Factor for the number of points, for a narrow passage near a limit."""
SPREADS_RAD = (0.02, 0.08, 0.25)
"""Standard deviations of the random neighbours, used in turn, rad."""
NEAR_SHARE = 0.1
"""A configuration that is nearer to a limit than this share of the joint's range costs more, at most as much
as one full step.
"""
STEP_RAD = 0.3
"""Largest joint step between points."""
PLACE_M, PLACE_RAD, MAX_PLACES = 0.015, 0.1, 200
INSIDE_RAD = 8e-3
"""Distance that the path keeps from joint limits, rad or m, unless the start is nearer to a limit. The
splines between points need this margin, or less if points are closer together.
"""
AHEAD = 2
"""Number of places beyond the end of all routes that a trial must pass before a larger search begins."""
STEPS = 30
SMOOTHINGS = (60, 15, 4)
"""Numbers of smoothing rounds. If the smoothed route touches something, the next smaller number is used."""


class Particles:
    """Joint paths along one TCP path from one start. Equal arguments give equal results.

    Attributes:
        shares: points on the path, as shares of it, shape (n,).
        reached: share of the path that the joints reach.
    """

    def __init__(
        self,
        robot: RobotDescription,
        start: Array,
        path: TcpPath,
        count: int,
        factor: int = 1,
        end: Array | None = None,
    ) -> None:
        """
        Args:
            count: number of configurations.
            factor: factor for the number of points.
            end: joints in which all routes end, shape (dof,); None means any.
        """
        self._robot, self._arm = robot, robot.model.kinematics(path.free)
        self._count, self._random = count, np.random.default_rng(count)
        self._path, self._start = path, start
        self._keep_inside(INSIDE_RAD / factor)
        places = max(path.places, path.length_m / PLACE_M, path.angle_rad / PLACE_RAD)
        self.shares = np.linspace(0.0, 1.0, factor * min(MAX_PLACES, int(np.ceil(places))) + 1)
        self._poses = path.poses(self.shares)
        self.reached = 0.0
        self._end = end
        self._last: list[tuple[Array, Array]] = []
        """The configurations at the last two places that routes reach, and the costs of these routes."""
        self._next = 0
        """Index of the place after them."""
        self._way = self._carry(start)

    def ways(self) -> Iterator[Array]:
        """Yield, for each route, the joint positions at all shares, shape (n, dof). The smoothest route is
        first. Yields nothing if no route reaches the end.
        """
        for count in SMOOTHINGS if self._way is not None else ():
            yield self._smooth(count)

    def may_go_on(self, count: int, factor: int) -> bool:
        """Whether any route continues for the next `AHEAD` places after the place where all routes of this
        search end.

        Args:
            count, factor: number of configurations, and factor for the number of places, from the last two
                places before it.
        """
        if self._end is not None:
            return True
        self._count = count
        self._keep_inside(INSIDE_RAD / factor)
        rows, costs = self._last[0]
        begin, end = self._next - len(self._last), min(self._next + AHEAD, len(self.shares) - 1)
        shares = np.linspace(self.shares[begin], self.shares[end], factor * (end - begin) + 1)[1:]
        for share, pose in zip(shares, self._path.poses(shares), strict=True):
            rows, costs, _ = self._step(rows, costs, pose, 0)
            if len(rows) == 0:
                return False
            self.reached = max(self.reached, float(share))
        return True

    def _keep_inside(self, room_rad: float) -> None:
        """Keep this distance (rad or m) from the joint limits. If the start is nearer to a limit, keep only
        the start's distance.
        """
        limits = self._robot.limits
        self._low = np.minimum(limits.min_position + room_rad, self._start)
        self._high = np.maximum(limits.max_position - room_rad, self._start)

    def _carry(self, start: Array) -> Array | None:
        rows, costs = start[None], np.zeros(1)
        history, parents = [rows], [np.zeros(1, dtype=np.intp)]
        for place, (share, pose) in enumerate(zip(self.shares[1:], self._poses[1:], strict=True), start=1):
            self._last, self._next = [*self._last[-1:], (rows, costs)], place
            rows, costs, parent = self._step(rows, costs, pose, len(self.shares) - place)
            if len(rows) == 0:
                return None
            history.append(rows)
            parents.append(parent)
            self.reached = float(share)
        way = [int(costs.argmin())]
        for each in parents[:0:-1]:
            way.append(int(each[way[-1]]))
        return np.array([rows[index] for rows, index in zip(history, way[::-1], strict=True)])

    def _step(
        self, rows: Array, costs: Array, pose: Array, left: int
    ) -> tuple[Array, Array, npt.NDArray[np.intp]]:
        """Return the configurations that routes can reach at the next place, the cost of the cheapest route
        to each, and the index in `rows` from which this route comes.
        """
        found = self._around(rows, costs, pose, left)
        weights = 1.0 / self._robot.limits.max_velocity
        parent, total = link(found, self._nearness(found), rows, costs, weights, STEP_RAD)
        reached = np.isfinite(total)
        return found[reached], total[reached], parent[reached]

    def _around(self, rows: Array, costs: Array, pose: Array, left: int) -> Array:
        """Random collision-free configurations at a pose, near `rows`. Rows with a lower cost get more of
        them.

        If the end is given, every second configuration is moved towards it, by one of the `left` remaining
        steps.
        """
        if self._end is not None and left == 1:
            return self._end[None]
        order = np.argsort(costs)[: self._count // 3]
        indices = np.arange(self._count)
        near = rows[order[indices % len(order)]]
        if self._end is not None:
            near[::2] += (self._end - near[::2]) / left
        drawn = indices[len(order) :]
        spreads = np.take(SPREADS_RAD, drawn % len(SPREADS_RAD))
        near[drawn] += spreads[:, None] * self._random.normal(size=(len(drawn), rows.shape[1]))
        kept = self._arm.descend_all(pose, near, STEPS, (self._low, self._high), POSE_SHARE)
        return kept[self._robot.collision.clearance.are_free(kept)] if len(kept) else kept

    def _descend(self, pose: Array, near: Array) -> tuple[Array, bool, float, float]:
        return self._arm.descend(pose, near, STEPS, within=(self._low, self._high), share=POSE_SHARE)

    def _nearness(self, rows: Array) -> Array:
        """The cost of configurations that are near joint limits."""
        room = np.minimum(rows - self._low, self._high - rows) / (self._high - self._low)
        near = np.clip(1.0 - room / NEAR_SHARE, 0.0, 1.0)
        return np.asarray((near**2).sum(axis=1) * (STEP_RAD / self._robot.limits.max_velocity.max()) ** 2)

    def _smooth(self, count: int) -> Array:
        assert self._way is not None
        rows = self._way.copy()
        for _ in range(count):
            for index in range(1, len(rows) if self._end is None else len(rows) - 1):
                after = rows[min(index + 1, len(rows) - 1)]
                middle = 0.25 * rows[index - 1] + 0.5 * rows[index] + 0.25 * after
                joints, solved, _, _ = self._descend(self._poses[index], middle)
                if solved and self._robot.collision.is_free(joints):
                    rows[index] = joints
        return rows
