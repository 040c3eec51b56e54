"""The arm behind a simulated controller: cobot's own dynamics, stepped each millisecond."""

from __future__ import annotations

import math
from typing import Literal

import mujoco
import numpy as np

from cobot.config import Settings
from cobot.orientations import kuka_angles
from cobot.robot import quaternion
from cobot.types import Array, JointLimits
from rtloop.backends import Impedance, Measured
from rtloop.backends.mujoco import MujocoBackend

STEP_S = 0.001
STIFFNESS_SHARE = 0.2
"""Stiffness while the controller's program uses an impedance, as a share of the maximum stiffness."""
DAMPING_RATIO = 0.7
GUIDED_SHARE = 1.0 / 16.0
"""Damping of a guided arm: the critical damping at this share of the maximum stiffness."""
Springs = Literal["joint", "cartesian"]


class ControllerArm:
    """The simulated arm.

    Attributes:
        limits: limits of its joints.
        setpoint: target of the drives, shape (dof,), rad.
        measured: values of its sensors.
        overlay: torques from the client in addition to the torques of the drives, shape (dof,), N·m.
    """

    def __init__(
        self, settings: Settings, limits: JointLimits, position: Array, springs: Springs | None = None
    ) -> None:
        """
        Args:
            springs: impedance of the drives at the joints or at the TCP; None for position control.
        """
        rt = settings.rt.model_copy(update={"period_s": STEP_S})
        self._drives = MujocoBackend(settings.model_copy(update={"rt": rt}), limits)
        self._model, self._data = self._drives._model, self._drives._data
        self._tcp = self._model.site(settings.robot.tcp).id
        sites = {self._model.site(index).name for index in range(self._model.nsite)}
        self._flange = self._model.site("flange").id if "flange" in sites else self._tcp
        self._base = self._model.body(settings.robot.base_frame).id
        self._jacobian = np.zeros((6, limits.dof))
        self._dynamics = mujoco.MjData(self._model)
        self.limits = limits
        self.setpoint = np.array(position, dtype=float)
        self._velocity = np.zeros(limits.dof)
        self.overlay = np.zeros(limits.dof)
        self._rows = np.zeros((3, limits.dof))
        self.measured = Measured(limits.dof)
        self._drives.open(self.setpoint)
        if springs is not None:
            self._drives.set_impedance(self._soft(springs))
        self._drives.read(self.measured)

    def _soft(self, springs: Springs) -> Impedance:
        cartesian = springs == "cartesian"
        nominal = self._drives.nominal_cartesian_stiffness if cartesian else self._drives.nominal_stiffness
        return Impedance(cartesian, STIFFNESS_SHARE * nominal, np.full(len(nominal), DAMPING_RATIO))

    @property
    def push(self) -> Array:
        """The wrench that the surroundings exert at the TCP, in the base frame, shape (6,), N and N·m. To
        push the arm, write to this array.
        """
        return self._drives.push

    def torque_of(self, wrench: Array) -> Array:
        """Calculate the joint torques that correspond to a wrench at the TCP in the base frame. Shapes:
        (dof,) and (6,).
        """
        return self._find_jacobian().T @ wrench

    def speed_at(self, velocity: Array) -> float:
        """Calculate the TCP speed at these joint velocities, m/s."""
        return float(np.linalg.norm(self._find_jacobian()[:3] @ velocity))

    def pose(self) -> tuple[float, ...]:
        """The pose of the flange in the base frame: x, y, z in mm and a quaternion (w, x, y, z)."""
        data = self._data
        turn = data.xmat[self._base].reshape(3, 3).T
        place = 1e3 * turn @ (data.site_xpos[self._flange] - data.xpos[self._base])
        orientation = turn @ data.site_xmat[self._flange].reshape(3, 3)
        return (*place.tolist(), *quaternion.from_matrix(orientation.ravel()))

    def kuka_pose(self) -> tuple[float, ...]:
        """The flange pose in the base frame, as KUKA writes it: X, Y, Z in mm, and A, B, C in degrees."""
        x, y, z, *turn = self.pose()
        return x, y, z, *map(math.degrees, kuka_angles(turn))

    def _find_jacobian(self) -> Array:
        mujoco.mj_jacSite(self._model, self._data, self._jacobian[:3], self._jacobian[3:], self._tcp)
        return self._jacobian

    def release(self) -> None:
        """Release the arm, so that a person can guide it. Only dampers and the gravity compensation act on
        it.
        """
        nominal = self._drives.nominal_stiffness
        self._drives.set_impedance(Impedance(False, GUIDED_SHARE * nominal, np.ones(len(nominal))))

    def drift(self, milliseconds: int) -> None:
        """Simulate a released arm for a number of milliseconds. Its target follows its position."""
        rows = self._rows
        rows[1:] = 0.0
        for _ in range(milliseconds):
            rows[0] = self.measured.position
            self._drives.write(rows)
            self._drives.read(self.measured)
        self.setpoint, self._velocity = self.measured.position.copy(), self.measured.velocity.copy()

    def loosen(self) -> None:
        """Put the arm under torque control. Only torques act on it, in addition to the compensation of
        gravity and friction.
        """
        nothing = np.zeros(self.limits.dof)
        self._drives.set_impedance(Impedance(False, nothing, np.ones(self.limits.dof)))

    def exert(self, torque: Array, milliseconds: int) -> None:
        """Exert torques on an arm under torque control, for a number of milliseconds. They have shape (dof,),
        in N·m. The arm's target follows its position.
        """
        rows = self._rows
        for _ in range(milliseconds):
            rows[0], rows[1] = self.measured.position, self.measured.velocity
            rows[2] = self._acceleration_of(torque)
            self._drives.write(rows)
            self._drives.read(self.measured)
        self.setpoint, self._velocity = self.measured.position.copy(), self.measured.velocity.copy()

    def _acceleration_of(self, torque: Array) -> Array:
        """Calculate the acceleration, rad/s², that a torque of the drives causes, without velocity-dependent
        torques, which the drives compensate.
        """
        data, model = self._dynamics, self._model
        gravity, found = np.zeros(self.limits.dof), np.zeros(self.limits.dof)
        data.qpos[:], data.qvel[:] = self._data.qpos, 0.0
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_rne(model, data, 0, gravity)
        data.qvel[:] = self._data.qvel
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_solveM(model, data, found[None], (torque - data.qfrc_bias + gravity)[None])
        return found

    def hold(self) -> None:
        """Return to position control."""
        self._drives.set_impedance(None)

    def advance(self, target: Array, velocity: Array, milliseconds: int) -> None:
        """Move to a target (rad) in a number of milliseconds, and arrive there with the given velocity
        (rad/s).
        """
        time_s = milliseconds * STEP_S
        from_position, from_velocity = self.setpoint, self._velocity
        acceleration = (velocity - from_velocity) / time_s
        self._data.qfrc_applied[:] = self.overlay
        rows = self._rows
        rows[2] = acceleration
        for step in range(1, milliseconds + 1):
            share = step / milliseconds
            rows[0] = _between(from_position, from_velocity, target, velocity, time_s, share)
            rows[1] = from_velocity + acceleration * (share * time_s)
            self._drives.write(rows)
        self.setpoint, self._velocity = np.array(target), np.array(velocity)
        self._drives.read(self.measured)
        self.measured.external_effort -= self.overlay  # the client's torque is not an external effort


def _between(
    begin: Array, begin_velocity: Array, end: Array, end_velocity: Array, time_s: float, share: float
) -> Array:
    """Interpolate between two positions with their velocities by a cubic Hermite polynomial."""
    square, cube = share * share, share**3
    position: Array = (
        (2 * cube - 3 * square + 1) * begin
        + (cube - 2 * square + share) * time_s * begin_velocity
        + (3 * square - 2 * cube) * end
        + (cube - square) * time_s * end_velocity
    )
    return position
