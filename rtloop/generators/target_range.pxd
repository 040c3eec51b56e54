from cobot.arrays cimport MAX_DOF


cdef class TargetRange:
    cdef readonly int n
    cdef double period_s, still_after_s, since_s, share
    cdef bint free  # Whether there are no bounds until the next begin.
    cdef double newest[MAX_DOF]
    cdef double still_s[MAX_DOF]
    # Distance of the recent targets from their last minimum. Older steps have less weight.
    cdef double rise[MAX_DOF]
    cdef double fall[MAX_DOF]
    # The longest single step in this distance, which loses weight in the same way.
    cdef double longest_rise[MAX_DOF]
    cdef double longest_fall[MAX_DOF]
    cdef double c_low[MAX_DOF]
    cdef double c_high[MAX_DOF]

    cdef void c_begin(self, const double* position) noexcept nogil
    cdef void c_open(self) noexcept nogil
    cdef void c_open_at(self, const double* target) noexcept nogil
    cdef void c_expect(self, double command_s) noexcept nogil
    cdef void c_update(self, const double* target) noexcept nogil
    cdef void c_include(self, const double* target) noexcept nogil
    cdef bint c_stands(self, int i, double target) noexcept nogil
    cdef void c_advance(self) noexcept nogil
    cdef void _open(self, int i) noexcept nogil
    cdef void _forget(self, int i) noexcept nogil


cdef class PoseRange:
    cdef readonly TargetRange chart  # x, y, z, and the sum of the targets' turns
    cdef double newest[7]

    cdef void c_begin(self, const double* pose) noexcept nogil
    cdef void c_open(self) noexcept nogil
    cdef void c_update(self, const double* pose, bint states_motion) noexcept nogil
    cdef void c_advance(self) noexcept nogil
    cdef bint c_stands(self, const double* pose) noexcept nogil
    cdef void c_room(self, const double* pose, double* low, double* high) noexcept nogil
