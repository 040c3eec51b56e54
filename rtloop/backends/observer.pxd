from cobot.arrays cimport MAX_DOF
from cobot.robot.mujoco cimport mjData, mjModel


cdef class Observer:
    cdef const mjModel* _model
    cdef mjData* _data
    cdef mjData* _solved  # the data from which the dry friction is taken
    cdef object _owners  # the objects that own the memory of these pointers
    cdef int _dof
    cdef double _before[MAX_DOF]
    cdef double _change[MAX_DOF]  # change in velocity over the last period
    cdef double _share, _rate_hz
    cdef const double* _jacobian
    cdef readonly object effort, wrench, friction
    cdef double* c_effort
    cdef double* c_wrench
    cdef double* c_friction
    cdef void c_update(self) noexcept nogil
    cdef void _find_wrench(self) noexcept nogil
