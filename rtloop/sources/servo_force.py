"""Modes 6 and 7: a servo mode's motion, with force control along the force axes."""

from __future__ import annotations

from typing import cast

import numpy as np

from cobot.ipc.layout import Interpolation, Intervention
from cobot.robot.model import RobotModel
from cobot.types import Array, CartesianLimits, JointLimits
from rtloop.backends import Measured
from rtloop.generators.pose_interpolation import PoseInterpolator
from rtloop.generators.pose_limiter import PoseLimiter
from rtloop.inboxes.point_queue import PointQueue
from rtloop.sources.cartesian import CartesianSource
from rtloop.sources.servo_base import ServoSource


class ForceServo(CartesianSource):
    """Follows the pose of a joint source's reference, and in the null space its posture.

    Where no force turns it aside, the arm's joints are those of the source.
    """

    def __init__(
        self,
        points: ServoSource,
        model: RobotModel,
        limits: JointLimits,
        within: CartesianLimits,
        period_s: float,
        wish: np.ndarray,
    ) -> None:
        super().__init__(Interpolation.NONE, model, limits, within, period_s, period_s, wish)
        self._points = points
        self._pose_of = _PoseOf(points, model)
        self._interpolator = cast(PoseInterpolator, self._pose_of)
        self._limiter = cast(PoseLimiter, self._pose_of)  # the joints' limits are the source's
        self._before_points = np.zeros(limits.dof)

    @property
    def taken(self) -> int:
        return self._points.taken

    @property
    def dropped(self) -> int:
        return self._points.dropped

    @property
    def underruns(self) -> int:
        return self._points.underruns

    @property
    def buffered(self) -> int:
        return self._points.buffered

    def begin(self, command: Array) -> None:
        self._points.begin(command)
        np.copyto(self._before_points, command[0])
        super().begin(command)

    def fetch(self, queue: PointQueue) -> Intervention | None:
        flaw = self._points.fetch(queue)
        self.refusal = self._points.refusal
        return flaw

    def press(self, wrench: Array) -> None:
        """Exert this from now on, in the force frame; what is not finite is not taken."""
        if np.isfinite(wrench).all():
            np.copyto(self._wrench, wrench)

    def advance(self, measured: Measured) -> None:
        self._pose_of.measured = measured
        super().advance(measured)

    def _pull_at_posture(self, joints: Array) -> Array:
        """The source's own step: what of it moves the TCP is taken out again where it is not wanted."""
        here = self._points.reference[0]
        step: Array = here - self._before_points
        np.copyto(self._before_points, here)
        np.copyto(self._posture, here)
        step += super()._pull_at_posture(joints)
        return step


class _PoseOf:
    """Where a joint source's reference puts the TCP: an interpolator and a limiter for `CartesianSource`.

    Attributes:
        pose: x, y, z, w, x, y, z.
        measured: in this cycle; the owner sets it.
    """

    def __init__(self, points: ServoSource, model: RobotModel) -> None:
        self._points = points
        self._model = model
        self.pose = np.zeros(7)
        self.measured: Measured | None = None

    def begin(self, pose: Array, twist: Array | None = None) -> None:
        np.copyto(self.pose, pose)

    def step(self, pose: Array) -> None:
        """Nothing is limited."""

    def advance(self) -> None:
        assert self.measured is not None
        self._points.advance(self.measured)
        self._model.forward_into(self._points.reference[0], self.pose)
