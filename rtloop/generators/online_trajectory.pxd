"""Declarations for other compiled modules: the fastest profile to a moving target. See
online_trajectory.pyx.
"""

from cobot.arrays cimport MAX_DOF
from rtloop.generators.brake cimport Brake
from rtloop.generators.interpolation cimport Interpolator
from rtloop.generators.moving_frame cimport Motion
from rtloop.generators.otg cimport Problem, Profile
from rtloop.generators.target_estimate cimport Estimate

cdef class OnlineTrajectory(Interpolator):
    cdef Estimate estimate
    cdef Brake brake
    cdef double[MAX_DOF] max_velocity, max_acceleration, max_jerk
    cdef double[MAX_DOF] swing_s
    cdef Motion[MAX_DOF] frame  # The state of the target when it is due.
    cdef Problem[MAX_DOF] problems
    cdef Profile[MAX_DOF] profiles
    cdef bint braking, settling
    cdef double time_s, due_s, duration_s

    cdef void c_forget(self) noexcept nogil
    cdef void c_settle(self, const double* state, const double* target) noexcept nogil
    cdef void _end(self) noexcept nogil
    cdef void _plan(self, double due_s) noexcept nogil
    cdef double _longest_s(self) noexcept nogil
    cdef void _start_brake(self) noexcept nogil
