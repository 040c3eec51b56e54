"""Distances between geoms, for compiled code; see `distances.pyx`."""

from cobot.robot.mujoco cimport mjData, mjModel


cdef struct GeomPair:
    int first
    int second
    int rule             # of `distances.pyx`
    double first_half_m  # from the middle of the bounding capsule's axis to its end
    double second_half_m
    double radii_m       # of both
    double farthest_m


cdef class GeomDistances:
    cdef readonly int count
    cdef double _farthest_m
    cdef int _dof, _capacity
    cdef GeomPair* _pairs
    cdef object _mj
    cdef const mjModel* _model
    cdef mjData* _data

    cdef bint c_find(self, const double* joints, double* out) noexcept nogil
    cdef bint c_find_near(self, const double* joints, const double* last, double near_m,
                          double* out) noexcept nogil
    cdef bint _place(self, const double* joints) noexcept nogil
    cdef double _between(self, const GeomPair* pair, double farthest_m) noexcept nogil
