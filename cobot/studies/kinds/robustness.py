"""Finds the share of a program's runs that succeed when the cell differs randomly from the model.

A task is one run of the program on a simulated arm, with the real cycle and safety layer.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from cobot.config import Settings
from cobot.errors import PlanningError
from cobot.planners.forecast import evaluate_run
from cobot.robot.description import RobotDescription
from cobot.studies.chunks import Columns
from cobot.studies.kinds.disturbances import PARAMETERS, UnknownLoad
from cobot.studies.kinds.robot_study import RobotStudy
from cobot.studies.parameters.spaces import Value, seed_of
from cobot.studies.programs.program_moves import PlannedMove, Program, plan_program
from cobot.studies.study import Kernel
from cobot.types import Array
from rtloop.rehearsal import rehearse

MAX_CAUSES = 5
"""Maximum number of reasons in an answer. The table contains all of them."""


class RobustnessStudy(RobotStudy):
    """Finds the share of a program's runs that succeed when the cell differs randomly from the model.

    Attributes:
        space: some of `PARAMETERS`.
        metric: success, or one of the numbers of a run.
    """

    first_chunk: ClassVar[int] = 2
    parameter_names: ClassVar[tuple[str, ...]] = PARAMETERS

    kind: Literal["robustness"]
    metric: Literal["success", "error_m", "duration_s", "effort"] = "success"
    program: Program

    @model_validator(mode="after")
    def _require_no_search(self) -> Self:
        if self.search is not None:
            raise ValueError("search: a robustness study computes shares and has nothing to search")
        if "speed" in self.space and self.space["speed"].is_random:
            raise ValueError("space.speed: must be an axis of the grid, because each speed is planned once")
        return self

    def answer(self, columns: Columns) -> dict[str, Any]:
        causes = Counter(_kind_of(str(cause)) for cause in columns["cause"] if cause)
        most = sorted(causes.items(), key=lambda item: (-item[1], item[0]))[:MAX_CAUSES]
        return super().answer(columns) | {f"failed because {cause}": count for cause, count in most}

    def kernel(self) -> Kernel:
        speeds = {
            float(self.points.at_grid(number).get("speed", 1.0))
            for number in range(self.points.points_of_grid)
        }
        plans = {
            speed: plan_program(self.description, self.program, speed, self.seed) for speed in sorted(speeds)
        }
        return _RobustnessKernel(self, self.description, self.robot.load_settings(), plans)


@dataclass(slots=True)
class _Outcome:
    """The result of one run of the program so far. A run that fails has no duration, because it ends
    early.
    """

    success: bool = True
    cause: str = ""
    error_m: float = 0.0
    duration_s: float = 0.0
    effort: float = 0.0

    def fail(self, cause: str) -> None:
        self.success, self.cause, self.duration_s = False, cause, np.nan


@dataclass(slots=True)
class _RobustnessKernel:
    study: RobustnessStudy
    robot: RobotDescription
    settings: Settings
    plans: dict[float, list[PlannedMove]]
    names: tuple[str, ...] = field(default=("success", "cause", "error_m", "duration_s", "effort"))

    def __call__(self, first: int, last: int) -> Columns:
        runs = [self._run(task) for task in range(first, last)]
        results = {name: np.array([getattr(run, name) for run in runs]) for name in self.names}
        return {**self.study.parameters(first, last), **results}

    def _run(self, task: int) -> _Outcome:
        values: dict[str, Value] = self.study.points.at(task)
        given = {name: float(values.get(name, 0.0)) for name in PARAMETERS if name != "speed"}
        random = np.random.default_rng(seed_of(self.study.seed, task % self.study.points.count))
        offsets = random.normal(0.0, 1.0, self.robot.limits.dof) * given["joint_offset_rad"]
        part = np.array([given[f"part_{axis}_m"] for axis in "xyz"])
        run = _Outcome()
        for move in self.plans[float(values.get("speed", 1.0))]:
            joints = self._move(move, given, random, run)
            if run.success and move.tolerance_m is not None:
                self._check(move, self.robot.model.forward(joints + offsets).position, part, run)
            if not run.success:
                break
        return run

    def _move(
        self, move: PlannedMove, given: dict[str, float], random: np.random.Generator, run: _Outcome
    ) -> Array:
        """Simulate a motion, and return the joint positions at its end, rad."""
        if move.trajectory is None:
            return move.start
        load = UnknownLoad(
            self.robot,
            move.trajectory,
            given["payload_kg"],
            max(0.0, given["friction_nm"]),
            abs(given["encoder_noise_rad"]),
            random,
        )
        try:
            found = evaluate_run(
                self.robot, rehearse(self.settings, self.robot, move.start, move.trajectory, load)
            )
        except PlanningError as exc:
            run.fail(f"{move.place}: {exc}")
            return move.start
        run.duration_s += found.run.duration_s
        run.effort = max(run.effort, float(found.run.effort.max()))
        if found.flaw is not None:
            who = "" if found.flaw.joint is None else f"{found.flaw.joint}: "
            run.fail(f"{move.place} after {found.flaw.time_s:.3f} s: {who}{found.flaw.says}")
        return load.joints

    def _check(self, move: PlannedMove, place: Array, part: Array, run: _Outcome) -> None:
        """Check that the TCP reaches the part at its actual position, which is offset from the expected
        one.
        """
        assert move.tolerance_m is not None
        error_m = float(np.linalg.norm(place - (move.goal.position + part)))
        run.error_m = max(run.error_m, error_m)
        if error_m > move.tolerance_m:
            run.fail(f"{move.place}: misses the part by {error_m:.5f} m, allowed: {move.tolerance_m:g} m")


def _kind_of(cause: str) -> str:
    """A reason with its numbers removed, so that reasons that differ only in numbers are counted together."""
    place, _, text = cause.partition("]")
    return f"{place}]" + re.sub(r"\d+(\.\d+)?(e-?\d+)?(?= |$)", "...", text)
