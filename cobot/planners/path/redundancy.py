"""Planning the arm angle of an S-R-S arm along a TCP path. It is the only degree of freedom that a TCP path
leaves.

The nodes of a graph are arm angles at evenly spaced points along the path. Two nodes at neighbouring points
are connected if each joint turns so little between them that the motion is continuous. The cheapest route is
smoothed as far as limits and surroundings permit, and becomes a spline of the arm angle. The inverse
kinematics stays in the branch of the start: it could only change its branch where axes align, which happens
at single points of the graph.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from cobot.planners.lattice import cheapest, leads
from cobot.planners.path.tcp_path import TcpPath
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import SrsArm
from cobot.types import Array

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

PLACE_M, PLACE_RAD = 0.015, 0.06
MIN_PLACES, MAX_PLACES = 24, 128
NEAR_LIMIT_RAD, AT_LIMIT = 0.1, 0.5
"""Distance from a joint limit below which a node has a cost, rad, and the cost of a path that stays at the
limit from start to end, s².
"""
ALIGNED_RAD = 0.02
SMOOTHNESS = (1e4, 1e3, 1e2, 10.0, 1.0, 0.1, 0.0)
"""Weights of the curvature of the arm angle, relative to the weight of its distance from the path through
the graph. The weights are tried in this order.
"""
PULLS, EDGE, HELD = 8, 0.15, 1e9
"""Three values for smoothing: the number of rounds in which points outside the corridor are moved back into
it; how far inside they are moved, as a share of the distance from the edge to the path through the graph; and
the weight that keeps the start in place.
"""
DEGREE = 5
MARGIN_RAD = 1e-4


@dataclass(frozen=True, slots=True)
class Mesh:
    """Resolution of the graph.

    Attributes:
        factor: factor for the number of points.
        angles: arm angles per full turn.
        window: largest change of the arm angle between points, in these steps.
        step_rad: largest joint step between points.
    """

    factor: int
    angles: int
    window: int
    step_rad: float


MESHES = Mesh(1, 72, 6, 0.6), Mesh(2, 180, 12, 0.5), Mesh(4, 360, 20, 0.4)
ENCLOSING = Mesh(
    1,
    max(mesh.angles for mesh in MESHES),
    max(mesh.window * 360 * mesh.factor // mesh.angles for mesh in MESHES),
    max(mesh.step_rad * mesh.factor for mesh in MESHES),
)
"""A mesh that contains every route through any of `MESHES`: it contains all their arm angles, only the points
that they share, and steps as large as theirs. If this mesh has no route, the others have none either.
"""


@dataclass(frozen=True, slots=True)
class Profile:
    """The arm angle along the path.

    Attributes:
        arm, path: the arm and the path that it follows.
        branch: branch of the inverse kinematics.
        spline: arm angle over the share of the path, [0, 1], rad.
    """

    arm: SrsArm
    path: TcpPath
    branch: int
    spline: BSpline

    def joints_at(self, share: float, near: Array) -> Array | None:
        pose = self.path.poses(np.array([share]))[0]
        return self.arm.joints(pose, float(self.spline(share)), self.branch)

    def rows(self, shares: Array) -> Array | None:
        """The joint positions at the given shares; None if a share has no joint positions. Shapes: (n, dof)
        and (n,).
        """
        found = [
            self.arm.joints(pose, float(angle), self.branch)
            for pose, angle in zip(self.path.poses(shares), self.spline(shares), strict=True)
        ]
        return None if any(joints is None for joints in found) else np.array(found)


class RedundancyGraph:
    """The graph of one path and one start."""

    def __init__(
        self,
        robot: RobotDescription,
        start: Array,
        path: TcpPath,
        mesh: Mesh,
        end: Array | None = None,
        leading_on: bool = False,
    ) -> None:
        """
        Args:
            end: joints in which all paths end, shape (dof,), at the end of the TCP path; None means any.
            leading_on: leave out nodes that cannot be reached from the start.
        """
        arm = robot.model.inverse_kinematics.arm_angle
        assert arm is not None
        self._robot, self._arm, self._path, self._mesh = robot, arm, path, mesh
        self._start = start
        places = max(path.length_m / PLACE_M, path.angle_rad / PLACE_RAD, path.places)
        count = mesh.factor * int(np.clip(np.ceil(places), MIN_PLACES, MAX_PLACES))
        self.shares = np.linspace(0.0, 1.0, count + 1)
        self._angles = np.linspace(-np.pi, np.pi, mesh.angles, endpoint=False)
        self._branches = self._branches_at(start)
        self._rows: dict[int, Array]
        """Joints of each branch at n points and m arm angles, shape (n, m, dof); NaN where there
        is no node.
        """
        poses = path.poses(self.shares[1:])
        if leading_on:
            self._rows = {
                branch: arm.leading_on(poses, self._angles, start, branch, mesh.window, mesh.step_rad)
                for branch in self._branches
            }
        else:
            rows = arm.grid(poses, self._angles, self._branches)
            self._rows = {branch: rows[:, :, index] for index, branch in enumerate(self._branches)}
        self._end: tuple[float, int] | None = None
        if end is not None:
            self._end = arm.of(end)
            self._lead_to(end)
        self._free: dict[int, npt.NDArray[np.bool_]] = {}
        self._cost: dict[int, Array] = {}
        self.reached = 0.0

    def profiles(self) -> Iterator[Profile]:
        """The profiles of routes: first the cheapest route of each branch at the start, smoothest first, then
        the cheapest route through collision-free nodes.
        """
        from scipy.interpolate import BSpline

        known: dict[int, Array] = {}
        for free in (False, True):
            for branch in self._branches:
                angles = self._cheapest(branch, free)
                if angles is None:
                    continue
                corridor = self._corridor(angles[1:], branch, free)
                way = np.vstack([angles[1:], corridor])
                if branch in known and np.array_equal(known[branch], way):
                    continue  # its profiles would be the same
                known[branch] = way
                if self._end is not None:  # the last node represents the end itself
                    angles[-1] += (self._end[0] - angles[-1] + np.pi) % (2.0 * np.pi) - np.pi
                for smoothness in SMOOTHNESS:
                    curve = _smooth_within(angles, corridor, smoothness, self._end is not None)
                    yield Profile(self._arm, self._path, branch, BSpline(*curve, DEGREE))

    def has_way(self, free: bool) -> bool:
        """Whether at least one route reaches the end. With `free`, the route must pass through collision-free
        nodes only.
        """
        for branch in self._branches:
            rows, mesh = self._rows[branch], self._mesh
            good = self._are_free(branch) if free else ~np.isnan(rows[:, :, 0])
            reached = leads(rows, good, self._start, mesh.window, mesh.step_rad)
            self.reached = max(self.reached, float(self.shares[reached]))
            if reached == len(rows):
                return True
        return False

    def _lead_to(self, end: Array) -> None:
        """Replace the node nearest to `end` with `end`, and remove all other nodes at the end of the path."""
        assert self._end is not None
        angle, branch = self._end
        step = self._angles[1] - self._angles[0]
        for each, rows in self._rows.items():
            rows[-1] = np.nan
            if each == branch:
                rows[-1, round((angle + np.pi) / step) % len(self._angles)] = end

    def _corridor(self, angles: Array, branch: int, free: bool) -> Array:
        """The lowest and the highest arm angle at each point, shape (2, n). All nodes between the given angle
        and these two angles are valid.
        """
        good = np.isfinite(self._costs(branch))
        if free:
            good &= self._are_free(branch)
        count, step = len(self._angles), self._angles[1] - self._angles[0]
        nodes = np.rint((angles + np.pi) / step).astype(int) % count
        ways = np.arange(count)
        bounds = []
        for sign in (-1, 1):
            seen = np.take_along_axis(good, (nodes[:, None] + sign * ways) % count, axis=1)
            bounds.append(angles + sign * step * (np.logical_and.accumulate(seen, axis=1).sum(axis=1) - 1.0))
        return np.array(bounds)

    def _branches_at(self, start: Array) -> list[int]:
        """The branch of the inverse kinematics at the start and, where axes are nearly aligned, the
        neighbouring branches.
        """
        aside = ALIGNED_RAD * np.eye(len(start))
        others = {self._arm.of(joints)[1] for joints in (*(start + aside), *(start - aside))}
        own = self._arm.of(start)[1]
        return [own, *sorted(others - {own})]

    def _cheapest(self, branch: int, free: bool) -> Array | None:
        """The arm angles at all points of the cheapest route, without jumps by full turns; None if no route
        reaches the end. Shape: (n + 1,).

        free: use only nodes that are free of collisions.
        """
        costs = self._costs(branch)
        if free:
            costs = np.where(self._are_free(branch), costs, np.inf)
        weights, mesh = 1.0 / self._robot.limits.max_velocity, self._mesh
        indices, _ = cheapest(self._rows[branch], costs, self._start, weights, mesh.window, mesh.step_rad)
        if len(indices) == 0:
            return None
        angle, _ = self._arm.of(self._start)
        return np.unwrap(np.concatenate([[angle], self._angles[indices]]))

    def _costs(self, branch: int) -> Array:
        """The cost of the nodes of a branch, shape (n, m); infinite for nodes without joint angles."""
        if branch not in self._cost:
            limits, rows = self._robot.limits, self._rows[branch]
            margin = np.minimum(rows - limits.min_position, limits.max_position - rows)
            near = np.clip(1.0 - margin / NEAR_LIMIT_RAD, 0.0, None)
            cost = AT_LIMIT / len(rows) * (near**2).sum(axis=2)
            good = margin.min(axis=2) >= MARGIN_RAD  # not where the joints are NaN
            self._cost[branch] = np.where(good, cost, np.inf)
        return self._cost[branch]

    def _are_free(self, branch: int) -> npt.NDArray[np.bool_]:
        if branch not in self._free:
            rows = self._rows[branch]
            there = np.asarray(~np.isnan(rows[:, :, 0]))
            there[there] = self._robot.collision.clearance.are_free(rows[there])
            self._free[branch] = there
        return self._free[branch]


def _smooth_within(angles: Array, corridor: Array, smoothness: float, to_end: bool) -> tuple[Array, Array]:
    """Fit a spline to angles at evenly spaced points, and return its knots and control points. The spline
    begins at the first angle. If `to_end` is true, it ends at the last angle.

    Whittaker's smoothing minimises the squared distances to the angles plus squared second differences.
    Points outside the corridor, shape (2, n - 1), are moved to its edge with increasing weight.
    """
    count = len(angles)
    knots = np.concatenate([np.zeros(DEGREE), np.linspace(0.0, 1.0, count - DEGREE + 1), np.ones(DEGREE)])
    greville = np.array([knots[i + 1 : i + DEGREE + 1].mean() for i in range(count)])
    even = np.linspace(0.0, 1.0, count)
    wanted = np.interp(greville, even, angles)
    low = np.interp(
        greville, even[1:], np.minimum(corridor[0] + EDGE * (angles[1:] - corridor[0]), angles[1:])
    )
    high = np.interp(
        greville, even[1:], np.maximum(corridor[1] + EDGE * (angles[1:] - corridor[1]), angles[1:])
    )
    weights = np.ones(count)
    fixed = [0, -1] if to_end else [0]
    weights[fixed] = HELD * (1.0 + smoothness)
    for _ in range(PULLS):
        points = _whittaker(wanted, weights, smoothness)
        points[fixed] = angles[fixed]
        inside = np.clip(points, low, high)
        outside = np.abs(inside[1:] - points[1:]) > 0.0
        if not outside.any():
            break
        wanted[1:][outside] = inside[1:][outside]
        weights[1:][outside] *= 10.0
    return knots, points


def _whittaker(wanted: Array, weights: Array, smoothness: float) -> Array:
    from scipy.linalg import solveh_banded

    count = len(wanted)
    bands = np.zeros((3, count))
    for row, value in enumerate((1.0, -2.0, 1.0)):
        for column, other in enumerate((1.0, -2.0, 1.0)[: row + 1]):
            bands[row - column, column : count - 2 + column] += smoothness * value * other
    bands[0] += weights
    return np.asarray(solveh_banded(bands, weights * wanted, lower=True))
