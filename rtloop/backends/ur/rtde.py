"""Packages of RTDE, protocol version 2: a length, a type and a payload, highest byte first."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

PORT = 30004
PROTOCOL = 2
MAX_BUFFER = 1 << 20
"""Maximum number of bytes of incomplete packages that are kept. A package is at most 65,535 bytes long."""
_HEADER = struct.Struct(">HB")
_FORMATS = {
    "BOOL": ("?", 1),
    "UINT8": ("B", 1),
    "UINT32": ("I", 1),
    "UINT64": ("Q", 1),
    "INT32": ("i", 1),
    "DOUBLE": ("d", 1),
    "VECTOR3D": ("d", 3),
    "VECTOR6D": ("d", 6),
    "VECTOR6INT32": ("i", 6),
    "VECTOR6UINT32": ("I", 6),
}
Value = float | tuple[float, ...]


class Kind(IntEnum):
    """Types of packages, which are ASCII letters."""

    REQUEST_PROTOCOL_VERSION = 86
    GET_CONTROL_VERSION = 118
    TEXT_MESSAGE = 77
    DATA = 85
    SETUP_OUTPUTS = 79
    SETUP_INPUTS = 73
    START = 83
    PAUSE = 80


_KINDS = frozenset(Kind)


class RtdeError(Exception):
    """Raised if the controller sends bytes that are not RTDE, or a package that does not match the
    session.
    """


@dataclass(frozen=True, slots=True)
class Package:
    kind: int
    payload: bytes


def encode(kind: Kind, payload: bytes = b"") -> bytes:
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


class Splitter:
    """Splits a stream of bytes into packages. The bytes may arrive in pieces of any size."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def split(self, received: bytes) -> list[Package]:
        """Add received bytes, and return the packages that are now complete.

        Raises:
            RtdeError: the length or the type of a package is invalid.
        """
        self._buffer += received
        found: list[Package] = []
        begin = 0
        while len(self._buffer) - begin >= _HEADER.size:
            length, kind = _HEADER.unpack_from(self._buffer, begin)
            if length < _HEADER.size:
                raise RtdeError(
                    f"a package has {length} bytes; the shortest possible package has {_HEADER.size}"
                )
            if kind not in _KINDS:
                raise RtdeError(f"a package has the unknown type {kind}")
            if len(self._buffer) - begin < length:
                break
            found.append(Package(kind, bytes(self._buffer[begin + _HEADER.size : begin + length])))
            begin += length
        del self._buffer[:begin]
        return found


class Recipe:
    """Names and types of the variables of a data package.

    Attributes:
        number: number of the recipe in packages, 1 to 255; 0 means that the controller rejected it.
        names, types: names and types of the variables, in order.
    """

    def __init__(self, number: int, names: Sequence[str], types: Sequence[str]) -> None:
        """
        Raises:
            RtdeError: the numbers of names and types differ, or a type is unknown.
        """
        if len(names) != len(types):
            raise RtdeError(f"the controller reported {len(types)} types for {len(names)} variables")
        strange = [each for each in types if each not in _FORMATS]
        if strange:
            raise RtdeError(f"the type {strange[0][:40]!r} is not one of RTDE's: {', '.join(_FORMATS)}")
        self.number, self.names, self.types = number, tuple(names), tuple(types)
        formats = [_FORMATS[each] for each in types]
        self._struct = struct.Struct(">B" + "".join(f"{count}{letter}" for letter, count in formats))
        self._counts = [count for _, count in formats]

    def encode(self, values: Mapping[str, Any]) -> bytes:
        """Encode a data package."""
        flat: list[Any] = []
        for name, count in zip(self.names, self._counts, strict=True):
            if count == 1:
                flat.append(values[name])
            else:
                flat.extend(values[name])
        return encode(Kind.DATA, self._struct.pack(self.number, *flat))

    def decode(self, payload: bytes) -> dict[str, Any]:
        """Decode the values of a data package. Vectors become tuples.

        Raises:
            RtdeError: the package belongs to a different recipe, or its length is wrong.
        """
        if len(payload) != self._struct.size:
            raise RtdeError(f"a data package has {len(payload)} bytes, expected {self._struct.size}")
        flat = self._struct.unpack(payload)
        if flat[0] != self.number:
            raise RtdeError(f"a data package has recipe {flat[0]}, expected {self.number}")
        found: dict[str, Any] = {}
        begin = 1
        for name, count in zip(self.names, self._counts, strict=True):
            found[name] = flat[begin] if count == 1 else flat[begin : begin + count]
            begin += count
        return found


def encode_outputs_setup(frequency_hz: float, names: Sequence[str]) -> bytes:
    return encode(Kind.SETUP_OUTPUTS, struct.pack(">d", frequency_hz) + ",".join(names).encode())


def encode_inputs_setup(names: Sequence[str]) -> bytes:
    return encode(Kind.SETUP_INPUTS, ",".join(names).encode())


def decode_setup(payload: bytes) -> tuple[int, list[str]]:
    """Return the recipe's number, and one entry for each variable: its type, or an entry of `ANSWERED`.

    Raises:
        RtdeError: the answer is empty.
    """
    if not payload:
        raise RtdeError("the answer to a recipe is empty")
    return payload[0], payload[1:].decode("ascii", errors="replace").split(",")


def encode_text(message: str, source: str, level: int) -> bytes:
    """Encode a text message. The level is 0 for an exception, 1 for an error, 2 for a warning and 3 for
    information.
    """
    said, by = message.encode()[:255], source.encode()[:255]
    payload = bytes([len(said)]) + said + bytes([len(by)]) + by + bytes([level])
    return encode(Kind.TEXT_MESSAGE, payload)


def decode_text(payload: bytes) -> str:
    """Return the readable part of a message's text."""
    length = payload[0] if payload else 0
    return payload[1 : 1 + length].decode(errors="replace")
