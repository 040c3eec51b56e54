"""Decoding of FRI messages, for both sides of the connection. See `encoding` for the reverse.

The field numbers are defined in the generated sources of the vendor's client. FRI 1.11 to 1.17 and 2.x share
the identifiers and most fields that are read here. Only 1.x has a commanded joint position (field 3 of the
monitor data), only 2.x has a measured pose (field 9), and only 2.7 has an external force (field 6) and a
frame around each message (`framing`). Unknown fields are skipped.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import TypeVar

from rtloop.backends.fri import wire
from rtloop.backends.fri.framing import FRAME_BYTES, unframe
from rtloop.backends.fri.messages import (
    COMMAND_ID,
    MAX_IO,
    MAX_JOINTS,
    MAX_NAME,
    MONITORING_ID,
    CommandMessage,
    CommandMode,
    ControlMode,
    DriveState,
    FriHeader,
    IoDirection,
    IoType,
    IoValue,
    MonitoringMessage,
    OperationMode,
    OverlayType,
    Quality,
    SafetyState,
    SessionState,
)
from rtloop.backends.fri.wire import WireError, fields, need_length, read_doubles, varint_of

MAX_BYTES = 4096
"""Maximum size of a message, bytes. The vendor's client allows 1500 in both directions."""
MAX_PACKET = MAX_BYTES + FRAME_BYTES

_Enum = TypeVar("_Enum", bound=IntEnum)
_Message = TypeVar("_Message", MonitoringMessage, CommandMessage)
_POSE, _WRENCH = 7, 6


def decode_monitoring(packet: bytes) -> MonitoringMessage | str:
    """Decode a monitoring message, or return the reason why the packet is invalid. Never raises, whatever the
    bytes.
    """
    return _decode(packet, MONITORING_ID, "monitoring", _monitoring)


def decode_command(packet: bytes) -> CommandMessage | str:
    """Decode a command. Works like `decode_monitoring`."""
    return _decode(packet, COMMAND_ID, "command", _command)


def _decode(
    packet: bytes, wanted: int, name: str, read: Callable[[bytes, FriHeader], _Message]
) -> _Message | str:
    try:
        packet, framed = unframe(packet)
        if len(packet) > MAX_BYTES:
            return f"the packet has {len(packet)} bytes; a {name} message has at most {MAX_BYTES}"
        header = _header(packet)
        if header.identifier != wanted:
            return (
                f"a message {header.identifier:#x} instead of {wanted:#x}: neither FRI 1.11 to 1.17 nor 2.x "
                f"sends that as a {name} message"
            )
        message = read(packet, header)
        message.framed = framed
        return message
    except WireError as exc:
        return f"no {name} message of FRI: {exc}"


def _header(packet: bytes) -> FriHeader:
    values = [-1, -1, -1]
    for number, kind, at, end in fields(packet, 0, len(packet)):
        if number != 1:
            continue
        need_length(number, kind)
        for inner, inner_kind, value, _ in fields(packet, at, end):
            if inner <= 3:
                values[inner - 1] = varint_of(inner, inner_kind, value) & 0xFFFF_FFFF
    if -1 in values:
        raise WireError("the header is incomplete")
    return FriHeader(*values)


def _enum(of: type[_Enum], what: str, number: int, kind: int, value: int) -> _Enum:
    try:
        return of(varint_of(number, kind, value))
    except ValueError as exc:
        raise WireError(f"{what} is {value}; valid values: {[int(each) for each in of]}") from exc


def _monitoring(packet: bytes, header: FriHeader) -> MonitoringMessage:
    message = MonitoringMessage(header)
    readers = {2: _read_robot, 3: _read_monitor, 4: _read_connection, 5: _read_interpolator}
    for number, kind, at, end in fields(packet, 0, len(packet)):
        if number in readers:
            need_length(number, kind)
            readers[number](message, packet, at, end)
    _check_joints(message)
    return message


def _check_joints(message: MonitoringMessage) -> None:
    """Check that all joint values are for the same number of joints."""
    count = message.joints or len(message.measured_position)
    if not 0 <= count <= MAX_JOINTS:
        raise WireError(f"the message is for {count} joints; the maximum is {MAX_JOINTS}")
    for values in (
        message.measured_position,
        message.commanded_position,
        message.ipo_position,
        message.measured_torque,
        message.commanded_torque,
        message.external_torque,
    ):
        if values and len(values) != count:
            raise WireError(f"the message contains values of {len(values)} joints, but the robot has {count}")
    message.joints = count


