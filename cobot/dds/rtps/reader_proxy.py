"""The record that a writer keeps for a matched reader, and the datagrams for that reader."""

from __future__ import annotations

from collections.abc import Iterable

from cobot.dds.rtps import submessages
from cobot.dds.rtps.history import Change
from cobot.dds.rtps.types import Address

MAX_PIECE = 60_000
"""Maximum payload of a datagram, in bytes. Longer samples are divided into fragments of this size."""

FIRST_HEARTBEAT_S = 0.02
"""Time after which a heartbeat follows an unacknowledged sample, s. It doubles with each further
heartbeat.
"""

MAX_HEARTBEAT_S = 0.5


def pieces(change: Change) -> range:
    """The fragment numbers of a change; only 1 if it is sent as a whole."""
    return range(1, max(1, -(-len(change.payload) // MAX_PIECE)) + 1)


class ReaderProxy:
    """A matched reader.

    joined: number of a sample. The reader gets no samples up to this number, unless they are addressed to it.
    asked: all missing samples up to this number are being sent, because one request cannot name all of them.
    sent: highest number that was sent to the reader, declared irrelevant, or left for the reader to request.
    acknowledged: all samples up to this number have arrived.
    queue: the fragments that must be sent, as an ordered set of fragment numbers for each change.
    """

    __slots__ = (
        "_envelope", "_guid_entity", "_heartbeats", "_writer", "acknowledged", "address", "asked", "due_s",
        "guid", "heartbeat_s", "interval_s", "joined", "pumping", "queue", "reliable", "sent",
    )  # fmt: skip

    def __init__(
        self,
        header: bytes,
        writer: bytes,
        guid: bytes,
        address: Address,
        *,
        reliable: bool,
        joined: int,
        last: int,
    ) -> None:
        """
        Args:
            last: number of the writer's latest sample.
        """
        self._envelope = header + submessages.info_destination(guid[:12])
        self._writer = writer
        self._guid_entity = guid[12:]
        self._heartbeats = 0
        self.guid = guid
        self.address = address
        self.reliable = reliable
        self.joined = self.acknowledged = joined
        self.sent = last
        self.asked = 0
        self.queue: dict[Change, dict[int, None]] = {}
        self.pumping = False
        self.heartbeat_s = 0.0
        self.interval_s = FIRST_HEARTBEAT_S
        self.due_s: float | None = None

    def wants(self, change: Change) -> bool:
        if change.only is not None:
            return change.only == self.guid
        return change.sequence > self.joined

    def enqueue(self, change: Change, fragments: Iterable[int]) -> None:
        self.queue.setdefault(change, {}).update(dict.fromkeys(fragments))

    @property
    def passed(self) -> int:
        """The sequence number up to which the reader needs no more changes from the writer."""
        if self.reliable:
            return self.acknowledged
        return next(iter(self.queue)).sequence - 1 if self.queue else self.sent

    def piece(self, change: Change, piece: int) -> bytes:
        """One piece of a change, with the submessages that the reader needs before it."""
        arguments = self._guid_entity, self._writer, change.sequence, change.inline, change.payload
        if len(change.payload) <= MAX_PIECE:
            body = submessages.data(*arguments, key=change.disposes)
        else:
            body = submessages.data_fragment(*arguments, piece, MAX_PIECE)
        skipped = self.skipped(change.sequence)
        self.sent = max(self.sent, change.sequence)
        return skipped + submessages.info_time(change.time_s) + body

    def skipped(self, sequence: int) -> bytes:
        """A gap for samples that this reader must skip: those between the last sample sent and this one."""
        if not self.reliable or sequence <= self.sent + 1:
            return b""
        return submessages.gap(self._guid_entity, self._writer, self.sent + 1, sequence)

    def heartbeat(self, first: int, last: int, *, final: bool) -> bytes:
        self._heartbeats += 1
        return submessages.heartbeat(
            self._guid_entity, self._writer, first, last, self._heartbeats, final=final
        )

    def heartbeat_fragment(self, sequence: int, last: int) -> bytes:
        self._heartbeats += 1
        return submessages.heartbeat_fragment(
            self._guid_entity, self._writer, sequence, last, self._heartbeats
        )

    def gaps(self, sequences: list[int]) -> bytes:
        """GAP submessages for samples that will never be sent to this reader.

        Args:
            sequences: their sequence numbers, ascending.
        """
        made = b""
        while sequences:
            base = sequences[0]
            made += submessages.gap(self._guid_entity, self._writer, base, base + 1, sequences[1:])
            sequences = [number for number in sequences if number > base + 256]
        return made

    def enveloped(self, body: bytes) -> bytes:
        return self._envelope + body
