"""A simulated ROS 2 driver for the contract: its action and its joint. It uses no network, and its clock is
simulated.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cobot.grippers.protocol import Gripper, IoPort
from cobot.grippers.ros.link import DriverState

if TYPE_CHECKING:
    from cobot.grippers.ros.driver import RosOptions

SPEED_M_S = 0.1
SUCCEEDED, CANCELED = 4, 5


class RosRig:
    """A simulated ROS 2 driver, see `cobot.grippers.contract.suite.GripperRig`. It is also the link for its
    drivers.
    """

    faults = frozenset({"disconnect"})

    def __init__(self, options: RosOptions) -> None:
        self._options = options
        self._seconds = 10.0
        self._width_m = self._target_m = options.open_width
        self._runs = self._gone = False
        self._object_m: float | None = None
        self._last: dict[str, Any] | None = None
        self.heard = DriverState()

    def now_s(self) -> float:
        return self._seconds

    def gripper(self, port: IoPort) -> Gripper:
        """Create one more driver for the same action."""
        from cobot.grippers.ros.driver import RosGripper

        return RosGripper(self._options, port, self, self)

    def open(self) -> None:
        """See `ActionLink`. The same applies to `close`, `send` and `cancel`."""
        self.heard.earlier = None if self._runs else self._last
        self._tell()

    def close(self) -> None: ...

    def send(self, goal: dict[str, Any]) -> None:
        options, command = self._options, goal["command"]
        number = self.heard.begin(self._seconds)
        position = command["position"]
        share = (position if isinstance(position, float) else position[0]) - options.closed_position
        self._target_m = share / (options.open_position - options.closed_position) * options.open_width
        self._runs = True
        self._hear(what="answer", number=number, accepted=True)

    def cancel(self) -> None:
        if self._runs:
            self._target_m = self._width_m
            self._end(CANCELED, stalled=False)

    def step(self, duration_s: float) -> None:
        """Advance the clock."""
        self._seconds += duration_s
        target_m = self._target_m
        if self._object_m is not None and self._width_m >= self._object_m:
            target_m = max(target_m, self._object_m)
        way_m, step_m = target_m - self._width_m, SPEED_M_S * duration_s
        self._width_m = (
            target_m if abs(way_m) <= step_m else self._width_m + (step_m if way_m > 0 else -step_m)
        )
        if self._runs and self._width_m == target_m:
            self._end(SUCCEEDED, stalled=target_m != self._target_m)
        self._tell()

    def place(self, width_m: float | None) -> None:
        """Put an object between the fingers, or remove it."""
        self._object_m = width_m

    def inject(self, fault: str) -> None:
        """Make the ROS 2 driver unavailable until `clear`."""
        self._gone, self.heard.ready = True, False

    def clear(self, fault: str) -> None:
        """Make the ROS 2 driver available again."""
        self._gone = False

    def _end(self, status: int, *, stalled: bool) -> None:
        self._runs, self._last = False, {"stalled": stalled, "reached_goal": not stalled}
        self._hear(what="result", number=self.heard.goal.number, status=status, values=self._last)

    def _tell(self) -> None:
        options = self._options
        way = options.open_position - options.closed_position
        self._hear(what="ready", ready=True)
        position = options.closed_position + way * self._width_m / options.open_width
        self._hear(what="joint", position=position, effort=None)

    def _hear(self, **content: Any) -> None:
        if not self._gone:
            self.heard.take(content, self._seconds)
