"""The line along which a jog moves the TCP, and the rotation about an axis.

With joint velocities alone, the TCP would leave its line, because the Jacobian changes along the way. So the
pose on the line is tracked, and deviations from it are corrected. When a jog ends, rtloop stops each joint
separately, as quickly as possible, so the TCP leaves the line by up to 3 mm and 0.7° at 0.1 m/s. The next jog
corrects this deviation, so that the deviations of many jogs do not add up.
"""

from __future__ import annotations

import numpy as np

from cobot.pose import Pose
from cobot.robot import quaternion
from cobot.robot.model import RobotModel
from cobot.types import Array

CORRECTION_PER_S = 10.0
"""Gain for returning the TCP to its line, 1/s."""
MOVED_RAD = 1e-3
"""Maximum distance of a joint from the last target, rad or m. If it is larger, something else has moved the
arm.
"""
FAR_M, FAR_RAD = 0.01, 0.05
"""Maximum deviation from the line after a jog that the next jog corrects, m and rad. Larger deviations are
not corrected, because the jog must move as expected.
"""
MAX_CORRECTION = 0.5
"""Maximum velocity of the correction, as a share of the velocity along the line."""


class JogLine:
    """The line along which the TCP moves, from the pose at which its motion began.

    Attributes:
        twist: velocity along the line, shape (6,), in the base frame, m/s and rad/s.
    """

    def __init__(self, model: RobotModel, position: Array, velocity: Array) -> None:
        """Begin the line at these joint positions and velocities, shape (dof,)."""
        self._model = model
        self._pose = model.forward(position)
        _, _, jacobian = model.forward_and_jacobian(position)
        self.twist: Array = jacobian @ velocity
        self._rest: Array = position

    def in_base(self, twist: Array) -> Array:
        """Convert a twist from the tool's axes, at the current point of the line, to the base's axes."""
        rotation = self._pose.rotation
        return np.concatenate([rotation @ twist[:3], rotation @ twist[3:]])

    def corrected(self, position: Array) -> Array:
        """Return the twist that keeps the TCP on the line, or that brings it back if it has left the line.
        Shape: (6,).
        """
        moved, turned = self._deviation(self._model.forward(position))
        correction = -CORRECTION_PER_S * np.concatenate([moved, turned])
        size = float(np.linalg.norm(correction))
        most = MAX_CORRECTION * float(np.linalg.norm(self.twist))
        return np.asarray(self.twist + correction * min(1.0, most / max(size, 1e-12)))

    def advance(self, position: Array, velocity: Array, step_s: float) -> None:
        """Advance along the line by the distance that these joint velocities move the TCP."""
        _, _, jacobian = self._model.forward_and_jacobian(position)
        size = max(float(self.twist @ self.twist), 1e-300)
        share = float(np.clip((jacobian @ velocity) @ self.twist / size, 0.0, 1.0))
        way = share * step_s * self.twist
        self._pose = _shifted(self._pose, way[:3], way[3:])

    def rest(self, position: Array) -> None:
        """Record that the arm has stopped at these joint positions. The line continues from there. The
        deviation caused by the stop is corrected later, unless it is large.
        """
        pose = self._model.forward(position)
        moved, turned = self._deviation(pose)
        far = np.linalg.norm(moved) > FAR_M or np.linalg.norm(turned) > FAR_RAD
        self._pose = pose if far else _shifted(pose, -moved, -turned)
        self.twist, self._rest = np.zeros(6), position.copy()

    def rests_at(self, position: Array) -> bool:
        """Return whether the arm is still at the position where it stopped."""
        return bool(np.abs(position - self._rest).max() < MOVED_RAD)

    def _deviation(self, pose: Pose) -> tuple[Array, Array]:
        """Return how far a pose is from the line: the displacement across the line (m) and a rotation vector
        (rad). Both are in the base frame.
        """
        turned = quaternion.between(self._pose.quaternion.tolist(), pose.quaternion.tolist())
        return (
            _across(pose.position - self._pose.position, self.twist[:3]),
            _across(np.array(turned, float), self.twist[3:]),
        )


def _shifted(pose: Pose, way: Array, turn: Array) -> Pose:
    """Return the pose, moved by a displacement and rotated by a rotation vector, both in the base frame."""
    turned = quaternion.product(quaternion.exp(turn.tolist()), pose.quaternion.tolist())
    return Pose(pose.position + way, np.array(turned, float))


def _across(vector: Array, direction: Array) -> Array:
    """Return the component of a vector that is perpendicular to a direction; the whole vector if the
    direction is zero.
    """
    size = float(direction @ direction)
    return np.asarray(vector - (vector @ direction) / size * direction if size > 0.0 else vector)
