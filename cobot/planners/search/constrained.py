"""Planner ompl under constraints: RRTConnect on the surface where the constraints hold.

Newton's method projects each small step, towards a random configuration or the other tree, back to that
surface (D. Berenson, S. Srinivasa, D. Ferguson and J. Kuffner, "Manipulation planning on constraint
manifolds", 2009). The smaller tree grows next. Half of the targets are near a node of that tree, because from
within a shelf, nearly all distant targets are behind boards. Such steps also shorten the path between two of
its nodes. Finally the path is smoothed: each node moves to the middle between its neighbours.
"""

from __future__ import annotations

import itertools
import time

import numpy as np

from cobot.errors import PlanningError, PlanningTimeout
from cobot.motions.requests import MotionRequest
from cobot.planners.held import Held
from cobot.planners.search.sampling import room
from cobot.planners.search.spline import smooth_motion
from cobot.robot.clearance import Clearance
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName

STEP_RAD = 0.15
NEARBY, NEARBY_RAD = 0.5, 0.25
"""Share of the targets that are near a node of the tree, and the standard deviation of these targets. All
other targets may be anywhere.
"""
SEARCHES = 4
MUCH_WORK = 100_000
"""No search begins after this many collision checks. This is a count and not a time, so that the same
seed always gives the same path.
"""
SHORTCUTS, EVENINGS = 150, 25
EVEN_STEP_RAD = 0.08


def plan_constrained(robot: RobotDescription, request: MotionRequest, goals: Array, held: Held) -> Trajectory:
    """A smooth motion to one of the goals, shape (n, dof). The goals must be collision-free and keep the
    constraints.

    Raises:
        PlanningTimeout: no path was found within the request's time.
        CollisionError, PlanningError: the smoothed path touches something or violates a constraint.
    """
    room_m = room(robot, np.vstack([request.start, goals]))
    with robot.collision.keeping(room_m) as clearance:
        search = _Steps(held, clearance, request)
        found = search.paths(request.start, goals)
        if not found:
            raise PlanningTimeout.after(
                request.timeout_s,
                f"ompl: no free path that keeps the constraints within {request.timeout_s:.1f} s "
                f"({len(search.trees[0])} and {len(search.trees[1])} places reached from start and goal)",
            )
    reasons = []
    for way in sorted(found, key=_length):
        with robot.collision.keeping(room_m):
            corners = search.even_out(way)
        try:
            motion = smooth_motion(robot, corners, request.scaled_limits(robot), held)
            held.check(motion, PlannerName.OMPL)
        except PlanningError as exc:
            reasons.append(exc)
        else:
            return motion
    raise reasons[0]


class _Tree:
    """A search tree. Each of its nodes stores its parent."""

    def __init__(self, roots: Array) -> None:
        self._rows = np.array(roots)
        self._count = len(roots)
        self._parents = [-1] * len(roots)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> Array:
        return np.asarray(self._rows[index])

    def nearest(self, joints: Array) -> int:
        away = self._rows[: self._count] - joints
        return int(np.einsum("ij,ij->i", away, away).argmin())

    def add(self, parent: int, places: list[Array]) -> int:
        """Add a chain of nodes and return the index of the last one."""
        for place in places:
            if self._count == len(self._rows):
                self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
            self._rows[self._count] = place
            self._parents.append(parent)
            parent, self._count = self._count, self._count + 1
        return parent

    def back(self, index: int) -> list[Array]:
        """The nodes from this node back to the root of the tree."""
        way = []
        while index >= 0:
            way.append(self[index].copy())
            index = self._parents[index]
        return way


class _Steps:
    """The search for one request."""

    def __init__(self, held: Held, clearance: Clearance, request: MotionRequest) -> None:
        self._held = held
        self._clearance = clearance
        self._end_s = time.monotonic() + request.timeout_s
        self._random = np.random.default_rng(request.seed)
        self.trees: tuple[_Tree, _Tree]

    def paths(self, start: Array, goals: Array) -> list[list[Array]]:
        """Search for several paths. After a path that needed many checks, no further paths are searched
        for.
        """
        begun = self._clearance.evaluations
        found: list[list[Array]] = []
        while len(found) < SEARCHES and (way := self._connect(start, goals)):
            found.append(self._shorten(way))
            if self._clearance.evaluations - begun > MUCH_WORK:
                break
        return found

    def _connect(self, start: Array, goals: Array) -> list[Array] | None:
        """The nodes of a path, each one step away from the previous node; None if time runs out."""
        self.trees = near, far = _Tree(start[None]), _Tree(goals)
        roots, target = len(goals) - 1, goals[0]
        while not self._is_over():
            index = near.nearest(target)
            places, _ = self._toward(near[index], target)
            newest = near.add(index, places)
            other = far.nearest(near[newest])
            bridge, arrived = self._toward(far[other], near[newest])
            last = far.add(other, bridge)
            if arrived:
                way = near.back(newest)[::-1] + far.back(last)[1:]
                return way if near is self.trees[0] else way[::-1]
            near, far = self.trees
            if len(near) > len(far) - roots:
                near, far = far, near
            target = self._draw_target(near)
        return None

    def _is_over(self) -> bool:
        return time.monotonic() >= self._end_s

    def _draw_target(self, tree: _Tree) -> Array:
        """Draw the configuration towards which this tree grows next."""
        low, high = self._held.low, self._held.high
        if self._random.random() >= NEARBY:
            return self._random.uniform(low, high)
        place = tree[int(self._random.integers(len(tree)))]
        return np.clip(place + self._random.normal(0.0, NEARBY_RAD, len(place)), low, high)

    def _shorten(self, way: list[Array]) -> list[Array]:
        """Replace parts of a path by shortcuts wherever straight steps lead from one node to a later one."""
        for _ in range(SHORTCUTS):
            if len(way) < 3 or self._is_over():
                break
            begin, end = sorted(self._random.choice(len(way), 2, replace=False))
            places, arrived = self._toward(way[begin], way[end])
            if arrived and _length([way[begin], *places]) < _length(way[begin : end + 1]) - 1e-6:
                way[begin + 1 : end + 1] = places
        return way

    def even_out(self, way: list[Array]) -> Array:
        """The path in short steps, with each node moved to the middle of its neighbours, shape (n, dof)."""
        reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
        count = max(3, int(np.ceil(reached[-1] / EVEN_STEP_RAD)) + 1)
        even = np.linspace(0.0, reached[-1], count)
        rows = np.stack([np.interp(even, reached, column) for column in np.transpose(way)], axis=1)
        for index in range(1, count - 1):
            place = self._held.project(rows[index])
            rows[index] = rows[index] if place is None else place
        if not all(self._is_step(a, b) for a, b in itertools.pairwise(rows)):
            return np.array(way)
        for _ in range(EVENINGS):
            if self._is_over():
                break
            for index in range(1, count - 1):
                before, after = rows[index - 1], rows[index + 1]
                place = self._held.project(0.5 * (before + after))
                if place is not None and self._is_step(before, place) and self._is_step(place, after):
                    rows[index] = place
        return rows

    def _toward(self, here: Array, target: Array) -> tuple[list[Array], bool]:
        return self._held.projection.steps_toward(self._clearance, here, target, STEP_RAD)

    def _is_step(self, begin: Array, end: Array) -> bool:
        return self._held.projection.is_step(self._clearance, begin, end, STEP_RAD)


def _length(way: list[Array]) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
