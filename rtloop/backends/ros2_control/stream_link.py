"""The link for streaming: datagrams between the cycle and the process that speaks DDS."""

from __future__ import annotations

import contextlib
import socket
import time
from typing import Any

import numpy as np

from cobot.types import Array
from rtloop.backends.ros2_control.link import ClientProcess

BUFFER_BYTES = 1 << 16


class StreamProcess(ClientProcess):
    """A `StreamLink` that uses the process that speaks DDS."""

    threaded = True

    def __init__(self, settings: dict[str, Any], dof: int) -> None:
        super().__init__(settings)
        self._dof = dof
        self._socket: socket.socket | None = None
        self._values = np.full(1 + 3 * dof, np.nan)
        self._values[0] = -np.inf
        self._into = np.zeros_like(self._values)

    def open(self) -> None:
        if self._runs:
            return
        self.close()
        own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        with other:
            own.setblocking(False)
            own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
            self._socket = own
            self._begin({**self._settings, "stream": other.fileno()}, (other.fileno(),))

    def close(self) -> None:
        super().close()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def latest(self, rows: Array) -> float:
        connection = self._socket
        if connection is not None:
            with contextlib.suppress(OSError):  # no more datagrams have arrived
                while connection.recv_into(self._into.data) == self._into.nbytes:
                    self._values, self._into = self._into, self._values
        rows[:] = self._values[1:].reshape(3, self._dof)
        return time.monotonic() - float(self._values[0])

    def command(self, position: Array) -> None:
        connection = self._socket
        if connection is not None:
            # its buffer is full or it has ended; the cycle detects its silence
            with contextlib.suppress(OSError):
                connection.send(np.ascontiguousarray(position).data)
