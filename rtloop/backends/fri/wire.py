"""The part of Protobuf's wire format that FRI needs.

A message is a sequence of fields. Each field consists of a key, which contains the field's number and kind,
and a value. The kinds are: 0 for a varint, 1 for eight bytes, 2 for a length and that many bytes, 5 for four
bytes. Source: "Encoding", Protocol Buffers documentation.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from functools import cache

VARINT, EIGHT_BYTES, LENGTH, FOUR_BYTES = 0, 1, 2, 5
_VARINT_BYTES = 10
_DOUBLE = struct.Struct("<d")
_DOUBLE_FIELD = 1 + _DOUBLE.size


class WireError(Exception):
    """Raised if bytes are not a valid message. The text gives the reason."""


def read_varint(data: bytes, at: int, end: int) -> tuple[int, int]:
    """Read a varint. Returns the number, below 2**64, and the position after it."""
    value = shift = 0
    for index in range(at, min(end, at + _VARINT_BYTES)):
        byte = data[index]
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value & 0xFFFF_FFFF_FFFF_FFFF, index + 1
        shift += 7
    raise WireError(f"the number at byte {at} is incomplete")


def fields(data: bytes, at: int, end: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield each field as four numbers: the field number, the kind, and two values. For a varint, the values
    are the varint and 0. For data, they are the start and the end of the data.
    """
    while at < end:
        key = data[at]
        if key < 0x80:
            at += 1
        else:
            key, at = read_varint(data, at, end)
        number, kind = key >> 3, key & 7
        if number == 0:
            raise WireError(f"the field number before byte {at} is 0, which is invalid")
        if kind == VARINT:
            value, at = read_varint(data, at, end)
            yield number, kind, value, 0
            continue
        if kind == LENGTH:
            size, at = read_varint(data, at, end)
        elif kind == EIGHT_BYTES:
            size = 8
        elif kind == FOUR_BYTES:
            size = 4
        else:
            raise WireError(f"field {number} has the unknown wire type {kind}")
        if size > end - at:
            raise WireError(f"field {number} needs {size} bytes, but only {end - at} are left")
        yield number, kind, at, at + size
        at += size


def varint_of(number: int, kind: int, value: int) -> int:
    """Return the value of a field that must be a varint."""
    if kind != VARINT:
        raise WireError(f"field {number} must be a number, but has wire type {kind}")
    return value


def double_of(data: bytes, number: int, kind: int, at: int) -> float:
    """Return the value of a field that must be a double."""
    if kind != EIGHT_BYTES:
        raise WireError(f"field {number} must be a double, but has wire type {kind}")
    value: float = _DOUBLE.unpack_from(data, at)[0]
    return value


def need_length(number: int, kind: int) -> None:
    """Check that a field contains a message or a string."""
    if kind != LENGTH:
        raise WireError(f"field {number} must be a message, but has wire type {kind}")


@cache
def _row(count: int) -> struct.Struct:
    return struct.Struct("<" + "Bd" * count)


@cache
def _packed(count: int) -> struct.Struct:
    return struct.Struct(f"<{count}d")


def read_doubles(data: bytes, at: int, end: int, wanted: int, limit: int) -> tuple[float, ...]:
    """Read the doubles in the repeated field `wanted` of a message. Each one may have its own key, or they
    may be packed.

    Raises:
        WireError: there are more than `limit` doubles, or the field is of a different kind.
    """
    count, rest = divmod(end - at, _DOUBLE_FIELD)
    if rest == 0 and 0 < count <= limit:
        row = _row(count).unpack_from(data, at)
        if row[::2] == (wanted << 3 | EIGHT_BYTES,) * count:
            return row[1::2]
    found: list[float] = []
    for number, kind, begin, stop in fields(data, at, end):
        if number != wanted:
            continue
        if kind == EIGHT_BYTES:
            found.append(_DOUBLE.unpack_from(data, begin)[0])
        elif kind == LENGTH and (stop - begin) % 8 == 0:
            if stop - begin > 8 * limit:
                raise WireError(
                    f"field {wanted} contains {(stop - begin) // 8} values; the maximum is {limit}"
                )
            found.extend(_packed((stop - begin) // 8).unpack_from(data, begin))
        else:
            raise WireError(f"field {wanted} must contain doubles, but has wire type {kind}")
        if len(found) > limit:
            raise WireError(f"field {wanted} contains more than {limit} values")
    return tuple(found)


def varint(value: int) -> bytes:
    """Encode a number below 2**64. A negative number is encoded as its two's complement."""
    value &= 0xFFFF_FFFF_FFFF_FFFF
    if value < 0x80:
        return bytes((value,))
    found = bytearray()
    while value >= 0x80:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    found.append(value)
    return bytes(found)


def number_field(number: int, value: int) -> bytes:
    return bytes((number << 3 | VARINT,)) + varint(value)


def double_field(number: int, value: float) -> bytes:
    return bytes((number << 3 | EIGHT_BYTES,)) + _DOUBLE.pack(value)


def bytes_field(number: int, content: bytes) -> bytes:
    """Encode a field with a message or a string."""
    return bytes((number << 3 | LENGTH,)) + varint(len(content)) + content


def doubles_field(number: int, values: Sequence[float]) -> bytes:
    """Encode each value with its own key, because FRI clients and controllers do not pack doubles."""
    row: list[float] = [number << 3 | EIGHT_BYTES] * (2 * len(values))
    row[1::2] = values
    return _row(len(values)).pack(*row)
