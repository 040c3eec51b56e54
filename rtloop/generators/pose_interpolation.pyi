"""Poses between streamed poses, and the slow move to a single one: see pose_interpolation.pyx.

A pose is shape (7,): x, y, z in m and a quaternion (w, x, y, z); a twist is shape (6,): linear and angular
velocity, m/s and rad/s; both in the base frame.
"""

import numpy.typing as npt

from cobot.ipc.layout import Interpolation
from cobot.types import Array

class PoseInterpolator:
    """An `Interpolator` of poses. Real-time safe.

    Attributes:
        pose: of this cycle. The quaternion's sign does not jump.
    """

    pose: Array

    def __init__(
        self,
        kind: Interpolation,
        period_s: float,
        max_linear_velocity: float,
        max_linear_acceleration: float,
        max_linear_jerk: float,
        max_angular_velocity: float,
        max_angular_acceleration: float,
        max_angular_jerk: float,
    ) -> None: ...
    def begin(self, pose: Array, twist: npt.ArrayLike = 0.0, acceleration: npt.ArrayLike = 0.0) -> None:
        """Start here, forget all commands, and hold (what moves is brought to rest)."""

    def aim(self, pose: Array, twist: Array | None, duration_s: float) -> None:
        """A new command, to be reached `duration_s` from now: one command period.

        Args:
            twist: at the pose, as the sender states it; None: estimated where it is needed.
        """

    def advance(self) -> None:
        """One period on."""

    @property
    def twist(self) -> Array:
        """The twist of this cycle, a copy, shape (6,): m/s and rad/s."""

    @property
    def acceleration(self) -> Array:
        """The acceleration of this cycle, a copy, shape (6,): m/s² and rad/s². The angular part lacks terms
        of second order in the turn since the newest command."""

class MinJerkMove:
    """From rest to rest along a straight line and about a fixed axis, the shorter way. Real-time safe.

    Attributes:
        pose, twist: of this cycle.
        acceleration: of this cycle, shape (6,), m/s² and rad/s².
        done: whether the pose is the goal.
    """

    pose: Array
    twist: Array
    acceleration: Array
    done: bool

    def __init__(self, start: Array, goal: Array, duration_s: float, period_s: float) -> None:
        """A move that lasts a millisecond or more; any quaternion but zero will do."""

    def advance(self) -> None:
        """One period on."""
