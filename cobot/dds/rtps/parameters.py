"""Parameter lists, the format of announcements and inline QoS (RTPS 2.2, 9.4.2.11)."""

from __future__ import annotations

from enum import IntEnum
from socket import inet_aton, inet_ntoa
from struct import Struct, pack

from cobot.dds.rtps.cursor import Cursor, Layout
from cobot.dds.rtps.errors import MalformedError
from cobot.dds.rtps.types import Address, Guid, SampleIdentity

Parameters = dict[int, list[bytes]]
"""The values of a parameter list by parameter id, each in the order of the list."""


class Pid(IntEnum):
    PAD = 0x0000
    SENTINEL = 0x0001
    LEASE_DURATION = 0x0002
    TOPIC_NAME = 0x0005
    TYPE_NAME = 0x0007
    DOMAIN_ID = 0x000F
    PROTOCOL_VERSION = 0x0015
    VENDOR_ID = 0x0016
    RELIABILITY = 0x001A
    DURABILITY = 0x001D
    USER_DATA = 0x002C
    UNICAST_LOCATOR = 0x002F
    DEFAULT_UNICAST_LOCATOR = 0x0031
    METATRAFFIC_UNICAST_LOCATOR = 0x0032
    PARTICIPANT_GUID = 0x0050
    BUILTIN_ENDPOINTS = 0x0058
    ENDPOINT_GUID = 0x005A
    ENTITY_NAME = 0x0062
    KEY_HASH = 0x0070
    STATUS_INFO = 0x0071
    RELATED_SAMPLE_IDENTITY = 0x0083
    # Fast DDS before 2.14 knows only a different number for the same parameter.
    RELATED_SAMPLE_IDENTITY_EPROSIMA = 0x800F


ENCAPSULATION = b"\0\3\0\0"
"""The four bytes that begin a serialised parameter list, little endian (PL_CDR_LE)."""

_HEADER = Struct("<HH")
_IDENTITY = Struct("<16siI")
_PARAMETER = Layout("HH")
_LOCATOR_KIND_UDP4 = 1
_LOCATOR_BYTES = 24
_INFINITE_S = 0x7FFFFFFF
_DISPOSED_OR_UNREGISTERED = 0x03
_MAX_LOCATORS = 16


def parameter(pid: int, value: bytes) -> bytes:
    padding = -len(value) % 4
    return _HEADER.pack(pid, len(value) + padding) + value + bytes(padding)


SENTINEL = parameter(Pid.SENTINEL, b"")


def text(value: str) -> bytes:
    encoded = value.encode() + b"\0"
    return len(encoded).to_bytes(4, "little") + encoded


def octets(value: bytes) -> bytes:
    return len(value).to_bytes(4, "little") + value


def locator(address: Address) -> bytes:
    return pack("<iI12s4s", _LOCATOR_KIND_UDP4, address[1], b"", inet_aton(address[0]))


def duration(seconds: float) -> bytes:
    whole = int(seconds)
    return pack("<iI", whole, int((seconds - whole) * 2**32))


def related_identity(identity: SampleIdentity) -> bytes:
    """Inline QoS that identifies the related sample, under each of the two parameter ids in use. The end
    marker is not included.
    """
    value = _IDENTITY.pack(identity.writer, identity.sequence >> 32, identity.sequence & 0xFFFFFFFF)
    return parameter(Pid.RELATED_SAMPLE_IDENTITY_EPROSIMA, value) + parameter(
        Pid.RELATED_SAMPLE_IDENTITY, value
    )


def disposal(guid: bytes) -> bytes:
    """Inline QoS, without its end marker, that reports that an entity is gone."""
    status = bytes((0, 0, 0, _DISPOSED_OR_UNREGISTERED))
    return parameter(Pid.KEY_HASH, guid) + parameter(Pid.STATUS_INFO, status)


