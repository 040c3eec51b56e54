"""The stop that a client of the WebSocket requests."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from app.services.rights.stop_reason import StopReason
from app.services.rights.stopping import Stopped, StopService, together
from cobot import audit


class StreamStop:
    """Stops all robots on behalf of one connection.

    A request that arrives during a stop is carried out after it, so that a client that sends thousands of
    requests keeps only one task busy. A stop is completed even if the connection is lost.

    Args:
        robots: the stop services of all robots, by name.
        timeout_s: timeout of each stop.
        reason: the reason that is reported to the clients whose motions end.
        answer: called with the number of the request and the result of its stop.
    """

    def __init__(
        self,
        robots: Mapping[str, StopService],
        timeout_s: float,
        reason: StopReason,
        answer: Callable[[int, Stopped], None],
    ) -> None:
        self._robots = robots
        self._timeout_s = timeout_s
        self._reason = reason
        self._answer = answer
        self._task: asyncio.Task[None] | None = None
        self._wanted: int | None = None  # number of the newest request; None while no stop is pending

    def begin(self, number: int) -> None:
        """Begin a stop and return at once, because the next message may be an e-stop."""
        self._wanted = number
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._stop())

    async def _stop(self) -> None:
        while self._wanted is not None:
            number, self._wanted = self._wanted, None
            stops = (each.stop(self._timeout_s, self._reason) for each in self._robots.values())
            done = together(dict(zip(self._robots, await asyncio.gather(*stops), strict=True)))
            audit.note("stop", message=done.message)
            self._answer(number, done)
