"""Inertia and bias forces of the arm, for compiled code; see `dynamics.pyx`."""

from cobot.robot.mujoco cimport mjData, mjModel


# The place of a body in the frame of the last joint that moves it; -1: it is fixed.
cdef struct Frame:
    int joint
    double turn[9]
    double offset[3]


cdef class Dynamics:
    cdef object _mj
    cdef const mjModel* _model
    cdef mjData* _data
    cdef Frame* _frames
    cdef int _dof
    cdef object _joints, _velocity
    cdef double* _c_joints
    cdef double* _c_velocity

    cdef void c_mass_matrix(self, const double* joints, double* full) noexcept nogil
    cdef void c_bias_torques(
        self, const double* joints, const double* velocity, double* torques
    ) noexcept nogil
