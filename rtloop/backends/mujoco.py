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
        # MuJoCo makes a new view at each access; these stay valid as long as the data.
        self._position, self._velocity = self._data.qpos, self._data.qvel
        self._bias, self._control = self._data.qfrc_bias, self._data.ctrl
        dof = limits.dof
        self._high, self._low = limits.max_effort, -limits.max_effort
        self._friction = self._model.dof_frictionloss.copy()
        self._torque = np.zeros(dof)
        self._term = np.zeros(dof)
        # stiffness, damping of the controller, damping of the joint; and what each acts on
        self._gains = np.zeros((3, dof))
        self._gains[2] = self._model.dof_damping
        self._springs = np.zeros((3, dof))
        self.fail_read = ""
        self.fail_write = ""

    def open(self, initial_position: Array) -> None:
        self._position[:] = initial_position
        self._velocity[:] = 0.0
        mujoco.mj_forward(self._model, self._data)
        inertia = np.zeros((len(self._torque), len(self._torque)))
        mujoco.mj_fullM(self._model, self._data, inertia)
        self._gains[0] = inertia.diagonal() * NATURAL_FREQUENCY_RAD_S**2
        self._gains[1] = inertia.diagonal() * 2.0 * DAMPING_RATIO * NATURAL_FREQUENCY_RAD_S
        self._torque[:] = self._bias

    def enable(self) -> None:
        """The simulated drives are always on."""

    def read(self, position: Array, velocity: Array, effort: Array) -> None:
        if self.fail_read:
            raise BackendError(self.fail_read)
        np.copyto(position, self._position)
        np.copyto(velocity, self._velocity)
        np.copyto(effort, self._torque)

    def write(self, position: Array, velocity: Array, acceleration: Array) -> None:
        if self.fail_write:
            raise BackendError(self.fail_write)
        torque, term, springs = self._torque, self._term, self._springs
        mujoco.mj_step1(self._model, self._data)
        np.subtract(position, self._position, out=springs[0])
        np.subtract(velocity, self._velocity, out=springs[1])
        np.copyto(springs[2], velocity)
        np.multiply(springs, self._gains, out=springs)
        np.add.reduce(springs, axis=0, out=torque)
        torque += self._bias
        mujoco.mj_mulM(self._model, self._data, term, acceleration)
        torque += term
        np.multiply(velocity, 1.0 / FRICTION_VELOCITY_RAD_S, out=term)
        np.tanh(term, out=term)
        term *= self._friction
        torque += term
        np.minimum(torque, self._high, out=torque)
        np.maximum(torque, self._low, out=torque)
        np.copyto(self._control, torque)
        mujoco.mj_step2(self._model, self._data)

    def disable(self) -> None:
        """The simulated arm has no brakes: it is simply no longer stepped."""

    def close(self) -> None:
        """Nothing to let go of."""
