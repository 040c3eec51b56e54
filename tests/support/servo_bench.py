"""Servo sessions of the service beside the cycle, on virtual time, for tests of all that begins them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

from rig import Rig, no_tokens
from virtual_service import Cycle
from virtual_time import VirtualClock, VirtualLoop

from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.programs.sequences import SequenceService
from app.services.rights.ownership import Ownership
from app.services.rights.stopping import StopService
from app.services.state.link import RobotLink
from app.services.streaming.force import ForceService
from app.services.streaming.servo import ServoService
from app.services.streaming.sessions import StreamService
from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode

SESSION = 1_700_000_000_123_456_789


class Bench:
    """A service beside a cycle, both on virtual time, which goes on while something is awaited."""

    def __init__(self, rig: Rig, robot: RobotDescription, settings: Settings, link: RobotLink) -> None:
        self.rig, self.link = rig, link
        self.ownership = Ownership(link)
        self.planning = PlanningService(None, 1)
        motion = MotionService(robot, link, self.planning)
        self.streams = StreamService(link, self.ownership, motion, settings.streaming)
        rig.describe()
        url, tokens = "http://127.0.0.1:1", no_tokens()
        sequences = SequenceService(self.ownership, link, settings.sequences, url, 1.0, tokens)
        self.stopping = StopService(link, self.ownership, sequences.stop)
        self.force = ForceService(robot, link, self.streams, self.stopping, lambda text: None)
        self.servo = ServoService(robot, link, self.streams, self.force)
        self._point_id = 0

    def set_mode(self, mode: int, **fields: Any) -> None:
        values = {"mode": mode, "watchdog_timeout": 0.5, "send_period": 0.01, **fields}
        self._point_id = 0
        self.send(type="servo_control", command="set_mode", **values)

    def stop(self) -> None:
        self.send(type="servo_control", command="stop")

    def point(self, position: Any, **fields: Any) -> None:
        self._point_id += 1
        values = {"session_id": SESSION, "point_id": self._point_id, "time": 0.01, **fields}
        self.send(type="servo_point", position=[float(value) for value in position], **values)

    def send(self, **fields: Any) -> None:
        self.servo.receive(json.dumps(fields))

    async def cycles(self, count: int) -> None:
        await asyncio.sleep(count * self.rig.settings.rt.period_s)

    async def until(self, condition: Callable[[], object], cycles: int = 20_000) -> None:
        for _ in range(cycles):
            if condition():
                return
            await self.cycles(1)
        raise AssertionError(f"has not happened: {self.servo.feedback()}")

    async def active(self) -> None:
        await self.until(lambda: self.servo.feedback()["state"] == "active")

    async def idle(self) -> None:
        await self.until(lambda: self.servo.feedback()["state"] == "idle" and self.rig.mode is LoopMode.HOLD)

    async def done(self, work: Coroutine[Any, Any, Any]) -> Any:
        """The result of something that needs the cycle."""
        task = asyncio.ensure_future(work)
        await self.until(task.done)
        return task.result()


Run = Callable[[Callable[[Bench], Any]], None]


def runner(rig: Rig, robot: RobotDescription, settings: Settings) -> Run:
    """Runs a test's coroutine function with a bench."""

    loop = VirtualLoop()
    clock = VirtualClock(loop)

    @asynccontextmanager
    async def bench() -> AsyncIterator[Bench]:
        cycle = Cycle(rig, loop, clock)
        await asyncio.sleep(0.03)
        link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0, clock=clock)
        made = Bench(rig, robot, settings, link)
        try:
            yield made
        finally:
            made.servo.close()
            made.streams.close()
            made.planning.close()
            cycle.close()
            link.close()

    def runs(test: Callable[[Bench], Any]) -> None:
        async def live() -> None:
            async with bench() as made:
                await test(made)

        try:
            loop.run_until_complete(live())
            loop.run_until_complete(asyncio.sleep(0.0))
        finally:
            loop.close()

    return runs
