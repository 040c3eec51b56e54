"""Inertia and bias forces of the arm, computed by MuJoCo in separate memory.

Joint vectors are shape (dof,): rad, rad/s, N·m. Not thread safe. Values that are not finite give results that
are not finite, and have no other effect.
"""

from libc.string cimport memcpy

import numpy as np

from cobot.arrays cimport checked_dof, doubles
from cobot.robot.mujoco cimport (
    kinematic_data_of,
    mj_comPos,
    mj_comVel,
    mj_crb,
    mj_deleteData,
    mj_fullM,
    mj_kinematics,
    mj_rne,
    mj_setConst,
    mjModel,
    model_of,
)


cdef class Dynamics:
    """The dynamics of a `mujoco.MjModel` with one coordinate per joint."""

    def __cinit__(self, mj):
        self._mj = mj
        self._dof = checked_dof(mj.nv)
        self._joints, self._velocity = np.zeros(self._dof), np.zeros(self._dof)
        self._c_joints = doubles(self._joints, self._dof)
        self._c_velocity = doubles(self._velocity, self._dof)
        self._model = model_of(mj)
        self._data = kinematic_data_of(self._model)

    def __dealloc__(self):
        if self._data != NULL:
            mj_deleteData(self._data)

    def settle(self):
        """Recompute the model's constants after its masses have changed. Takes about 10 µs."""
        mj_setConst(<mjModel*>self._model, self._data)

    cdef void c_mass_matrix(self, const double* joints, double* full) noexcept nogil:
        """Joint-space inertia, dof × dof, kg·m², including the drives' inertia (armature)."""
        memcpy(self._data.qpos, joints, self._dof * sizeof(double))
        mj_kinematics(self._model, self._data)
        mj_comPos(self._model, self._data)
        mj_crb(self._model, self._data)
        mj_fullM(self._model, self._data, full)

    cdef void c_bias_torques(
        self, const double* joints, const double* velocity, double* torques
    ) noexcept nogil:
        """The torques for motion without acceleration: gravity, Coriolis and centrifugal forces."""
        memcpy(self._data.qpos, joints, self._dof * sizeof(double))
        memcpy(self._data.qvel, velocity, self._dof * sizeof(double))
        mj_kinematics(self._model, self._data)
        mj_comPos(self._model, self._data)
        mj_comVel(self._model, self._data)
        mj_rne(self._model, self._data, 0, torques)

    cdef void c_inverse(
        self, const double* joints, const double* velocity, const double* acceleration, double* torques
    ) noexcept nogil:
        """The torques for an acceleration, including the drives' inertia (armature), without friction."""
        cdef int i
        memcpy(self._data.qacc, acceleration, self._dof * sizeof(double))
        memcpy(self._data.qpos, joints, self._dof * sizeof(double))
        memcpy(self._data.qvel, velocity, self._dof * sizeof(double))
        mj_kinematics(self._model, self._data)
        mj_comPos(self._model, self._data)
        mj_comVel(self._model, self._data)
        mj_rne(self._model, self._data, 1, torques)
        for i in range(self._dof):
            torques[i] += self._model.dof_armature[i] * acceleration[i]

    def inverse(self, joints, velocity, acceleration):
        """The torques for rows of joints, shape (..., dof), N·m, without friction."""
        shape = np.shape(joints)
        states = (joints, velocity, acceleration)
        given = [
            np.array(each if np.shape(each) == shape else np.broadcast_to(each, shape), np.float64, order="C")
            for each in states
        ]
        torques = np.zeros(shape)
        if torques.size == 0:
            return torques
        if shape[len(shape) - 1] != self._dof:
            raise ValueError(f"rows of {self._dof} joints are needed, not {shape}")
        cdef Py_ssize_t rows = torques.size // self._dof, row, begin
        cdef const double* q = doubles(given[0], torques.size)
        cdef const double* v = doubles(given[1], torques.size)
        cdef const double* a = doubles(given[2], torques.size)
        cdef double* out = doubles(torques, torques.size)
        for row in range(rows):
            begin = row * self._dof
            self.c_inverse(&q[begin], &v[begin], &a[begin], &out[begin])
        return torques

    def mass_matrix(self, joints):
        """Joint-space inertia, shape (dof, dof), kg·m²."""
        self._joints[...] = joints
        full = np.zeros((self._dof, self._dof))
        self.c_mass_matrix(self._c_joints, doubles(full, self._dof * self._dof))
        return full

    def bias_torques(self, joints, velocity):
        """The torques for motion without acceleration, shape (dof,), N·m, without friction."""
        self._joints[...] = joints
        self._velocity[...] = velocity
        torques = np.zeros(self._dof)
        self.c_bias_torques(self._c_joints, self._c_velocity, doubles(torques, self._dof))
        return torques
