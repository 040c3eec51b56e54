"""The connection to a gripper: Modbus RTU, or the text protocol of the URCap."""

from __future__ import annotations

from typing import Protocol

from cobot.grippers.modbus import Master
from cobot.grippers.robotiq.registers import COUNT, REQUEST, STATUS, Request, RobotiqStatus


class GripperLink(Protocol):
    """Interface of a connection. Each method raises a GripperError if there is no answer or the answer is
    wrong.
    """

    def open(self) -> None:
        """Connect. An open connection is closed and opened again."""
        ...

    def close(self) -> None: ...

    def status(self) -> RobotiqStatus:
        """Read the status of the gripper."""
        ...

    def request(self) -> Request:
        """Read the last request that the gripper has received."""
        ...

    def send(self, request: Request) -> None: ...


class ModbusLink:
    """A connection that reads and writes registers over Modbus RTU."""

    def __init__(self, master: Master) -> None:
        self.open, self.close, self._master = master.open, master.close, master

    def status(self) -> RobotiqStatus:
        return RobotiqStatus.of(self._master.read(STATUS, COUNT))

    def request(self) -> Request:
        return Request.of(self._master.read(REQUEST, COUNT))

    def send(self, request: Request) -> None:
        self._master.write(REQUEST, request.words)
