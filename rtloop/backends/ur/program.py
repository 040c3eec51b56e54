"""cobot's program on the controller: its text, and the connection that it opens to this computer."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from importlib.resources import files

from cobot.robot.tool import Tool
from cobot.types import JointLimits
from rtloop.backends import BackendError
from rtloop.backends.ur.fields import AXES
from rtloop.backends.ur.options import UrOptions
from rtloop.backends.ur.torques import HELD_STEPS, SPEED_SHARE, TORQUE_PERIOD_S, torque_rate
from rtloop.backends.ur.transport import ByteListener, ByteStream, UrTransport

MAGIC = 0x636F626F
"""First number that the program sends. The second one identifies the upload."""
SCALE = 1e8
"""Integer that represents one radian in a message."""
FIRST_TIMEOUT_S = 3.0
"""How long the program waits for its first command, s."""
_HELLO = struct.Struct(">ii")
_MESSAGE = struct.Struct(">8i")
TORQUE_SCALE = 1e6
"""Integer that represents 1 N·m in a message."""
END, POSITION, PAYLOAD, GUIDE, WAIT, EXERT = 0, 1, 2, 3, 4, 5
PARTS = ("freedrive", "torque")
"""Options that include lines of the program. A line that ends with the name of an option is left out if the
option is off.
"""
MAX_PERIODS = 1000


def script(options: UrOptions, limits: JointLimits, host: str, port: int, token: int, period_s: float) -> str:
    """Return the program text."""
    text = files("rtloop.backends.ur").joinpath("control.script").read_text(encoding="utf-8")
    values = {
        "HOST": host,
        "PORT": port,
        "TOKEN": token,
        "MAGIC": MAGIC,
        "PERIOD": repr(period_s),
        "TIMEOUT": repr(options.timeout_s),
        "FIRST_TIMEOUT": repr(FIRST_TIMEOUT_S),
        "STOP": repr(options.stop_rad_s2),
        "LOOKAHEAD": repr(options.lookahead_s),
        "GAIN": repr(options.gain),
        "ENTRY": repr(options.entry_rad),
        "MAX_TORQUE": limits.max_effort.tolist(),
        "TORQUE_STEP": (torque_rate(limits) * TORQUE_PERIOD_S).tolist(),
        "MAX_SPEED": (SPEED_SHARE * limits.max_velocity).tolist(),
        "HELD_STEPS": HELD_STEPS,
        "TORQUE_TIMEOUT": repr(options.torque_timeout_s),
    }
    for name, value in values.items():
        text = text.replace(f"@@{name}@@", str(value))
    unused = tuple(f"# {name}" for name in PARTS if not getattr(options, name))
    used = (line for line in text.splitlines() if not line.endswith(unused))
    lines = (line.partition("#")[0].rstrip() for line in used)
    return "\n".join(filter(None, lines)) + "\n"


def encode_position(position: Sequence[float], periods: int) -> bytes:
    """Encode a commanded position as a message to the program.

    Args:
        periods: number of periods since the previous message.
    """
    numbers = [round(SCALE * value) for value in position]
    return _MESSAGE.pack(POSITION, *numbers, max(1, min(periods, MAX_PERIODS)))


def encode_torque(torque: Sequence[float]) -> bytes:
    """Encode a message with joint torques, N·m, in addition to gravity."""
    return _MESSAGE.pack(EXERT, *(round(TORQUE_SCALE * value) for value in torque), 0)


def decode_torque(message: bytes) -> list[float] | None:
    """Return the torques in a message, N·m; None if the message contains none."""
    kind, *numbers = _MESSAGE.unpack(message)
    return [each / TORQUE_SCALE for each in numbers[:AXES]] if kind == EXERT else None


def decode_position(message: bytes) -> list[float] | None:
    """Return the joint positions in a message, rad; None if the message contains none."""
    kind, *numbers = _MESSAGE.unpack(message)
    return [each / SCALE for each in numbers[:AXES]] if kind == POSITION else None


class MotionProgram:
    """The connection to the program on the controller.

    Attributes:
        started: whether this process has uploaded a program that may still be on the controller.
    """

    def __init__(self, transport: UrTransport, options: UrOptions, limits: JointLimits) -> None:
        self._transport, self._options, self._limits = transport, options, limits
        self._listener: ByteListener | None = None
        self._stream: ByteStream | None = None
        self._guests: list[tuple[ByteStream, bytes]] = []
        self._token = 0
        self.started = False

    def open(self) -> None:
        """
        Raises:
            BackendError: the port is taken.
        """
        if self._listener is not None:
            return
        try:
            self._listener = self._transport.listen(self._options.port)
        except OSError as exc:
            raise BackendError(
                f"TCP port {self._options.port} of this computer cannot be used: {exc.strerror}; choose "
                "another robot.backend.port, or end the program that uses it"
            ) from exc

    def text(self, local: str, period_s: float) -> str:
        """Return the text for the next upload. Connections of earlier programs are rejected from then on."""
        assert self._listener is not None
        self.drop()
        self._token = self._token % 1_000_000 + 1 + round(1e3 * self._transport.clock()) % 1_000_000
        self.started = True
        host = self._options.callback or local
        return script(self._options, self._limits, host, self._listener.port, self._token, period_s)

    @property
    def place(self) -> str:
        port = self._listener.port if self._listener is not None else self._options.port
        return f"port {port} of {self._options.callback or 'this computer'}"

    @property
    def is_connected(self) -> bool:
        return self._stream is not None

    @property
    def streams(self) -> list[ByteStream]:
        return [self._stream] if self._stream is not None else []

    def poll(self) -> None:
        """Accept the program's connection, and detect its end."""
        if self._stream is not None:
            try:
                self._stream.receive()
            except OSError:
                self._lose()
        if self._listener is None:
            return
        while (guest := self._listener.accept()) is not None:
            self._guests.append((guest, b""))
        guests, self._guests = self._guests, []
        for guest, heard in guests:
            self._hear(guest, heard)

    def _hear(self, guest: ByteStream, heard: bytes) -> None:
        try:
            heard += guest.receive()
        except OSError:
            guest.close()
            return
        if len(heard) < _HELLO.size:
            self._guests = [*self._guests, (guest, heard)][-4:]
        elif _HELLO.unpack_from(heard) == (MAGIC, self._token) and self._stream is None:
            self._stream = guest
        else:
            guest.close()

    def send_position(self, position: Sequence[float], periods: int) -> None:
        self._send(encode_position(position, periods))

    def send_torque(self, torque: Sequence[float]) -> None:
        self._send(encode_torque(torque))

    def send_tool(self, tool: Tool) -> None:
        """Send the payload: the mass, and the centre of mass in the flange frame."""
        numbers = [round(1e3 * tool.mass), *(round(1e6 * float(value)) for value in tool.centre)]
        self._send(_MESSAGE.pack(PAYLOAD, *numbers, 0, 0, 0))

    def send_hand(self, *, guided: bool) -> None:
        """Release the arm for hand guiding until the next message is due, or make the program hold it and
        wait for a position.
        """
        self._send(_MESSAGE.pack(GUIDE if guided else WAIT, *[0] * 7))

    def drop(self) -> None:
        """End the program if it is still running."""
        if self._stream is not None:
            self._send(_MESSAGE.pack(END, *[0] * 7))
        self._lose()

    def close(self) -> None:
        self.drop()
        for guest, _ in self._guests:
            guest.close()
        if self._listener is not None:
            self._listener.close()
        self._guests, self._listener = [], None

    def _send(self, message: bytes) -> None:
        if self._stream is None:
            return
        try:
            self._stream.send(message)
        except OSError:
            self._lose()

    def _lose(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream = None
