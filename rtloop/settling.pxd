from cobot.arrays cimport MAX_DOF
from rtloop.safety.limiter cimport Safety


cdef class SettlingMonitor:
    cdef readonly bint settled, rests, misread
    cdef readonly double largest  # largest deviation of a joint, rad
    cdef object _limits
    cdef Safety _safety
    cdef double _error[MAX_DOF]  # Difference of measured and commanded position, rad.
    cdef double _norm, _jump, _largest_step
    cdef double _settle_position_rad, _settle_velocity_rad_s, _settle_time_s, _rest_rad
    cdef double _place[MAX_DOF]  # Measured position since which the arm has hardly moved, rad.
    cdef int _dof
    cdef long long _still_cycles, _unsettled_cycles, _settle_cycles, settle_limit_cycles
    cdef long long _placed_cycles, _rest_cycles

    cdef void c_begin(self) noexcept nogil
    cdef void c_hold(self) noexcept nogil
    cdef bint c_tracks(self, const double* position, double allowed) noexcept nogil
    cdef void c_settle(
        self, const double* position, const double* velocity, bint may_be_still, bint anywhere
    ) noexcept nogil
    cdef bint c_check_end(self) noexcept nogil
