from posix.time cimport CLOCK_MONOTONIC, clock_gettime, timespec


cdef inline long long monotonic_ns() noexcept nogil:
    """Return the time on CLOCK_MONOTONIC, as `time.monotonic_ns` does."""
    cdef timespec now
    clock_gettime(CLOCK_MONOTONIC, &now)
    return <long long>now.tv_sec * 1_000_000_000 + now.tv_nsec


cdef class CycleClock:
    cdef public long long overruns
    cdef readonly double factor

    # Delay of the cycle in nanoseconds; if the sleep failed, its negative errno.
    cdef long long c_wait(self, bint moving, bint planned) noexcept nogil


cdef class RealtimeClock(CycleClock):
    cdef long long _period_ns, _planned_ns
    cdef readonly long long _deadline_ns  # deadline of the next cycle; 0 before the first wait


cdef class FastClock(CycleClock):
    cdef RealtimeClock _real


cdef class Pace:
    cdef long long _period_ns, _last_ns, _since_ns
    cdef long long _ahead_ns  # lead of the device's beats over the clock
    # Number of beats since they were last not ahead of the clock, and the time that has passed since then.
    cdef readonly long long beats, beats_ns

    cdef long long c_early(self, long long now_ns, bint beaten) noexcept nogil
    cdef void c_hold(self, long long early_ns) noexcept nogil
