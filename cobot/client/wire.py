"""Binary frames of the WebSocket /robot/stream: a header of 16 bytes, then a record of `cobot.ipc.layout`.

The header contains the kind (4 bytes), the layout version (4 bytes) and the sequence number (8 bytes). All
numbers are little-endian, and records have no gaps.
"""

from __future__ import annotations

import struct
from enum import IntEnum

import numpy as np

from cobot.errors import InputError, LayoutError
from cobot.ipc.layout import chunk_dtype, session_dtype, setpoint_dtype
from cobot.ipc.state_fields import LAYOUT_VERSION, state_dtype

PATH = "/robot/stream"
MAX_FRAME_BYTES = 65536
_HEADER = struct.Struct("<IIQ")


class FrameKind(IntEnum):
    """The content of a binary frame."""

    STATE = 1  # sent by the service; the client sends all other kinds
    SESSION = 2
    SETPOINT = 3
    CHUNK = 4
    ESTOP = 5  # has no record
    END = 6  # has no record


_DTYPES = {
    FrameKind.STATE: state_dtype,
    FrameKind.SESSION: session_dtype,
    FrameKind.SETPOINT: setpoint_dtype,
    FrameKind.CHUNK: chunk_dtype,
}


def packed(kind: FrameKind, sequence: int, record: np.ndarray | None = None) -> bytes:
    """Create a binary frame, which consists of the header and a record."""
    return _HEADER.pack(kind, LAYOUT_VERSION, sequence) + (b"" if record is None else record.tobytes())


def header(frame: bytes) -> tuple[FrameKind, int]:
    """Read the kind and the sequence number of a frame.

    Raises:
        InputError: the frame is shorter than a header, or its kind is unknown.
        LayoutError: the sender uses a different version of the records.
    """
    if len(frame) < _HEADER.size:
        raise InputError(f"a binary frame begins with {_HEADER.size} bytes of header, got {len(frame)} bytes")
    kind, layout, sequence = _HEADER.unpack_from(frame)
    if layout != LAYOUT_VERSION:
        raise LayoutError(
            f"the frame has layout version {layout}, but this program has {LAYOUT_VERSION}; use the same "
            "version of cobot on both sides"
        )
    if kind not in list(FrameKind):
        valid = ", ".join(f"{each} ({each.name.lower()})" for each in FrameKind)
        raise InputError(f"there is no binary frame of kind {kind}; valid kinds: {valid}")
    return FrameKind(kind), sequence


def record(frame: bytes, dof: int) -> np.ndarray:
    """A copy of the record in a frame. The frame's `header` must be valid. The result has shape ().

    Raises:
        InputError: the frame is too short or too long for the record.
    """
    kind = FrameKind(_HEADER.unpack_from(frame)[0])
    dtype = _DTYPES[kind](dof) if kind in _DTYPES else np.dtype([])
    size = len(frame) - _HEADER.size
    if size != dtype.itemsize:
        raise InputError(f"a record {kind.name.lower()} has {dtype.itemsize} bytes, got {size}")
    return np.frombuffer(frame, dtype, 1, _HEADER.size).reshape(()).copy()
