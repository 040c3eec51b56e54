"""Calculates the maximum speed of a jog at the arm's position, from the joint limits, the TCP speed limit,
singularities and obstacles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.errors import InputError
from cobot.reasons import Reason, ReasonCode
from cobot.robot.description import RobotDescription
from cobot.types import Array, JointLimits, vector

TCP_M_S = 0.25
"""Maximum speed of the TCP during a jog, m/s: the reduced speed of ISO 10218-1."""
JOINT_SHARE = 0.5
"""Maximum speed of a joint during a jog, as a share of its own limit."""
RATE_PER_S = 3.0
"""Maximum velocity towards a limit, as a multiple of the remaining distance, 1/s. This makes the approach
exponential: the velocity damper of Faverjon & Tournassoud, ICRA 1987. Further away, it would require too much
deceleration, so a constant deceleration is used there.
"""
JOINT_ROOM = 0.01
"""Distance that a jog keeps from a joint's limit, rad or m, so that a planned motion can begin there."""
OBSTACLE_ROOM_M = 0.003
"""Distance that a jog keeps from obstacles in addition to the margin of planned motions, m."""
FAR_M = 0.3
"""Obstacles further away than this are ignored, m, because a jog is slow."""
LOOK_S = 0.01
"""Time over which the approach to obstacles is calculated, s."""
APPROACH_M_S = 1e-3
"""Obstacles that approach more slowly than this are ignored, m/s."""
SINGULAR = 0.06
"""Threshold for the singular values of the Jacobian, m/rad or dimensionless. Velocities along directions with
smaller singular values are damped.
"""
UNLIMITED = Reason("")
SLOWED = 0.98
"""If the velocity is below this share of the requested one, the reason is reported."""


@dataclass(frozen=True, slots=True)
class LimitedVelocity:
    """Joint velocities within all speed limits.

    Attributes:
        velocity: joint velocities, shape (dof,), rad/s or m/s.
        speed: share of the requested velocity that the speed limits permit.
        share: velocity as a share of the requested velocity.
        reason: reason why the share is below 1; "" if it is 1.
    """

    velocity: Array
    speed: float
    share: float
    reason: Reason


