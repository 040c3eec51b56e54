"""Torques that make an arm compliant, for arms whose controller compensates gravity. They are calculated from
the measured state, with the springs of the simulation.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.config import Settings
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits
from rtloop.backends import Impedance
from rtloop.backends.springs import Springs


class GivingWay:
    """
    Attributes:
        robot: model of the robot.
        nominal_stiffness, nominal_cartesian_stiffness: see `rtloop.backends.ImpedanceControlled`.
    """

    def __init__(
        self, settings: Settings, limits: JointLimits, rate: Array | float, stiffness_share: float = 1.0
    ) -> None:
        """
        Args:
            rate: maximum rate of change of the torques, N·m/s, one value or one per joint.
            stiffness_share: maximum stiffness that this arm permits, as a share of the simulation's maximum
                stiffness.
        """
        names = settings.robot
        self.robot = RobotModel.load(names.model, limits, base=names.base_frame, tcp=names.tcp)
        self._model, self._data = self.robot.mj, mujoco.MjData(self.robot.mj)
        self._base = self._model.body(names.base_frame).id
        self._tcp = self._model.site(names.tcp).id
        self._jacobian = np.zeros((6, limits.dof))
        self._springs = Springs(self.robot, self._data, self._jacobian)
        self._step = np.broadcast_to(rate, limits.dof) * settings.rt.period_s
        self._max_effort = limits.max_effort
        self._zeros, self._gravity = np.zeros(limits.dof), np.zeros(limits.dof)
        self.nominal_stiffness = stiffness_share * self._springs.joint_stiffness
        self.nominal_cartesian_stiffness = stiffness_share * self._springs.tcp_stiffness
        self.torque = np.zeros(limits.dof)

    def begin(self, impedance: Impedance) -> None:
        """Begin with zero torque."""
        self.torque[:] = 0.0
        self._springs.use(impedance)

    def use(self, impedance: Impedance) -> None:
        """Set the impedance that applies from the next cycle on."""
        self._springs.use(impedance)

    def torques(self, command: Array, position: Array, velocity: Array) -> Array:
        """Return the torques to command in this cycle, shape (dof,), N·m. They do not compensate gravity,
        because the robot itself does.

        The torques never change faster than the robot permits. If a measured value is not finite, the
        springs' torques are zero, and the commanded torques fade out.

        Args:
            command: commanded position, velocity and acceleration, shape (3, dof).
        """
        wanted = np.zeros(len(position))
        if all(np.isfinite(each).all() for each in (command, position, velocity)):
            wanted = self._find_torques(command, position, velocity)
        np.clip(wanted, -self._max_effort, self._max_effort, out=wanted)
        self.torque += np.clip(wanted - self.torque, -self._step, self._step)
        return self.torque

    def _find_torques(self, command: Array, position: Array, velocity: Array) -> Array:
        data = self._data
        data.qpos[:], data.qvel[:] = position, 0.0
        mujoco.mj_fwdPosition(self._model, data)
        mujoco.mj_rne(self._model, data, 0, self._gravity)
        data.qvel[:] = velocity
        mujoco.mj_fwdVelocity(self._model, data)
        self._find_jacobian()
        inertial = np.zeros(len(position))
        mujoco.mj_mulM(self._model, data, inertial, command[2])
        wanted: Array = self._springs.torques(command) + data.qfrc_bias - self._gravity + inertial
        return wanted

    def _find_jacobian(self) -> None:
        """Calculate the TCP Jacobian in the base frame."""
        mujoco.mj_jacSite(self._model, self._data, self._jacobian[:3], self._jacobian[3:], self._tcp)
        turn = self._data.xmat[self._base].reshape(3, 3)
        self._jacobian[:3] = turn.T @ self._jacobian[:3]
        self._jacobian[3:] = turn.T @ self._jacobian[3:]
