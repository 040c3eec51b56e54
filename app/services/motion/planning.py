"""Plans in worker processes, so that planning neither blocks the service nor continues after a stop."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar, cast

from app.services.motion.planning_pool import PlanningPool, Preparation, WorkerLost
from app.services.motion.planning_tasks import surround
from cobot.errors import PlanningError, PlanningTimeout
from cobot.launch.forked import Forked
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene
from cobot.robot.tool import BARE, Tool

POLL_S = 0.02
ATTEMPTS = 2
"""Maximum number of workers that get the same task, because the task itself may be what crashes them."""

Result = TypeVar("Result")

log = logging.getLogger("cobot.planning")


@dataclass(frozen=True, slots=True)
class PlanningStatus:
    """State of the pool of planning processes.

    Attributes:
        state: "ready", "starting" while there is no worker yet, or "failed" while none can be started.
        workers: the configured number of workers.
        usable, busy: number of working processes, and number of those that have a task.
        replaced: number of workers that have ended or were suspended without a request of the service.
        problem: reason why no worker can be started; "" if workers can be started.
    """

    state: str
    workers: int
    usable: int
    busy: int
    replaced: int
    problem: str


class PlanningService:
    """A pool of planning processes, each with the robot loaded.

    Each robot has its own pool, so that planning for one robot does not delay other robots.

    Args:
        config: settings file; None for the file that ships with cobot.
        robot: name of a robot in the settings; None for the default robot.
        blanks: see `PlanningPool`.

    Attributes:
        scene: the scene that all plans use.
        tool: the tool that all plans use.
    """

    scene = Scene()
    tool = BARE

    def __init__(
        self, config: Path | None, workers: int, robot: str | None = None, blanks: list[Forked] | None = None
    ) -> None:
        chosen = {"--config": config, "--robot": robot}
        self._arguments = [part for name, value in chosen.items() if value for part in (name, str(value))]
        self._pool = PlanningPool(self._arguments, workers, blanks)
        # for the current scene and possibly the next one
        self._known: list[tuple[Scene, Tool, Preparation]] = []

    def warm_up(self) -> None:
        """Start the workers in advance, so that the first plan does not wait for their imports."""
        self._pool.start()

    @property
    def warm(self) -> bool:
        """Whether all workers have started."""
        return self._pool.usable == self._pool.size

    async def renew(self) -> None:
        """Replace the workers with new ones, which read the current settings file. Returns when the new
        workers run or cannot be started.
        """
        old = self._pool
        self._pool = PlanningPool(self._arguments, old.size)
        self._pool.replaced = old.replaced
        old.close()
        self._pool.start()
        while not (self.warm or self._pool.problem):
            await asyncio.sleep(POLL_S)

    @property
    def status(self) -> PlanningStatus:
        """The current state of the pool."""
        pool = self._pool
        problem = "" if pool.usable else pool.problem
        state = "ready" if pool.usable else "failed" if problem else "starting"
        return PlanningStatus(state, pool.size, pool.usable, pool.busy, pool.replaced, problem)

    async def compute(
        self, work: Callable[[RobotDescription], Result], timeout_s: float, scene: Scene | None = None
    ) -> Result:
        """Run a picklable function with the robot in a worker, and return its result. If the call is
        cancelled, the worker is killed.

        If the worker is lost, or the scene or the tool changes in the meantime, the function runs once more,
        which is safe because planning moves nothing.

        Args:
            timeout_s: total timeout: the wait for a free worker, the work, and a possible repetition.
            scene: a scene that is not in force yet; None for the current one.

        Raises:
            PlanningTimeout: the worker did not finish in time.
            PlanningError: all workers that ran the function have ended.
            UnavailableError: no worker can be started, or no worker was free in this time.
            CobotError: any error that the function raises.
        """
        asked_s, lost = asyncio.get_running_loop().time(), 0
        while True:
            chosen, tool = scene or self.scene, self.tool
            try:
                found = await self._pool.run(work, timeout_s, asked_s, self._preparation(chosen, tool))
            except TimeoutError as exc:
                raise PlanningTimeout.after(
                    timeout_s, f"planning took longer than {timeout_s:.1f} s and was cancelled; {exc}"
                ) from exc
            except MemoryError as exc:
                raise PlanningError("the planning process has no memory left for this motion") from exc
            except WorkerLost as exc:
                lost += exc.begun
                if lost == ATTEMPTS:
                    raise PlanningError(f"the planning process {exc}, like the previous one") from exc
                log.warning("the planning process %s; its task is repeated", exc)
                continue
            if chosen is (scene or self.scene) and tool is self.tool:
                return cast(Result, found)
            log.info("the scene or the tool has changed during planning: planning again")

    async def prepare(self, scene: Scene | None = None, processes: int | None = None) -> None:
        """Make free planning processes load the scene and the tool before their next task.

        Args:
            scene: a scene that is not in use yet; None for the current one.
            processes: number of processes, in the order of task assignment; None for all.
        """
        ahead = self._preparation(scene or self.scene, self.tool)
        if ahead is not None:
            await self._pool.prepare(ahead, self._pool.size if processes is None else processes)

    def _preparation(self, scene: Scene, tool: Tool) -> Preparation | None:
        """Return the preparation for a scene and a tool; None if no process has ever needed one."""
        if not (self._known or scene.version or tool.version):
            return None
        for known, with_tool, ahead in self._known:
            if known is scene and with_tool is tool:
                return ahead
        made = Preparation(partial(surround, scene=scene, tool=tool))
        self._known = [(scene, tool, made), *self._known[:1]]
        return made

    def close(self) -> None:
        self._pool.close()
