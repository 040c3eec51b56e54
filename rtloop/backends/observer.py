"""Feels what pushes the simulated arm, from its motion and the drives' torques.

The momentum observer of De Luca, Albu-Schäffer, Haddadin and Hirzinger (IROS 2006): the generalised
momentum p = M dq changes by what the drives, gravity, friction and the surroundings do. Over one period

    p' - p = (M' - M) dq' + M (dq' - dq),    M (dq' - dq) / h = torque - bias - damping dq' + external

so that the inertia's change drops out, and what is left is external. The observer follows it through a
lag of first order.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.types import Array

GAIN_HZ = 100.0
"""Of the observer, 1/s: 63 % of a push are seen after 10 ms, 99 % within 50."""
MIN_SINGULAR = 0.01
"""Singular value of the Jacobian at which half of a force is seen: what the joints' torques cannot tell
is left out rather than guessed."""
INERTIA, BIAS, DAMPING, TORQUE, FRICTION, LAST = range(6)


class Observer:
    """Torques and wrench that the surroundings exert. Real-time safe.

    Attributes:
        effort: on the joints, shape (dof,), N·m.
        wrench: at the TCP, shape (6,), N and N·m, in the Jacobian's frame: the one that explains `effort`
            best.
        friction: dry friction of the joints in the last period, shape (dof,), N·m. The torque sensors of
            such an arm sit behind the gears: they feel the drive less this.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, jacobian: Array) -> None:
        self._model, self._data, self._jacobian = model, data, jacobian
        self._velocity, self._bias, self._torque = data.qvel, data.qfrc_bias, data.qfrc_actuator
        self._rubbing = np.flatnonzero(model.dof_frictionloss)
        self._damping = model.dof_damping.copy()
        share = 1.0 - np.exp(-GAIN_HZ * model.opt.timestep)
        self._weights = np.array([1.0 / model.opt.timestep, 1.0, 1.0, -1.0, -1.0, 0.0]) * share
        self._weights[LAST] = 1.0 - share
        self._terms = np.zeros((6, model.nv))
        (
            self._inertia_term,
            self._bias_term,
            self._damping_term,
            self._torque_term,
            self.friction,
            self._last,
        ) = self._terms
        self._before, self._change = np.zeros(model.nv), np.zeros(model.nv)
        self.effort, self.wrench = np.zeros(model.nv), np.zeros(6)
        self._square = np.zeros((6, 6))
        self._square_diagonal = self._square.reshape(-1)[::7]

    def reset(self) -> None:
        """The arm stands still and nothing pushes it."""
        np.copyto(self._before, self._velocity)
        self.friction[:] = 0.0
        self.effort[:] = 0.0
        self.wrench[:] = 0.0

    def update(self) -> None:
        """After each step, while MuJoCo still has inertia and bias of the step's beginning."""
        data = self._data
        np.subtract(self._velocity, self._before, out=self._change)
        np.copyto(self._before, self._velocity)
        mujoco.mj_mulM(self._model, data, self._inertia_term, self._change)
        np.copyto(self._bias_term, self._bias)
        np.multiply(self._damping, self._velocity, out=self._damping_term)
        np.copyto(self._torque_term, self._torque)
        first = data.ne  # MuJoCo's forces of constraint: equalities, then dry friction
        self.friction[self._rubbing] = data.efc_force[first : first + len(self._rubbing)]
        np.copyto(self._last, self.effort)
        np.dot(self._weights, self._terms, out=self.effort)
        np.dot(self._jacobian, self._jacobian.T, out=self._square)
        self._square_diagonal += MIN_SINGULAR**2
        mujoco.mju_cholFactor(self._square, 0.0)
        np.dot(self._jacobian, self.effort, out=self.wrench)
        mujoco.mju_cholSolve(self.wrench, self._square, self.wrench)
