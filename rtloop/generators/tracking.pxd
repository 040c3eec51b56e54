from cobot.arrays cimport MAX_DOF
from rtloop.generators.moving_frame cimport Motion
from rtloop.generators.otg cimport Problem, Profile
from rtloop.generators.rates cimport Rates


cdef class Tracker:
    cdef readonly object ahead
    cdef double* c_ahead  # (3, dof)
    cdef int dof
    cdef double period_s
    cdef Problem problem[MAX_DOF]
    cdef Profile profile[MAX_DOF]

    cdef bint c_brake(self, const double* state, const Rates* rates) noexcept nogil
    cdef void c_approach(
        self, const double* state, const double* target, const double* velocity, const Rates* rates,
        const double* max_velocity, const double* lowest, const double* highest,
    ) noexcept nogil
    cdef bint c_along(
        self, const double* state, const double* request, const Rates* rates, double share, double catch_up,
        const double* low, const double* high,
    ) noexcept nogil
    cdef bint _overshoots_bound(self, int joint, Motion frame, double low, double high) noexcept nogil
    cdef bint c_overruns(
        self, int joint, const double* state, const Rates* rates, double low, double high
    ) noexcept nogil
    cdef void _stop_at_bound(
        self, int joint, const double* state, const Rates* rates, double share, double bound
    ) noexcept nogil
    cdef double _beyond(self, int joint, double bound) noexcept nogil
    cdef void _pose(self, int joint, const double* state, const Rates* rates) noexcept nogil
    cdef bint _reach(self) noexcept nogil
    cdef bint _leaves(self, const double* lowest, const double* highest) noexcept nogil
    cdef void _step(self, int joint) noexcept nogil
