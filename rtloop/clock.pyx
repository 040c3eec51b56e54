"""When the next cycle begins."""

import os

from libc.errno cimport EINTR
from posix.time cimport CLOCK_MONOTONIC, TIMER_ABSTIME, clock_nanosleep, timespec


cdef class Clock:
    """Paces the cycle. Real-time safe.

    Attributes:
        overruns: periods that were missed because a cycle began too late.
    """

    def wait(self, *, bint moving):
        """Wait for the next cycle; returns by how many nanoseconds it is late."""
        cdef long long late_ns
        with nogil:
            late_ns = self.c_wait(moving)
        if late_ns < 0:
            raise OSError(-late_ns, f"clock_nanosleep: {os.strerror(-late_ns)}")
        return late_ns

    cdef long long c_wait(self, bint moving) noexcept nogil:
        return 0


cdef class RealtimeClock(Clock):
    """Absolute deadlines on CLOCK_MONOTONIC: lateness does not add up, missed periods are skipped.

    The first deadline is one period after the first wait.
    """

    def __init__(self, double period_s):
        self._period_ns = round(period_s * 1e9)

    cdef long long c_wait(self, bint moving) noexcept nogil:
        cdef timespec deadline
        cdef long long late_ns, missed
        cdef int error = EINTR
        if self._deadline_ns == 0:
            self._deadline_ns = monotonic_ns()
        self._deadline_ns += self._period_ns
        deadline.tv_sec = self._deadline_ns // 1_000_000_000
        deadline.tv_nsec = self._deadline_ns % 1_000_000_000
        while error == EINTR:  # A signal ends the sleep early: sleep on, the deadline is absolute.
            error = clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL)
        if error != 0:
            return -error
        late_ns = monotonic_ns() - self._deadline_ns
        if late_ns > self._period_ns:
            missed = late_ns // self._period_ns
            self.overruns += missed
            self._deadline_ns += missed * self._period_ns
        return late_ns


cdef class FastClock(Clock):
    """Robot time without waiting while the arm moves on a path; else, at rest and while somebody streams, in
    step with the real clock.
    """

    def __init__(self, double period_s):
        self._real = RealtimeClock(period_s)

    cdef long long c_wait(self, bint moving) noexcept nogil:
        if moving:
            self._real._deadline_ns = 0  # at the next rest it counts from then on
            return 0
        return min(self._real.c_wait(False), 0)
