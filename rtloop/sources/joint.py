"""What a streaming session makes of its client's targets: a joint reference for every cycle."""

from __future__ import annotations

from typing import Protocol

import mujoco
import numpy as np

from cobot.ipc.layout import CHUNK_POINTS, Interpolation, Intervention
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits
from rtloop.backends import Measured
from rtloop.generators.chunks import ChunkInterpolator
from rtloop.generators.factory import make_interpolator
from rtloop.sources.target_checks import SLACK_S, is_finite, joint_jump

LONGEST_CHUNK_S = 600.0


class Source(Protocol):
    """Follows a stream of targets. Real-time safe.

    Attributes:
        reference: where the joints should be in this cycle, shape (3, dof): rad, rad/s, rad/s².
        refusal: why the last target was refused.
        heading: a joint step towards the last target, rad: only its direction counts.
    """

    refusal: str

    @property
    def reference(self) -> Array: ...

    @property
    def heading(self) -> Array: ...

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
    """Joint targets, interpolated, or chunks of timed ones; whichever came last counts.

    Attributes:
        late, starved: see `ChunkInterpolator`.
    """

    def __init__(
        self,
        kind: Interpolation,
        limits: JointLimits,
        safe_velocity: Array,
        period_s: float,
        command_s: float,
    ) -> None:
        rates = limits.max_velocity, limits.max_acceleration, limits.max_jerk
        self._interpolator = make_interpolator(kind, limits.dof, period_s, *rates)
        self._chunks = ChunkInterpolator(limits.dof, period_s, *rates)
        self._chunked = False
        self._time_s = 0.0  # of the chunks' reference
        self.refusal = ""
        self.heading = np.zeros(limits.dof)
        self._names = limits.names
        self._velocity = safe_velocity
        self._period_s = period_s
        self._command_s = command_s
        self._last = np.zeros(limits.dof)

    @property
    def reference(self) -> Array:
        return self._chunks.reference if self._chunked else self._interpolator.reference

    @property
    def late(self) -> int:
        return self._chunks.late

    @property
    def starved(self) -> int:
        return self._chunks.starved

    def begin(self, command: Array) -> None:
        self._chunked = False
        self._interpolator.begin(command)
        np.copyto(self._last, command[0])

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        target = setpoint["joints"]
        velocity = setpoint["joint_velocity"] if setpoint["feed_forward"] else None
        if not is_finite(target) or (velocity is not None and not is_finite(velocity)):
            self.refusal = "a streamed joint target is not finite"
            return Intervention.NOT_FINITE
        self.refusal = joint_jump(target, self._last, interval_s, self._velocity, self._names)
        if self.refusal:
            return Intervention.JUMP
        if self._chunked:
            self.begin(self.reference)
        np.subtract(target, self.reference[0], out=self.heading)
        np.copyto(self._last, target)
        self._interpolator.aim(target, velocity, self._command_s)
        return None

    def take_chunk(self, chunk: np.ndarray, robot_time_s: float) -> Intervention | None:
        """Timed targets from now on, see `cobot.ipc.layout.chunk_dtype`; or what is wrong with them."""
        count, dof = min(int(chunk["count"]), CHUNK_POINTS), len(self._last)
        times_s, points = chunk["times_s"][:count].copy(), chunk["points"][:count, :dof].copy()
        if not (is_finite(times_s) and is_finite(points)):
            self.refusal = "a streamed chunk is not finite"
            return Intervention.NOT_FINITE
        self._time_s = robot_time_s - self._period_s  # the reference is that of the cycle before
        if count and times_s[-1] > robot_time_s + LONGEST_CHUNK_S:
            self.refusal = f"the chunk ends in more than {LONGEST_CHUNK_S:g} s"
            return Intervention.LATE
        self.refusal = self._chunk_jump(times_s, points)
        if self.refusal:
            return Intervention.JUMP
        if not self._chunked:
            self._chunks.begin(self.reference)
        self.refusal = self._chunks.take(times_s, points, self._time_s)
        if self.refusal:
            return Intervention.LATE
        self._chunked = True
        np.copyto(self._last, points[-1])
        np.subtract(points[-1], self.reference[0], out=self.heading)
        return None

    def advance(self, measured: Measured) -> None:
        if self._chunked:
            self._time_s += self._period_s
            self._chunks.advance(self._time_s)
        else:
            self._interpolator.advance()

    def follow(self, command: Array) -> None:
        """The reference does not wait for the arm."""

    def _chunk_jump(self, times_s: Array, points: Array) -> str:
        """Whether the targets that are still ahead would take a joint faster than it can be."""
        ahead = times_s > self._time_s
        at = np.concatenate([[self._time_s - SLACK_S], times_s[ahead]])
        rows = np.vstack([self.reference[0], points[ahead]])
        excess = np.abs(np.diff(rows, axis=0)) - self._velocity * np.diff(at)[:, None]
        if excess.size == 0 or excess.max() <= 0.0:
            return ""
        point, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        return f"{self._names[joint]} would have to jump to point {point} of the chunk"


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
        mass = self._model.mass_matrix(position)
        mujoco.mju_cholFactor(mass, 0.0)
        wanted = np.empty(len(torque))
        mujoco.mju_cholSolve(wanted, mass, torque)
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
