"""Writes and reads submessages (RTPS 2.2, 9.4.5).

All data are written little endian and aligned to 4 bytes. This includes samples, so a reader may find up to 3
zeros after the bytes of a sample. Both byte orders and any alignment are read.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from struct import Struct

from cobot.dds.rtps.cursor import Cursor, Layout
from cobot.dds.rtps.errors import MalformedError
from cobot.dds.rtps.number_sets import pack_fragments, pack_sequences, read_fragments, read_sequences
from cobot.dds.rtps.parameters import SENTINEL, Parameters, read_parameters

VENDOR = 0x017E
"""Our vendor id. The OMG has not assigned it to any vendor."""

HEADER_BYTES = 20
_MAGIC = b"RTPS"
_VERSION = bytes((2, 2))
_U32_MAX = 0xFFFFFFFF


class SubmessageKind(IntEnum):
    PAD = 0x01
    ACKNACK = 0x06
    HEARTBEAT = 0x07
    GAP = 0x08
    INFO_TS = 0x09
    INFO_SRC = 0x0C
    INFO_DST = 0x0E
    NACK_FRAG = 0x12
    HEARTBEAT_FRAG = 0x13
    DATA = 0x15
    DATA_FRAG = 0x16


_LITTLE = 0x01
_FINAL = 0x02
_INVALIDATE = 0x02
_INLINE_QOS = 0x02
_DATA = 0x04
_KEY = 0x08


def protocol_header(prefix: bytes) -> bytes:
    return _MAGIC + _VERSION + VENDOR.to_bytes(2, "big") + prefix


_SUBMESSAGE = Struct("<BBH")
_DATA_HEADER = Struct("<BBHHH4s4siI")
_FRAGMENT_HEADER = Struct("<BBHHH4s4siIIHHI")
_TIME = Struct("<BBHII")
_HEARTBEAT_BODY = Struct("<BBH4s4siIiII")
_HEARTBEAT_FRAG_BODY = Struct("<BBH4s4siIII")
_PAIR = Struct("<4s4s")
_SEQUENCE = Struct("<iI")


def _submessage(kind: SubmessageKind, flags: int, body: bytes) -> bytes:
    return _SUBMESSAGE.pack(kind, flags | _LITTLE, len(body)) + body


def info_destination(prefix: bytes) -> bytes:
    return _submessage(SubmessageKind.INFO_DST, 0, prefix)


def info_time(seconds: float) -> bytes:
    """An INFO_TS submessage. `seconds` is the time since 1970; 32 bits are enough until 2106."""
    whole = int(seconds)
    return _TIME.pack(SubmessageKind.INFO_TS, _LITTLE, 8, whole & _U32_MAX, int((seconds - whole) * 2**32))


def data(reader: bytes, writer: bytes, sequence: int, inline: bytes, payload: bytes, *, key: bool) -> bytes:
    """A DATA submessage. `inline` contains the inline parameters without their end marker. With `key`,
    the payload is only the key of a disposed entity.
    """
    flags = _LITTLE | (_KEY if key else _DATA)
    if inline:
        flags |= _INLINE_QOS
        inline += SENTINEL
    payload += bytes(-len(payload) % 4)
    length = 20 + len(inline) + len(payload)
    head = _DATA_HEADER.pack(
        SubmessageKind.DATA, flags, length, 0, 16, reader, writer, sequence >> 32, sequence & _U32_MAX
    )
    return head + inline + payload


def data_fragment(
    reader: bytes, writer: bytes, sequence: int, inline: bytes, payload: bytes, number: int, size: int
) -> bytes:
    """A DATA_FRAG submessage with fragment `number`, counted from 1, of a payload that is divided into pieces
    of `size` bytes.
    """
    piece = payload[(number - 1) * size : number * size]
    piece += bytes(-len(piece) % 4)
    flags = _LITTLE
    if inline:
        flags |= _INLINE_QOS
        inline += SENTINEL
    length = 32 + len(inline) + len(piece)
    sequences = sequence >> 32, sequence & _U32_MAX
    head = _FRAGMENT_HEADER.pack(
        SubmessageKind.DATA_FRAG,
        flags,
        length,
        0,
        28,
        reader,
        writer,
        *sequences,
        number,
        1,
        size,
        len(payload),
    )
    return head + inline + piece


def heartbeat(reader: bytes, writer: bytes, first: int, last: int, count: int, *, final: bool) -> bytes:
    flags = _LITTLE | (_FINAL if final else 0)
    numbers = first >> 32, first & _U32_MAX, last >> 32, last & _U32_MAX, count & _U32_MAX
    return _HEARTBEAT_BODY.pack(SubmessageKind.HEARTBEAT, flags, 28, reader, writer, *numbers)


def heartbeat_fragment(reader: bytes, writer: bytes, sequence: int, last: int, count: int) -> bytes:
    numbers = sequence >> 32, sequence & _U32_MAX, last, count & _U32_MAX
    return _HEARTBEAT_FRAG_BODY.pack(SubmessageKind.HEARTBEAT_FRAG, _LITTLE, 24, reader, writer, *numbers)


def gap(reader: bytes, writer: bytes, start: int, base: int, members: Iterable[int] = ()) -> bytes:
    """A GAP submessage: the samples from `start` to `base` - 1, and `members` (from `base` on), will never be
    sent.
    """
    start_bytes = _SEQUENCE.pack(start >> 32, start & _U32_MAX)
    body = _PAIR.pack(reader, writer) + start_bytes + pack_sequences(base, members)
    return _submessage(SubmessageKind.GAP, 0, body)


def acknowledgement(
    reader: bytes, writer: bytes, base: int, missing: Iterable[int], count: int, *, final: bool
) -> bytes:
    body = (
        _PAIR.pack(reader, writer) + pack_sequences(base, missing) + (count & _U32_MAX).to_bytes(4, "little")
    )
    return _submessage(SubmessageKind.ACKNACK, _FINAL if final else 0, body)


def fragments_wanted(reader: bytes, writer: bytes, sequence: int, missing: list[int], count: int) -> bytes:
    sequence_bytes = _SEQUENCE.pack(sequence >> 32, sequence & _U32_MAX)
    numbers = pack_fragments(missing[0], missing) + (count & _U32_MAX).to_bytes(4, "little")
    return _submessage(SubmessageKind.NACK_FRAG, 0, _PAIR.pack(reader, writer) + sequence_bytes + numbers)


@dataclass(frozen=True, slots=True)
class RtpsHeader:
    prefix: bytes
    vendor: int


@dataclass(slots=True)
class Submessage:
    kind: int
    flags: int
    body: Cursor


@dataclass(slots=True)
class Data:
    """A DATA submessage, or a DATA_FRAG with `fragment` set. `payload` is a view; None if there is no
    payload.
    """

    reader: bytes
    writer: bytes
    sequence: int
    inline: Parameters | None
    payload: memoryview | None
    little: bool
    fragment: DataFragment | None = None


@dataclass(slots=True)
class DataFragment:
    first: int
    count: int
    size: int
    total: int


_DATA_LAYOUT = Layout("HH4s4siI")
_FRAGMENT_LAYOUT = Layout("IHHI")
_PAIR_LAYOUT = Layout("4s4s")
_TIME_LAYOUT = Layout("II")
_INVALID_TIME = (_U32_MAX, _U32_MAX)


def read_header(datagram: memoryview) -> tuple[RtpsHeader, Cursor]:
    """Read the header. Returns the sender, and a cursor at the first submessage."""
    if len(datagram) < HEADER_BYTES or datagram[:4] != _MAGIC or datagram[4] != _VERSION[0]:
        raise MalformedError("not an RTPS 2 message")
    vendor = datagram[6] << 8 | datagram[7]
    header = RtpsHeader(datagram[8:HEADER_BYTES].tobytes(), vendor)
    return header, Cursor(datagram, HEADER_BYTES, len(datagram), little=True)


def read_submessages(cursor: Cursor) -> Iterator[Submessage]:
    """Yield one submessage after the other. The datagram may end early only between two of them."""
    while cursor.remaining:
        start = cursor.take(4)
        kind, flags = start[0], start[1]
        little = bool(flags & _LITTLE)
        length = int.from_bytes(start[2:4], "little" if little else "big")
        # A length of 0 means "to the end of the message". Submessages that may have an empty body are an
        # exception.
        if not length and kind not in (SubmessageKind.PAD, SubmessageKind.INFO_TS):
            length = cursor.remaining
        body = cursor.part(length)
        body.little = little
        yield Submessage(kind, flags, body)


def read_data(message: Submessage) -> Data:
    body = message.body
    start = body.position + 4
    _, to_inline, reader, writer, high, low = body.read(_DATA_LAYOUT)
    fragment = None
    has_payload = bool(message.flags & (_DATA | _KEY))
    if message.kind == SubmessageKind.DATA_FRAG:
        fragment = DataFragment(*body.read(_FRAGMENT_LAYOUT))
        has_payload = True
    sequence = (high << 32) | low
    if sequence < 1:
        raise MalformedError(f"a sample has the number {sequence}, which must be 1 or more")
    ahead = start + to_inline - body.position
    if ahead < 0:
        raise MalformedError(f"inline QoS at byte {to_inline} is inside the header")
    body.skip(ahead)
    inline = read_parameters(body) if message.flags & _INLINE_QOS else None
    payload = body.rest() if has_payload else None
    return Data(reader, writer, sequence, inline, payload, body.little, fragment)


def read_pair(message: Submessage) -> tuple[bytes, bytes]:
    """Read the entity ids of the reader and the writer. All submessages below begin with these ids."""
    reader, writer = message.body.read(_PAIR_LAYOUT)
    return reader, writer


def read_heartbeat(message: Submessage) -> tuple[int, int, bool]:
    """Read a heartbeat. Returns the number of the writer's first sample, the number of its last sample, and
    whether no answer is needed.
    """
    first, last = message.body.sequence(), message.body.sequence()
    if first < 1 or last < first - 1:
        raise MalformedError(f"a heartbeat reports samples from {first} to {last}, which is not a range")
    return first, last, bool(message.flags & _FINAL)


def read_heartbeat_fragment(message: Submessage) -> tuple[int, int]:
    """Read a fragment heartbeat. Returns the number of the sample, and the last fragment that was sent."""
    return message.body.sequence(), message.body.u32()


def read_gap(message: Submessage) -> tuple[int, int, list[int]]:
    """Read a gap. Returns start, base and members; see `gap`."""
    start = message.body.sequence()
    base, members = read_sequences(message.body)
    if start < 1 or base < start:
        raise MalformedError(f"a gap from {start} to {base} is invalid")
    return start, base, members


def read_acknowledgement(message: Submessage) -> tuple[int, list[int], bool]:
    """Read an acknowledgement. Returns the number below which all samples have arrived, the requested
    samples, and whether no answer is needed.
    """
    base, missing = read_sequences(message.body)
    return base, missing, bool(message.flags & _FINAL)


def read_fragments_wanted(message: Submessage) -> tuple[int, list[int]]:
    sequence = message.body.sequence()
    return sequence, read_fragments(message.body)[1]


def read_time(message: Submessage) -> float | None:
    """Read a time stamp, in seconds since 1970; None if the time is withdrawn or invalid."""
    if message.flags & _INVALIDATE:
        return None
    whole, fraction = message.body.read(_TIME_LAYOUT)
    return None if (whole, fraction) == _INVALID_TIME else whole + fraction * 2.0**-32


def read_source(message: Submessage) -> RtpsHeader:
    """Read INFO_SRC. Returns the sender of the submessages that follow."""
    message.body.skip(6)
    vendor = int.from_bytes(message.body.bytes(2), "big")
    return RtpsHeader(message.body.bytes(12), vendor)
