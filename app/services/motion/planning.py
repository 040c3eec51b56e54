"""Planning in worker processes, so that it can neither block the service nor outlive a stop."""

from __future__ import annotations

import asyncio
import multiprocessing
import signal
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar, cast

import pebble

from cobot.config import load_settings
from cobot.errors import PlanningError, PlanningTimeout
from cobot.launch.process import Niceness, be, die_with_parent
from cobot.logs import start_logging
from cobot.planners import MotionRequest, WaypointRequest, plan, plan_waypoints
from cobot.planners.rated import RatedMove, plan_rated
from cobot.robot.description import RobotDescription, load_robot
from cobot.trajectory import Trajectory

Result = TypeVar("Result")
PlanRequest = MotionRequest | WaypointRequest | RatedMove


@dataclass
class _Worker:
    robot: RobotDescription | None = None


_worker = _Worker()
"""A worker process keeps this between its tasks; in the service itself it stays empty."""


def _prepare(config: Path | None, robot: str | None) -> None:
    die_with_parent(signal.SIGKILL)
    be(Niceness.BACKGROUND)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    settings = load_settings(config).of(robot)
    start_logging("planning", settings.logging)
    _worker.robot = load_robot(settings)


def _work(work: Callable[[RobotDescription], Result]) -> Result:
    assert _worker.robot is not None
    return work(_worker.robot)


def _planned(robot: RobotDescription, request: PlanRequest) -> Trajectory | None:
    if isinstance(request, MotionRequest):
        return plan(robot, request)
    if isinstance(request, WaypointRequest):
        return plan_waypoints(robot, request)
    return plan_rated(robot, request)


def _ready(robot: RobotDescription) -> None:
    """A task that only waits for the worker."""


class PlanningService:
    """A pool of planning processes, each with the robot loaded.

    Each robot has a pool of its own: what one has to plan does not keep another waiting.

    Args:
        config: the settings' file, None for the shipped one.
        robot: one of its robots, None for the default one.

    Attributes:
        warm: whether the workers have started.
    """

    warm = False

    def __init__(self, config: Path | None, workers: int, robot: str | None = None) -> None:
        self._workers = workers
        self._arguments = [config, robot]
        self._pool = self._new_pool()

    def _new_pool(self) -> pebble.ProcessPool:
        return pebble.ProcessPool(
            max_workers=self._workers,
            initializer=_prepare,
            initargs=self._arguments,
            context=multiprocessing.get_context("spawn"),
        )

    async def warm_up(self) -> None:
        """Start the workers: the first plan should not wait for their imports."""
        await asyncio.gather(*(self._run(_ready, None) for _ in range(self._workers)))
        self.warm = True

    async def renew(self) -> None:
        """Have workers that know the settings' file as it is now; the old ones have nothing to do."""
        self.warm = False
        old, self._pool = self._pool, self._new_pool()
        await asyncio.to_thread(_end, old)
        await self.warm_up()

    async def plan(self, request: PlanRequest, timeout_s: float) -> Trajectory | None:
        """See `cobot.planners.plan`, `plan_waypoints` and `plan_rated`; raises as `compute` does."""
        return await self.compute(partial(_planned, request=request), timeout_s)

    async def compute(self, work: Callable[[RobotDescription], Result], timeout_s: float) -> Result:
        """What a picklable function makes of the robot. Cancelling this kills the worker.

        Raises:
            PlanningTimeout: the worker did not finish in time.
            CobotError: what the function raises.
        """
        try:
            return await self._run(work, timeout_s)
        except TimeoutError as exc:
            raise PlanningTimeout(f"planning took longer than {timeout_s:.0f} s and was given up") from exc
        except pebble.ProcessExpired as exc:
            raise PlanningError(f"the planning process died (exit code {exc.exitcode})") from exc

    async def _run(self, work: Callable[[RobotDescription], Result], timeout_s: float | None) -> Result:
        found = await asyncio.wrap_future(self._pool.schedule(_work, args=[work], timeout=timeout_s))
        return cast(Result, found)

    def close(self) -> None:
        _end(self._pool)


def _end(pool: pebble.ProcessPool) -> None:
    pool.stop()
    pool.join()