def _read_robot(message: MonitoringMessage, data: bytes, begin: int, stop: int) -> None:
    drives: list[DriveState] = []
    for number, kind, at, end in fields(data, begin, stop):
        if number == 1:
            message.joints = varint_of(number, kind, at) & 0x7FFF_FFFF
        elif number == 2:
            message.safety = _enum(SafetyState, "safety state", number, kind, at)
        elif number == 5 and kind == wire.LENGTH:
            while at < end:
                value, at = wire.read_varint(data, at, end)
                drives.append(_enum(DriveState, "drive state", number, wire.VARINT, value))
        elif number == 5:
            drives.append(_enum(DriveState, "drive state", number, kind, at))
        elif number == 6:
            message.operation_mode = _enum(OperationMode, "operation mode", number, kind, at)
        elif number == 7:
            message.control_mode = _enum(ControlMode, "control mode", number, kind, at)
    message.drives = tuple(drives)


_ROWS = {
    1: "measured_position",
    2: "measured_torque",
    3: "commanded_position",
    4: "commanded_torque",
    5: "external_torque",
}


def _read_monitor(message: MonitoringMessage, data: bytes, begin: int, stop: int) -> None:
    for number, kind, at, end in fields(data, begin, stop):
        row = _ROWS.get(number)
        if row is not None:
            need_length(number, kind)
            setattr(message, row, read_doubles(data, at, end, 1, MAX_JOINTS))
        elif number == 6:
            need_length(number, kind)
            message.external_force = read_doubles(data, at, end, 1, _WRENCH)
        elif number == 8:
            need_length(number, kind)
            _add_io(message.io, data, at, end)
        elif number == 9:
            need_length(number, kind)
            message.measured_pose = _pose(data, at, end)
        elif number == 15:
            need_length(number, kind)
            message.time_s = _time(data, at, end)


def _pose(data: bytes, at: int, end: int) -> tuple[float, ...]:
    """Decode the pose in a named transformation: seven values in field 2."""
    return read_doubles(data, at, end, 2, _POSE)


def _time(data: bytes, begin: int, stop: int) -> float:
    seconds = nanoseconds = 0
    for number, kind, value, _ in fields(data, begin, stop):
        if number == 1:
            seconds = varint_of(number, kind, value) & 0xFFFF_FFFF
        elif number == 2:
            nanoseconds = varint_of(number, kind, value) & 0xFFFF_FFFF
    return seconds + nanoseconds * 1e-9


def _read_connection(message: MonitoringMessage, data: bytes, begin: int, stop: int) -> None:
    for number, kind, value, _ in fields(data, begin, stop):
        if number == 1:
            message.state = _enum(SessionState, "session state", number, kind, value)
        elif number == 2:
            message.quality = _enum(Quality, "connection quality", number, kind, value)
        elif number == 3:
            message.send_period_ms = varint_of(number, kind, value) & 0xFFFF_FFFF
        elif number == 4:
            message.receive_multiplier = varint_of(number, kind, value) & 0xFFFF_FFFF


def _read_interpolator(message: MonitoringMessage, data: bytes, begin: int, stop: int) -> None:
    for number, kind, at, end in fields(data, begin, stop):
        if number == 1:
            need_length(number, kind)
            message.ipo_position = read_doubles(data, at, end, 1, MAX_JOINTS)
        elif number == 10:
            message.command_mode = _enum(CommandMode, "command mode", number, kind, at)
        elif number == 11:
            message.overlay = _enum(OverlayType, "overlay", number, kind, at)
        elif number == 12:
            message.tracking_performance = wire.double_of(data, number, kind, at)


def _add_io(found: list[IoValue], data: bytes, begin: int, stop: int) -> None:
    if len(found) == MAX_IO:
        raise WireError(f"there are more than {MAX_IO} inputs and outputs")
    value = IoValue("", IoType.BOOLEAN, IoDirection.INPUT)
    for number, kind, at, end in fields(data, begin, stop):
        if number == 1:
            need_length(number, kind)
            if end - at > MAX_NAME:
                raise WireError(f"the name of an input or output has {end - at} bytes, allowed: {MAX_NAME}")
            value.name = data[at:end].decode("utf-8", "replace")
        elif number == 2:
            value.type = _enum(IoType, "type of an input or output", number, kind, at)
        elif number == 3:
            value.direction = _enum(IoDirection, "direction of an input or output", number, kind, at)
        elif number == 4:
            value.value = varint_of(number, kind, at)
        elif number == 5:
            value.value = wire.double_of(data, number, kind, at)
    found.append(value)


def _command(packet: bytes, header: FriHeader) -> CommandMessage:
    message = CommandMessage(header)
    for number, kind, begin, stop in fields(packet, 0, len(packet)):
        if number != 2:
            continue
        need_length(number, kind)
        for inner, inner_kind, at, end in fields(packet, begin, stop):
            if inner in (1, 2, 3, 5):
                need_length(inner, inner_kind)
            if inner == 1:
                message.position = read_doubles(packet, at, end, 1, MAX_JOINTS)
            elif inner == 2:
                message.wrench = read_doubles(packet, at, end, 1, 6)
            elif inner == 3:
                message.torque = read_doubles(packet, at, end, 1, MAX_JOINTS)
            elif inner == 5:
                _add_io(message.io, packet, at, end)
    return message
