"""The clock of the service and its clients. They receive it as an argument.

Code that needs the time reads a `Clock`: for stamps in shared memory, deadlines, ages and time stamps.
Coroutines wait with asyncio's own functions (`sleep`, `wait_for`, `timeout`, `call_later`). These use the
time of the running event loop, and tests replace that loop by a virtual one, which jumps from timer to timer
and sets the time of the tests' clock (tests/support/virtual_service.py). A `Clock` therefore needs no waiting
functions for coroutines. The loop's time cannot replace the clock: the time of uvloop has a resolution of 1
ms and does not advance within an iteration, and stamps in shared memory use CLOCK_MONOTONIC. Threads have no
event loop and wait with `Clock.sleep`.

The real-time loop uses a separate clock (`rtloop.clock`), which also triggers its cycles.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Protocol


class Ticks(Protocol):
    """A running ticker, which ticks until it is closed."""

    def close(self) -> None: ...


class Clock(Protocol):
    """A source of the current time."""

    def now_ns(self) -> int:
        """Time on CLOCK_MONOTONIC, in ns. Time stamps in shared memory use this clock."""
        ...

    def now_s(self) -> float:
        """Time on CLOCK_MONOTONIC, in seconds."""
        ...

    def wall_ns(self) -> int:
        """Time of day, ns since 1970. It may jump."""
        ...

    def sleep(self, seconds: float) -> None:
        """Block a thread that has no event loop."""
        ...

    def ticker(self, rate_hz: float, on_tick: Callable[[int], None]) -> Ticks:
        """Start a ticker in the running event loop; see `cobot.ticker.Ticker`."""
        ...


class SystemClock:
    """The computer's clock."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def now_s(self) -> float:
        return time.monotonic()

    def wall_ns(self) -> int:
        return time.time_ns()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)

    def ticker(self, rate_hz: float, on_tick: Callable[[int], None]) -> Ticks:
        from cobot.ticker import Ticker  # uses a Linux timer, which is not needed by clients

        return Ticker(rate_hz, on_tick)


SYSTEM = SystemClock()


def utc_now(clock: Clock) -> datetime:
    """Time of day of this clock, in UTC."""
    return datetime.fromtimestamp(clock.wall_ns() * 1e-9, UTC)


class WallTime:
    """Converts times on CLOCK_MONOTONIC to times of day.

    The two clocks cannot be read at the same moment, and a thread may be interrupted between the readings.
    Stamps that were calculated from a new pair of readings each time would therefore jitter by that delay and
    could go back. So the offset is kept until readings prove that it is wrong. Linux adjusts the rate of both
    clocks in the same way, so the offset changes only when the time of day is set.
    """

    READINGS = 5
    """Number of readings for a new offset. The fastest one determines it."""

    def __init__(self, clock: Clock = SYSTEM) -> None:
        self._clock = clock
        self._ahead_ns = self._measured_ahead_ns()

    def at(self, now_ns: int) -> int:
        """The time of day, ns since 1970, at a time on CLOCK_MONOTONIC, ns."""
        return now_ns + self.ahead_ns()

    def ahead_ns(self) -> int:
        """The time of day minus CLOCK_MONOTONIC, in ns."""
        least, most = self._read()
        if not least <= self._ahead_ns <= most:
            self._ahead_ns = self._measured_ahead_ns()
        return self._ahead_ns

    def _read(self) -> tuple[int, int]:
        """The smallest and largest offsets, in ns, that are possible after one reading of the two clocks."""
        before_ns = self._clock.now_ns()
        wall_ns = self._clock.wall_ns()
        return wall_ns - self._clock.now_ns(), wall_ns - before_ns

    def _measured_ahead_ns(self) -> int:
        least, most = min((self._read() for _ in range(self.READINGS)), key=lambda each: each[1] - each[0])
        return (least + most) // 2