def read_parameters(cursor: Cursor) -> Parameters:
    """Read a list up to its sentinel. A list without a sentinel is malformed."""
    values: Parameters = {}
    while True:
        pid, length = cursor.read(_PARAMETER)
        if pid == Pid.SENTINEL:
            return values
        value = cursor.bytes(length)
        if pid != Pid.PAD:
            values.setdefault(pid, []).append(value)


def disposes(inline: Parameters | None) -> bool:
    status = inline.get(Pid.STATUS_INFO) if inline else None
    return bool(status and len(status[0]) >= 4 and status[0][3] & _DISPOSED_OR_UNREGISTERED)


def read_identity(inline: Parameters | None, little: bool) -> SampleIdentity | None:
    for pid in (Pid.RELATED_SAMPLE_IDENTITY, Pid.RELATED_SAMPLE_IDENTITY_EPROSIMA):
        value = inline.get(pid) if inline else None
        if value:
            cursor = value_cursor(value[0], little)
            guid = Guid(cursor.bytes(16))
            if any(guid):
                return SampleIdentity(guid, cursor.sequence())
    return None


def value_cursor(value: bytes, little: bool) -> Cursor:
    return Cursor(memoryview(value), 0, len(value), little)


class ParameterReader:
    """Typed access to the parameters of an announcement. A value that does not match its type is
    malformed.
    """

    def __init__(self, payload: bytes) -> None:
        if len(payload) < len(ENCAPSULATION) or payload[0] != 0 or payload[1] not in (2, 3):
            raise MalformedError(
                f"an announcement begins with {payload[:4].hex()}, which is not a parameter list"
            )
        self._little = payload[1] == 3
        self._values = read_parameters(
            Cursor(memoryview(payload), len(ENCAPSULATION), len(payload), self._little)
        )

    def __contains__(self, pid: int) -> bool:
        return pid in self._values

    def _cursor(self, pid: int) -> Cursor:
        values = self._values.get(pid)
        if not values:
            raise MalformedError(f"an announcement lacks parameter {pid:#06x}")
        return value_cursor(values[0], self._little)

    def u32(self, pid: int, default: int) -> int:
        return self._cursor(pid).u32() if pid in self else default

    def vendor(self) -> int:
        return int.from_bytes(self._cursor(Pid.VENDOR_ID).bytes(2), "big") if Pid.VENDOR_ID in self else 0

    def guid(self, pid: int) -> Guid:
        return Guid(self._cursor(pid).bytes(16))

    def text(self, pid: int, longest: int) -> str:
        value = self.octets(pid, longest + 1)
        try:
            return value.split(b"\0", 1)[0].decode()
        except UnicodeDecodeError:
            raise MalformedError(f"text of parameter {pid:#06x} is not UTF-8") from None

    def octets(self, pid: int, longest: int) -> bytes:
        cursor = self._cursor(pid)
        length = cursor.u32()
        if length > longest:
            raise MalformedError(f"parameter {pid:#06x} has {length} bytes, at most {longest}")
        return cursor.bytes(length)

    def seconds(self, pid: int, default: float) -> float:
        """Read a duration, in seconds. The value that RTPS defines as infinite becomes infinity."""
        if pid not in self:
            return default
        whole, fraction = self._cursor(pid).read(Layout("iI"))
        return float("inf") if whole == _INFINITE_S else max(0.0, whole + fraction * 2.0**-32)

    def locators(self, pid: int) -> list[Address]:
        """The UDPv4 addresses in a parameter with locators."""
        found = []
        for value in self._values.get(pid, [])[:_MAX_LOCATORS]:
            cursor = value_cursor(value, self._little)
            kind, port = cursor.u32(), cursor.u32()
            address = cursor.bytes(_LOCATOR_BYTES - 8)
            if kind == _LOCATOR_KIND_UDP4 and 0 < port <= 0xFFFF and any(address[12:]):
                found.append((inet_ntoa(address[12:]), port))
        return found
