"""Determines the order in which the event loop serves connections, so that many clients cannot delay a stop.

All connections share one thread. Without such an order, each iteration of the event loop would serve all
connections that have sent data. With 500 connections an iteration takes a fifth of a second, and a stop needs
several iterations. So work is done in small pieces, as many per iteration as fit into some milliseconds. A
connection with more work waits for the next iteration, in the order of arrival. A stop is served at once.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable

MAX_TURNS = 16
"""Maximum number of pieces of work that begin in one iteration of the event loop, while iterations are
short.
"""
LONG_S = 0.003
"""Duration of an iteration above which the next one begins fewer pieces of work, but at least one, s."""


class Turns:
    """The pieces of work that wait for an iteration of one event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Callable[[], object]] = deque()
        self._left = self._most = MAX_TURNS
        self._begun_s = 0.0
        self._renewing = False

    def mine(self) -> bool:
        """Whether a piece of work may be done at once. If it may, count it as done in this iteration."""
        if self._waiting or self._left <= 0:
            return False
        self._count()
        return True

    def wait(self, work: Callable[[], object]) -> None:
        """Do a piece of work when its turn comes, which may be at once."""
        if self.mine():
            work()
        else:
            self._waiting.append(work)

    async def turn(self) -> None:
        """Wait for the caller's turn."""
        if self.mine():
            return
        turn = self._loop.create_future()
        self._waiting.append(lambda: None if turn.done() else turn.set_result(None))
        await turn

    def _count(self) -> None:
        self._left -= 1
        if not self._renewing:
            self._renewing = True
            self._begun_s = time.perf_counter()
            self._loop.call_soon(self._next_iteration)

    def _next_iteration(self) -> None:
        now_s = time.perf_counter()
        late = now_s - self._begun_s > LONG_S
        self._most = max(1, self._most // 2) if late else min(MAX_TURNS, self._most + 1)
        self._left, self._renewing = self._most, False
        while self._waiting and self._left > 0:
            self._count()  # does at least one piece, and schedules the next iteration
            self._waiting.popleft()()
            if time.perf_counter() - now_s > LONG_S:
                break
