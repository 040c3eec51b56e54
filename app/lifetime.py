"""Starts and ends the application's resources and background tasks, from opening shared memory to the final
stop of the arms.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import signal
from collections.abc import AsyncIterator
from dataclasses import dataclass
from importlib.metadata import version

from fastapi import FastAPI

from app.api.start_failure import saying_why
from app.mcp.endpoint import McpEndpoint
from app.offers.robots_on_graph import serving
from app.robot_services import Services, SharedParts, serving_robot
from app.services.events.log_lines import log_events
from app.services.keys import Keys
from app.services.rights.stop_reason import StopReason
from cobot.audit import Audit
from cobot.config import Settings
from cobot.robot.description import RobotDescription

STOP_S = 3.0
"""Timeout for each arm to stop when the service shuts down, s."""


@dataclass(frozen=True, slots=True)
class Lifetime:
    """The resources and background tasks of one application.

    Attributes:
        robots: the robots by name.
        agents: the MCP endpoint. Its running requests end with the application.
        reload_by_signal: whether SIGHUP reloads the configuration.
    """

    settings: Settings
    robots: dict[str, RobotDescription]
    shared: SharedParts
    agents: McpEndpoint
    reload_by_signal: bool

    @contextlib.asynccontextmanager
    async def of(self, app: FastAPI) -> AsyncIterator[None]:
        """Serve the robots while the context is open. When it is left, all arms are stopped."""
        events = self.shared.events
        async with saying_why(app), contextlib.AsyncExitStack() as stack:
            await self._begin(app, stack)
            _settle_memory()
            serving_now: dict[str, Services] = app.state.robots
            for each in serving_now.values():
                each.link.heartbeat.watch_for_pauses()
            events.publish("service", what="started", version=version("cobot"), robots=list(serving_now))
            yield
            await _stop_all(serving_now)

    async def _begin(self, app: FastAPI, stack: contextlib.AsyncExitStack) -> None:
        """Start everything in dependency order. `stack` ends it in the reverse order."""
        shared, settings = self.shared, self.settings
        stack.callback(shared.events.close)
        stack.enter_context(log_events(shared.events))
        app.state.audit = Audit(settings.audit_file, shared.clock)
        stack.callback(app.state.audit.close)
        app.state.keys = Keys(settings.keys_file, shared.clock)
        stack.callback(app.state.keys.close)
        app.state.robots = {
            name: await stack.enter_async_context(serving_robot(each, self.robots[name], shared))
            for name, each in settings.each.items()
        }
        app.state.services = app.state.robots[settings.robot.name]
        shared.sync.robots.update(app.state.robots)
        stack.callback(shared.sync.close)
        stack.push_async_callback(self.agents.close)
        if self.reload_by_signal:
            asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, app.state.reloading.begin)
        tcps = {name: each.robot.tcp for name, each in settings.each.items()}
        app.state.graph = await stack.enter_async_context(serving(app.state.robots, tcps, shared.clock))


def _settle_memory() -> None:
    """Exclude all current objects from garbage collection, and re-enable it (`app.__main__` disabled it).

    Collecting what the imports left would take 0.1 s and free almost nothing.
    """
    gc.freeze()
    gc.enable()


async def _stop_all(robots: dict[str, Services]) -> None:
    for each in robots.values():
        each.jobs.book.ending = True
    reason = StopReason("stopped by the end of the service", "service")
    await asyncio.gather(*(each.stopping.stop(STOP_S, reason) for each in robots.values()))
