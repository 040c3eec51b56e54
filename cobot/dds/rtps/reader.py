"""The reading side of one topic: matched writers, order, acknowledgements (RTPS 2.2, 8.4.12).

A reliable reader answers heartbeats. If a later sample shows that a sample is missing, the reader requests
the missing one immediately, because some writers send heartbeats only every few seconds.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from functools import partial

from cobot.dds.rtps.announcements import EndpointAnnouncement
from cobot.dds.rtps.endpoint import RtpsEndpoint
from cobot.dds.rtps.errors import RtpsError
from cobot.dds.rtps.inbound import Inbound
from cobot.dds.rtps.parameters import Parameters, disposes
from cobot.dds.rtps.submessages import DataFragment
from cobot.dds.rtps.types import Address, Guid, Qos, Sample
from cobot.dds.rtps.wire import Wire
from cobot.dds.rtps.writer_proxy import Arrival, WriterProxy

_FAST_DDS = 0x010F
_SPACING_S = 0.003  # between acknowledgements to one writer, which may send a heartbeat with every sample
_ASK_AFTER_S = 0.002  # a missing sample may only be delayed; wait before requesting it
_ASK_AGAIN_S = (0.02, 1.0)  # first and longest interval
_FRAGMENTS_QUIET_S = 0.02  # request fragments if none has arrived for this time
_INTRODUCE_S = 0.1


class Reader(RtpsEndpoint[WriterProxy]):
    """The reading side of a topic. Made by `Participant.create_reader`; every public method may be called
    from any thread.
    """

    def __init__(self, wire: Wire, inbound: Inbound, announcement: EndpointAnnouncement) -> None:
        super().__init__(wire, announcement)
        self._inbound = inbound

    def close(self) -> None:
        with self._wire.lock:
            if self._closed:
                return
            self._closed = True
            for guid in list(self._proxies):
                self.unmatch(guid)

    def _take(self, proxy: WriterProxy, sequence: int, arrival: Arrival) -> None:
        """Process a sample. The samples of one writer arrive here in order."""
        raise NotImplementedError

    def _has_room(self, size: int) -> bool:
        """Whether a sample of this size can be accepted. A reliable sample that cannot be accepted stays
        unacknowledged, and is sent again.
        """
        return True

    # Messages from writers; the participant calls these with the lock held

    def match(self, guid: bytes, address: Address, qos: Qos, vendor: int) -> None:
        """Register a discovered writer, or a new address of a known one."""
        known = self._proxies.get(guid)
        if known is not None:
            known.address = address
            return
        proxy = WriterProxy(
            self._inbound, self._header, self.guid.entity, guid, address, vendor,
            reliable=self.qos.reliable and qos.reliable,
        )  # fmt: skip
        self._proxies[guid] = proxy
        if proxy.reliable:
            proxy.interval_s = _INTRODUCE_S
            self._introduce(proxy)

    def unmatch(self, guid: bytes) -> None:
        proxy = self._proxies.pop(guid, None)
        if proxy is not None:
            self._inbound.clear(proxy)

    def on_data(self, guid: bytes, sequence: int, arrival: Arrival) -> None:
        proxy = self._proxies.get(guid)
        if proxy is not None:
            self._on_arrival(proxy, sequence, arrival)

    def _on_arrival(self, proxy: WriterProxy, sequence: int, arrival: Arrival) -> None:
        if not proxy.expects(sequence):
            return
        if not self._has_room(arrival.size):
            self._wire.statistics.refused += 1
            proxy.last = max(proxy.last, sequence)
        else:
            for number, ready in proxy.accept(sequence, arrival):
                proxy.interval_s = 0.0
                self._take(proxy, number, ready)
        if proxy.reliable and proxy.heard and not proxy.complete:
            again_s = proxy.acknowledged_s + proxy.interval_s - time.monotonic()
            self._acknowledge_in(proxy, max(_ASK_AFTER_S, again_s))

    def on_fragment(
        self, guid: bytes, sequence: int, fragment: DataFragment, arrival: Arrival, piece: memoryview
    ) -> None:
        """Process a fragment of a sample. `arrival` does not contain the payload yet."""
        proxy = self._proxies.get(guid)
        if proxy is None or not proxy.expects(sequence):
            return
        now_s = time.monotonic()
        assembly = proxy.assemble(sequence, fragment, arrival.inline, piece, now_s)
        if assembly is not None:
            arrival.payload, arrival.inline = assembly.payload(), assembly.inline
            self._on_arrival(proxy, sequence, arrival)
            return
        self._drain(proxy)
        if proxy.reliable and proxy.heard:
            proxy.interval_s = 0.0
            self._acknowledge_in(proxy, _FRAGMENTS_QUIET_S)

    def on_gap(self, guid: bytes, start: int, base: int, members: list[int]) -> None:
        proxy = self._proxies.get(guid)
        if proxy is not None and proxy.reliable:
            proxy.skip(start, base, members)
            self._drain(proxy)

    def on_heartbeat(self, guid: bytes, first: int, last: int, *, final: bool) -> None:
        proxy = self._proxies.get(guid)
        if proxy is None or not proxy.reliable:
            return
        if not proxy.heard:
            proxy.heard = True
            proxy.interval_s = 0.0
        proxy.announce(last)
        proxy.begin_at(first)
        self._drain(proxy)
        if not proxy.complete:
            self._acknowledge_in(proxy, _ASK_AFTER_S)
        elif not final:
            self._acknowledge_in(proxy, 0.0)

    def on_heartbeat_fragment(self, guid: bytes, sequence: int) -> None:
        """Record that a sample is being sent. It is not answered, because some writers report this with every
        fragment.
        """
        proxy = self._proxies.get(guid)
        if proxy is not None and proxy.reliable and proxy.heard and proxy.expects(sequence):
            proxy.last = max(proxy.last, sequence)
            self._acknowledge_in(proxy, _FRAGMENTS_QUIET_S)

    def _drain(self, proxy: WriterProxy) -> None:
        for number, ready in proxy.drain():
            proxy.interval_s = 0.0
            self._take(proxy, number, ready)

    # Answers

    def _introduce(self, proxy: WriterProxy) -> None:
        """Keep requesting the first heartbeat until it arrives, because the writer may not know this reader
        yet.

        Fast DDS answers a request with base 0 immediately, and any other request up to 3 s later.
        """
        if proxy.heard or self._proxies.get(proxy.guid) is not proxy:
            return
        base = 0 if proxy.vendor == _FAST_DDS else 1
        self._wire.send(proxy.introduction(base), proxy.address)
        self._wire.later(proxy.interval_s, partial(self._introduce, proxy))
        proxy.interval_s = min(1.5 * proxy.interval_s, _ASK_AGAIN_S[1])

    def _acknowledge_in(self, proxy: WriterProxy, delay_s: float) -> None:
        """Acknowledge after `delay_s`, or earlier if an acknowledgement is already scheduled, but not too
        often.
        """
        now_s = time.monotonic()
        spacing_s = _ASK_AGAIN_S[0] if proxy.interval_s else _SPACING_S
        due_s = max(now_s + delay_s, proxy.acknowledged_s + spacing_s)
        if due_s >= proxy.acknowledge_at_s:
            return
        proxy.acknowledge_at_s = due_s
        if due_s <= now_s:
            self._acknowledge(proxy)
        else:
            self._wire.later(due_s - now_s, partial(self._acknowledge, proxy))

    def _acknowledge(self, proxy: WriterProxy) -> None:
        now_s = time.monotonic()
        if now_s < proxy.acknowledge_at_s or self._proxies.get(proxy.guid) is not proxy:
            return
        proxy.acknowledge_at_s = float("inf")
        if now_s - proxy.quiet_since_s() < _FRAGMENTS_QUIET_S:
            # More fragments are in transit. If they were requested now, they would arrive twice.
            proxy.acknowledge_at_s = now_s + _FRAGMENTS_QUIET_S
            self._wire.later(_FRAGMENTS_QUIET_S, partial(self._acknowledge, proxy))
            return
        self._wire.send(proxy.acknowledgement(), proxy.address)
        proxy.acknowledged_s = now_s
        if proxy.complete:
            proxy.interval_s = 0.0
        else:
            fastest, slowest = _ASK_AGAIN_S
            proxy.interval_s = min(max(fastest, 2 * proxy.interval_s), slowest)
            self._acknowledge_in(proxy, proxy.interval_s)


class TopicReader(Reader):
    """A reader that passes its samples to a callback on the participant's delivery thread.

    At most `depth` samples wait for the callback; newer ones replace the oldest. Without a depth, a reliable
    writer must wait while `ParticipantLimits.undelivered` bytes wait for the callback.
    """

    def __init__(
        self,
        wire: Wire,
        inbound: Inbound,
        announcement: EndpointAnnouncement,
        on_sample: Callable[[Sample], None],
        deliver: Callable[[Callable[[], None]], None],
        on_close: Callable[[TopicReader], None],
    ) -> None:
        super().__init__(wire, inbound, announcement)
        self._on_sample = on_sample
        self._deliver = deliver
        self._on_close = on_close
        self._waiting: deque[Sample] = deque()
        self._waiting_bytes = 0
        self._scheduled = False

    def close(self) -> None:
        """Close the reader. No callback begins after this call, but a running callback may continue."""
        with self._wire.lock:
            if self._closed:
                return
            super().close()
            self._waiting.clear()
            self._on_close(self)

    def _has_room(self, size: int) -> bool:
        most = self._wire.limits.undelivered
        return self.qos.depth is not None or not self._waiting or self._waiting_bytes + size <= most

    def _take(self, proxy: WriterProxy, sequence: int, arrival: Arrival) -> None:
        if arrival.payload is None or disposes(arrival.inline):
            return  # a change of an instance; topics here have no keys and so no instances
        sample = Sample(
            arrival.payload, Guid(proxy.guid), sequence, arrival.related, arrival.time_s, arrival.vendor
        )
        self._waiting.append(sample)
        self._waiting_bytes += arrival.size
        if self.qos.depth is not None:
            self._push_out(self.qos.depth)
        if not self._scheduled:
            self._scheduled = True
            self._deliver(self._deliver_one)

    def _push_out(self, depth: int) -> None:
        most = self._wire.limits.undelivered
        while len(self._waiting) > depth or (self._waiting_bytes > most and len(self._waiting) > 1):
            self._waiting_bytes -= len(self._waiting.popleft().payload)
            self._wire.statistics.overrun += 1

    def _deliver_one(self) -> None:
        with self._wire.lock:
            if self._closed:
                return
            sample = self._waiting.popleft()
            self._waiting_bytes -= len(sample.payload)
            self._scheduled = bool(self._waiting)
            if self._scheduled:
                self._deliver(self._deliver_one)  # takes turns with the other readers
        self._on_sample(sample)


class BuiltinReader(Reader):
    """A reader of discovery data. The network thread processes its samples immediately.

    on_announcement(prefix of the sender, payload, inline QoS)
    """

    def __init__(
        self,
        wire: Wire,
        inbound: Inbound,
        announcement: EndpointAnnouncement,
        on_announcement: Callable[[bytes, bytes, Parameters | None], None],
    ) -> None:
        super().__init__(wire, inbound, announcement)
        self._on_announcement = on_announcement

    def _take(self, proxy: WriterProxy, sequence: int, arrival: Arrival) -> None:
        try:
            self._on_announcement(proxy.guid[:12], arrival.payload or b"", arrival.inline)
        except RtpsError:
            self._wire.statistics.malformed += 1
