"""Encoding of FRI messages, the counterpart of the module `codec`."""

from __future__ import annotations

from collections.abc import Sequence

from rtloop.backends.fri.framing import frame
from rtloop.backends.fri.messages import (
    MAX_NAME,
    CommandMessage,
    FriHeader,
    IoType,
    IoValue,
    MonitoringMessage,
)
from rtloop.backends.fri.wire import bytes_field, double_field, doubles_field, number_field

NANOSECONDS = 1_000_000_000


def encode_command(message: CommandMessage) -> bytes:
    """Encode a command as a complete packet."""
    content = b""
    if message.position:
        content = _joints(1, message.position)
    if message.wrench:
        content += _joints(2, message.wrench)
    if message.torque:
        content += _joints(3, message.torque)
    for value in message.io:
        content += _io(5, value)
    packet = _header(message.header)
    if content:
        packet += bytes_field(2, content)
    return frame(packet) if message.framed else packet


def encode_monitoring(message: MonitoringMessage) -> bytes:
    """Encode a monitoring message as a complete packet. Fields that are empty or None are omitted."""
    robot = number_field(1, message.joints) + number_field(2, message.safety)
    for drive in message.drives:
        robot += number_field(5, drive)
    if message.operation_mode is not None:
        robot += number_field(6, message.operation_mode)
    robot += number_field(7, message.control_mode)
    connection = (
        number_field(1, message.state)
        + number_field(2, message.quality)
        + number_field(3, message.send_period_ms)
        + number_field(4, message.receive_multiplier)
    )
    packet = (
        _header(message.header)
        + bytes_field(2, robot)
        + bytes_field(3, _monitor(message))
        + bytes_field(4, connection)
        + bytes_field(5, _interpolator(message))
    )
    return frame(packet) if message.framed else packet


def _header(header: FriHeader) -> bytes:
    return bytes_field(
        1,
        number_field(1, header.identifier)
        + number_field(2, header.sequence)
        + number_field(3, header.reflected),
    )


def _joints(number: int, values: Sequence[float]) -> bytes:
    return bytes_field(number, doubles_field(1, values))


def _monitor(message: MonitoringMessage) -> bytes:
    content = b""
    for number, values in (
        (1, message.measured_position),
        (2, message.measured_torque),
        (3, message.commanded_position),
        (4, message.commanded_torque),
        (5, message.external_torque),
        (6, message.external_force),
    ):
        if values:
            content += _joints(number, values)
    for value in message.io:
        content += _io(8, value)
    if message.measured_pose:
        content += bytes_field(9, bytes_field(1, b"flange") + doubles_field(2, message.measured_pose))
    if message.time_s is not None:
        seconds, nanoseconds = divmod(round(message.time_s * NANOSECONDS), NANOSECONDS)
        content += bytes_field(15, number_field(1, seconds) + number_field(2, nanoseconds))
    return content


def _interpolator(message: MonitoringMessage) -> bytes:
    content = _joints(1, message.ipo_position) if message.ipo_position else b""
    content += number_field(10, message.command_mode) + number_field(11, message.overlay)
    if message.tracking_performance is not None:
        content += double_field(12, message.tracking_performance)
    return content


def _io(number: int, value: IoValue) -> bytes:
    content = (
        bytes_field(1, value.name.encode()[:MAX_NAME])
        + number_field(2, value.type)
        + number_field(3, value.direction)
    )
    if value.type == IoType.ANALOG:
        content += double_field(5, value.value)
    else:
        content += number_field(4, int(value.value))
    return bytes_field(number, content)
