"""The announcements of participants and endpoints in discovery (RTPS 2.2, 8.5 and 9.6.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from struct import pack

from cobot.dds.rtps import submessages
from cobot.dds.rtps.errors import MalformedError
from cobot.dds.rtps.parameters import (
    ENCAPSULATION,
    SENTINEL,
    ParameterReader,
    Pid,
    disposal,
    duration,
    locator,
    octets,
    parameter,
    text,
)
from cobot.dds.rtps.types import PARTICIPANT_ENTITY, UNKNOWN_ENTITY, Address, Guid, Qos

PARTICIPANT_WRITER = bytes((0, 1, 0, 0xC2))

LEASE_S = 20.0
_DEFAULT_LEASE_S = 100.0  # for a participant that does not announce it (RTPS 2.2, table 9.13)
_MAX_NAME = 1024
_MAX_USER_DATA = 8192

_BEST_EFFORT, _RELIABLE = 1, 2
_VOLATILE, _TRANSIENT_LOCAL = 0, 1
_MAX_BLOCKING_S = 0.1
# The announcers and the detectors of participants, publications and subscriptions.
_BUILTIN_ENDPOINTS = 0x3F


@dataclass(frozen=True, slots=True)
class ParticipantAnnouncement:
    """A participant. `metatraffic` and `user` are all its UDPv4 addresses for discovery and for samples."""

    guid: Guid
    domain_id: int | None
    name: str
    user_data: bytes
    vendor: int
    lease_s: float
    metatraffic: tuple[Address, ...] = ()
    user: tuple[Address, ...] = ()


@dataclass(frozen=True, slots=True)
class EndpointAnnouncement:
    """A writer or reader. `addresses` are its addresses for samples; if empty, the addresses of the
    participant are used.
    """

    guid: Guid
    topic: str
    type_name: str
    qos: Qos
    user_data: bytes = b""
    addresses: tuple[Address, ...] = ()


def _common() -> bytes:
    return parameter(Pid.PROTOCOL_VERSION, bytes((2, 2))) + parameter(
        Pid.VENDOR_ID, submessages.VENDOR.to_bytes(2, "big")
    )


def pack_participant(announcement: ParticipantAnnouncement) -> bytes:
    parts = [
        ENCAPSULATION,
        _common(),
        parameter(Pid.PARTICIPANT_GUID, announcement.guid),
        *(parameter(Pid.METATRAFFIC_UNICAST_LOCATOR, locator(a)) for a in announcement.metatraffic),
        *(parameter(Pid.DEFAULT_UNICAST_LOCATOR, locator(a)) for a in announcement.user),
        parameter(Pid.LEASE_DURATION, duration(announcement.lease_s)),
        parameter(Pid.BUILTIN_ENDPOINTS, pack("<I", _BUILTIN_ENDPOINTS)),
        parameter(Pid.ENTITY_NAME, text(announcement.name)),
        parameter(Pid.USER_DATA, octets(announcement.user_data)),
        SENTINEL,
    ]
    if announcement.domain_id is not None:
        parts.insert(1, parameter(Pid.DOMAIN_ID, pack("<I", announcement.domain_id)))
    return b"".join(parts)


def read_participant(payload: bytes) -> ParticipantAnnouncement:
    values = ParameterReader(payload)
    guid = values.guid(Pid.PARTICIPANT_GUID)
    return ParticipantAnnouncement(
        guid=Guid(guid.prefix + PARTICIPANT_ENTITY),
        domain_id=values.u32(Pid.DOMAIN_ID, 0) if Pid.DOMAIN_ID in values else None,
        name=values.text(Pid.ENTITY_NAME, _MAX_NAME) if Pid.ENTITY_NAME in values else "",
        user_data=values.octets(Pid.USER_DATA, _MAX_USER_DATA) if Pid.USER_DATA in values else b"",
        vendor=values.vendor(),
        lease_s=values.seconds(Pid.LEASE_DURATION, _DEFAULT_LEASE_S),
        metatraffic=tuple(values.locators(Pid.METATRAFFIC_UNICAST_LOCATOR)),
        user=tuple(values.locators(Pid.DEFAULT_UNICAST_LOCATOR)),
    )


def pack_endpoint(announcement: EndpointAnnouncement) -> bytes:
    qos = announcement.qos
    reliability = pack("<I", _RELIABLE if qos.reliable else _BEST_EFFORT) + duration(_MAX_BLOCKING_S)
    durability = pack("<I", _TRANSIENT_LOCAL if qos.transient_local else _VOLATILE)
    guid = announcement.guid
    parts = [
        ENCAPSULATION,
        _common(),
        parameter(Pid.PARTICIPANT_GUID, guid.prefix + PARTICIPANT_ENTITY),
        parameter(Pid.ENDPOINT_GUID, guid),
        parameter(Pid.KEY_HASH, guid),
        parameter(Pid.TOPIC_NAME, text(announcement.topic)),
        parameter(Pid.TYPE_NAME, text(announcement.type_name)),
        *(parameter(Pid.UNICAST_LOCATOR, locator(address)) for address in announcement.addresses),
        parameter(Pid.RELIABILITY, reliability),
        parameter(Pid.DURABILITY, durability),
    ]
    if announcement.user_data:
        parts.append(parameter(Pid.USER_DATA, octets(announcement.user_data)))
    return b"".join((*parts, SENTINEL))


def read_endpoint(payload: bytes, *, writer: bool) -> EndpointAnnouncement:
    values = ParameterReader(payload)
    # A property that an endpoint does not announce has the default of its kind (DDS 1.4, 2.2.3).
    reliability = values.u32(Pid.RELIABILITY, _RELIABLE if writer else _BEST_EFFORT)
    durability = values.u32(Pid.DURABILITY, _VOLATILE)
    return EndpointAnnouncement(
        values.guid(Pid.ENDPOINT_GUID if Pid.ENDPOINT_GUID in values else Pid.KEY_HASH),
        values.text(Pid.TOPIC_NAME, _MAX_NAME),
        values.text(Pid.TYPE_NAME, _MAX_NAME),
        Qos(reliable=reliability > _BEST_EFFORT, transient_local=durability >= _TRANSIENT_LOCAL, depth=None),
        values.octets(Pid.USER_DATA, _MAX_USER_DATA) if Pid.USER_DATA in values else b"",
        tuple(values.locators(Pid.UNICAST_LOCATOR)),
    )


def pack_key(pid: Pid, guid: Guid) -> bytes:
    """The payload of a disposal, which consists of the key only."""
    return ENCAPSULATION + parameter(pid, guid) + SENTINEL


def read_key(payload: bytes) -> Guid:
    """Read the guid in the payload of a disposal."""
    values = ParameterReader(payload)
    for pid in (Pid.ENDPOINT_GUID, Pid.PARTICIPANT_GUID, Pid.KEY_HASH):
        if pid in values:
            return values.guid(pid)
    raise MalformedError("an announcement that a participant or endpoint has ended has no key")


def goodbye(participant: Guid) -> bytes:
    """The datagram that announces the end of a participant and all its endpoints."""
    key = pack_key(Pid.PARTICIPANT_GUID, participant)
    body = submessages.data(UNKNOWN_ENTITY, PARTICIPANT_WRITER, 2, disposal(participant), key, key=True)
    return submessages.protocol_header(participant.prefix) + body
