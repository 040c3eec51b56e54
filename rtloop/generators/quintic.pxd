"""Declarations for other compiled modules: a smooth reference to a stream's future position. See
quintic.pyx.
"""

from cobot.arrays cimport MAX_DOF
from rtloop.generators.interpolation cimport Interpolator
from rtloop.generators.online_trajectory cimport OnlineTrajectory
from rtloop.generators.target_estimate cimport Estimate

cdef class Quintic(Interpolator):
    cdef Estimate estimate
    cdef OnlineTrajectory end
    cdef double[MAX_DOF] max_velocity, max_acceleration
    cdef double[6 * MAX_DOF] coefficients
    cdef bint ended
    cdef double time_s, duration_s, horizon_s

    cdef bint _follows_stream(self) noexcept nogil
    cdef void _settle(self) noexcept nogil
