"""Whether any arm holds still and moves: `measure` of a folder of `cobot new-robot`.

Everything runs on the virtual clock in this process. The oracle is MuJoCo, which integrates the motion of
the arm under the torques of the simulated drives.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rig import Rig

from benchmarks.arm_draws import Arm
from cobot.config import SETTINGS_FILE, load_settings
from cobot.errors import CobotError
from cobot.ipc.layout import MotionResult
from cobot.planners import MotionRequest, plan
from cobot.robot.description import load_robot
from cobot.robot.tool import BARE, Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Scaling

POSTURES, MOTIONS = 100, 20
PLANNERS = (PlannerName.PTP, PlannerName.LIN, PlannerName.OMPL)
STILL = 1e-3
"""Velocity at which an arm holds still, rad/s; of a slide, as a share of the reach per second."""
TRACKS = 1e-3
"""Tracking error that the iiwa is allowed at full speed, rad (tests/rtloop/backends/test_mujoco.py)."""
TRIES = 20
"""Pairs of start and goal that a planner is given before a motion counts as refused."""
SEARCH_S = 2.0
"""How long ompl looks for a way: between many random postures of an arm that turns far there is none."""


@dataclass(frozen=True, slots=True)
class Figures:
    """Results for one arm. Lengths of slides are divided by the reach: 1e-3 is a milliradian for a hinge, and
    a thousandth of the reach for a slide.

    Attributes:
        postures: number of free and holdable postures that were tried, without and with the payload.
        payload_kg: mass of the payload.
        still: share of the postures in which the arm holds still, without and with the payload.
        velocity: largest velocity of a joint after a second of holding, per second.
        tracking: largest difference between measured and commanded position in all motions.
        completed: number of completed motions of each planner.
        refused: number of motions for which no goal was found that the planner accepts.
        reasons: an example of what each planner said to a goal that it refused.
        faults: sentences of the motions that were started and not completed.
        seconds: time that the measurement took.
    """

    name: str
    postures: tuple[int, int]
    payload_kg: float
    still: tuple[float, float]
    velocity: float
    tracking: float
    completed: dict[str, int]
    refused: dict[str, int]
    reasons: dict[str, str]
    faults: tuple[str, ...]
    seconds: float

    @property
    def tracking_ratio(self) -> float:
        """The tracking error, as a multiple of the error that is allowed for the iiwa."""
        return self.tracking / TRACKS

    @property
    def good(self) -> bool:
        """Whether the arm holds still in every posture, and completes every motion that was started."""
        return min(self.still) == 1.0 and not self.faults and self.tracking_ratio <= 1.0

    def __str__(self) -> str:
        still = " / ".join(
            f"{100 * share:.0f} % of {count}" for share, count in zip(self.still, self.postures, strict=True)
        )
        done = ", ".join(f"{count} {name}" for name, count in self.completed.items())
        refused = ", ".join(f"{count} {name}" for name, count in self.refused.items() if count)
        parts = [
            f"{self.name}: holds still in {still} (0 / {self.payload_kg:.3g} kg)",
            f"velocity {self.velocity:.1g}",
            f"tracking {self.tracking_ratio:.2f} times the iiwa's",
            f"completed {done}",
        ]
        parts += [f"refused {refused}"] if refused else []
        parts += [f"{len(self.faults)} faults, the first: {self.faults[0]}"] if self.faults else []
        return "; ".join([*parts, f"{self.seconds:.0f} s"])


def measure(folder: Path, seed: int = 0, postures: int = POSTURES, motions: int = MOTIONS) -> Figures:
    """Hold random postures and run random motions at full speed, the second half of them with a payload.

    Args:
        folder: with cobot-setting.yaml, as `cobot new-robot` writes it.

    Raises:
        CobotError: the folder cannot be loaded.
    """
    begun_s = time.perf_counter()
    settings = load_settings(folder / SETTINGS_FILE)
    arm = Arm(settings, load_robot(settings), np.random.default_rng(seed))
    payload = arm.payload()
    bare, loaded = (arm.holdable(tool, postures) for tool in (BARE, payload))
    held = [arm.speeds(bare, BARE), arm.speeds(loaded, payload)]
    moved = _Motions(arm, (bare, loaded), (BARE, payload))
    moved.run(motions)
    speeds = np.concatenate(held)
    return Figures(
        name=settings.robot.name,
        postures=(len(bare), len(loaded)),
        payload_kg=payload.mass,
        still=(_still(held[0]), _still(held[1])),
        velocity=float(speeds.max(initial=0.0)),
        tracking=moved.tracking,
        completed=moved.completed,
        refused=moved.refused,
        reasons=moved.reasons,
        faults=tuple(moved.faults),
        seconds=time.perf_counter() - begun_s,
    )


class _Motions:
    """Random motions one after the other, each from where the last one ended.

    Attributes: see `Figures`.
    """

    def __init__(self, arm: Arm, postures: tuple[list[Array], ...], tools: tuple[Tool, ...]) -> None:
        self.arm, self._postures, self._tools = arm, postures, tools
        self.tracking = 0.0
        self.completed = {str(planner): 0 for planner in PLANNERS}
        self.refused = {str(planner): 0 for planner in PLANNERS}
        self.reasons: dict[str, str] = {}
        self.faults: list[str] = []

    def run(self, count: int) -> None:
        for postures, tool in zip(self._postures, self._tools, strict=True):
            if not postures:
                continue
            here: Array | None = None
            for number in range(count // len(self._tools)):
                here = self._next(here, postures, tool, PLANNERS[number % len(PLANNERS)])
        self.arm.robot.model.carry(BARE)

    def _next(
        self, start: Array | None, postures: list[Array], tool: Tool, planner: PlannerName
    ) -> Array | None:
        """The position in which the motion has ended; None if no motion can start there."""
        random = self.arm.random
        self.arm.robot.model.carry(tool)
        for _ in range(TRIES):
            if start is None:
                start = postures[int(random.integers(len(postures)))]
            motion = self._plan(start, postures, planner)
            if motion is not None:
                return self._execute(start, motion, tool, planner)
            start = None  # Perhaps no free way begins there, or no line.
        self.refused[str(planner)] += 1
        return start

    def _plan(self, start: Array, postures: list[Array], planner: PlannerName) -> Trajectory | None:
        random = self.arm.random
        goal = postures[int(random.integers(len(postures)))]
        aim, free = self.arm.line(start) if planner is PlannerName.LIN else (goal, ())
        request = MotionRequest(start, aim, planner, Scaling(1.0), timeout_s=SEARCH_S, free_axes=free)
        try:
            return plan(self.arm.robot, request)
        except CobotError as exc:
            self.reasons[str(planner)] = str(exc)
            return None

    def _execute(self, start: Array, motion: Trajectory, tool: Tool, planner: PlannerName) -> Array | None:
        rig = Rig(self.arm.settings, self.arm.robot, simulated=True, start=start)
        try:
            rig.loop.controller.tool_and_scene.carry(tool)
            rig.step(20)
            refusal = rig.start(motion, tool=tool.version)
            if not refusal:
                self._follow(rig)
            if not refusal and rig.result is MotionResult.ARRIVED:
                self.completed[str(planner)] += 1
                return motion.end
            self.faults.append(f"{planner}: {refusal or rig.reason or rig.result.name}")
            return None
        finally:
            rig.close()

    def _follow(self, rig: Rig) -> None:
        measured = rig.memory.state.data["position"]
        while rig.loop.controller.moving:
            rig.step()
            off = np.abs((measured[: rig.limits.dof] - rig.commanded[-1]) / self.arm.size).max()
            self.tracking = max(self.tracking, float(off))


def _still(speeds: Array) -> float:
    """The share of speeds at which an arm holds still."""
    return float((speeds < STILL).mean()) if len(speeds) else 1.0


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.any_arm", description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER", help="made by cobot new-robot")
    for folder in parser.parse_args().folders:
        try:
            print(measure(folder), flush=True)
        except CobotError as exc:
            print(f"{folder.name}: {exc}", flush=True)


if __name__ == "__main__":
    main()
