"""The last thing before a command is written: the same code in every mode and for every backend."""

import numpy as np

from cobot.types import Array, JointLimits
from rtloop.generators.target_range import TargetRange

POSITION_TOLERANCE_RAD: float

class Safety:
    """Guards one arm's commands. Real-time safe.

    Attributes:
        command: the command let through last, shape (3, dof): rad, rad/s, rad/s².
        position, velocity, acceleration: its rows.
        motion: what the arm really does, which the command's rates may misstate, shape (3, dof).
        interventions: how often each kind of excess was caught, shape (len(Intervention),).
        intervened_ns: when the last one of each kind was, in the same order.
        counted: their sum.
        now_ns: the cycle's time; the caller sets it.
        pursuing: whether the output is not the request but follows it.
    """

    now_ns: int

    @property
    def command(self) -> Array: ...
    @property
    def position(self) -> Array: ...
    @property
    def velocity(self) -> Array: ...
    @property
    def acceleration(self) -> Array: ...
    @property
    def motion(self) -> Array: ...
    @property
    def interventions(self) -> np.ndarray: ...
    @property
    def intervened_ns(self) -> np.ndarray: ...
    @property
    def pursuing(self) -> bool: ...
    @property
    def counted(self) -> int: ...
    def __init__(self, limits: JointLimits, period_s: float) -> None:
        """
        Raises:
            InputError: too many joints.
        """
    def use(self, limits: JointLimits, share: float = 1.0, catch_up: float = ...) -> None:
        """Catch what exceeds these rates, from now on; the joint positions' limits stay.

        Args:
            share: of the velocities.
            catch_up: how much faster than a moving request a pursuit of it may be, rad/s.
        """
    def slow_down(self, share: float) -> None:
        """Permit only a share of the velocities; a faster arm is slowed down within the other limits."""
    def stay_within(self, targets: TargetRange | None) -> None:
        """Let no streamed joint go where it could stop only beyond these bounds. None: no such bounds."""
    def reset(self, position: Array) -> None:
        """Start over at rest at a position, without a jump: the arm has to be there.

        A position beyond the limits, where it was pushed, is held, and left only towards them.
        """
    def apply(self, request: Array, *, streamed: bool = False) -> bool:
        """Let a command through, or the nearest that is safe; the result is in `command`.

        Args:
            request: shape (3, dof): rad, rad/s, rad/s².
            streamed: whether it comes from a stream, whose next target is unknown.

        Returns:
            False when the request is not finite: the caller has to latch an e-stop.
        """
    def brake(self) -> bool:
        """Come to rest from wherever the arm is, each joint for itself, as fast as the limits permit.

        Returns:
            Whether it is at rest.
        """
    def count(self, kind: int) -> None:
        """One more intervention."""
