"""A periodic callback in the event loop at up to 1 kHz, because the loop's own timers are too coarse."""

from __future__ import annotations

import asyncio
import ctypes
import os
import struct
from collections.abc import Callable

_CLOCK_MONOTONIC = 1
_LIBC = ctypes.CDLL(None, use_errno=True)


class Ticker:
    """A kernel timer that calls a function with the number of periods since the last call.

    Args:
        rate_hz: rate of the ticks.
        on_tick: called in the running event loop.
    """

    def __init__(self, rate_hz: float, on_tick: Callable[[int], None]) -> None:
        self._on_tick = on_tick
        self._loop = asyncio.get_running_loop()
        self._fd = _LIBC.timerfd_create(_CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
        if self._fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create")
        seconds, nanoseconds = divmod(round(1e9 / rate_hz), 1_000_000_000)
        period = (ctypes.c_long * 4)(
            seconds, nanoseconds, seconds, nanoseconds
        )  # the interval, then the time until the first tick
        _LIBC.timerfd_settime(self._fd, 0, period, None)
        self._loop.add_reader(self._fd, self._tick)

    def close(self) -> None:
        self._loop.remove_reader(self._fd)
        os.close(self._fd)

    def _tick(self) -> None:
        self._on_tick(struct.unpack("=Q", os.read(self._fd, 8))[0])