class JogLimits:
    """The limits of a jog for one robot. Like the service's kinematics, the calculation uses the model's
    scratch memory.
    """

    def __init__(self, robot: RobotDescription, stream: JointLimits | None = None) -> None:
        """
        Args:
            stream: joint limits of the session; None for the robot's limits.
        """
        self._robot = robot
        self._rates = stream or robot.limits

    def check(self, joints: Array | None) -> None:
        """Reject velocities with the wrong number of joints.

        Raises:
            InputError: the number is wrong; the error gives the correct number.
        """
        if joints is not None:
            vector(joints, self._robot.limits.dof, name="joints")

    def wanted(self, joints: Array | None, twist: Array | None, position: Array) -> LimitedVelocity:
        """Calculate the joint velocities for a request. If they exceed a speed limit, they are reduced.

        Args:
            joints: see `JogCommand`.
            twist: TCP velocity along the axes of the base frame, shape (6,), m/s and rad/s.
            position: joint positions, shape (dof,).

        Raises:
            InputError: the request contains neither joints nor a twist.
        """
        _, _, jacobian = self._robot.model.forward_and_jacobian(position)
        share, reason = 1.0, UNLIMITED
        if joints is not None:
            velocity = np.array(joints)
        elif twist is not None:
            velocity = damped(jacobian, twist)
            done = jacobian @ velocity
            size = max(float(np.dot(twist, twist)), 1e-300)
            share = float(np.clip(np.dot(done, twist) / size, 0.0, 1.0))
            if share < SLOWED:
                words = "the arm is near a singularity, where it cannot move in this direction"
                reason = Reason(words, ReasonCode.SINGULARITY)
        else:
            raise InputError("a jog frame must have either joints or a twist")
        fast = self._too_fast(velocity, jacobian)
        return LimitedVelocity(velocity * fast, fast, share * fast, reason)

    def of_twist(self, twist: Array, position: Array) -> Array:
        """Calculate the joint velocities for a twist in the base frame, within the speed limits, shape
        (dof,).
        """
        _, _, jacobian = self._robot.model.forward_and_jacobian(position)
        velocity = damped(jacobian, twist)
        return velocity * self._too_fast(velocity, jacobian)

    def _too_fast(self, velocity: Array, jacobian: Array) -> float:
        """Return the share of a velocity that is within the speed limits."""
        fastest = np.minimum(JOINT_SHARE * self._robot.limits.max_velocity, self._rates.max_velocity)
        of_joints = (np.abs(velocity) / fastest).max()
        of_tcp = np.linalg.norm(jacobian[:3] @ velocity) / TCP_M_S
        return float(1.0 / np.max([1.0, of_joints, of_tcp]))

    def gentle_share(self, acceleration: Array) -> float:
        """Return the share of a joint acceleration that is within the limits."""
        return float(1.0 / max(1.0, (np.abs(acceleration) / self._rates.max_acceleration).max()))

    def share(self, position: Array, velocity: Array) -> tuple[float, Reason]:
        """Return the share of a velocity that is safe at this position, 0 to 1, and the reason for a share
        below 1 ("" for 1).
        """
        share, reason = self._of_limits(position, velocity)
        near, why = self.of_obstacles(position, velocity)
        if near < share:
            share, reason = near, why
        return (share, reason) if share < SLOWED else (1.0, UNLIMITED)

    def _of_limits(self, position: Array, velocity: Array) -> tuple[float, Reason]:
        limits = self._robot.limits
        room = np.where(velocity > 0.0, limits.max_position - position, position - limits.min_position)
        allowed = allowed_speed(room - JOINT_ROOM, self._rates.max_acceleration)
        speed = np.abs(velocity)
        shares = np.where(speed > allowed, allowed / np.maximum(speed, 1e-9), 1.0)
        joint = int(shares.argmin())
        ends = limits.max_position if velocity[joint] > 0.0 else limits.min_position
        unit, name = limits.unit(joint), limits.names[joint]
        value, limit = float(position[joint]), float(ends[joint])
        words = f"{name} is at {value:.2f} {unit}, near its limit of {limit:.2f} {unit}"
        return float(shares[joint]), Reason(words, ReasonCode.JOINT_LIMIT, (name,), value, limit, unit)

    def of_obstacles(self, position: Array, velocity: Array) -> tuple[float, Reason]:
        """Return the share of a velocity that is safe with respect to obstacles, and the reason if it is
        below 1.
        """
        here, closing = self._approach(position, velocity, FAR_M)
        room = here - self._robot.collision.margin_m - OBSTACLE_ROOM_M
        slowing = (self._rates.max_acceleration / np.maximum(np.abs(velocity), 1e-9)).min()
        allowed = allowed_speed(room, slowing * np.maximum(closing, APPROACH_M_S))
        counts = (closing > APPROACH_M_S) & (closing > allowed)
        if not counts.any():
            return 1.0, UNLIMITED
        shares = np.where(counts, allowed / np.maximum(closing, 1e-9), 1.0)
        pair = int(shares.argmin())
        return float(shares[pair]), self._distance(pair, here)

    def nearest(self, position: Array, velocity: Array, within_m: float) -> Reason:
        """Describe the nearest pair of parts that approach each other, with their distance; "" if no such
        pair is within the given distance.
        """
        here, closing = self._approach(position, velocity, within_m)
        distances = np.where(closing > APPROACH_M_S, here, np.inf)
        if not (distances < within_m).any():
            return UNLIMITED
        return self._distance(int(distances.argmin()), here)

    def _approach(self, position: Array, velocity: Array, farthest_m: float) -> tuple[Array, Array]:
        """Return the distance (m) of each pair, and the speed (m/s) at which it decreases."""
        rows = np.stack([position, position + LOOK_S * velocity])
        here, there = self._robot.collision.clearance.distances(rows, farthest_m)
        return here, (here - there) / LOOK_S

    def _distance(self, pair: int, here: Array) -> Reason:
        first, second = self._robot.collision.names(pair)
        words = f"{first} and {second} are {1e3 * here[pair]:.0f} mm from each other"
        return Reason(words, ReasonCode.NEAR_OBSTACLE, (first, second), float(here[pair]), unit="m")


def allowed_speed(room: Array, deceleration: Array) -> Array:
    """Return the maximum speed at which parts may approach each other when they are `room` apart, m or rad;
    see `RATE_PER_S`.

    An approach at this speed never needs more than `deceleration`, in the same unit per s².
    """
    left = np.maximum(room, 0.0)
    far = 2.0 * deceleration * left - (deceleration / RATE_PER_S) ** 2
    return np.where(RATE_PER_S**2 * left <= deceleration, RATE_PER_S * left, np.sqrt(np.maximum(far, 0.0)))


def damped(jacobian: Array, twist: Array) -> Array:
    """Return the smallest joint velocities that produce a twist, shape (dof,). They are damped near a
    singularity, where they would otherwise grow without bound.

    Args:
        jacobian: shape (6, dof).
        twist: shape (6,).
    """
    left, sizes, right = np.linalg.svd(jacobian, full_matrices=False)
    lacking = np.maximum(0.0, 1.0 - (sizes / SINGULAR) ** 2) * SINGULAR**2
    return np.asarray(right.T @ ((sizes / (sizes**2 + lacking)) * (left.T @ twist)))
