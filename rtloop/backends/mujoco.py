"""A simulated torque-controlled arm: MuJoCo's dynamics under joint impedance control.

The drives get, each cycle,

    tau = M(q) ddq_cmd + bias(q, dq) + friction(dq_cmd) + K (q_cmd - q) + D (dq_cmd - dq)

clamped to the effort limits: on a planned motion the first three terms do the work and the springs
see only what the model does not know; pushed, the arm yields by force over stiffness.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.config import Settings
from cobot.model import RobotModel
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError

NATURAL_FREQUENCY_RAD_S = 60.0
DAMPING_RATIO = 0.7
"""Of each joint about its inertia at the start. 60 rad/s gives some 5000 N·m/rad in the large joints and
500 in the small ones, the range in which the LBR's own joint impedance works, and is a hundredth of the
rate of a 1 kHz cycle, far from what discrete damping would make unstable."""
FRICTION_VELOCITY_RAD_S = 0.01
"""Commanded speed over which the compensation of dry friction grows to its full value."""


class MujocoBackend:
    """The `Backend` that needs no robot.

    Attributes:
        fail_read, fail_write: what the device shall complain of from now on; "" for nothing.
    """

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        robot = settings.robot
        self._model = RobotModel.load(robot.model, limits, base=robot.base_frame, tcp=robot.tcp).mj
        self._model.opt.timestep = settings.rt.period_s
        self._data = mujoco.MjData(self._model)
        self._limits = limits
        self._damping = self._model.dof_damping.copy()
        self._friction = self._model.dof_frictionloss.copy()
        self._torque = np.zeros(limits.dof)
        self._term = np.zeros(limits.dof)
        self._stiffness = np.zeros(limits.dof)
        self._resistance = np.zeros(limits.dof)
        self.fail_read = ""
        self.fail_write = ""

    def open(self, initial_position: Array) -> None:
        self._data.qpos[:] = initial_position
        self._data.qvel[:] = 0.0
        mujoco.mj_forward(self._model, self._data)
        inertia = np.zeros((self._limits.dof, self._limits.dof))
        mujoco.mj_fullM(self._model, self._data, inertia)
        self._stiffness[:] = inertia.diagonal() * NATURAL_FREQUENCY_RAD_S**2
        self._resistance[:] = 2.0 * DAMPING_RATIO * inertia.diagonal() * NATURAL_FREQUENCY_RAD_S
        self._torque[:] = self._data.qfrc_bias

    def enable(self) -> None:
        """The simulated drives are always on."""

    def read(self, position: Array, velocity: Array, effort: Array) -> None:
        if self.fail_read:
            raise BackendError(self.fail_read)
        np.copyto(position, self._data.qpos)
        np.copyto(velocity, self._data.qvel)
        np.copyto(effort, self._torque)

    def write(self, position: Array, velocity: Array, acceleration: Array) -> None:
        if self.fail_write:
            raise BackendError(self.fail_write)
        model, data, torque, term = self._model, self._data, self._torque, self._term
        mujoco.mj_step1(model, data)
        mujoco.mj_mulM(model, data, torque, acceleration)
        torque += data.qfrc_bias
        np.subtract(position, data.qpos, out=term)
        term *= self._stiffness
        torque += term
        np.subtract(velocity, data.qvel, out=term)
        term *= self._resistance
        torque += term
        np.multiply(velocity, self._damping, out=term)
        torque += term
        np.divide(velocity, FRICTION_VELOCITY_RAD_S, out=term)
        np.tanh(term, out=term)
        term *= self._friction
        torque += term
        np.clip(torque, -self._limits.max_effort, self._limits.max_effort, out=torque)
        np.copyto(data.ctrl, torque)
        mujoco.mj_step2(model, data)

    def disable(self) -> None:
        """The simulated arm has no brakes: it is simply no longer stepped."""

    def close(self) -> None:
        """Nothing to let go of."""
