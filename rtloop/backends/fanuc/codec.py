"""Encoding and decoding of Stream Motion packets, in both directions."""

from __future__ import annotations

import struct
from collections.abc import Callable

from rtloop.backends.fanuc.messages import (
    AXES,
    FORCE_VERSION,
    IO_BYTES,
    MIN_VERSION,
    THRESHOLDS,
    CapabilityPacket,
    CommandPacket,
    IoBlock,
    IoBlockKind,
    IoConfigRequest,
    IoConfigResult,
    LimitRate,
    LimitsPacket,
    LimitsRequest,
    PacketType,
    PointType,
    Received,
    Sent,
    StartPacket,
    StatusPacket,
    StopPacket,
)

_HEAD = struct.Struct(">II")
_STATUS = struct.Struct(f">IIIBBBBI{3 * AXES + 1}f")
_FORCE = struct.Struct(">6fI")
_NO_FORCE = _FORCE.pack(*[0.0] * 6, 0xFFFF_FFFF)
_COMMAND = struct.Struct(f">IIIBBH{AXES}d{IO_BYTES}s")
_CAPABILITY = struct.Struct(">7I")
_SHORT_CAPABILITY = 25
"""Length of the capability packet of some R-50iA controllers, bytes. Its last field is a single byte."""
_LIMITS_REQUEST = struct.Struct(">4I")
_LIMITS = struct.Struct(f">6I{2 * THRESHOLDS}f")
_BLOCK = struct.Struct(">4I")
_BLOCKS = 32
_RESULT = struct.Struct(">3I")
_POSITION, _JOINTS, _CURRENTS = (slice(8 + AXES * part, 8 + AXES * (part + 1)) for part in range(3))
_STATUS_LENGTHS = {
    PacketType.STATUS_3: _STATUS.size + IO_BYTES,
    PacketType.STATUS: _STATUS.size + _FORCE.size + IO_BYTES,
}


def encode_status(packet: StatusPacket) -> bytes:
    forces = packet.version >= FORCE_VERSION
    head = _STATUS.pack(
        PacketType.STATUS if forces else PacketType.STATUS_3,
        packet.version,
        packet.sequence,
        packet.status,
        packet.robot_status,
        packet.contact_stop,
        0,
        packet.time_ms % (1 << 32),
        *_filled(packet.pose),
        *_filled(packet.joints),
        *_filled(packet.currents),
        packet.safety_scale,
    )
    return head + (_NO_FORCE if forces else b"") + packet.io.ljust(IO_BYTES, b"\0")


def encode_command(packet: CommandPacket) -> bytes:
    return _COMMAND.pack(
        PacketType.COMMAND,
        packet.version,
        packet.sequence,
        packet.is_last,
        packet.moves,
        packet.style,
        *_filled(packet.position),
        packet.io,
    )


def encode_start(version: int) -> bytes:
    return _HEAD.pack(PacketType.START, version)


def encode_stop(version: int) -> bytes:
    return _HEAD.pack(PacketType.STOP, version)


def encode_capability_request(version: int) -> bytes:
    return _CAPABILITY.pack(PacketType.CAPABILITY, version, 1, 0, 0, 0, 0)


def encode_capability(packet: CapabilityPacket) -> bytes:
    return _CAPABILITY.pack(
        PacketType.CAPABILITY,
        packet.version,
        1,
        packet.period_ms,
        packet.start_move,
        packet.version,
        packet.at_tcp,
    )


def encode_limits_request(request: LimitsRequest) -> bytes:
    return _LIMITS_REQUEST.pack(PacketType.LIMITS, request.version, request.axis, request.rate)


def encode_limits(packet: LimitsPacket) -> bytes:
    return _LIMITS.pack(
        PacketType.LIMITS,
        packet.version,
        packet.axis,
        packet.rate,
        packet.max_speed,
        packet.interval_ms,
        *packet.unloaded,
        *packet.loaded,
    )


def encode_io_config(request: IoConfigRequest) -> bytes:
    rows = [_BLOCK.pack(each.kind, each.type, each.start, each.length) for each in request.blocks]
    rows += [_BLOCK.pack(IoBlockKind.NONE, 0, 1, 0)] * (_BLOCKS - len(rows))
    return _HEAD.pack(PacketType.IO_CONFIG, request.version) + b"".join(rows)


def encode_io_result(packet: IoConfigResult) -> bytes:
    return _RESULT.pack(PacketType.IO_CONFIG, packet.result, packet.load)


def decode_received(data: bytes) -> Received | str:
    """Decode a packet from a controller, or return the reason why it is invalid."""
    if len(data) < _HEAD.size:
        return f"a packet of {len(data)} bytes; the shortest packet has {_HEAD.size}"
    kind, version = _HEAD.unpack_from(data)
    decode = _RECEIVED.get(kind)
    if decode is None:
        return f"a packet of type {kind} and {len(data)} bytes, which no controller sends"
    return decode(data, kind, version)


