"""Torques for the controller's `direct_torque`, which compensates gravity itself. They act like springs
around the commanded position. This module also estimates external efforts.

From the URScript manual of PolyScope 5.25: the function sets the target torques, without gravity, for one of
500 control steps per second, and must be called in each step. After a step without a call, the controller
returns to position control. A program itself returns with `stopj` or `speedj`.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.config import Settings
from cobot.types import Array, JointLimits
from rtloop.backends import Impedance
from rtloop.backends.giving_way import GivingWay
from rtloop.backends.observer import Observer
from rtloop.results import ACCEPTED, Accepted, Rejected

TORQUE_PERIOD_S = 0.002
"""The control step of controllers with `direct_torque`, s."""
MIN_POLYSCOPE, MIN_POLYSCOPE_X, POLYSCOPE_X = (5, 23), (10, 11), (10,)
"""First software versions that support `direct_torque` and `MOTOR_TORQUE`."""
MOTOR_TORQUE = "actual_current_as_torque"
"""RTDE variable with the measured motor currents, converted to torques, N·m."""
HELD_STEPS = 4
"""Number of control steps without a message for which the newest torques stay in effect. After that they fade
out.
"""
SPEED_SHARE = 1.1
"""Share of a joint's velocity limit above which the program ends the torques and stops the arm."""
RISE_S = 0.05
"""Minimum time in which the torque of a joint rises from 0 to its limit, s."""
REST_RAD_S = 0.01
"""The arm is at rest if no joint is faster than this, rad/s."""
MAX_REPEATED = 5
"""Number of consecutive packages with identical values from a moving arm after which the values are
considered frozen.
"""
MAX_CONSTANT = 10
"""Number of packages with the same values and motor currents after which the values of an arm at rest are
considered frozen. The noise of measured currents never repeats.
"""
STIFFNESS_SHARE = 0.09
"""Stiffness as a share of the simulation's maximum stiffness. The stiffest springs then have a frequency of
30 rad/s, which is low because several milliseconds pass between measuring and exerting a torque.
"""


def torque_rate(limits: JointLimits) -> Array:
    """Return the maximum rate of the torques, shape (dof,), N·m/s."""
    return limits.max_effort / RISE_S


def check_version(version: tuple[int, ...], text: str, *, has_torque: bool) -> Accepted | Rejected:
    """Check that a controller has `direct_torque`.

    Args:
        version: version of its software.
        text: the version as text for messages.
        has_torque: whether its RTDE has `MOTOR_TORQUE`.
    """
    first = MIN_POLYSCOPE if version < POLYSCOPE_X else MIN_POLYSCOPE_X
    if version >= first and has_torque:
        return ACCEPTED
    return Rejected(
        f"robot.backend.torque is true, but the controller's software {text} has no direct_torque: update it "
        f"to {'.'.join(map(str, first))} or later, or set robot.backend.torque to false"
    )


class ExertedTorques:
    """
    Attributes:
        nominal_stiffness, nominal_cartesian_stiffness: see `rtloop.backends.ImpedanceControlled`.
        is_on: whether torques are exerted, not positions.
    """

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        self._giving = GivingWay(settings, limits, torque_rate(limits), STIFFNESS_SHARE)
        self.robot = self._giving.robot
        self.nominal_stiffness = self._giving.nominal_stiffness
        self.nominal_cartesian_stiffness = self._giving.nominal_cartesian_stiffness
        self.is_on = False
        model = self._model = self.robot.mj
        model.opt.timestep = settings.rt.period_s
        model.dof_damping[:] = model.dof_frictionloss[:] = 0.0  # for real joints they are unknown
        self._data = mujoco.MjData(model)
        self._observer = Observer(model, self._data, np.zeros((6, limits.dof)))
        self._gravity = np.zeros(limits.dof)
        self._before = np.zeros(3 * limits.dof)
        self._repeated = self._constant = 0

    def is_needed(self, impedance: Impedance | None) -> bool:
        """Whether an impedance needs torques. The controller's own position control is as stiff as the
        stiffest springs of the joints.
        """
        if impedance is None:
            return False
        return impedance.cartesian or not np.allclose(impedance.stiffness, self.nominal_stiffness, rtol=1e-6)

    def begin(self, impedance: Impedance) -> None:
        """Use this impedance from the next cycle on."""
        if self.is_on:
            self._giving.use(impedance)
        else:
            self._giving.begin(impedance)
        self.is_on = True

    def check(self, position: Array, velocity: Array, motor: Array) -> Accepted | Rejected:
        """Check that the measured values can be used for torques. Call it once per package.

        Args:
            motor: measured torques of the motors, N·m.
        """
        now = np.concatenate([position, velocity, motor])
        moves = float(np.abs(velocity).max()) > REST_RAD_S
        same = now == self._before
        self._repeated = self._repeated + 1 if moves and same[: -len(motor)].all() else 0
        self._constant = self._constant + 1 if same.all() else 0
        self._before = now
        if not np.isfinite(now).all():
            return Rejected("the controller reports a position, velocity or current that is not a number")
        if self._repeated >= MAX_REPEATED:
            what, times = "position of a moving arm", self._repeated
        elif self._constant >= MAX_CONSTANT:
            what, times = "position and the motor currents", self._constant
        else:
            return ACCEPTED
        return Rejected(
            f"the controller has repeated the {what} {times} times: no torque can be computed from them"
        )

    def find(self, command: Array, position: Array, velocity: Array) -> Array:
        """Return the torques to exert in this cycle, see `GivingWay.torques`."""
        return self._giving.torques(command, position, velocity)

    def estimate(self, position: Array, velocity: Array, motor: Array) -> Array:
        """Estimate the external efforts, including friction. Shape: (dof,), in N·m.

        Under torque control, the exerted torques are used, because the controller compensates friction in
        addition to them.

        Args:
            motor: measured torques of the motors, N·m. They are used only in position control.
        """
        data = self._data
        if not all(np.isfinite(each).all() for each in (position, velocity, motor)):
            return self._observer.effort
        data.qpos[:], data.qvel[:] = position, 0.0
        mujoco.mj_fwdPosition(self._model, data)
        mujoco.mj_rne(self._model, data, 0, self._gravity)
        data.qvel[:] = velocity
        mujoco.mj_fwdVelocity(self._model, data)
        data.qfrc_actuator[:] = self._gravity + self._giving.torque if self.is_on else motor
        self._observer.update()
        return self._observer.effort
