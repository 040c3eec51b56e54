"""The simulated Robotiq gripper for the contract. Frames are passed in memory, and the clock is simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cobot.grippers.protocol import IoPort
from cobot.grippers.robotiq.slave import Fingers, Slave
from cobot.grippers.robotiq.text_slave import TextSlave

if TYPE_CHECKING:
    from cobot.grippers.robotiq.driver import RobotiqGripper, RobotiqOptions

TOO_HOT = 0x08


class SlaveLine:
    """A serial line to a slave. It provides the methods of pyserial that a master uses."""

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


class TextLine:
    """A connection to the text protocol of a slave. It provides the methods of a socket that a client
    uses.
    """

    def __init__(self, slave: Slave) -> None:
        self._slave = TextSlave(slave)
        self._answer = b""

    def sendall(self, data: bytes) -> None:
        self._answer += self._slave.feed(data)

    def recv(self, count: int) -> bytes:
        if not self._answer:
            raise TimeoutError
        found, self._answer = self._answer[:count], self._answer[count:]
        return found

    def close(self) -> None: ...


class RobotiqRig:
    """A simulated gripper, see `cobot.grippers.contract.suite.GripperRig`.

    Attributes:
        fingers: fingers of the device.
    """

    faults = frozenset({"disconnect", "fault"})

    def __init__(self, options: RobotiqOptions) -> None:
        self._options = options
        self._time_s = 0.0
        self.fingers = Fingers(options.model, lambda: self._time_s)
        self._slave = Slave(self.fingers, options.unit)

    def now_s(self) -> float:
        return self._time_s

    def gripper(self, port: IoPort) -> RobotiqGripper:
        """Create one more driver for the same device."""
        from cobot.grippers.robotiq.driver import RobotiqGripper

        line = SlaveLine if self._options.protocol == "rtu" else TextLine
        return RobotiqGripper(self._options, port, self, lambda: line(self._slave))

    def step(self, duration_s: float) -> None:
        """Advance the device's clock."""
        self._time_s += duration_s
        self.fingers.advance()

    def place(self, width_m: float | None) -> None:
        """Put an object between the fingers, or remove it."""
        self.fingers.object_m = width_m

    def inject(self, fault: str) -> None:
        """Start a fault, which lasts until `clear`."""
        self._slave.silent = fault == "disconnect"
        self.fingers.fault = TOO_HOT if fault == "fault" else 0

    def clear(self, fault: str) -> None:
        """End a fault."""
        self._slave.silent, self.fingers.fault = False, 0
