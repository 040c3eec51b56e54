"""When the next cycle begins."""

from __future__ import annotations

import ctypes
import os
import time
from typing import Protocol

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class Clock(Protocol):
    """Paces the cycle. Real-time safe.

    Attributes:
        overruns: periods that were missed because a cycle began too late.
    """

    overruns: int

    def wait(self, *, moving: bool) -> int:
        """Wait for the next cycle; returns by how many nanoseconds it is late."""
        ...


class RealtimeClock:
    """Absolute deadlines on CLOCK_MONOTONIC: lateness does not add up, missed periods are skipped."""

    def __init__(self, period_s: float) -> None:
        self.overruns = 0
        self._period_ns = round(period_s * 1e9)
        self._deadline_ns = 0  # of the next cycle; the first one is one period after the first wait
        self._timespec = _Timespec()
        self._reference = ctypes.byref(self._timespec)
        self._sleep = ctypes.CDLL(None, use_errno=True).clock_nanosleep

    def wait(self, *, moving: bool) -> int:
        self._deadline_ns = (self._deadline_ns or time.monotonic_ns()) + self._period_ns
        self._timespec.tv_sec, self._timespec.tv_nsec = divmod(self._deadline_ns, 1_000_000_000)
        # A signal ends the sleep early (EINTR): sleep on, the deadline is absolute.
        while (error := self._sleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, self._reference, None)) != 0:
            if error != 4:
                raise OSError(error, f"clock_nanosleep: {os.strerror(error)}")
        late_ns = time.monotonic_ns() - self._deadline_ns
        if late_ns > self._period_ns:
            missed = late_ns // self._period_ns
            self.overruns += missed
            self._deadline_ns += missed * self._period_ns
        return late_ns


class FastClock:
    """Robot time without waiting while the arm moves on a path; else, at rest and while somebody streams, in
    step with the real clock.
    """

    def __init__(self, period_s: float) -> None:
        self.overruns = 0
        self._period_s = period_s
        self._real: RealtimeClock | None = None

    def wait(self, *, moving: bool) -> int:
        if moving:
            self._real = None
            return 0
        if self._real is None:
            self._real = RealtimeClock(self._period_s)
        self._real.wait(moving=False)
        return 0
