"""Estimates external efforts on the simulated arm from its motion and the drives' torques.

The momentum observer of De Luca, Albu-Schäffer, Haddadin and Hirzinger (IROS 2006): the generalised momentum
p = M dq changes through the drives, gravity, friction and the surroundings. Over one period

    p' - p = (M' - M) dq' + M (dq' - dq),    M (dq' - dq) / h = torque - bias - damping dq' + external

so the change of the inertia cancels, and the remainder is the external effort. The observer filters it with a
first-order lag.
"""

from libc.math cimport exp

import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from cobot.robot.linear cimport cholesky_solve
from cobot.robot.mujoco cimport data_of, mj_mulM, model_of

# 1/s: the estimate reaches 63 % of a push after 10 ms and 99 % within 50 ms.
cdef double GAIN_HZ = 100.0
# Singular value of the Jacobian at which half of a force is estimated. Components that the joint torques do
# not show are estimated as zero.
cdef double MIN_SINGULAR = 0.01


cdef class Observer:
    def __init__(self, model: object, data: object, jacobian: object) -> None:
        cdef int dof = checked_dof(model.nv)
        self._owners = model, data, jacobian
        self._model, self._data = model_of(model), data_of(data)
        self._solved = self._data
        self._jacobian = doubles(jacobian, 6 * dof)
        self._dof = dof
        self._share = 1.0 - exp(-GAIN_HZ * self._model.opt.timestep)
        self._rate_hz = 1.0 / self._model.opt.timestep
        self.effort, self.friction, self.wrench = np.zeros(dof), np.zeros(dof), np.zeros(6)
        self.c_effort, self.c_friction = doubles(self.effort, dof), doubles(self.friction, dof)
        self.c_wrench = doubles(self.wrench, 6)
        self.reset()

    def solve_by(self, data: object) -> None:
        """Take the dry friction from the data of a larger model, whose first joints are the arm's."""
        self._owners = *self._owners, data
        self._solved = data_of(data)

    def reset(self) -> None:
        cdef int joint
        for joint in range(self._dof):
            self._before[joint] = self._data.qvel[joint]
            self.c_friction[joint] = self.c_effort[joint] = 0.0
        self.wrench[:] = 0.0

    def update(self) -> None:
        self.c_update()

    cdef void c_update(self) noexcept nogil:
        cdef mjData* data = self._data
        cdef mjData* solved = self._solved
        cdef double momentum[MAX_DOF]  # M (dq' - dq)
        cdef double external
        cdef int i, row = solved.ne, dof = self._dof
        for i in range(dof):
            self._change[i] = data.qvel[i] - self._before[i]
            self._before[i] = data.qvel[i]
        mj_mulM(self._model, data, momentum, self._change)
        # MuJoCo's constraint forces: equalities first, then dry friction, unless the model switches it off.
        for i in range(dof):
            self.c_friction[i] = 0.0
            if self._model.dof_frictionloss[i] > 0.0 and row < solved.ne + solved.nf:
                self.c_friction[i] = solved.efc_force[row]
                row += 1
            external = (
                momentum[i] * self._rate_hz
                + data.qfrc_bias[i]
                + self._model.dof_damping[i] * data.qvel[i]
                - data.qfrc_actuator[i]
                - self.c_friction[i]
            )
            self.c_effort[i] = self._share * external + (1.0 - self._share) * self.c_effort[i]
        self._find_wrench()

    cdef void _find_wrench(self) noexcept nogil:
        """Calculate the wrench that best explains the effort: the damped least-squares solution."""
        cdef double square[36]
        cdef const double* jacobian = self._jacobian
        cdef double product
        cdef int row, column, i, dof = self._dof
        for row in range(6):
            for column in range(row + 1):
                product = 0.0
                for i in range(dof):
                    product += jacobian[row * dof + i] * jacobian[column * dof + i]
                square[6 * row + column] = square[6 * column + row] = product
            square[7 * row] += MIN_SINGULAR * MIN_SINGULAR
            product = 0.0
            for i in range(dof):
                product += jacobian[row * dof + i] * self.c_effort[i]
            self.c_wrench[row] = product
        cholesky_solve(square, 6, self.c_wrench)
