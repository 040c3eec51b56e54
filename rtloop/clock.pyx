"""Clocks that start the cycles."""

import os

from libc.errno cimport EINTR
from posix.time cimport CLOCK_MONOTONIC, TIMER_ABSTIME, clock_nanosleep, nanosleep, timespec

# After a pause, beats of a device may come in quick succession until this much time has been made up.
cdef long long CATCH_UP_NS = 100_000_000
# Additional permitted jitter of the beats.
cdef long long SCATTER_NS = 50_000_000
# The clocks of the device and the computer may differ by 1 / DRIFT.
cdef int DRIFT = 100


cdef class CycleClock:
    """Times the cycle. Real-time safe.

    Attributes:
        overruns: number of periods that were missed because a cycle began too late.
        factor: the time factor, robot time per wall time while a planned motion runs.
    """

    def __cinit__(self):
        self.factor = 1.0

    def scale(self, double factor):
        """Set the time factor. `rtloop.time_factor.refusal` checks beforehand whether it is permitted."""
        self.factor = factor

    def wait(self, *, bint moving, bint planned=False):
        """Wait for the next cycle. Returns its delay in nanoseconds.

        Args:
            moving: whether the arm moves or may move.
            planned: whether a planned motion runs that is not being stopped.
        """
        cdef long long late_ns
        with nogil:
            late_ns = self.c_wait(moving, planned)
        if late_ns < 0:
            raise OSError(-late_ns, f"clock_nanosleep: {os.strerror(-late_ns)}")
        return late_ns

    cdef long long c_wait(self, bint moving, bint planned) noexcept nogil:
        return 0


cdef class RealtimeClock(CycleClock):
    """A clock with absolute deadlines on CLOCK_MONOTONIC. Delays do not add up, and missed periods are
    skipped.

    The first deadline is one period after the first wait. While a planned motion runs, the time between two
    deadlines is a period divided by the time factor.
    """

    def __init__(self, double period_s):
        self._period_ns = self._planned_ns = round(period_s * 1e9)

    def scale(self, double factor):
        CycleClock.scale(self, factor)
        self._planned_ns = round(self._period_ns / factor)

    cdef long long c_wait(self, bint moving, bint planned) noexcept nogil:
        cdef timespec deadline
        cdef long long late_ns, missed, period_ns = self._planned_ns if planned else self._period_ns
        cdef int error = EINTR
        if self._deadline_ns == 0:
            self._deadline_ns = monotonic_ns()
        self._deadline_ns += period_ns
        deadline.tv_sec = self._deadline_ns // 1_000_000_000
        deadline.tv_nsec = self._deadline_ns % 1_000_000_000
        # A signal ends the sleep early. Since the deadline is absolute, the sleep is simply repeated.
        while error == EINTR:
            error = clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &deadline, NULL)
        if error != 0:
            return -error
        late_ns = monotonic_ns() - self._deadline_ns
        if late_ns > period_ns:
            missed = late_ns // period_ns
            self.overruns += missed
            self._deadline_ns += missed * period_ns
        return late_ns


cdef class FastClock(CycleClock):
    """A clock that does not wait while the arm moves on a path. At rest and during streaming sessions, it
    keeps step with the real clock.
    """

    def __init__(self, double period_s):
        self._real = RealtimeClock(period_s)

    cdef long long c_wait(self, bint moving, bint planned) noexcept nogil:
        if moving:
            self._real._deadline_ns = 0  # when the arm is next at rest, deadlines are counted from that time
            return 0
        return min(self._real.c_wait(False, False), 0)


cdef class Pace:
    """Compares the beats of an externally clocked device with the computer's clock. Each beat advances the
    path by one period, so beats that come too fast would move the arm too fast. Real-time safe.
    """

    def __init__(self, double period_s):
        self._period_ns = round(period_s * 1e9)
        self._ahead_ns = -CATCH_UP_NS  # allow for a pause before the first beat

    def early_ns(self, long long now_ns, bint beaten):
        """Like `c_early`, for Python."""
        return self.c_early(now_ns, beaten)

    cdef long long c_early(self, long long now_ns, bint beaten) noexcept nogil:
        """Return the time by which the cycle that begins now must be delayed, with or without a beat; 0 if
        the beats are on time.
        """
        cdef long long passed_ns = now_ns - self._last_ns if self._last_ns else 0
        cdef long long drift_ns = passed_ns // DRIFT
        self._last_ns = now_ns
        self._ahead_ns -= passed_ns
        if self._ahead_ns > 0:
            self._ahead_ns = max(0, self._ahead_ns - drift_ns)
        else:
            self._ahead_ns = max(-CATCH_UP_NS, min(0, self._ahead_ns + drift_ns))
        if self._ahead_ns <= 0:
            self.beats, self._since_ns = 0, now_ns
        self.beats_ns = now_ns - self._since_ns
        if beaten:
            self.beats += 1
            self._ahead_ns += self._period_ns
        return max(0, self._ahead_ns - SCATTER_NS - self._period_ns)

    cdef void c_hold(self, long long early_ns) noexcept nogil:
        """Wait until the beat is due."""
        cdef timespec pause
        pause.tv_sec = early_ns // 1_000_000_000
        pause.tv_nsec = early_ns % 1_000_000_000
        nanosleep(&pause, NULL)
