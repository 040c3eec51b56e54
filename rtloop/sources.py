"""What a streaming session makes of its client's targets: a joint reference for every cycle."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cobot.layout import Interpolation, Intervention
from cobot.model import RobotModel
from cobot.types import Array, JointLimits
from rtloop.backends import Measured
from rtloop.interpolation import make_interpolator
from rtloop.stream_checks import joint_jump


class Source(Protocol):
    """Follows a stream of targets. Real-time safe.

    Attributes:
        reference: where the joints should be in this cycle, shape (3, dof): rad, rad/s, rad/s².
        refusal: why the last target was refused.
        heading: a joint step towards the last target, rad: only its direction counts.
    """

    reference: Array
    refusal: str
    heading: Array

    def begin(self, command: Array) -> None:
        """Go on from what is commanded, shape (3, dof)."""
        ...

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        """A new target, so long after the last one; or what is wrong with it."""
        ...

    def advance(self, measured: Measured) -> None:
        """One period on."""
        ...

    def follow(self, command: Array) -> None:
        """What the safety layer has made of the reference, shape (3, dof)."""
        ...


class JointSource:
    """Joint targets, interpolated."""

    def __init__(
        self,
        kind: Interpolation,
        limits: JointLimits,
        safe_velocity: Array,
        period_s: float,
        command_s: float,
    ) -> None:
        self._interpolator = make_interpolator(
            kind, limits.dof, period_s, limits.max_velocity, limits.max_acceleration, limits.max_jerk
        )
        self.reference = self._interpolator.reference
        self.refusal = ""
        self.heading = np.zeros(limits.dof)
        self._names = limits.names
        self._velocity = safe_velocity
        self._command_s = command_s
        self._last = np.zeros(limits.dof)

    def begin(self, command: Array) -> None:
        self._interpolator.begin(command)
        np.copyto(self._last, command[0])

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        target = setpoint["joints"]
        velocity = setpoint["joint_velocity"] if setpoint["feed_forward"] else None
        if not np.isfinite(target).all() or (velocity is not None and not np.isfinite(velocity).all()):
            self.refusal = "a streamed joint target is not finite"
            return Intervention.NOT_FINITE
        self.refusal = joint_jump(target, self._last, interval_s, self._velocity, self._names)
        if self.refusal:
            return Intervention.JUMP
        np.subtract(target, self.reference[0], out=self.heading)
        np.copyto(self._last, target)
        self._interpolator.aim(target, velocity, self._command_s)
        return None

    def advance(self, measured: Measured) -> None:
        self._interpolator.advance()

    def follow(self, command: Array) -> None:
        """The reference does not wait for the arm."""


class TorqueSource:
    """Joint torques, on top of what gravity and motion take: the arm moves as they would move it.

    The reference is a model of the arm, M(q) q'' = torque + what the surroundings exert - its damping,
    within the limits of velocity, acceleration and jerk; the drives follow it softly. So every limit holds
    in this mode too, and a torque against an obstacle becomes that torque on the obstacle.
    """

    def __init__(self, model: RobotModel, limits: JointLimits, period_s: float) -> None:
        self._model = model
        self._limits = limits
        self._period_s = period_s
        self._damping = model.mj.dof_damping.copy()
        self._torque = np.zeros(limits.dof)
        self.reference = np.zeros((3, limits.dof))
        self.heading = np.zeros(limits.dof)
        self.refusal = ""

    def begin(self, command: Array) -> None:
        np.copyto(self.reference, command)
        self._torque[:] = 0.0

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        torque = setpoint["joints"]
        if not np.isfinite(torque).all():
            self.refusal = "a streamed torque is not finite"
            return Intervention.NOT_FINITE
        np.clip(torque, -self._limits.max_effort, self._limits.max_effort, out=self._torque)
        np.copyto(
            self.heading, self._torque
        )  # the mass matrix is positive: never more than a right angle off
        return None

    def advance(self, measured: Measured) -> None:
        limits, period_s = self._limits, self._period_s
        position, velocity, acceleration = self.reference
        torque = self._torque + measured.external_effort - self._damping * velocity
        wanted = np.linalg.solve(self._model.mass_matrix(position), torque)
        # so that the acceleration can be back at zero when the velocity has reached its limit
        room = np.sqrt(
            2.0 * limits.max_jerk * np.maximum(limits.max_velocity - np.sign(wanted) * velocity, 0.0)
        )
        most = np.minimum(limits.max_acceleration, room)
        np.clip(wanted, -most, most, out=wanted)
        step = limits.max_jerk * period_s
        acceleration += np.clip(wanted - acceleration, -step, step)
        velocity += period_s * acceleration
        position += period_s * velocity

    def follow(self, command: Array) -> None:
        np.copyto(self.reference, command)
