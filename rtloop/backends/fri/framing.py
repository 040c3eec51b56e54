"""The frame around messages in FRI 2.7: the length of the message, the message, and its CRC-32 checksum.

The length and the checksum are Protobuf fixed32 values: four bytes, lowest first. Older releases send only
the message. It begins with its header: the key of field 1, the length of the header, and the key of the
identifier in the header.
"""

from __future__ import annotations

import struct
from zlib import crc32

from rtloop.backends.fri.wire import WireError

FRAME_BYTES = 8
_NUMBER = struct.Struct("<I")
_HEADER_KEY, _IDENTIFIER_KEY = 0x0A, 0x08


def frame(message: bytes) -> bytes:
    """Put a message into the frame of FRI 2.7, and return the packet."""
    return _NUMBER.pack(len(message)) + message + _NUMBER.pack(crc32(message))


def unframe(packet: bytes) -> tuple[bytes, bool]:
    """Return the message in a packet, and whether it was framed.

    Raises:
        WireError: the length or the checksum of the frame is wrong.
    """
    if len(packet) < FRAME_BYTES:
        return packet, False
    stated, size = _NUMBER.unpack_from(packet)[0], len(packet) - FRAME_BYTES
    if stated != size:
        if _begins_message(packet, 0) or not _begins_message(packet, 4):
            return packet, False
        raise WireError(
            f"the frame of FRI 2.7 states a message of {stated} bytes, but the message has {size} (packet: "
            f"{len(packet)} bytes)"
        )
    message = packet[4:-4]
    found, sent = crc32(message), _NUMBER.unpack_from(packet, len(packet) - 4)[0]
    if found != sent:
        raise WireError(
            f"the frame of FRI 2.7 states the CRC-32 {sent:#010x}, but its message has {found:#010x}"
        )
    return message, True


def _begins_message(packet: bytes, at: int) -> bool:
    """Whether a message without a frame may begin at this position."""
    return packet[at] == _HEADER_KEY and len(packet) > at + 2 and packet[at + 2] == _IDENTIFIER_KEY
