"""The time that the service and its clients go by, given to them and not fetched.

Who asks what time it is, asks a `Clock`: moments in shared memory, deadlines, ages, time stamps. Who waits in
a coroutine waits with asyncio's own tools (`sleep`, `wait_for`, `timeout`, `call_later`), for these ask the
running event loop, and a loop can be virtual as well: the tests have one that jumps from timer to timer and
whose time their clock shows (tests/virtual.py). So a clock needs no second set of waits, nothing that
asyncio offers is lost, and nobody can forget to wait by the clock. The loop's own time is no substitute for
it: uvloop's is in whole milliseconds and stands still within a turn, and shared memory wants CLOCK_MONOTONIC.
Threads, which have no loop, wait with `Clock.sleep`.

rtloop has a clock of its own (`rtloop.clock`), which paces a cycle instead of telling the time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol


class Ticks(Protocol):
    """Something that ticks until it is closed."""

    def close(self) -> None: ...


class Clock(Protocol):
    """What time it is."""

    def now_ns(self) -> int:
        """CLOCK_MONOTONIC, which the stamps in shared memory are on: ns."""
        ...

    def now_s(self) -> float:
        """The same: s."""
        ...

    def wall_ns(self) -> int:
        """The time of day, which may jump: ns since 1970."""
        ...

    def sleep(self, seconds: float) -> None:
        """Keep a thread that has no event loop waiting."""
        ...

    def ticker(self, rate_hz: float, on_tick: Callable[[int], None]) -> Ticks:
        """A tick in the running event loop; see `cobot.ticker.Ticker`."""
        ...


class SystemClock:
    """The computer's."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def now_s(self) -> float:
        return time.monotonic()

    def wall_ns(self) -> int:
        return time.time_ns()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    def ticker(self, rate_hz: float, on_tick: Callable[[int], None]) -> Ticks:
        from cobot.ticker import Ticker  # a timer of Linux; a client has no use for it

        return Ticker(rate_hz, on_tick)


SYSTEM = SystemClock()
