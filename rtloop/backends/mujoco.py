"""A simulated torque-controlled arm: MuJoCo's dynamics under joint impedance control.

The drives get, each cycle,

    tau = M(q) ddq_cmd + bias(q, dq) + friction(dq_cmd) + K (q_cmd - q) + D (dq_cmd - dq)

clamped to the effort limits; friction grows with dq_cmd up to its full value. On a planned motion the
first three terms do the work and the springs see only what the model does not know; pushed, the arm
yields by force over stiffness.
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
        self._model.actuator_ctrlrange[:] = np.stack([-limits.max_effort, limits.max_effort], axis=1)
        self._data = mujoco.MjData(self._model)
        # MuJoCo makes a new view at each access; these stay valid as long as the data.
        self._position, self._velocity = self._data.qpos, self._data.qvel
        self._bias, self._torque = self._data.qfrc_bias, self._data.ctrl
        self._effort = self._data.actuator_force  # the torque, clamped
        dof = limits.dof
        self._friction = self._model.dof_frictionloss.copy()
        self._low, self._high = -self._friction, self._friction
        # Two products give all that is linear, from position, velocity and acceleration in a row: what is
        # commanded gives springs and friction, what is measured springs.
        self._from_command = np.zeros((2 * dof, 3 * dof))
        self._from_state = np.zeros((dof, 2 * dof))
        self._state = np.zeros(2 * dof)
        self._state_rows = self._state[:dof], self._state[dof:]
        self._terms = np.zeros((4, dof))
        self._commanded = self._terms[:2].ravel()
        self._friction_term, self._state_term, self._inertia_term = self._terms[1:]
        self.fail_read = ""
        self.fail_write = ""

    def open(self, initial_position: Array) -> None:
        self._position[:] = initial_position
        self._velocity[:] = 0.0
        mujoco.mj_forward(self._model, self._data)
        dof = len(initial_position)
        inertia = np.zeros((dof, dof))
        mujoco.mj_fullM(self._model, self._data, inertia)
        stiffness = inertia.diagonal() * NATURAL_FREQUENCY_RAD_S**2
        damping = inertia.diagonal() * 2.0 * DAMPING_RATIO * NATURAL_FREQUENCY_RAD_S
        spring, damper, joint_damper, friction = (
            np.diag(gain)
            for gain in (
                stiffness,
                damping,
                self._model.dof_damping,
                self._friction / FRICTION_VELOCITY_RAD_S,
            )
        )
        none = np.zeros((dof, dof))
        self._from_command[:] = np.block([[spring, damper + joint_damper, none], [none, friction, none]])
        self._from_state[:] = np.block([-spring, -damper])
        self._torque[:] = self._bias
        mujoco.mj_forward(self._model, self._data)

    def enable(self) -> None:
        """The simulated drives are always on."""

    def read(self, measured: Array) -> None:
        if self.fail_read:
            raise BackendError(self.fail_read)
        np.copyto(measured[0], self._position)
        np.copyto(measured[1], self._velocity)
        np.copyto(measured[2], self._effort)

    def write(self, command: Array) -> None:
        if self.fail_write:
            raise BackendError(self.fail_write)
        position, velocity = self._state_rows
        mujoco.mj_step1(self._model, self._data)
        np.copyto(position, self._position)
        np.copyto(velocity, self._velocity)
        np.dot(self._from_command, command.ravel(), out=self._commanded)
        np.maximum(self._friction_term, self._low, out=self._friction_term)
        np.minimum(self._friction_term, self._high, out=self._friction_term)
        np.dot(self._from_state, self._state, out=self._state_term)
        mujoco.mj_mulM(self._model, self._data, self._inertia_term, command[2])
        np.add.reduce(self._terms, axis=0, out=self._torque)
        np.add(self._torque, self._bias, out=self._torque)
        mujoco.mj_step2(self._model, self._data)

    def disable(self) -> None:
        """The simulated arm has no brakes: it is simply no longer stepped."""

    def close(self) -> None:
        """Nothing to let go of."""
