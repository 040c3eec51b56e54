"""A simulated Robotiq gripper: its fingers, its registers, and its answers to frames of Modbus RTU.

Faults are plain attributes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from cobot.grippers.modbus import framed, is_whole
from cobot.grippers.robotiq.registers import (
    COUNT,
    FULL,
    MODELS,
    NOT_ACTIVE,
    REQUEST,
    STATUS,
    Activation,
    Detection,
    Request,
    RobotiqStatus,
)
from cobot.modbus import REFUSED, ModbusFunction

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
HOLDING_A = 0.4


class Fingers:
    """Two fingers that move to a position, and stop at an object between them.

    Attributes:
        request: the latest request.
        object_m: width of the object between the fingers; None for no object.
        activation_s: duration of an activation.
        fault: gFLT, for tests.
        moved_s: time at which the fingers first moved after the latest request; None before.
    """

    def __init__(self, model: str, now_s: Callable[[], float]) -> None:
        self.model = MODELS[model]
        self.request = Request(False, False)
        self.object_m: float | None = None
        self.activation_s = 1.0
        self.fault = 0
        self.moved_s: float | None = None
        self._now_s = now_s
        self._seen_s = now_s()
        self._position = 0.0
        self._activated_s: float | None = None
        self._detection = Detection.MOVING

    @property
    def width_m(self) -> float:
        """The current width between the fingers, m."""
        return self.model.stroke_m * (1.0 - self._position / FULL)

    def take(self, request: Request) -> None:
        """Receive a request."""
        self.advance()
        before, self.request = self.request, request
        if not request.activate:
            self._activated_s = None
        elif not before.activate:
            self._activated_s = self._now_s() + self.activation_s
        if (request.go, request.position) != (before.go, before.position):
            self._detection, self.moved_s = Detection.MOVING, None

    def advance(self) -> None:
        """Move the fingers up to the current time."""
        now_s = self._now_s()
        passed_s, self._seen_s = now_s - self._seen_s, now_s
        if self._activation() is not Activation.COMPLETE or not self.request.go:
            return
        speed = self.request.speed / FULL
        least, most = self.model.speed_m_s
        step = passed_s * (least + speed * (most - least)) / self.model.stroke_m * FULL
        target, stop = float(self.request.position), self._obstacle()
        closing = target > self._position
        if closing and stop is not None and self._position <= stop < target:
            self._go_towards(stop, step, now_s)
            if self._position == stop:
                self._detection = Detection.STOPPED_CLOSING
            return
        self._go_towards(target, step, now_s)
        if self._position == target:
            self._detection = Detection.AT_POSITION
        elif self._detection is not Detection.AT_POSITION:
            self._detection = Detection.MOVING

    def status(self) -> RobotiqStatus:
        """The current status."""
        self.advance()
        activation = self._activation()
        holds = self._detection in (Detection.STOPPED_CLOSING, Detection.STOPPED_OPENING)
        fault = self.fault or (NOT_ACTIVE if self.request.go and activation is Activation.RESET else 0)
        return RobotiqStatus(
            self.request.activate,
            self.request.go,
            activation,
            self._detection,
            fault,
            self.request.position,
            round(self._position),
            HOLDING_A if holds else 0.0,
        )

    def _go_towards(self, target: float, step: float, now_s: float) -> None:
        way = target - self._position
        if way and step:
            self.moved_s = now_s if self.moved_s is None else self.moved_s
            self._detection = Detection.MOVING
        self._position = target if abs(way) <= step else self._position + (step if way > 0 else -step)

    def _obstacle(self) -> float | None:
        if self.object_m is None:
            return None
        return FULL * (1.0 - self.object_m / self.model.stroke_m)

    def _activation(self) -> Activation:
        if self._activated_s is None:
            return Activation.RESET
        return Activation.COMPLETE if self._now_s() >= self._activated_s else Activation.IN_PROGRESS


class Slave:
    """Answers frames of Modbus RTU.

    Attributes:
        silent: whether the device does not answer, like an unplugged device.
        garbage: whether the device's answers are damaged.
    """

    def __init__(self, fingers: Fingers, unit: int = 9) -> None:
        self.fingers = fingers
        self.unit = unit
        self.silent = self.garbage = False
        self._buffer = b""

    def feed(self, data: bytes) -> bytes:
        """The device's answer to these bytes, which may be part of a request or contain several requests."""
        self._buffer = (self._buffer + data)[-512:]
        answers = b""
        while frame := self._next():
            if frame[0] == self.unit and not self.silent:
                answer = framed(bytes((self.unit,)) + self._answer(frame[1], frame[2:-2]))
                answers += bytes(byte ^ 0x5A for byte in answer) if self.garbage else answer
        return answers

    def _next(self) -> bytes:
        """The next complete frame. Any bytes before this frame are invalid and are dropped."""
        for start in range(len(self._buffer)):
            length = _length(self._buffer[start:])
            frame = self._buffer[start : start + length]
            if length and len(frame) == length and is_whole(frame):
                self._buffer = self._buffer[start + length :]
                return frame
        return b""

    def _answer(self, function: int, data: bytes) -> bytes:
        match function:
            case ModbusFunction.READ_HOLDING_REGISTERS | ModbusFunction.READ_INPUT_REGISTERS:
                address, count = struct.unpack(">HH", data)
                return self._read(function, address, count)
            case ModbusFunction.WRITE_REGISTERS:
                address, count = struct.unpack(">HH", data[:4])
                return self._write(function, address, count, data[5:]) or bytes((function,)) + data[:4]
            case ModbusFunction.READ_WRITE_REGISTERS:
                address, count, to, written = struct.unpack(">HHHH", data[:8])
                return self._write(function, to, written, data[9:]) or self._read(function, address, count)
            case _:
                return bytes((function | REFUSED, ILLEGAL_FUNCTION))

    def _read(self, function: int, address: int, count: int) -> bytes:
        for first, words in ((STATUS, self.fingers.status().words), (REQUEST, self.fingers.request.words)):
            if _within(first, address, count):
                found = words[address - first : address - first + count]
                return bytes((function, 2 * count)) + struct.pack(f">{count}H", *found)
        return bytes((function | REFUSED, ILLEGAL_ADDRESS))

    def _write(self, function: int, address: int, count: int, data: bytes) -> bytes:
        """Write registers. Returns "" if the request was accepted, otherwise the exception."""
        if len(data) != 2 * count:
            return bytes((function | REFUSED, ILLEGAL_VALUE))
        if not _within(REQUEST, address, count):
            return bytes((function | REFUSED, ILLEGAL_ADDRESS))
        words = self.fingers.request.words
        words[address - REQUEST : address - REQUEST + count] = struct.unpack(f">{count}H", data)
        self.fingers.take(Request.of(words))
        return b""


def _within(first: int, address: int, count: int) -> bool:
    """Whether these registers are inside a block."""
    return count > 0 and address in range(first, first + COUNT + 1 - count)


def _length(data: bytes) -> int:
    """Length of a request that begins with these bytes. It is 0 if the length is not known yet, or if these
    bytes do not begin a request.
    """
    if len(data) < 2:
        return 0
    match data[1]:
        case ModbusFunction.WRITE_REGISTERS:
            return 9 + data[6] if len(data) > 6 else 0
        case ModbusFunction.READ_WRITE_REGISTERS:
            return 13 + data[10] if len(data) > 10 else 0
        case _:
            return 8
