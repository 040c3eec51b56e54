"""The text protocol of Robotiq's URCap, on TCP port 63352 of the robot's controller.

A client sends lines, `SET POS 255 SPE 128` or `GET POS`. The answer to SET is `ack`. The answer to GET is the
name and the value, such as `POS 3`. The answer to anything else is `?`. Some controllers end answers with a
newline, others do not.

Source: the URCap's manual, chapter on the gripper socket.
"""

from __future__ import annotations

import re
import select
import socket
from collections.abc import Callable
from typing import Any

from cobot.grippers.protocol import GripperError
from cobot.grippers.robotiq.registers import Activation, Detection, Request, RobotiqStatus

PORT = 63352
ACK, UNKNOWN = "ack", "?"
QUIET_S = 0.02
"""Time without data after which a value without a newline is considered complete, s."""
MAX_ANSWER = 64
_VALUE = re.compile(r"([A-Z]{3}) (\d{1,3})")


class UrcapLink:
    """A client of this protocol.

    Args:
        device: HOST or HOST:PORT.
        timeout_s: timeout for each answer.
        connect: creates a connection that tests use instead of TCP.
    """

    def __init__(self, device: str, timeout_s: float, connect: Callable[[], Any] | None = None) -> None:
        host, _, port = device.partition(":")
        self._address = host, int(port or PORT)
        self._timeout_s = timeout_s
        self._connect = connect or self._dial
        self._socket: Any = None

    def open(self) -> None:
        """See `GripperLink`. On a new connection, no late answers can arrive."""
        self.close()
        try:
            self._socket = self._connect()
        except OSError as exc:
            raise self._error(f"cannot be reached: {exc}; check its address and its Robotiq URCap") from exc

    def _dial(self) -> socket.socket:
        made = socket.create_connection(self._address, self._timeout_s)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return made

    def close(self) -> None:
        """See `GripperLink`."""
        connection, self._socket = self._socket, None
        if connection is not None:
            connection.close()

    def status(self) -> RobotiqStatus:
        """See `GripperLink`. Sends one line for each value, because the protocol has no request for all
        values together.
        """
        stage = self._get("STA", 3)
        return RobotiqStatus(
            stage != Activation.RESET,
            bool(self._get("GTO", 1)),
            Activation(stage),
            Detection(self._get("OBJ", 3)),
            self._get("FLT") & 0x0F,
            self._get("PRE"),
            self._get("POS"),
            0.0,
        )

    def request(self) -> Request:
        """See `GripperLink`."""
        bits = bool(self._get("ACT", 1)), bool(self._get("GTO", 1))
        return Request(*bits, self._get("PRE"), self._get("SPE"), self._get("FOR"))

    def send(self, request: Request) -> None:
        """See `GripperLink`."""
        values = f"POS {request.position} SPE {request.speed} FOR {request.force} GTO {request.go:d}"
        asked = f"SET ACT {request.activate:d} {values if request.activate else 'ATR 0 GTO 0'}"
        answer = self._ask(asked)
        if answer != ACK:
            raise self._error(f"answers {answer!r} to {asked!r}, expected {ACK!r}")

    def _get(self, name: str, most: int = 255) -> int:
        answer = self._ask(f"GET {name}")
        found = _VALUE.fullmatch(answer)
        if found is None or found[1] != name or int(found[2]) > most:
            raise self._error(f"answers {answer!r} to 'GET {name}', expected a value from 0 to {most}")
        return int(found[2])

    def _ask(self, line: str) -> str:
        connection = self._socket
        if connection is None:
            raise self._error("is not connected")
        answer = b""
        try:
            connection.sendall(f"{line}\n".encode())
            while not self._is_whole(answer):
                got = connection.recv(MAX_ANSWER)
                if not got:
                    raise self._error("has ended the connection")
                answer = (answer + got).lstrip()  # the newline after an `ack` may arrive late
        except TimeoutError as exc:
            raise self._error(f"has not answered {line!r} within {self._timeout_s:g} s") from exc
        except OSError as exc:
            raise self._error(f"has lost its connection: {exc}") from exc
        return answer.decode("ascii", "replace").strip()

    def _is_whole(self, answer: bytes) -> bool:
        text = answer.decode("ascii", "replace")
        if text.endswith("\n") or text in (ACK, UNKNOWN) or len(answer) >= MAX_ANSWER:
            return True
        if not _VALUE.fullmatch(text):
            return False
        return not select.select([self._socket], [], [], QUIET_S)[0]

    def _error(self, what: str) -> GripperError:
        host, port = self._address
        return GripperError(f"{host}:{port}: the gripper's URCap {what}")
