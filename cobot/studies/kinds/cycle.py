"""Finds the shortest cycle of a program whose waypoints, order, speeds and blend radii may be changed within
limits.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from cobot.errors import LimitError, PlanningError
from cobot.planners.blending.joined import joined, leg_of
from cobot.robot.description import RobotDescription
from cobot.studies.chunks import Columns
from cobot.studies.kinds.robot_study import RobotStudy
from cobot.studies.parameters.spaces import Axis, Value
from cobot.studies.programs.program_moves import (
    PlannedMove,
    Program,
    StudyMove,
    nearest_program,
    plan_moves,
    plan_program,
)
from cobot.studies.study import Kernel

PARAMETERS = ("speed", "blend_radius_m")
"""Parameters that a file may contain. All other parameters follow from the program."""
MAX_FREE = 6
"""Maximum number of motions in a group with free order, because six motions already give 720 orders."""


class CycleStudy(RobotStudy):
    """Finds the parameters that make a program fastest.

    Attributes:
        space: some of `PARAMETERS`. Each move with `within_m` adds move1_x_m, move1_y_m and move1_z_m (with
            its number), and each group of `orders` adds order1: the number of a permutation.
        orders: groups of moves whose goals may be visited in any order. A move is given by its position in
            the program.
    """

    first_chunk: ClassVar[int] = 2
    parameter_names: ClassVar[tuple[str, ...]] = PARAMETERS

    kind: Literal["cycle"]
    metric: Literal["duration_s"] = "duration_s"
    goal: Literal["max", "min"] = "min"
    program: Program
    orders: Annotated[
        list[Annotated[list[int], Field(min_length=2, max_length=MAX_FREE)]], Field(max_length=20)
    ] = Field(default_factory=list)

    @model_validator(mode="after")
    def _require_consistency(self) -> Self:
        places = [place for group in self.orders for place in group]
        for place in places:
            if not 1 <= place < len(self.program) or places.count(place) > 1:
                raise ValueError(
                    f"orders: {place} occurs twice or is not a move of the program; "
                    f"valid: 1 to {len(self.program) - 1}"
                )
        for number, move in enumerate(self.program):
            if move.within_m is not None and (move.pose is None or number == 0):
                raise ValueError(f"program[{number}].within_m: needs a pose; it cannot move joint angles")
        return self

    @cached_property
    def axes(self) -> dict[str, Axis]:
        found = dict(self.space)
        for number, move in enumerate(self.program):
            if move.within_m is not None:
                span = [-move.within_m, move.within_m]
                found |= {f"move{number}_{axis}_m": Axis(uniform=span) for axis in "xyz"}
        for number, group in enumerate(self.orders, start=1):
            orders = len(list(itertools.permutations(group)))
            found[f"order{number}"] = Axis(values=[float(order) for order in range(orders)])
        return found

    def answer(self, columns: Columns) -> dict[str, Any]:
        answer = super().answer(columns)
        unplanned = int((columns["cause"] != "").sum())
        if unplanned:
            first = next(str(cause) for cause in columns["cause"] if cause)
            answer |= {"cannot be planned": unplanned, "the first program fails because": first}
        if unplanned and unplanned == len(columns["cause"]) and "planned" in columns:
            answer["no program can be planned"] = nearest_program(columns, self.axes)
        durations = np.asarray(columns["duration_s"], dtype=float)
        if np.isfinite(durations).any():
            best = int(np.nanargmin(durations))
            answer["duration_s as written"] = float(
                durations[best] + np.asarray(columns["saved_s"], dtype=float)[best]
            )
        return answer

    def program_with(self, values: dict[str, Value]) -> list[StudyMove]:
        """The program in which the given parameters are set."""
        moves = list(self.program)
        for number, move in enumerate(self.program):
            if move.within_m is not None and move.pose is not None:
                shift = [float(values[f"move{number}_{axis}_m"]) for axis in "xyz"]
                position = [at + by for at, by in zip(move.pose[:3], shift, strict=True)]
                moves[number] = move.model_copy(update={"pose": [*position, *move.pose[3:]]})
        free = list(moves)
        for number, group in enumerate(self.orders, start=1):
            chosen = list(itertools.permutations(group))[int(float(values[f"order{number}"]))]
            for place, source in zip(group, chosen, strict=True):
                moves[place] = free[source]
        return moves

    def kernel(self) -> Kernel:
        as_written = duration_of(
            plan_program(self.description, self.program, 1.0, self.seed), self.description, 0.0
        )
        return _CycleKernel(self, self.description, as_written)


@dataclass(slots=True)
class _CycleKernel:
    study: CycleStudy
    robot: RobotDescription
    as_written_s: float

    def __call__(self, first: int, last: int) -> Columns:
        rows = [self._duration(self.study.at(task)) for task in range(first, last)]
        durations = np.array([duration_s for duration_s, _, _ in rows])
        results: dict[str, Any] = {
            "duration_s": durations,
            "saved_s": self.as_written_s - durations,
            "planned": np.array([planned for _, planned, _ in rows]),
            "cause": np.array([cause for _, _, cause in rows]),
        }
        return {**self.study.parameters(first, last), **results}

    def _duration(self, values: dict[str, Value]) -> tuple[float, int, str]:
        """The duration (s) and the number of planned motions. If the program cannot be planned, the duration
        is NaN, and the text gives the reason.
        """
        speed, radius_m = float(values.get("speed", 1.0)), float(values.get("blend_radius_m", 0.0))
        planned: list[PlannedMove] = []
        try:
            for move in plan_moves(self.robot, self.study.program_with(values), speed, self.study.seed):
                planned.append(move)  # noqa: PERF402 - those before an error count
            return duration_of(planned, self.robot, radius_m), len(planned), ""
        except (PlanningError, LimitError) as exc:
            return float("nan"), len(planned), str(exc)[:200]


def duration_of(planned: list[PlannedMove], robot: RobotDescription, radius_m: float) -> float:
    """A program's duration, s, if the given blend radius is used at all corners where the arm need not stop.

    Raises:
        PlanningError: the motions cannot be blended.
    """
    moves = [move for move in planned if move.trajectory is not None]
    if not moves:
        return 0.0
    legs = [leg_of(robot, move.request, move.trajectory) for move in moves if move.trajectory is not None]
    if radius_m <= 0.0 or len(legs) == 1:
        return float(sum(leg.motion.duration_s for leg in legs))
    radii_m = [0.0 if move.stop else radius_m for move in moves[:-1]]
    return float(joined(robot, legs, radii_m).trajectory.duration_s)
