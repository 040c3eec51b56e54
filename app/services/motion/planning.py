"""Planning in worker processes, so that it can neither block the service nor outlive a stop."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar, cast

from app.services.motion.planning_pool import PlanningPool, WorkerLost
from app.services.motion.planning_tasks import PlanRequest, in_scene, plan_motion
from cobot.errors import PlanningError, PlanningTimeout
from cobot.launch.forked import Forked
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene
from cobot.robot.tool import BARE
from cobot.trajectory import Trajectory

POLL_S = 0.02
ATTEMPTS = 2
"""Maximum number of workers that get the same task. The task itself may be what ends them."""

Result = TypeVar("Result")

log = logging.getLogger("cobot.planning")


@dataclass(frozen=True, slots=True)
class PlanningStatus:
    """How the pool stands.

    Attributes:
        state: "ready", "starting" while there is no worker yet, or "failed" while none can be started.
        workers: the configured number of workers.
        usable, busy: how many can be given a task or have one, and how many have one.
        replaced: how many have ended, or stood still, by no act of the service.
        problem: why no worker can be started; "" otherwise.
    """

    state: str
    workers: int
    usable: int
    busy: int
    replaced: int
    problem: str


class PlanningService:
    """A pool of planning processes, each with the robot loaded.

    Each robot has a pool of its own: what one has to plan does not keep another waiting.

    Args:
        config: the settings' file, None for the shipped one.
        robot: one of its robots, None for the default one.
        blanks: see `PlanningPool`.

    Attributes:
        scene: what everything is planned in.
        tool: what everything is planned with.
    """

    scene = Scene()
    tool = BARE

    def __init__(
        self, config: Path | None, workers: int, robot: str | None = None, blanks: list[Forked] | None = None
    ) -> None:
        chosen = {"--config": config, "--robot": robot}
        self._arguments = [part for name, value in chosen.items() if value for part in (name, str(value))]
        self._pool = PlanningPool(self._arguments, workers, blanks)

    def warm_up(self) -> None:
        """Start the workers: the first plan should not wait for their imports."""
        self._pool.start()

    @property
    def warm(self) -> bool:
        """Whether all workers have started."""
        return self._pool.usable == self._pool.size

    async def renew(self) -> None:
        """Have workers that know the settings file as it is now; returns when they are there or cannot be."""
        old = self._pool
        self._pool = PlanningPool(self._arguments, old.size)
        self._pool.replaced = old.replaced
        old.close()
        self._pool.start()
        while not (self.warm or self._pool.problem):
            await asyncio.sleep(POLL_S)

    @property
    def status(self) -> PlanningStatus:
        """How the pool stands now."""
        pool = self._pool
        problem = "" if pool.usable else pool.problem
        state = "ready" if pool.usable else "failed" if problem else "starting"
        return PlanningStatus(state, pool.size, pool.usable, pool.busy, pool.replaced, problem)

    async def plan(self, request: PlanRequest, timeout_s: float) -> Trajectory | None:
        """See `cobot.planners.plan`, `plan_waypoints` and `plan_rated`; raises as `compute` does."""
        return await self.compute(partial(plan_motion, request=request), timeout_s)

    async def compute(self, work: Callable[[RobotDescription], Result], timeout_s: float) -> Result:
        """What a picklable function makes of the robot. Cancelling this kills the worker.

        A function whose worker has been lost is given to another one: it has moved nothing.

        Args:
            timeout_s: for all of it: until a worker is free, its work, and once more what has to be.

        Raises:
            PlanningTimeout: the worker did not finish in time.
            PlanningError: the workers that had it have ended.
            UnavailableError: no worker can be started, or none was free in this time.
            CobotError: what the function raises.
        """
        asked_s = asyncio.get_running_loop().time()
        while True:
            scene, tool = self.scene, self.tool
            found = await self._compute(self.placed(work), timeout_s, asked_s)
            if scene is self.scene and tool is self.tool:
                return found
            log.info("the scene or the tool has changed meanwhile: what was planned is planned again")

    def placed(self, work: Callable[[RobotDescription], Result]) -> Callable[[RobotDescription], Result]:
        """The same, in the scene and with the tool."""
        if not self.scene.version and not self.tool.version:
            return work
        return partial(in_scene, scene=self.scene, tool=self.tool, work=work)

    async def _compute(
        self, work: Callable[[RobotDescription], Result], timeout_s: float, asked_s: float
    ) -> Result:
        for left in reversed(range(ATTEMPTS)):
            try:
                return cast(Result, await self._pool.run(work, timeout_s, asked_s))
            except TimeoutError as exc:
                raise PlanningTimeout.after(
                    timeout_s, f"planning took longer than {timeout_s:.1f} s and was given up; {exc}"
                ) from exc
            except MemoryError as exc:
                raise PlanningError("the planning process has no memory left for this motion") from exc
            except WorkerLost as exc:
                if not left:
                    raise PlanningError(f"the planning process {exc}, and so did the one before") from exc
                log.warning("the planning process %s; what it had is planned again", exc)
        raise AssertionError("unreachable")

    def close(self) -> None:
        self._pool.close()
