"""Inertia and bias forces of the arm, by MuJoCo, in memory of its own.

Joint vectors are shape (dof,): rad, rad/s, N·m. Not thread safe. Values that are not finite make results that
are not, and nothing else.
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
    model_of,
)


cdef class Dynamics:
    """Of a `mujoco.MjModel` with one coordinate per joint."""

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

    cdef void c_mass_matrix(self, const double* joints, double* full) noexcept nogil:
        """Joint-space inertia, dof × dof, kg·m², the drives' inertia (armature) included."""
        memcpy(self._data.qpos, joints, self._dof * sizeof(double))
        mj_kinematics(self._model, self._data)
        mj_comPos(self._model, self._data)
        mj_crb(self._model, self._data)
        mj_fullM(self._model, self._data, full)

    cdef void c_bias_torques(
        self, const double* joints, const double* velocity, double* torques
    ) noexcept nogil:
        """What the drives need to move on without acceleration: gravity, Coriolis and centrifugal forces."""
        memcpy(self._data.qpos, joints, self._dof * sizeof(double))
        memcpy(self._data.qvel, velocity, self._dof * sizeof(double))
        mj_kinematics(self._model, self._data)
        mj_comPos(self._model, self._data)
        mj_comVel(self._model, self._data)
        mj_rne(self._model, self._data, 0, torques)

    def mass_matrix(self, joints):
        """Shape (dof, dof), kg·m²."""
        self._joints[...] = joints
        full = np.zeros((self._dof, self._dof))
        self.c_mass_matrix(self._c_joints, doubles(full, self._dof * self._dof))
        return full

    def bias_torques(self, joints, velocity):
        """Shape (dof,), N·m, without friction."""
        self._joints[...] = joints
        self._velocity[...] = velocity
        torques = np.zeros(self._dof)
        self.c_bias_torques(self._c_joints, self._c_velocity, doubles(torques, self._dof))
        return torques
