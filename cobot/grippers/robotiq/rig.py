"""The simulated Robotiq gripper for the contract: its frames pass through memory, and it counts time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cobot.grippers.protocol import IoPort
from cobot.grippers.robotiq.slave import Fingers, Slave

if TYPE_CHECKING:
    from cobot.grippers.robotiq.driver import RobotiqGripper, RobotiqOptions

TOO_HOT = 0x08


class SlaveLine:
    """A serial line to a slave, with the methods of pyserial that a master uses."""

    def __init__(self, slave: Slave) -> None:
        self._slave = slave
        self._answer = b""

    def reset_input_buffer(self) -> None:
        self._answer = b""

    def write(self, data: bytes) -> None:
        self._answer += self._slave.feed(data)

    def read(self, count: int) -> bytes:
        found, self._answer = self._answer[:count], self._answer[count:]
        return found

    def close(self) -> None: ...


class RobotiqRig:
    """See `cobot.grippers.contract.suite.GripperRig`."""

    faults = frozenset({"disconnect", "fault"})

    def __init__(self, options: RobotiqOptions) -> None:
        self._options = options
        self._time_s = 0.0
        self._fingers = Fingers(options.model, lambda: self._time_s)
        self._slave = Slave(self._fingers, options.unit)

    def now_s(self) -> float:
        return self._time_s

    def gripper(self, port: IoPort) -> RobotiqGripper:
        """A new driver at the same device."""
        from cobot.grippers.robotiq.driver import RobotiqGripper

        return RobotiqGripper(self._options, port, self, lambda: SlaveLine(self._slave))

    def step(self, duration_s: float) -> None:
        """Have the device's time go on."""
        self._time_s += duration_s
        self._fingers.advance()

    def place(self, width_m: float | None) -> None:
        """Put an object between the fingers, or take it away."""
        self._fingers.object_m = width_m

    def inject(self, fault: str) -> None:
        """A fault begins, and lasts."""
        self._slave.silent = fault == "disconnect"
        self._fingers.fault = TOO_HOT if fault == "fault" else 0

    def clear(self, fault: str) -> None:
        """Its cause is gone."""
        self._slave.silent, self._fingers.fault = False, 0
