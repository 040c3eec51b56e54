"""The writing side of one topic: history, readers, acknowledgements, retransmission (RTPS 2.2, 8.4.9).

Samples are sent immediately with a final heartbeat, which requests an answer only if something is missing. A
timer, which runs only while something is unacknowledged, sends heartbeats that request an answer. Samples
larger than a datagram, and all repetitions, go through a queue per reader. They are sent in bursts that do
not overflow the receiver's socket buffer, and small samples share a datagram. Discovery sends everything
through this queue: hundreds of endpoints fit into a few datagrams.

In this module only `write` and `close` acquire `Wire.lock`; all other methods are called with it held.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from functools import partial

from cobot.dds.rtps import submessages
from cobot.dds.rtps.announcements import EndpointAnnouncement
from cobot.dds.rtps.endpoint import RtpsEndpoint
from cobot.dds.rtps.errors import ClosedError, SampleTooLargeError
from cobot.dds.rtps.history import Change, History
from cobot.dds.rtps.network import LOOPBACK
from cobot.dds.rtps.number_sets import MAX_BITS
from cobot.dds.rtps.parameters import related_identity
from cobot.dds.rtps.reader_proxy import (
    FIRST_HEARTBEAT_S,
    MAX_HEARTBEAT_S,
    MAX_PIECE,
    ReaderProxy,
    pieces,
)
from cobot.dds.rtps.types import Address, Guid, Qos, RemoteEndpoint, SampleIdentity
from cobot.dds.rtps.wire import Wire

_BURST_BYTES = 2 * MAX_PIECE  # three of these fill the usual receive buffer of 208 KiB
_BETWEEN_BURSTS_S = 0.001
_GATHERED_BYTES = 1_300  # small samples in one datagram: an Ethernet frame, so that losses are small
_GATHERED_HERE_BYTES = 16_000  # the maximum within this computer, where there are no frames
_GATHER_S = 0.002
_HELD_S = 10.0


class Writer(RtpsEndpoint[ReaderProxy]):
    """The writer of one topic. Made by `Participant.create_writer`; every public method is thread safe."""

    def __init__(
        self,
        wire: Wire,
        announcement: EndpointAnnouncement,
        on_close: Callable[[Writer], None] | None = None,
        accepts: Callable[[RemoteEndpoint], bool] | None = None,
        *,
        gathers: bool = False,
        lifespan_s: float = math.inf,
    ) -> None:
        """
        Args:
            gathers: whether samples wait for others that are written at the same time.
            lifespan_s: age after which a lost sample is not repeated, s.
        """
        super().__init__(wire, announcement)
        self.accepts = accepts or (lambda reader: True)
        self._gathers, self._lifespan_s = gathers, lifespan_s
        self._entity = self.guid.entity
        self._on_close = on_close
        self._history = History(self.qos.depth, wire.limits)
        self._last = 0
        self._timer_s = float("inf")

    def write(self, payload: bytes, related: SampleIdentity | None = None, only: Guid | None = None) -> int:
        """Send one sample and return its sequence number, without waiting.

        payload: the serialised bytes with their 4-byte encapsulation header.
        only: the only reader to address. If it is not matched yet, the sample waits for it in the history, up
            to 10 s, because a client's reply reader may be discovered after its request.
        Errors: SampleTooLargeError above `ParticipantLimits.payload`; ClosedError.
        """
        most = self._wire.limits.payload
        if len(payload) > most:
            raise SampleTooLargeError(f"a sample on {self.topic!r} has {len(payload)} bytes, allowed: {most}")
        inline = related_identity(related) if related is not None else b""
        with self._wire.lock:
            if self._closed:
                raise ClosedError(f"the writer of {self.topic!r} was closed")
            return self._store(payload, inline, only=only)

    def write_keyed(self, payload: bytes, key: bytes, inline: bytes = b"", *, disposes: bool = False) -> int:
        """Send a sample of a keyed topic. It replaces the previous sample with the same key. Used by
        discovery; the caller must hold the lock.
        """
        return self._store(payload, inline, key=key, disposes=disposes)

    def close(self) -> None:
        with self._wire.lock:
            if self._closed:
                return
            self._closed = True
            self._proxies.clear()
            if self._on_close is not None:
                self._on_close(self)

    def _store(
        self,
        payload: bytes,
        inline: bytes,
        *,
        only: bytes | None = None,
        key: bytes | None = None,
        disposes: bool = False,
    ) -> int:
        self._last += 1
        change = Change(self._last, payload, inline, time.time(), only, key, disposes, time.monotonic())
        gone = self._history.add(change)
        if self.qos.depth is None:
            self._wire.statistics.overrun += gone
        for proxy in self._proxies.values():
            if proxy.wants(change):
                self._transmit(proxy, change)
            if proxy.reliable and proxy.due_s is None:
                proxy.interval_s = FIRST_HEARTBEAT_S
                self._arm(proxy)
        if not any(proxy.reliable for proxy in self._proxies.values()):
            self._release()
        return self._last

    # Sending

    def _transmit(self, proxy: ReaderProxy, change: Change) -> None:
        if self._gathers:
            proxy.enqueue(change, pieces(change))
            if not proxy.pumping:
                proxy.pumping = True
                self._wire.later(_GATHER_S, partial(self._pump, proxy))
        elif not proxy.queue and len(change.payload) <= MAX_PIECE:
            self._send_piece(proxy, change, 1, done=True, burst_ends=True)
        else:
            self._send_later(proxy, [(change, pieces(change))])

    def _send_later(self, proxy: ReaderProxy, wanted: Iterable[tuple[Change, range | list[int]]]) -> None:
        for change, fragments in wanted:
            proxy.enqueue(change, fragments)
        if proxy.queue and not proxy.pumping:
            proxy.pumping = True
            self._pump(proxy)

    def _pump(self, proxy: ReaderProxy) -> None:
        """Send one burst of the queue and schedule the next."""
        if self._proxies.get(proxy.guid) is not proxy:
            return
        left = _BURST_BYTES
        while proxy.queue and left > 0:
            together = self._take_small(proxy)
            if together:
                left -= self._send_together(proxy, together)
            elif proxy.queue:
                left = self._send_fragments(proxy, left)
        proxy.pumping = bool(proxy.queue)
        if not proxy.reliable:
            self._release()
        if proxy.pumping:
            self._wire.later(_BETWEEN_BURSTS_S, partial(self._pump, proxy))

    def _take_small(self, proxy: ReaderProxy) -> list[Change]:
        """Take small samples for one datagram from the queue. Samples that were replaced before sending began
        are dropped.
        """
        taken: list[Change] = []
        room = _GATHERED_HERE_BYTES if proxy.address[0] == LOOPBACK else _GATHERED_BYTES
        for change, fragments in list(proxy.queue.items()):
            whole = len(fragments) == len(pieces(change))
            if whole and change.sequence not in self._history:
                del proxy.queue[change]  # the next datagram reports the gap
                continue
            room -= len(change.payload)
            if len(change.payload) > MAX_PIECE or (taken and room < 0):
                break
            del proxy.queue[change]
            taken.append(change)
        return taken

    def _send_together(self, proxy: ReaderProxy, changes: list[Change]) -> int:
        """Send whole samples in one datagram. Returns the number of bytes."""
        body = b"".join(proxy.piece(change, 1) for change in changes)
        if proxy.reliable:
            body += self._heartbeat(proxy, final=True)
        self._wire.send(proxy.enveloped(body), proxy.address)
        return len(body)

    def _send_fragments(self, proxy: ReaderProxy, left: int) -> int:
        """Send fragments of the first sample in the queue. Returns the number of bytes remaining in the
        burst.
        """
        change, fragments = next(iter(proxy.queue.items()))
        while fragments and left > 0:
            piece = next(iter(fragments))
            del fragments[piece]
            left -= min(len(change.payload), MAX_PIECE)
            self._send_piece(proxy, change, piece, done=not fragments, burst_ends=left <= 0)
        if not fragments:
            del proxy.queue[change]
        return left

    def _send_piece(
        self, proxy: ReaderProxy, change: Change, piece: int, *, done: bool, burst_ends: bool
    ) -> None:
        datagram = proxy.enveloped(proxy.piece(change, piece))
        if proxy.reliable and done:
            datagram += self._heartbeat(proxy, final=True)
        elif proxy.reliable and burst_ends:
            datagram += proxy.heartbeat_fragment(change.sequence, piece)
        self._wire.send(datagram, proxy.address)

    def _heartbeat(self, proxy: ReaderProxy, *, final: bool) -> bytes:
        """A heartbeat that names the samples that this reader may request."""
        first = self._history.first(self._last + 1)
        if first <= proxy.joined:
            wanted = (change.sequence for change in self._history if proxy.wants(change))
            first = next(wanted, self._last + 1)
        proxy.heartbeat_s = time.monotonic()
        # Samples in the queue have not been sent, so no reader can miss them yet.
        return proxy.heartbeat(first, max(proxy.sent, first - 1), final=final)

    # Heartbeats while something is unacknowledged

    def _arm(self, proxy: ReaderProxy) -> None:
        due_s = proxy.due_s = time.monotonic() + proxy.interval_s
        if due_s < self._timer_s:
            self._timer_s = due_s
            self._wire.later(proxy.interval_s, self._on_timer)

    def _on_timer(self) -> None:
        now_s = time.monotonic()
        if now_s < self._timer_s:
            return  # superseded by an earlier timer
        self._timer_s = float("inf")
        for proxy in self._proxies.values():
            if proxy.due_s is None:
                continue
            if proxy.due_s <= now_s:
                if not proxy.queue:
                    self._send_heartbeat(proxy)
                    proxy.interval_s = min(2 * proxy.interval_s, MAX_HEARTBEAT_S)
                proxy.due_s = now_s + proxy.interval_s
            self._timer_s = min(self._timer_s, proxy.due_s)
        if self._timer_s < float("inf"):
            self._wire.later(self._timer_s - now_s, self._on_timer)

    def _send_heartbeat(self, proxy: ReaderProxy) -> None:
        skipped = proxy.skipped(self._last + 1)
        proxy.sent = max(proxy.sent, self._last)
        body = skipped + self._heartbeat(proxy, final=False)
        self._wire.send(proxy.enveloped(body), proxy.address)

    # Messages from readers; the participant calls these with the lock held

    def match(self, guid: bytes, address: Address, qos: Qos) -> None:
        """Register a discovered reader, or a new address of a known one."""
        known = self._proxies.get(guid)
        if known is not None:
            known.address = address
            return
        keeps = self.qos.transient_local and qos.transient_local
        joined = 0 if keeps else self._last
        reliable = self.qos.reliable and qos.reliable
        proxy = ReaderProxy(
            self._header, self._entity, guid, address, reliable=reliable, joined=joined, last=self._last
        )
        self._proxies[guid] = proxy
        wanted = [change for change in self._history if proxy.wants(change)]
        if wanted and not reliable:
            self._send_later(proxy, ((change, pieces(change)) for change in wanted))
        elif reliable and self._last:
            proxy.acknowledged = 0
            self._greet(proxy, wanted)

    def _greet(self, proxy: ReaderProxy, wanted: list[Change]) -> None:
        """Tell a new reliable reader which samples it may request. The reader requests these samples after it
        has discovered this writer.
        """
        first = wanted[0].sequence if wanted else self._last + 1
        before = submessages.gap(proxy.guid[12:], self._entity, 1, first) if first > 1 else b""
        self._wire.send(proxy.enveloped(before + self._heartbeat(proxy, final=False)), proxy.address)
        self._arm(proxy)

    def unmatch(self, guid: bytes) -> None:
        if self._proxies.pop(guid, None) is not None:
            self._release()

    def on_acknowledgement(self, guid: bytes, base: int, missing: list[int], *, final: bool) -> None:
        proxy = self._proxies.get(guid)
        if proxy is None or not proxy.reliable:
            return
        acknowledged = min(base - 1, proxy.sent)
        if acknowledged > proxy.acknowledged:
            proxy.acknowledged = acknowledged
            proxy.interval_s = FIRST_HEARTBEAT_S
            self._release()
        if proxy.acknowledged >= self._last:
            proxy.due_s = None
        if len(missing) == MAX_BITS and proxy.asked < missing[-1]:
            # The list of missing samples is full, so the reader also lacks all later samples.
            missing = list(range(missing[0], proxy.sent + 1))
            proxy.asked = proxy.sent
        if missing:
            self._repair(proxy, missing)
        elif not final and not proxy.queue and time.monotonic() - proxy.heartbeat_s >= FIRST_HEARTBEAT_S / 2:
            # The minimum interval prevents two eager sides from answering each other endlessly.
            self._send_heartbeat(proxy)

    def _repair(self, proxy: ReaderProxy, missing: list[int]) -> None:
        never, there = [], []
        for sequence in missing:
            change = self._repeatable(sequence)
            if sequence > proxy.sent:
                break
            if change is None or not proxy.wants(change):
                never.append(sequence)
            else:
                there.append((change, pieces(change)))
        self._send_later(proxy, there)
        if never:
            body = proxy.gaps(never) + self._heartbeat(proxy, final=True)
            self._wire.send(proxy.enveloped(body), proxy.address)

    def _repeatable(self, sequence: int) -> Change | None:
        """The change with this number; None if it has been removed or is too old."""
        change = self._history.get(sequence)
        is_old = change is not None and time.monotonic() - change.written_s > self._lifespan_s
        return None if is_old else change

    def on_fragments_wanted(self, guid: bytes, sequence: int, missing: list[int]) -> None:
        proxy = self._proxies.get(guid)
        if proxy is None or not proxy.reliable:
            return
        change = self._repeatable(sequence)
        if change is None or not proxy.wants(change):
            self._repair(proxy, [sequence])
            return
        there = pieces(change)
        wanted = [number for number in missing if number in there]
        if wanted:
            self._send_later(proxy, [(change, wanted)])

    def _release(self) -> None:
        """Remove samples that every reader has received. If the history has a depth, nothing is removed here,
        because the depth decides what is kept.
        """
        if self.qos.depth is not None or not len(self._history):
            return
        everywhere = min((proxy.passed for proxy in self._proxies.values()), default=self._last)
        held_since_s = time.monotonic() - _HELD_S
        done = []
        for change in self._history:
            if change.sequence > everywhere:
                break
            if (
                change.only is not None
                and change.only not in self._proxies
                and change.written_s > held_since_s
            ):
                continue
            if change.disposes or not self.qos.transient_local:
                done.append(change.sequence)
        self._history.remove(done)
