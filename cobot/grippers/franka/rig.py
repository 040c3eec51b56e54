"""A simulated Franka Hand for the contract. It uses a simulated clock instead of waiting."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cobot.grippers.franka.link import CallResult, HandReading
from cobot.grippers.protocol import GripperError, IoPort

if TYPE_CHECKING:
    from cobot.grippers.franka.driver import FrankaHand, FrankaHandOptions


class FrankaHandRig:
    """A simulated hand, see `cobot.grippers.contract.suite.GripperRig`. It is also the connection to the
    hand.

    Attributes:
        width: width between the fingers, m.
        object_m: width of the object between the fingers; None for no object.
    """

    faults = frozenset({"disconnect"})

    def __init__(self, options: FrankaHandOptions) -> None:
        self._options = options
        self._most = self.width = options.max_width
        self.object_m: float | None = None
        self._silent = False
        self._goal: tuple[float, float] | None = None
        self._grasp: tuple[float, float] | None = None
        self._result: CallResult | None = None
        self._is_grasped = False

    def gripper(self, port: IoPort) -> FrankaHand:
        """Create one more driver for the same hand."""
        from cobot.grippers.franka.driver import FrankaHand

        return FrankaHand(self._options, port, lambda: self)

    def step(self, duration_s: float) -> None:
        """Advance the clock."""
        if self._is_grasped and self.object_m is None:
            self._is_grasped = False
        if self._goal is None:
            return
        target, speed = self._goal
        if self.object_m is not None and self.width >= self.object_m:
            target = max(target, self.object_m)
        way, step = target - self.width, speed * duration_s
        self.width = target if abs(way) <= step else self.width + (step if way > 0.0 else -step)
        if self.width == target:
            good = self._grasp is None or self._grasp[0] <= self.width <= self._grasp[1]
            self._is_grasped = self._grasp is not None and good and self.object_m is not None
            self._goal, self._result = None, CallResult(good)

    def place(self, width_m: float | None) -> None:
        """Put an object between the fingers, or remove it."""
        self.object_m = width_m

    def inject(self, fault: str) -> None:
        """Start a fault, which lasts until `clear`."""
        self._silent = True

    def clear(self, fault: str) -> None:
        """End a fault."""
        self._silent = False

    def open(self) -> None:
        """See `HandLink`. The same applies to the methods below."""
        self._require()

    def close(self) -> None: ...

    def read(self) -> HandReading:
        self._require()
        return HandReading(self.width, self._most, self._is_grasped, 20.0)

    def begin(self, call: str, *arguments: float) -> None:
        self._require()
        if call == "homing":
            arguments = (self._most, 0.1)
        width, speed, *_ = arguments
        self._grasp = None
        if call == "grasp":
            _, _, _, inner, outer = arguments
            self._grasp = width - inner, width + outer
        self._goal, self._result, self._is_grasped = (width, speed), None, False

    def result(self) -> CallResult | None:
        self._require()
        return self._result

    def abort(self) -> None:
        self._require()
        self._goal, self._result = None, CallResult(good=False)

    def _require(self) -> None:
        if self._silent:
            raise GripperError("the hand does not answer")
