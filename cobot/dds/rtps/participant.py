"""A DDS participant in pure Python. It exchanges bytes on topics as ROS 2 nodes do (RTPS 2.2 over UDP and
IPv4).

One thread serves the sockets and timers, and a second thread runs the callbacks. `Writer.write` sends from
the calling thread. Slow callbacks do not disturb the protocol, but all callbacks of a participant share one
thread. Code that waits for a long time must therefore not run in a callback.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from cobot.dds.rtps import submessages
from cobot.dds.rtps.announcements import (
    LEASE_S,
    PARTICIPANT_WRITER,
    EndpointAnnouncement,
    ParticipantAnnouncement,
)
from cobot.dds.rtps.delivery import Delivery
from cobot.dds.rtps.discovery import Discovery
from cobot.dds.rtps.errors import ClosedError, MalformedError
from cobot.dds.rtps.inbound import Inbound
from cobot.dds.rtps.parameters import read_identity
from cobot.dds.rtps.participant_record import ParticipantRecord
from cobot.dds.rtps.reader import Reader, TopicReader
from cobot.dds.rtps.submessages import Submessage, SubmessageKind
from cobot.dds.rtps.types import (
    PARTICIPANT_ENTITY,
    UNKNOWN_ENTITY,
    Guid,
    ParticipantLimits,
    ParticipantStatistics,
    Qos,
    RemoteEndpoint,
    RemoteParticipant,
    Sample,
)
from cobot.dds.rtps.wire import Wire
from cobot.dds.rtps.writer import Writer
from cobot.dds.rtps.writer_proxy import Arrival

_KEYLESS_WRITER, _KEYLESS_READER = 0x03, 0x04
_DEFAULT_LIMITS = ParticipantLimits()


class Participant:
    """A member of a DDS domain.

    Args:
        interfaces: names or IPv4 addresses of the interfaces to use and announce; None means all except
            loopback, including interfaces that come up later.
        localhost_only: whether to communicate only on this computer, as with ROS_LOCALHOST_ONLY.
        peers: IPv4 addresses of computers that multicast does not reach; their first participants get
            announcements.
        name: entity name that other participants may show.
        user_data: user data, which for ROS contains the enclave.
        on_change: called on the delivery thread after `discovered()` or `participants()` has changed.
        loss: a test's model of a bad network. It is called once for each datagram in either direction, and
            returns True to drop the datagram.

    Raises (constructor):
        NetworkError: an interface or a free port is missing.
    """

    # There are many parameters, because these are all the settings of DDS. Most have defaults.
    def __init__(
        self,
        domain_id: int = 0,
        interfaces: Sequence[str] | None = None,
        localhost_only: bool = False,
        peers: Sequence[str] = (),
        name: str = "",
        user_data: bytes = b"enclave=/;",
        *,
        limits: ParticipantLimits = _DEFAULT_LIMITS,
        on_change: Callable[[], None] | None = None,
        loss: Callable[[], bool] | None = None,
    ) -> None:
        self._wire = Wire(domain_id, interfaces, localhost_only, peers, limits, loss)
        self._lock = self._wire.lock
        # The prefix begins with the vendor, as the specification suggests. All other bytes are random.
        self._prefix = submessages.VENDOR.to_bytes(2, "big") + os.urandom(10)
        self.guid = Guid(self._prefix + PARTICIPANT_ENTITY)
        self._inbound = Inbound(limits, self._wire.statistics)
        self._delivery = Delivery(self._wire.statistics)
        self._on_change = on_change
        self._change_is_due = False
        self._closed = False
        self._domain_id = domain_id
        self._entity_numbers = itertools.count(1)
        announcement = ParticipantAnnouncement(
            guid=self.guid,
            domain_id=domain_id,
            name=name,
            user_data=user_data,
            vendor=submessages.VENDOR,
            lease_s=LEASE_S,
        )
        self._discovery = Discovery(self._wire, self._inbound, announcement, self._schedule_notice)
        self._delivery.start()
        with self._lock:
            self._wire.start(self._on_datagram)
            self._discovery.start()

    def create_writer(
        self,
        topic: str,
        type_name: str,
        qos: Qos,
        user_data: bytes = b"",
        accepts: Callable[[RemoteEndpoint], bool] | None = None,
        *,
        lifespan_s: float = math.inf,
    ) -> Writer:
        """A writer of a keyless topic, announced to all participants immediately.

        accepts: decides whether to write for a matching reader; with None, the writer writes for each.
        lifespan_s: age after which a lost sample is not repeated, s. Readers do not learn of it, because
            their clocks may differ.
        """
        with self._lock:
            guid = self._new_guid(_KEYLESS_WRITER)
            announcement = EndpointAnnouncement(guid, topic, type_name, qos, user_data)
            writer = Writer(self._wire, announcement, self._discovery.remove, accepts, lifespan_s=lifespan_s)
            self._discovery.add(writer)
            return writer

    def create_reader(
        self,
        topic: str,
        type_name: str,
        qos: Qos,
        on_sample: Callable[[Sample], None],
        user_data: bytes = b"",
    ) -> TopicReader:
        """Create a reader of a keyless topic. The delivery thread passes each sample to `on_sample`. The
        samples of one writer arrive in order.
        """
        with self._lock:
            guid = self._new_guid(_KEYLESS_READER)
            announcement = EndpointAnnouncement(guid, topic, type_name, qos, user_data)
            reader = TopicReader(
                self._wire, self._inbound, announcement, on_sample, self._delivery.put, self._discovery.remove
            )
            self._discovery.add(reader)
            return reader

    def discovered(self) -> list[RemoteEndpoint]:
        """The writers and readers of all other participants, on any topic."""
        with self._lock:
            return self._discovery.remotes

    def participants(self) -> list[RemoteParticipant]:
        """All other participants in the domain."""
        with self._lock:
            return self._discovery.participants

    @property
    def multicast(self) -> bool:
        """Whether discovery can use multicast. If not, only the first participants on this computer and the
        configured peers find this participant.
        """
        return self._wire.has_multicast

    @property
    def statistics(self) -> ParticipantStatistics:
        """A copy of the participant's counters."""
        with self._lock:
            return replace(self._wire.statistics)

    def record_in(self, participant_record: ParticipantRecord) -> None:
        """Record the data with which a successor can announce the end of this participant. The successor
        needs this data if this process is killed.
        """
        with self._lock:
            interfaces = [str(interface.ip) for interface in self._wire.interfaces]
            participant_record.write(self.guid, self._domain_id, interfaces, self._wire.told_one_by_one)

    def close(self) -> None:
        """Announce the end of this participant to all peers, and end its threads. This may be called
        twice.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._discovery.leave()
        self._wire.close()
        self._delivery.close()

    def _new_guid(self, kind: int) -> Guid:
        if self._closed:
            raise ClosedError("the participant was closed")
        number = next(self._entity_numbers) & 0xFFFFFF
        return Guid(self._prefix + number.to_bytes(3, "big") + bytes((kind,)))

    def _schedule_notice(self) -> None:
        """Schedule a single notification for all changes that happen before it runs."""
        if self._on_change is not None and not self._change_is_due:
            self._change_is_due = True
            self._delivery.put(self._tell_change)

    def _tell_change(self) -> None:
        with self._lock:
            self._change_is_due = False
        if self._on_change is not None:
            self._on_change()

    # Datagrams; called with the lock held

    def _on_datagram(self, datagram: memoryview, heard_from: str) -> None:
        try:
            self._interpret(datagram, heard_from)
        except MalformedError:
            self._wire.statistics.malformed += 1

    def _interpret(self, datagram: memoryview, heard_from: str) -> None:
        """Process a datagram. The receiver's state between submessages is local to this function (RTPS 2.2,
        8.3.4).
        """
        source, cursor = submessages.read_header(datagram)
        if source.prefix == self._prefix:
            return
        self._discovery.note_message(source.prefix)
        for_us = True
        time_s: float | None = None
        for message in submessages.read_submessages(cursor):
            if message.kind == SubmessageKind.INFO_DST:
                destination = message.body.bytes(12)
                for_us = destination == self._prefix or not any(destination)
            elif message.kind == SubmessageKind.INFO_TS:
                time_s = submessages.read_time(message)
            elif message.kind == SubmessageKind.INFO_SRC:
                source = submessages.read_source(message)
            elif not for_us:
                continue
            elif message.kind in (SubmessageKind.DATA, SubmessageKind.DATA_FRAG):
                self._on_data(message, source, time_s, heard_from)
            elif message.kind in (SubmessageKind.ACKNACK, SubmessageKind.NACK_FRAG):
                self._on_answer(message, source.prefix)
            elif message.kind in (
                SubmessageKind.HEARTBEAT,
                SubmessageKind.HEARTBEAT_FRAG,
                SubmessageKind.GAP,
            ):
                self._on_news(message, source.prefix)

    def _on_data(
        self, message: Submessage, source: submessages.RtpsHeader, time_s: float | None, heard_from: str
    ) -> None:
        data = submessages.read_data(message)
        if data.writer == PARTICIPANT_WRITER:
            payload = None if data.payload is None else data.payload.tobytes()
            self._discovery.on_participant(source.prefix, payload, data.inline, heard_from)
            return
        readers = self._readers(data.reader)
        if not readers:
            return
        guid = source.prefix + data.writer
        related = read_identity(data.inline, data.little) if data.inline else None
        arrival = Arrival(None, data.inline, related, time_s, source.vendor)
        if data.fragment is None:
            arrival.payload = None if data.payload is None else data.payload.tobytes()
            for reader in readers:
                reader.on_data(guid, data.sequence, arrival)
        elif data.payload is not None:
            for reader in readers:
                part = replace(arrival)
                reader.on_fragment(guid, data.sequence, data.fragment, part, data.payload)

    def _on_news(self, message: Submessage, prefix: bytes) -> None:
        entity, writer = submessages.read_pair(message)
        guid = prefix + writer
        readers = self._readers(entity)
        if message.kind == SubmessageKind.HEARTBEAT:
            first, last, final = submessages.read_heartbeat(message)
            for reader in readers:
                reader.on_heartbeat(guid, first, last, final=final)
        elif message.kind == SubmessageKind.GAP:
            start, base, members = submessages.read_gap(message)
            for reader in readers:
                reader.on_gap(guid, start, base, members)
        else:
            sequence, _ = submessages.read_heartbeat_fragment(message)
            for reader in readers:
                reader.on_heartbeat_fragment(guid, sequence)

    def _on_answer(self, message: Submessage, prefix: bytes) -> None:
        reader, entity = submessages.read_pair(message)
        self._discovery.note_acknowledgement(prefix)
        writer = self._discovery.writers.get(entity)
        if writer is None:
            return
        if message.kind == SubmessageKind.ACKNACK:
            base, missing, final = submessages.read_acknowledgement(message)
            writer.on_acknowledgement(prefix + reader, base, missing, final=final)
        else:
            writer.on_fragments_wanted(prefix + reader, *submessages.read_fragments_wanted(message))

    def _readers(self, entity: bytes) -> list[Reader]:
        """The addressed reader, or all readers if the submessage names none."""
        if entity == UNKNOWN_ENTITY:
            return list(self._discovery.readers.values())
        reader = self._discovery.readers.get(entity)
        return [] if reader is None else [reader]
