"""The text protocol of the URCap for a simulated gripper."""

from __future__ import annotations

from cobot.grippers.robotiq.registers import FULL, Request
from cobot.grippers.robotiq.slave import Slave
from cobot.grippers.robotiq.urcap import ACK, UNKNOWN

MAX_LINE = 256


class TextSlave:
    """Answers the lines of one client. All clients share the same gripper.

    Args:
        slave: the gripper. Its faults also apply here.
    """

    def __init__(self, slave: Slave) -> None:
        self._slave = slave
        self._buffer = b""

    def feed(self, data: bytes) -> bytes:
        """The device's answer to these bytes, which may be a part of a line or several lines."""
        *lines, rest = (self._buffer + data).split(b"\n")
        self._buffer = rest[-MAX_LINE:]
        if self._slave.silent:
            return b""
        answers = b"".join(self._answer(line.decode("ascii", "replace").split()) for line in lines)
        return bytes(byte ^ 0x5A for byte in answers) if self._slave.garbage else answers

    def _answer(self, words: list[str]) -> bytes:
        match words:
            case ["GET", name] if (value := self._values().get(name)) is not None:
                return f"{name} {value}\n".encode()
            case ["SET", *pairs] if pairs and len(pairs) % 2 == 0 and self._set(pairs):
                return ACK.encode()
            case _:
                return UNKNOWN.encode()

    def _values(self) -> dict[str, int]:
        fingers = self._slave.fingers
        status, request = fingers.status(), fingers.request
        return {
            "ACT": int(request.activate), "GTO": int(request.go), "ATR": 0, "POS": status.position,
            "SPE": request.speed, "FOR": request.force, "PRE": status.echo, "OBJ": int(status.detection),
            "STA": int(status.activation), "FLT": status.fault,
        }  # fmt: skip

    def _set(self, pairs: list[str]) -> bool:
        """Set values. All other values stay unchanged. Returns whether the values were accepted."""
        given = dict(zip(pairs[::2], pairs[1::2], strict=True))
        if not given.keys() <= {"ACT", "GTO", "ATR", "POS", "SPE", "FOR"}:
            return False
        if not all(value.isascii() and value.isdigit() and int(value) <= FULL for value in given.values()):
            return False
        values = {name: int(value) for name, value in given.items()}
        before = self._slave.fingers.request
        self._slave.fingers.take(
            Request(
                bool(values.get("ACT", before.activate)),
                bool(values.get("GTO", before.go)),
                values.get("POS", before.position),
                values.get("SPE", before.speed),
                values.get("FOR", before.force),
            )
        )
        return True
