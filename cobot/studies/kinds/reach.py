"""Finds the poses that an arm reaches: by inverse kinematics alone, without collisions, or on a straight line
from a start.

A task is one place with all its orientations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from cobot.errors import LimitError, PlanningError
from cobot.motions.planners import PlannerName
from cobot.motions.requests import MotionRequest
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import SrsArm
from cobot.studies.chunks import Columns
from cobot.studies.kinds.reach_space import Approach, Places, PlacesSpace, orientations, places_of
from cobot.studies.robot_choice import RobotChoice, hashes_of, joints_at
from cobot.studies.study import Kernel, Study
from cobot.types import Array, Pose, Scaling

ARM_ANGLES = np.linspace(-np.pi, np.pi, 36, endpoint=False)
"""Arm angles that are tried for an arm with a redundant elbow, rad."""
BRANCHES = 24
"""Maximum number of solutions that are tried for all other arms."""
MANIPULABILITY = 2
"""Number of the manipulability criterion in compiled code."""
Indices = npt.NDArray[np.int64]


class ReachStudy(Study):
    """Determines which places an arm can reach with its TCP, and in what share of the orientations it can
    reach each place.

    Attributes:
        metric: the result that colours the map.
        method: criterion for a reached pose. ik: joint angles within the limits reach it. free: these joint
            angles are also free of collisions. lin: a straight, collision-free line of the TCP leads to the
            pose from `start` at full speed.
        approach: directions of the TCP's z axis, see `Approach`.
        spins: number of turns about each direction.
        start: start for the method lin: a named position or joint angles, rad.
    """

    first_chunk: ClassVar[int] = 32
    maps: ClassVar[bool] = True

    kind: Literal["reach"]
    metric: Literal["share", "manipulability", "redundancy"] = "share"
    robot: RobotChoice = RobotChoice()
    space: PlacesSpace
    method: Literal["ik", "free", "lin"] = "free"
    approach: Approach = "down"
    spins: Annotated[int, Field(ge=1, le=360)] = 1
    start: str | list[float] | None = None

    @model_validator(mode="after")
    def _require_start(self) -> Self:
        if (self.method == "lin") != (self.start is not None):
            raise ValueError(
                f"start: must be given for the method lin and for no other; the method is {self.method}"
            )
        if self.approach == "inward" and self.space.mesh is None:
            raise ValueError(
                "approach: inward needs space.mesh: a box has no surface; use down or directions"
            )
        return self

    @cached_property
    def _places(self) -> Places:
        return places_of(self.space)

    @property
    def tasks(self) -> int:
        return len(self._places.positions)

    @cached_property
    def _robot(self) -> RobotDescription:
        return self.robot.load()

    def contents(self) -> dict[str, str]:
        return hashes_of(self._robot) | self.space.contents()

    def kernel(self) -> Kernel:
        robot, places = self._robot, self._places
        start = None if self.start is None else joints_at(robot, self.start, "start")
        if start is not None:
            robot.collision.check_position(start, "start")
        return ReachKernel(robot, places, self.approach, self.spins, self.method, start, self.seed)

    @property
    def metric_of_map(self) -> str:
        return self.metric

    def answer(self, columns: Columns) -> dict[str, Any]:
        reached, solved = columns["reached"] > 0, columns["solved"] > 0  # type: ignore[operator]
        share = np.asarray(columns["share"], dtype=float)
        known = np.isfinite(share)
        answer: dict[str, Any] = {
            "places": int(known.sum()),
            "places reached": int(reached.sum()),
            "places reached in all orientations": int((share == 1.0).sum()),
            "places with joints, but not free of collision": int((solved & ~reached).sum()),
            "mean share of orientations": float(share[known].mean()) if known.any() else None,
        }
        if self.space.box is not None and self.space.spacing_m > 0.0:
            answer["reached volume, m³"] = float(reached.sum() * self.space.spacing_m**3)
        if reached.any():
            best = int(np.nanargmax(np.asarray(columns["manipulability"], dtype=float)))
            answer["best manipulability"] = float(columns["manipulability"][best])
            answer["at"] = [round(float(columns[axis][best]), 6) for axis in "xyz"]
        else:
            answer |= self._nearest(columns)
        return answer

    def _nearest(self, columns: Columns) -> dict[str, Any]:
        """A sentence for a space in which the arm reaches no place. It names the place closest to the arm's
        reach.
        """
        gaps = np.asarray(columns["gap_m"], dtype=float)
        nearest = int(np.nanargmin(gaps)) if np.isfinite(gaps).any() else 0
        place = [round(float(columns[axis][nearest]), 6) for axis in "xyz"]
        gap = float(gaps[nearest])
        why = f"it is {gap:.3f} m beyond the reach" if gap > 0.0 else "joint limits or collisions prevent it"
        return {"no place is reached": f"the nearest to it is {place}: {why}"}


class Reached(NamedTuple):
    """The result for one place; see docs/studies.md."""

    orientations: int
    solved: int
    reached: int
    share: float
    manipulability: float
    redundancy: float
    gap_m: float


@dataclass(slots=True)
class ReachKernel:
    robot: RobotDescription
    places: Places
    approach: Any
    spins: int
    method: str
    start: Array | None
    seed: int
    same: Array | None = None

    def __call__(self, first: int, last: int) -> Columns:
        rows = [self._place(task) for task in range(first, last)]
        positions = self.places.positions[first:last]
        found = {
            name: np.array(values)
            for name, values in zip(Reached._fields, zip(*rows, strict=True), strict=True)
        }
        return {axis: positions[:, index] for index, axis in enumerate("xyz")} | found

    def _place(self, task: int) -> Reached:
        return self.evaluate(self.poses(task), task)

    def poses(self, task: int) -> Array:
        """The poses of the TCP at a place, shape (n, 7)."""
        turns = self._turns(task)
        return np.column_stack([np.broadcast_to(self.places.positions[task], (len(turns), 3)), turns])

    def evaluate(self, poses: Array, task: int) -> Reached:
        """Examine the poses of one place.

        Args:
            task: number of the task. It is the seed of the random numbers for arms without a closed form.
        """
        arm = self.robot.model.inverse_kinematics
        grid = arm.grid(poses, ARM_ANGLES) if isinstance(arm, SrsArm) else None
        solved, reached, best, redundancy, gap = 0, 0, np.nan, np.nan, np.inf
        for index, pose in enumerate(poses):
            rows, angles = self._solutions(pose, task, grid, index)
            if not len(rows):
                gap = min(gap, arm.gap(pose))
                continue
            solved, gap, usable = solved + 1, 0.0, self._usable(rows)
            if usable.any() and (self.method != "lin" or self._is_on_line(pose)):
                reached += 1
                best = np.fmax(best, max(arm.manipulability(row) for row in rows[usable]))
                angles = angles[usable]
                width = len(angles) if grid is None else len(np.unique(angles[angles >= 0])) / len(ARM_ANGLES)
                redundancy = np.fmax(redundancy, width)
        count = len(poses)
        return Reached(count, solved, reached, reached / count, float(best), float(redundancy), float(gap))

    def _turns(self, task: int) -> Array:
        """The orientations at a place. They are the same at all places unless they follow a surface."""
        normals = self.places.normals if self.approach == "inward" else None
        if self.same is None or normals is not None:
            self.same = orientations(self.approach, self.spins, None if normals is None else normals[task])
        return self.same

    def _solutions(self, pose: Array, task: int, grid: Array | None, index: int) -> tuple[Array, Indices]:
        """Joint positions for a pose, shape (n, dof): the best solution of each branch, and the solutions on
        the grid of arm angles.

        Also returns, for each of them, the number of its arm angle on the grid, or -1.
        """
        limits = self.robot.limits
        arm, middle = self.robot.model.inverse_kinematics, 0.5 * (limits.min_position + limits.max_position)
        found = arm.solve_all(pose, middle, MANIPULABILITY, BRANCHES, (self.seed + task) % 2**31)
        if not found:
            return np.zeros((0, limits.dof)), np.zeros(0, int)
        if grid is None:
            return np.array(found), np.full(len(found), -1)
        angles, branches = np.nonzero(np.isfinite(grid[index, ..., 0]))
        marks = np.concatenate([np.full(len(found), -1), angles])
        return np.vstack([found, grid[index, angles, branches]]), marks

    def _usable(self, rows: Array) -> npt.NDArray[np.bool_]:
        """Whether each solution may be used. It must be free of collisions, unless the method is ik."""
        if self.method == "ik" or not len(rows):
            return np.ones(len(rows), bool)
        return self.robot.collision.clearance.are_free(rows)

    def _is_on_line(self, pose: Array) -> bool:
        """Whether the TCP can move on a straight line from the start to this pose."""
        from cobot.planners import plan

        assert self.start is not None
        goal = Pose.from_numbers(pose)
        request = MotionRequest(self.start, goal, PlannerName.LIN, Scaling(1.0), seed=self.seed % 2**31)
        try:
            plan(self.robot, request)
        except (PlanningError, LimitError):
            return False
        return True
