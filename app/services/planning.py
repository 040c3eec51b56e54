"""Planning in worker processes, so that it can neither block the service nor outlive a stop."""

from __future__ import annotations

import asyncio
import multiprocessing
import signal
from dataclasses import dataclass
from pathlib import Path

import pebble

from cobot.config import load_settings
from cobot.errors import PlanningError, PlanningTimeout
from cobot.planners import MotionRequest, WaypointRequest, plan, plan_waypoints
from cobot.process import Niceness, be, die_with_parent
from cobot.robot import Robot, load_robot
from cobot.trajectory import Trajectory

PlanRequest = MotionRequest | WaypointRequest


@dataclass
class _Worker:
    robot: Robot | None = None


_worker = _Worker()
"""What a worker process keeps between its tasks; stays empty in the service."""


def _prepare(config: Path | None) -> None:
    die_with_parent(signal.SIGKILL)
    be(Niceness.BACKGROUND)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _worker.robot = load_robot(load_settings(config))


def _work(request: PlanRequest | None) -> Trajectory | None:
    assert _worker.robot is not None
    if isinstance(request, MotionRequest):
        return plan(_worker.robot, request)
    if isinstance(request, WaypointRequest):
        return plan_waypoints(_worker.robot, request)
    return None  # a task that only waits for the worker to be ready


class PlanningService:
    """A pool of planning processes, each with the robot loaded."""

    def __init__(self, config: Path | None, workers: int) -> None:
        self._workers = workers
        self._pool = pebble.ProcessPool(
            max_workers=workers,
            initializer=_prepare,
            initargs=[config],
            context=multiprocessing.get_context("spawn"),
        )

    async def warm_up(self) -> None:
        """Start the workers: the first plan should not wait for their imports."""
        await asyncio.gather(*(self._run(None, None) for _ in range(self._workers)))

    async def plan(self, request: PlanRequest, timeout_s: float) -> Trajectory | None:
        """See `cobot.planners.plan` and `plan_waypoints`. Cancelling this kills the worker.

        Raises:
            PlanningTimeout: the worker did not finish in time.
            CobotError: what the planner raises.
        """
        try:
            return await self._run(request, timeout_s)
        except TimeoutError as exc:
            raise PlanningTimeout(f"planning took longer than {timeout_s:.0f} s and was given up") from exc
        except pebble.ProcessExpired as exc:
            raise PlanningError(f"the planning process died (exit code {exc.exitcode})") from exc

    async def _run(self, request: PlanRequest | None, timeout_s: float | None) -> Trajectory | None:
        return await asyncio.wrap_future(self._pool.schedule(_work, args=[request], timeout=timeout_s))

    def close(self) -> None:
        self._pool.stop()
        self._pool.join()
