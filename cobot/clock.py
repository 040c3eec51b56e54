"""The clock of the service and its clients, which receive it as an argument.

Code that needs the time reads a `Clock`: for stamps in shared memory, deadlines, ages and time stamps.
Coroutines wait with asyncio's own functions (`sleep`, `wait_for`, `timeout`, `call_later`). These use the
time of the running event loop, and tests replace that loop by a virtual one, which jumps from timer to
timer and sets the time of the tests' clock (tests/support/virtual_service.py). A `Clock` therefore needs no
waiting functions for coroutines. The loop's time cannot replace the clock: uvloop's has a resolution of 1
ms and does not advance within an iteration, and stamps in shared memory are on CLOCK_MONOTONIC. Threads
have no event loop and wait with `Clock.sleep`.

The real-time loop has a clock of its own (`rtloop.clock`), which also paces its cycle.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol


class Ticks(Protocol):
    """A running ticker, which ticks until it is closed."""

    def close(self) -> None: ...


class Clock(Protocol):
    """A source of the present time."""

    def now_ns(self) -> int:
        """Time on CLOCK_MONOTONIC, which stamps in shared memory use, in ns."""
        ...

    def now_s(self) -> float:
        """Time on CLOCK_MONOTONIC, in seconds."""
        ...

    def wall_ns(self) -> int:
        """Time of day in ns since 1970. It may jump."""
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
        from cobot.ticker import Ticker  # uses a Linux timer, which clients do not need

        return Ticker(rate_hz, on_tick)


SYSTEM = SystemClock()
