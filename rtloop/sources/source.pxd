"""Sources convert a client's streamed targets into a joint reference for every cycle."""

from cobot.ipc.seqlock cimport Block
from rtloop.generators.target_range cimport TargetRange


cdef struct Setpoint:
    # Addresses of the fields of the last setpoint read, see `cobot.ipc.layout.setpoint_dtype`.
    unsigned long long* session
    unsigned long long* number
    unsigned long long* feed_forward
    double* joints
    double* joint_velocity
    double* pose
    double* wrench
    double* twist
    unsigned long long* move
    double* move_pose
    double* move_duration_s
    unsigned long long* cancel


cdef struct Chunk:
    # Addresses of the fields of the last chunk read, see `cobot.ipc.layout.chunk_dtype`.
    unsigned long long* session
    unsigned long long* number
    unsigned long long* count
    double* times_s
    double* points
    int point_size


cdef enum:
    # The flaw of a target: the number of the intervention as which it is counted, plus one.
    FINE = 0
    NOT_FINITE = 1
    JUMP = 9
    LATE = 14


cdef double LEAD_RAD

cdef Setpoint setpoint_fields(Block block)
cdef Chunk chunk_fields(Block block)
cdef object flaw_of(int code)


cdef class Source:
    cdef readonly int dof
    cdef readonly object reference
    cdef double* ref
    cdef readonly TargetRange targets  # None if the source has no joint targets

    cdef void c_begin(self, const double* command) noexcept nogil
    cdef int c_take(self, const Setpoint* setpoint, double interval_s) noexcept nogil
    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil
    cdef void c_follow(self, const double* command) noexcept nogil
    cdef void c_heading(self, double* step) noexcept nogil
    cdef void c_exert(self, double* rows) noexcept nogil
