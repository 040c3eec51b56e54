"""A simulated controller of Universal Robots and the backend in one process, as the tests drive them."""

from __future__ import annotations

from collections import deque

import numpy as np

from rtloop.backends.ur import UrBackend
from rtloop.backends.ur.simulator.lockstep import UrLockStep
from rtloop.backends.ur.transport import ByteStream


def hold(backend: UrBackend, way: UrLockStep, cycles: int) -> None:
    """Cycles in which the arm is commanded to where the controller holds it."""
    command = np.zeros((3, 6))
    for _ in range(cycles):
        backend.wait(0.1)
        command[0] = way.controller.arm.setpoint
        backend.write(command)


class LateCommands:
    """Commands that cobot's program receives late, in their order. It replaces `way.call_back`.

    Attributes:
        periods: delay of the next command, in control periods.
    """

    def __init__(self, way: UrLockStep) -> None:
        self.periods = 0
        self._way, self._call_back = way, way.call_back
        way.call_back = self.call_back  # type: ignore[method-assign]

    def call_back(self) -> ByteStream:
        return _LateStream(self._call_back(), self, self._way)


class _LateStream:
    def __init__(self, stream: ByteStream, late: LateCommands, way: UrLockStep) -> None:
        self._stream, self._late, self._way = stream, late, way
        self._held: deque[tuple[int, bytes]] = deque()
        self.local, self.is_connected = stream.local, stream.is_connected
        self.send, self.close, self.abort = stream.send, stream.close, stream.abort

    def receive(self) -> bytes:
        data, now = self._stream.receive(), self._way.controller.steps
        if data:
            self._held.append((now + self._late.periods, data))
        return b"" if not self._held or self._held[0][0] > now else self._held.popleft()[1]
