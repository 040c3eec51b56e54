from cobot.arrays cimport MAX_DOF
from cobot.robot.mujoco cimport mjData, mjModel


cdef class Observer:
    cdef const mjModel* _model
    cdef mjData* _data
    cdef mjData* _solved  # whose dry friction counts
    cdef object _owners  # of what the addresses lead to
    cdef int _dof
    cdef double _before[MAX_DOF]
    cdef double _change[MAX_DOF]  # of the velocity in the last period
    cdef double _share, _rate_hz
    cdef const double* _jacobian
    cdef readonly object effort, wrench, friction
    cdef double* c_effort
    cdef double* c_wrench
    cdef double* c_friction
    cdef void c_update(self) noexcept nogil
    cdef void _find_wrench(self) noexcept nogil
