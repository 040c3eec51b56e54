"""Keeps a stream out of obstacles; see `collision_monitor.pyx`."""

from cobot.arrays cimport MAX_DOF
from cobot.robot.distances cimport GeomDistances


cdef class CollisionMonitor:
    cdef public double share
    cdef public bint blocked
    cdef object _mj, _pairs, _watched, _stand
    cdef GeomDistances _distances
    cdef int _dof, _cycle, _tool
    cdef double _margin_m, _zone_m
    cdef double _max_acceleration[MAX_DOF]
    cdef double _jerk_s[MAX_DOF]          # of a joint's stopping time, what the limit of the jerk adds
    cdef object _rows, _blocking, _links  # of the pairs that are watched: zone, distance here and there, m
    cdef double* _c_zones_m
    cdef double* _c_here
    cdef double* _c_there
    cdef char* _c_blocking
    cdef char* _c_links                   # whether both are the arm's own

    cdef void c_look(self, const double* command) noexcept nogil
    cdef bint c_leads_away(self, const double* position, const double* heading) noexcept nogil
    cdef void _judge(self) noexcept nogil
