"""Finds participants and their endpoints, and matches compatible endpoints (RTPS 2.2, 8.5).

Participants announce themselves by multicast, and by unicast to those they have heard from. Endpoints are
announced over reliable built-in topics between every two participants. This module is long because it alone
decides which participants are peers, and which resources they may use.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial

from cobot.dds.rtps import submessages
from cobot.dds.rtps.announcements import (
    PARTICIPANT_WRITER,
    EndpointAnnouncement,
    ParticipantAnnouncement,
    goodbye,
    pack_endpoint,
    pack_key,
    pack_participant,
    read_endpoint,
    read_key,
    read_participant,
)
from cobot.dds.rtps.errors import MalformedError
from cobot.dds.rtps.inbound import Inbound
from cobot.dds.rtps.network import reachable
from cobot.dds.rtps.parameters import Parameters, Pid, disposal, disposes
from cobot.dds.rtps.reader import BuiltinReader, Reader, TopicReader
from cobot.dds.rtps.types import (
    UNKNOWN_ENTITY,
    Address,
    Guid,
    Qos,
    RemoteEndpoint,
    RemoteParticipant,
)
from cobot.dds.rtps.wire import Wire
from cobot.dds.rtps.writer import Writer

_PUBLICATIONS_WRITER, _PUBLICATIONS_READER = bytes((0, 0, 3, 0xC2)), bytes((0, 0, 3, 0xC7))
_SUBSCRIPTIONS_WRITER, _SUBSCRIPTIONS_READER = bytes((0, 0, 4, 0xC2)), bytes((0, 0, 4, 0xC7))
_LIVELINESS_WRITER, _LIVELINESS_READER = bytes((0, 2, 0, 0xC2)), bytes((0, 2, 0, 0xC7))

_BUILTIN_QOS = Qos(reliable=True, transient_local=True, depth=None)
_ANNOUNCE_FIRST = 5  # number of announcements in quick succession, because one may be lost
_ANNOUNCE_FIRST_S = 0.1
_ANNOUNCE_S = 3.0
_GREETINGS = 30
_GREET_S = 0.1
_MAX_LEASE_S = 300.0
_SILENT_S = 10.0  # if the table is full, a peer heard from within this time is not replaced


@dataclass(slots=True)
class _Remote:
    """An endpoint of a peer, and the address for its samples."""

    public: RemoteEndpoint
    address: Address


@dataclass(slots=True)
class _Peer:
    """A discovered participant.

    Attributes:
        metatraffic, user: addresses of the peer for discovery and for samples.
        lease_s: time without a message after which the peer is removed.
        heard_s: time of the peer's last message, on the monotonic clock.
        knows_us: whether the peer has acknowledged our discovery messages.
        endpoints: writers and readers of the peer by GUID.
    """

    public: RemoteParticipant
    metatraffic: Address
    user: Address
    lease_s: float
    heard_s: float
    knows_us: bool = False
    endpoints: dict[bytes, _Remote] = field(default_factory=dict)


def _terms(endpoint: RemoteEndpoint) -> tuple[str, str, Qos]:
    """The properties of an endpoint that decide which other endpoints match it."""
    return endpoint.topic, endpoint.type_name, endpoint.qos


class Discovery:
    """Discovery for one participant. The caller of any method must hold the wire's lock."""

    def __init__(
        self,
        wire: Wire,
        inbound: Inbound,
        announcement: ParticipantAnnouncement,
        on_change: Callable[[], None],
    ) -> None:
        self._wire = wire
        self._announcement = announcement
        self._prefix = announcement.guid.prefix
        self._header = submessages.protocol_header(self._prefix)
        self._on_change = on_change
        self._peers: dict[bytes, _Peer] = {}
        self._announced = 0
        self._left = False
        self.writers: dict[bytes, Writer] = {}
        self.readers: dict[bytes, Reader] = {}

        def builtin(entity: bytes) -> EndpointAnnouncement:
            return EndpointAnnouncement(Guid(self._prefix + entity), "", "", _BUILTIN_QOS)

        def writer(entity: bytes) -> Writer:
            made = self.writers[entity] = Writer(wire, builtin(entity), gathers=True)
            return made

        def reader(
            entity: bytes, on_announcement: Callable[[bytes, bytes, Parameters | None], None]
        ) -> Reader:
            made = BuiltinReader(wire, inbound, builtin(entity), on_announcement)
            self.readers[entity] = made
            return made

        self._publications = writer(_PUBLICATIONS_WRITER)
        self._subscriptions = writer(_SUBSCRIPTIONS_WRITER)
        self._builtin_writers = {
            _PUBLICATIONS_READER: self._publications,
            _SUBSCRIPTIONS_READER: self._subscriptions,
            # This writer sends nothing, because our endpoints have no leases. However, Fast DDS requests data
            # from the writer until the writer answers.
            _LIVELINESS_READER: writer(_LIVELINESS_WRITER),
        }
        self._builtin_readers = {
            _PUBLICATIONS_WRITER: reader(_PUBLICATIONS_READER, partial(self._on_endpoint, True)),
            _SUBSCRIPTIONS_WRITER: reader(_SUBSCRIPTIONS_READER, partial(self._on_endpoint, False)),
        }

    def start(self) -> None:
        self._announce_repeatedly()
        self._expire_repeatedly()

    @property
    def remotes(self) -> list[RemoteEndpoint]:
        return [remote.public for peer in self._peers.values() for remote in peer.endpoints.values()]

    @property
    def participants(self) -> list[RemoteParticipant]:
        return [peer.public for peer in self._peers.values()]

    # Our own endpoints

    def add(self, endpoint: Writer | TopicReader) -> None:
        entity = endpoint.guid.entity
        if isinstance(endpoint, Writer):
            self.writers[entity] = endpoint
        else:
            self.readers[entity] = endpoint
        self._announcer(endpoint).write_keyed(pack_endpoint(endpoint.announcement), endpoint.guid)
        for peer in self._peers.values():
            for remote in peer.endpoints.values():
                self._match(endpoint, remote)

    def remove(self, endpoint: Writer | TopicReader) -> None:
        if self._left:
            return
        (self.writers if isinstance(endpoint, Writer) else self.readers).pop(endpoint.guid.entity, None)
        key = pack_key(Pid.ENDPOINT_GUID, endpoint.guid)
        self._announcer(endpoint).write_keyed(key, endpoint.guid, disposal(endpoint.guid), disposes=True)

    def _announcer(self, endpoint: Writer | TopicReader) -> Writer:
        return self._publications if isinstance(endpoint, Writer) else self._subscriptions

    def _match(self, endpoint: Writer | Reader, remote: _Remote) -> None:
        public = remote.public
        if (endpoint.topic, endpoint.type_name) != (public.topic, public.type_name):
            return
        if isinstance(endpoint, Writer):
            if public.kind == "reader" and endpoint.qos.satisfies(public.qos) and endpoint.accepts(public):
                endpoint.match(public.guid, remote.address, public.qos)
        elif public.kind == "writer" and public.qos.satisfies(endpoint.qos):
            endpoint.match(public.guid, remote.address, public.qos, public.participant.vendor)

    # Participants

    def _announce_repeatedly(self) -> None:
        self._wire.look_around()
        self._wire.multicast(self._participant_datagram())
        for peer in self._peers.values():
            self._wire.send(self._participant_datagram(), peer.metatraffic)
        self._announced += 1
        first = self._announced < _ANNOUNCE_FIRST
        self._wire.later(_ANNOUNCE_FIRST_S if first else _ANNOUNCE_S, self._announce_repeatedly)

    def _participant_datagram(self) -> bytes:
        wire = self._wire
        told = replace(self._announcement, metatraffic=tuple(wire.metatraffic), user=tuple(wire.user))
        payload = pack_participant(told)
        body = submessages.data(UNKNOWN_ENTITY, PARTICIPANT_WRITER, 1, b"", payload, key=False)
        return self._header + submessages.info_time(time.time()) + body

    def leave(self) -> None:
        """Announce to all peers that this participant and its endpoints are gone."""
        self._left = True
        endpoints: list[Writer | Reader] = [*self.writers.values(), *self.readers.values()]
        for endpoint in endpoints:
            endpoint.close()
        datagram = goodbye(self._announcement.guid)
        self._wire.multicast(datagram)
        for peer in self._peers.values():
            self._wire.send(datagram, peer.metatraffic)

    def note_message(self, prefix: bytes) -> None:
        """Record a message, which proves that its sender is alive."""
        peer = self._peers.get(prefix)
        if peer is not None:
            peer.heard_s = time.monotonic()

    def note_acknowledgement(self, prefix: bytes) -> None:
        peer = self._peers.get(prefix)
        if peer is not None:
            peer.knows_us = True

    def on_participant(
        self, prefix: bytes, payload: bytes | None, inline: Parameters | None, heard_from: str
    ) -> None:
        """Process a participant's announcement that it exists or has ended."""
        if disposes(inline):
            self._drop(prefix)
            return
        announcement = read_participant(payload or b"")
        if announcement.guid.prefix != prefix:
            raise MalformedError("a participant announces another participant")
        if announcement.domain_id not in (None, self._announcement.domain_id):
            return
        metatraffic = reachable(list(announcement.metatraffic), heard_from, self._wire.interfaces)
        if metatraffic is None:
            return  # it offers no address for UDP over IPv4
        user = reachable(list(announcement.user), heard_from, self._wire.interfaces) or metatraffic
        peer = self._peers.get(prefix)
        if peer is None:
            self._meet(announcement, metatraffic, user)
            return
        peer.lease_s = min(announcement.lease_s, _MAX_LEASE_S)
        if (peer.metatraffic, peer.user) != (metatraffic, user):
            for remote in peer.endpoints.values():
                remote.address = user if remote.address == peer.user else remote.address
            peer.metatraffic, peer.user = metatraffic, user
            self._match_all(peer)

    def _meet(self, announcement: ParticipantAnnouncement, metatraffic: Address, user: Address) -> None:
        if not self._has_room():
            self._wire.statistics.refused += 1
            return
        public = RemoteParticipant(
            announcement.guid, announcement.name, announcement.user_data, announcement.vendor
        )
        lease_s = min(announcement.lease_s, _MAX_LEASE_S)
        peer = _Peer(public, metatraffic, user, lease_s, time.monotonic())
        self._peers[public.guid.prefix] = peer
        self._greet(peer, _GREETINGS)
        self._match_all(peer)
        self._on_change()

    def _has_room(self) -> bool:
        if len(self._peers) < self._wire.limits.participants:
            return True
        silent = min(self._peers.values(), key=lambda peer: peer.heard_s)
        if time.monotonic() - silent.heard_s < _SILENT_S:
            return False
        self._drop(silent.public.guid.prefix)
        return True

    def _greet(self, peer: _Peer, times: int) -> None:
        """Repeat our announcement until the peer answers. When the peer sent its first announcement, it may
        not have been listening yet.
        """
        if peer.knows_us or not times or self._peers.get(peer.public.guid.prefix) is not peer:
            return
        self._wire.send(self._participant_datagram(), peer.metatraffic)
        self._wire.later(_GREET_S, partial(self._greet, peer, times - 1))

    def _match_all(self, peer: _Peer) -> None:
        prefix = peer.public.guid.prefix
        for entity, writer in self._builtin_writers.items():
            writer.match(prefix + entity, peer.metatraffic, _BUILTIN_QOS)
        for entity, reader in self._builtin_readers.items():
            reader.match(prefix + entity, peer.metatraffic, _BUILTIN_QOS, peer.public.vendor)
        for remote in peer.endpoints.values():
            self._match_remote(remote)

    def _expire_repeatedly(self) -> None:
        now_s = time.monotonic()
        for prefix in [p for p, peer in self._peers.items() if now_s - peer.heard_s > peer.lease_s]:
            self._drop(prefix)
        self._wire.later(1.0, self._expire_repeatedly)

    def _drop(self, prefix: bytes) -> None:
        peer = self._peers.pop(prefix, None)
        if peer is None:
            return
        for remote in peer.endpoints.values():
            self._unmatch(remote)
        for entity, writer in self._builtin_writers.items():
            writer.unmatch(prefix + entity)
        for entity, reader in self._builtin_readers.items():
            reader.unmatch(prefix + entity)
        self._on_change()

    # Endpoints of others

    def _on_endpoint(self, is_writer: bool, prefix: bytes, payload: bytes, inline: Parameters | None) -> None:
        peer = self._peers[prefix]
        if disposes(inline):
            hashes = (inline or {}).get(Pid.KEY_HASH)
            guid = Guid(hashes[0][:16]) if hashes else read_key(payload)
            gone = peer.endpoints.pop(guid, None)
            if gone is not None:
                self._unmatch(gone)
                self._on_change()
            return
        announcement = read_endpoint(payload, writer=is_writer)
        guid = announcement.guid
        if guid.prefix != prefix:
            raise MalformedError("a participant announces an endpoint of another participant")
        if guid not in peer.endpoints and not self._has_room_for_endpoint(peer):
            self._wire.statistics.refused += 1
            return
        public = RemoteEndpoint(
            guid=guid,
            kind="writer" if is_writer else "reader",
            topic=announcement.topic,
            type_name=announcement.type_name,
            qos=announcement.qos,
            user_data=announcement.user_data,
            participant=peer.public,
        )
        own = list(announcement.addresses)
        address = reachable(own, peer.user[0], self._wire.interfaces) or peer.user
        before = peer.endpoints.get(guid)
        if before is not None and _terms(before.public) != _terms(public):
            self._unmatch(before)
        remote = peer.endpoints[guid] = _Remote(public, address)
        self._match_remote(remote)
        self._on_change()

    def _has_room_for_endpoint(self, peer: _Peer) -> bool:
        limits = self._wire.limits
        return (
            len(peer.endpoints) < limits.endpoints_per_participant
            and sum(len(other.endpoints) for other in self._peers.values()) < limits.endpoints
        )

    def _match_remote(self, remote: _Remote) -> None:
        for endpoint in self._counterparts(remote):
            self._match(endpoint, remote)

    def _unmatch(self, remote: _Remote) -> None:
        for endpoint in self._counterparts(remote):
            endpoint.unmatch(remote.public.guid)

    def _counterparts(self, remote: _Remote) -> list[Writer | Reader]:
        if remote.public.kind == "writer":
            return list(self.readers.values())
        return list(self.writers.values())
