"""Keeps a stream out of obstacles; see `collision_monitor.pyx`."""

from cobot.arrays cimport MAX_DOF
from cobot.robot.distances cimport GeomDistances
from rtloop.generators.otg cimport Problem
from rtloop.generators.rates cimport Rates


cdef class CollisionMonitor:
    cdef public double share
    cdef public bint blocked
    cdef public bint inside
    cdef object _mj, _pairs, _watched, _stand
    cdef GeomDistances _distances
    cdef int _dof, _cycle, _tool
    cdef double _margin_m, _zone_m, _late_s
    cdef Rates _rates
    cdef double _way[3][MAX_DOF]  # joint positions: two places on the way to rest, and rest
    cdef object _rows, _blocking, _links  # for each watched pair: zone and distances, m
    cdef double* _c_zones_m
    cdef double* _c_here
    cdef double* _c_there
    cdef double* _c_first
    cdef double* _c_second
    # distances for `c_leads_away`, separate from those of a check in progress
    cdef double* _c_before
    cdef double* _c_after
    cdef double* _c_floor                 # largest distance since the pair has been inside the margin, m
    cdef char* _c_blocking
    cdef char* _c_links                   # whether both parts belong to the arm

    cdef void c_look(self, const double* command) noexcept nogil
    cdef bint c_leads_away(self, const double* position, const double* heading) noexcept nogil
    cdef bint c_leads_deeper(self, const double* position, const double* heading) noexcept nogil
    cdef bint _probe(self, const double* position, const double* heading, double near_m) noexcept nogil
    cdef bint _see_inside(self) noexcept nogil
    cdef void _find_way_to_rest(self, const double* command) noexcept nogil
    cdef void _extrapolate(self, int joint, const double* command, Problem* problem) noexcept nogil
    cdef void _judge(self) noexcept nogil
    cdef double _nearest(self, int index) noexcept nogil