def decode_sent(data: bytes) -> Sent | str:
    """Decode a packet from a client of a controller, or return the reason why it is invalid."""
    if len(data) < _HEAD.size:
        return f"a packet of {len(data)} bytes; the shortest packet has {_HEAD.size}"
    kind, version = _HEAD.unpack_from(data)
    decode = _SENT.get(kind)
    if decode is None:
        return f"a packet of type {kind} and {len(data)} bytes, which no client sends"
    return decode(data, version)


def _status(data: bytes, kind: int, version: int) -> StatusPacket | str:
    length = _STATUS_LENGTHS[PacketType(kind)]
    if len(data) != length:
        return f"the status packet of type {kind} has {len(data)} bytes; it must have {length}"
    if version < MIN_VERSION:
        return f"a status packet of version {version}; the oldest supported version is {MIN_VERSION}"
    row = _STATUS.unpack_from(data)
    return StatusPacket(
        version,
        sequence=row[2],
        status=row[3],
        robot_status=row[4],
        contact_stop=row[5],
        time_ms=row[7],
        pose=row[_POSITION],
        joints=row[_JOINTS],
        currents=row[_CURRENTS],
        safety_scale=row[-1],
        io=data[-IO_BYTES:],
    )


def _capability(data: bytes, kind: int, version: int) -> CapabilityPacket | str:
    if len(data) not in (_CAPABILITY.size, _SHORT_CAPABILITY):
        return f"a capability packet of {len(data)} bytes; it must have {_CAPABILITY.size}"
    row = _CAPABILITY.unpack(data.ljust(_CAPABILITY.size, b"\0"))
    return CapabilityPacket(row[5], row[3], row[4], bool(row[6]))


def _limits(data: bytes, kind: int, version: int) -> LimitsPacket | str:
    if len(data) != _LIMITS.size:
        return f"a packet of the limits table with {len(data)} bytes; it must have {_LIMITS.size}"
    row = _LIMITS.unpack(data)
    axis, rate = row[2], row[3]
    if not (1 <= axis <= AXES and rate in list(LimitRate)):
        return f"a limits table of axis {axis} and type {rate}, which do not exist"
    return LimitsPacket(version, axis, LimitRate(rate), row[4], row[5], row[6:26], row[26:])


def _io_result(data: bytes, kind: int, version: int) -> IoConfigResult | str:
    if len(data) != _RESULT.size:
        return f"a result of the I/O configuration with {len(data)} bytes; it must have {_RESULT.size}"
    return IoConfigResult(*_RESULT.unpack(data)[1:])


def _decode_command(data: bytes, version: int) -> CommandPacket | str:
    if len(data) != _COMMAND.size:
        return f"a command of {len(data)} bytes; it must have {_COMMAND.size}"
    row = _COMMAND.unpack(data)
    return CommandPacket(version, row[2], row[6:-1], bool(row[3]), bool(row[4]), row[5], row[-1])


def _decode_limits_request(data: bytes, version: int) -> LimitsRequest | str:
    if len(data) != _LIMITS_REQUEST.size:
        return f"a request of limits with {len(data)} bytes; it must have {_LIMITS_REQUEST.size}"
    _, _, axis, rate = _LIMITS_REQUEST.unpack(data)
    if not (1 <= axis <= AXES and rate in list(LimitRate)):
        return f"a request of the limits of axis {axis} and type {rate}, which do not exist"
    return LimitsRequest(version, axis, LimitRate(rate))


def _asked(data: bytes, version: int) -> CapabilityPacket | str:
    if len(data) != _CAPABILITY.size:
        return f"a capability request of {len(data)} bytes; it must have {_CAPABILITY.size}"
    return CapabilityPacket(version)


def _config(data: bytes, version: int) -> IoConfigRequest | str:
    length = _HEAD.size + _BLOCKS * _BLOCK.size
    if len(data) != length:
        return f"an I/O configuration of {len(data)} bytes; it must have {length}"
    rows = list(_BLOCK.iter_unpack(data[_HEAD.size :]))
    try:
        blocks = [IoBlock(IoBlockKind(row[0]), PointType(row[1]), row[2], row[3]) for row in rows if row[0]]
    except ValueError as exc:
        return f"an I/O configuration with an unknown block: {exc}"
    return IoConfigRequest(version, tuple(blocks))


def _filled(values: tuple[float, ...]) -> tuple[float, ...]:
    return values + (0.0,) * (AXES - len(values))


_RECEIVED: dict[int, Callable[[bytes, int, int], Received | str]] = {
    PacketType.STATUS_3: _status,
    PacketType.STATUS: _status,
    PacketType.CAPABILITY: _capability,
    PacketType.LIMITS: _limits,
    PacketType.IO_CONFIG: _io_result,
}
_SENT: dict[int, Callable[[bytes, int], Sent | str]] = {
    PacketType.COMMAND: _decode_command,
    PacketType.CAPABILITY: _asked,
    PacketType.LIMITS: _decode_limits_request,
    PacketType.START: lambda data, version: StartPacket(version),
    PacketType.STOP: lambda data, version: StopPacket(version),
    PacketType.IO_CONFIG: _config,
}
