"""FANUC's Remote Motion Interface: JSON objects, one per line, over TCP.

A client connects to the well-known port, receives the number of a second port, and has its session there.
Only one request at a time is pending. Other lines that the controller sends before the reply are skipped. The
requests are defined in the manual B-84184EN and in `rmi/packets.hpp`, which FANUC publishes.
"""

from __future__ import annotations

import contextlib
import json
import math
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from cobot.foreign import joined_text
from rtloop.backends import BackendError
from rtloop.backends.fanuc.joints import from_horizon
from rtloop.backends.fanuc.messages import AXES
from rtloop.backends.fanuc.words import alarms_in_words, error_in_words

MAX_LINE = 65_536
MAX_SKIPPED = 100
"""Maximum number of other lines that are skipped before a request fails."""
REPLY_S = 2.0
KINDS = ("Command", "Instruction", "Communication")
SHOWN = 80
ALARMS = 5


def number_of(value: object) -> float:
    """Convert a value in a reply to a number. Anything else becomes NaN."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


class RmiLines(Protocol):
    """Sends and receives single lines."""

    def send(self, line: bytes) -> None: ...

    def receive(self, timeout_s: float) -> bytes:
        """Receive the next line, without its line ending.

        Raises:
            OSError: no line arrives in time, or the connection is closed.
        """
        ...

    def close(self) -> None: ...


class TcpLines:
    """`RmiLines` over TCP."""

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        """Connect. Raises OSError if the controller does not answer."""
        self._socket = socket.create_connection((host, port), timeout_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._rest = b""

    def send(self, line: bytes) -> None:
        self._socket.settimeout(REPLY_S)
        self._socket.sendall(line)

    def receive(self, timeout_s: float) -> bytes:
        deadline_s = time.monotonic() + timeout_s
        while b"\n" not in self._rest:
            if len(self._rest) > MAX_LINE:
                raise OSError(f"the controller has sent a line of more than {MAX_LINE} bytes")
            left_s = deadline_s - time.monotonic()
            if left_s <= 0.0:
                raise TimeoutError("timed out")
            self._socket.settimeout(left_s)
            heard = self._socket.recv(MAX_LINE)
            if not heard:
                raise ConnectionResetError("the controller has closed the connection")
            self._rest += heard
        line, _, self._rest = self._rest.partition(b"\n")
        return line.rstrip(b"\r")

    def close(self) -> None:
        self._socket.close()


@dataclass(frozen=True, slots=True)
class RmiStatus:
    """The reply to FRC_GetStatus. Fields that a controller omits are None.

    Attributes:
        servo_ready: whether the drives can move the arm.
        pendant: whether the teach pendant is on.
        program: 0 running, 1 paused, 2 aborted.
        next_sequence: number of the next instruction.
        override: speed override, per cent.
    """

    servo_ready: bool
    pendant: bool
    program: int | None
    next_sequence: int | None
    override: int | None


Connect = Callable[[int, float], RmiLines]
"""Type of a function that connects to a port within a timeout. It raises OSError if this fails."""


class RmiClient:
    """A session with the controller. Each method waits for its reply, at most `REPLY_S`.

    Raises:
        BackendError: raised by each method if there is no connection or no usable reply, or if the controller
            reports an error, which the text describes.
    """

    def __init__(self, where: str, port: int, connect_s: float, connect: Connect) -> None:
        self._where, self._port, self._connect_s, self._connect = where, port, connect_s, connect
        self._lines: RmiLines | None = None
        self.version = ""

    @property
    def is_connected(self) -> bool:
        return self._lines is not None

    def connect(self) -> None:
        """Begin a session, unless one is open."""
        if self._lines is not None:
            return
        with self._in_words(f"no Remote Motion Interface on TCP {self._where}:{self._port}"):
            self._lines = self._connect(self._port, self._connect_s)
        try:
            reply = self._request({"Communication": "FRC_Connect_STMO"}, "connect")
            port = reply.get("PortNumber")
            if type(port) is not int or not 1 <= port <= 65_535:
                raise BackendError(
                    f"the controller at {self._where} accepts a connection, but its reply has no port: is "
                    "option J519 with R912 (S636) installed?"
                )
            self.version = f"{reply.get('MajorVersion', '?')!s:.8}.{reply.get('MinorVersion', '?')!s:.8}"
        finally:
            self.drop()
        with self._in_words(
            f"the controller does not accept the session on TCP port {port}: another client is in control, "
            "or a session that has ended uncleanly still occupies it"
        ):
            self._lines = self._connect(port, self._connect_s)

    def drop(self) -> None:
        """Close the connection without asking the controller to end the session."""
        lines, self._lines = self._lines, None
        if lines is not None:
            lines.close()

    def disconnect(self) -> None:
        try:
            if self._lines is not None:
                self._request({"Communication": "FRC_Disconnect"}, "disconnect")
        finally:
            self.drop()

    def command(self, name: str, what: str, **fields: object) -> dict[str, Any]:
        """Send the command FRC_`name` and return the reply. `what` describes the request in words, for error
        messages.
        """
        return self._request({"Command": f"FRC_{name}", **fields}, what)

    def status(self) -> RmiStatus:
        reply = self.command("GetStatus", "report its status")

        def number(name: str) -> int | None:
            value = reply.get(name)
            return value if type(value) is int else None

        return RmiStatus(
            servo_ready=number("ServoReady") == 1,
            pendant=number("TPMode") == 1,
            program=number("ProgramStatus"),
            next_sequence=number("NextSequenceID"),
            override=number("Override"),
        )

    def alarms(self) -> str:
        """Return the active alarms in words; "" if no alarm is active."""
        reply = self.command("ReadError", "report its alarms", Count=ALARMS)
        texts = [reply.get(f"ErrorData{number}") for number in ("", *range(2, ALARMS + 1))]
        return alarms_in_words(text for text in texts if text and text != "No Error")

    def joints(self) -> tuple[float, ...]:
        """Return the axes in the form of Stream Motion, degrees and mm, shape (AXES,)."""
        angles = self.command("ReadJointAngles", "report its joints").get("JointAngle")
        named = angles if isinstance(angles, dict) else {}
        found = [number_of(named.get(f"J{axis}", 0.0)) for axis in range(1, AXES + 1)]
        if not named or not np.isfinite(found).all():
            raise BackendError("the controller's reply to FRC_ReadJointAngles has no joint angles")
        return from_horizon(found)

    def call(self, program: str, sequence: int) -> None:
        """Run a TP program. The controller replies only when the program ends, so this does not wait for the
        reply.
        """
        self._send({"Instruction": "FRC_Call", "SequenceID": sequence, "ProgramName": program})

    def _request(self, request: dict[str, object], what: str) -> dict[str, Any]:
        self._send(request)
        kind = next(iter(request))
        for _ in range(MAX_SKIPPED):
            reply = self._receive(what)
            if reply.get(kind) == request[kind]:
                break
            if reply.get("Command") == "Unknown":
                raise BackendError(f"the controller cannot {what}: it does not know {request[kind]}")
        else:
            self.drop()
            raise BackendError(f"the controller does not answer a request to {what}, but sends other lines")
        error = reply.get("ErrorID", 0)
        if error != 0:
            number = error if type(error) is int else -1
            raise BackendError(f"the controller does not {what}: {error_in_words(number)}")
        return reply

    def _send(self, request: dict[str, object]) -> None:
        if self._lines is None:
            raise BackendError("the Remote Motion Interface is not connected")
        with self._in_words("the connection to the Remote Motion Interface is lost"):
            self._lines.send(json.dumps(request).encode() + b"\r\n")

    def _receive(self, what: str) -> dict[str, Any]:
        assert self._lines is not None
        with self._in_words(f"the controller does not answer a request to {what}"):
            line = self._lines.receive(REPLY_S)
        try:
            reply = json.loads(line)
        except (ValueError, RecursionError):
            reply = None
        if not isinstance(reply, dict):
            self.drop()
            raise BackendError(
                "the device at the port of the Remote Motion Interface sends "
                f"'{joined_text(line.decode('utf-8', 'replace'), SHOWN)}' instead of a JSON object"
            )
        return reply

    @contextlib.contextmanager
    def _in_words(self, what: str) -> Iterator[None]:
        """Context manager that closes the connection after an error, so that the next request opens a new
        one.
        """
        try:
            yield
        except OSError as exc:
            self.drop()
            raise BackendError(f"{what}: {joined_text(exc.strerror or exc, SHOWN)}") from exc
