"""The monotonic clock for compiled planners, the same as Python's `time.monotonic`."""

from posix.time cimport CLOCK_MONOTONIC, clock_gettime, timespec


cdef inline double now_s() noexcept nogil:
    cdef timespec now
    clock_gettime(CLOCK_MONOTONIC, &now)
    return now.tv_sec + 1e-9 * now.tv_nsec
