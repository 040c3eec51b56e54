"""Declarations for other compiled modules: a reference through timed waypoints. See chunks.pyx."""

from cobot.arrays cimport MAX_DOF
from rtloop.generators.brake cimport Brake

cdef enum:
    # Maximum number of waypoints of a chunk, and of waypoints of older chunks that are still ahead.
    MAX_CHUNK = 64
    # Number of passed waypoints that are kept in the spline, so that a new chunk hardly changes its
    # beginning.
    SUPPORT = 3
    MAX_WAYPOINTS = 131  # The sum: MAX_CHUNK twice, and SUPPORT.

cdef enum ChunkRefusal:
    CHUNK_TAKEN = 0
    CHUNK_SHAPE = 1
    CHUNK_NOT_FINITE = 2
    CHUNK_TIMES = 3
    CHUNK_PAST = 4
    CHUNK_FULL = 5

cdef class ChunkInterpolator:
    cdef readonly object reference  # (3, n): position, velocity, acceleration.
    cdef double* ref
    cdef readonly long long late, starved, entered
    cdef int n
    cdef double period_s
    cdef double[3][MAX_DOF] bounds
    cdef Brake brake
    # The waypoints, including some that have been passed, and the state of the spline at each.
    cdef int count
    cdef double[MAX_WAYPOINTS] times_s
    cdef object waypoints  # (MAX_WAYPOINTS, 3, n): position, velocity, acceleration.
    cdef double* ends
    # The segments. The first knot is where the newest chunk has begun.
    cdef int pieces, piece
    cdef double[MAX_WAYPOINTS + 1] knots_s
    cdef object quintics  # (MAX_WAYPOINTS, 6, n)
    cdef double* coefficients
    cdef bint braking
    # Values for the message of a rejection.
    cdef int refused
    cdef long long refused_count
    cdef double refused_s

    cdef void c_begin(self, const double* state) noexcept nogil
    cdef int c_take(
        self, const double* times_s, const double* points, int count, double now_s
    ) noexcept nogil
    cdef void c_advance(self, double now_s) noexcept nogil
    cdef const double* c_waypoint(self, int ahead) noexcept nogil
    cdef double c_step_s(self) noexcept nogil
    cdef int _flaw(self, const double* times_s, const double* points, int count) noexcept nogil
    cdef int _index(self, double time_s) noexcept nogil
    cdef void _connect(self, double now_s, int first) noexcept nogil
    cdef int _first_in_reach(self, double now_s, int first) noexcept nogil
    cdef double _excess(self, const double* coefficients, double duration_s, double enough) noexcept nogil
    cdef void _start_brake(self) noexcept nogil

cdef void spline_rates(const double* times_s, int count, int n, double* ends) noexcept nogil
