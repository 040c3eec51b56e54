"""Detects hung local streaming clients. A process that is suspended, for example by SIGSTOP or a debugger,
loses its session.

rtloop stops the arm when no targets arrive, and detects the end of the client's process. But a suspended
process has not ended, so this module watches for it. Remote clients need no such check: the connection of a
hung client ends because pings are not answered.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator

from app.services.state.link import RobotLink
from cobot.launch.process import is_stopped

PERIOD_S = 0.5

log = logging.getLogger("cobot.streams")


@contextlib.asynccontextmanager
async def watching_clients(link: RobotLink, timeout_s: float) -> AsyncIterator[None]:
    """While the context is open, end the session of a client whose process has been suspended for
    `timeout_s`.
    """
    task = asyncio.create_task(_watch(link, timeout_s), name="hung clients")
    try:
        yield
    finally:
        task.cancel()


async def _watch(link: RobotLink, timeout_s: float) -> None:
    stopped_s = 0.0
    while True:
        await asyncio.sleep(PERIOD_S)
        process = link.streaming_process()
        stopped_s = stopped_s + PERIOD_S if process is not None and is_stopped(process) else 0.0
        if stopped_s >= timeout_s:
            log.warning(
                "%sthe streaming client, process %s, is suspended: its session ends", link.label, process
            )
            link.request_stop()
            stopped_s = 0.0
