"""A reader's record of one matched writer: samples that have arrived, wait for others, or are incomplete."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from cobot.dds.rtps import submessages
from cobot.dds.rtps.inbound import BufferHolder, Inbound
from cobot.dds.rtps.number_sets import MAX_BITS
from cobot.dds.rtps.parameters import Parameters
from cobot.dds.rtps.reassembly import SampleAssembly
from cobot.dds.rtps.submessages import DataFragment
from cobot.dds.rtps.types import Address, SampleIdentity

_MAX_GAPS = 64
_MAX_REPAIRED = 8  # incomplete samples whose fragments are requested at once


@dataclass(slots=True)
class Arrival:
    """A complete sample that has not been made into a `Sample` yet. `payload` is None if it has no
    payload.
    """

    payload: bytes | None
    inline: Parameters | None
    related: SampleIdentity | None
    time_s: float | None
    vendor: int

    @property
    def size(self) -> int:
        return len(self.payload) if self.payload is not None else 0


class WriterProxy(BufferHolder):
    """A matched writer.

    next: number of the next sample to deliver; all lower ones have been delivered or will never arrive.
    last: highest number that is known to exist.
    heard: whether a heartbeat has arrived, so that the writer knows this reader.
    """

    __slots__ = (
        "_acknowledgements", "_assemblies", "_envelope", "_gaps", "_inbound", "_pending", "_reader",
        "_writer", "acknowledge_at_s", "acknowledged_s", "address", "guid", "heard", "interval_s", "last",
        "next", "reliable", "vendor",
    )  # fmt: skip

    def __init__(
        self,
        inbound: Inbound,
        header: bytes,
        reader: bytes,
        guid: bytes,
        address: Address,
        vendor: int,
        *,
        reliable: bool,
    ) -> None:
        super().__init__()
        self._inbound = inbound
        self._envelope = header + submessages.info_destination(guid[:12])
        self._reader = reader
        self._writer = guid[12:]
        self._acknowledgements = 0
        self._pending: dict[int, Arrival] = {}
        self._assemblies: dict[int, SampleAssembly] = {}
        self._gaps: list[tuple[int, int]] = []
        self.guid = guid
        self.address = address
        self.vendor = vendor
        self.reliable = reliable
        self.next = 1
        self.last = 0
        self.heard = False
        self.acknowledged_s = 0.0
        self.acknowledge_at_s = float("inf")
        self.interval_s = 0.0

    def expects(self, sequence: int) -> bool:
        """Whether a sample with this number is still needed."""
        if sequence < self.next or sequence in self._pending:
            return False
        # Before the first heartbeat, the number of the writer's first sample is unknown.
        return not self.reliable or not self.heard or sequence < self.next + self._inbound.limits.window

    def accept(self, sequence: int, arrival: Arrival) -> Iterator[tuple[int, Arrival]]:
        """Accept a sample, and yield the samples that can now be delivered, in order."""
        self.last = max(self.last, sequence)
        self._forget_assembly(sequence)
        if not self.reliable or sequence == self.next:
            self.next = sequence + 1
            yield sequence, arrival
            yield from self.drain()
        elif len(self._pending) < self._inbound.limits.window and self._inbound.take(self, arrival.size):
            self._pending[sequence] = arrival

    def drain(self) -> Iterator[tuple[int, Arrival]]:
        """Deliver samples and skip gaps while the next number is known."""
        while self._pending or self._gaps:
            arrival = self._pending.pop(self.next, None)
            if arrival is not None:
                self._inbound.release(self, arrival.size)
                self.next += 1
                yield self.next - 1, arrival
                continue
            ends = [end for start, end in self._gaps if start <= self.next]
            self._gaps = [(start, end) for start, end in self._gaps if start > self.next]
            if max(ends, default=0) <= self.next:
                return
            self.begin_at(max(ends))

    def begin_at(self, sequence: int) -> None:
        """Skip all numbers below this one, which will never arrive."""
        if sequence <= self.next:
            return
        self.next = sequence
        for number in [number for number in self._pending if number < sequence]:
            self._inbound.release(self, self._pending.pop(number).size)
        for number in [number for number in self._assemblies if number < sequence]:
            self._forget_assembly(number)

    def announce(self, last: int) -> None:
        """Record the writer's last number. Samples that have already arrived may be newer."""
        self.last = max(last, max(self._pending, default=0), max(self._assemblies, default=0))

    def skip(self, start: int, base: int, members: list[int]) -> None:
        """Record a gap. If there are too many gaps, this one is dropped: the writer repeats it when the
        sample is requested again.
        """
        for first, end in [(start, base)] + [(member, member + 1) for member in members]:
            if first <= self.next:
                self.begin_at(end)
            elif self._gaps and self._gaps[-1][1] == first:
                self._gaps[-1] = (self._gaps[-1][0], end)
            elif first < end and len(self._gaps) < _MAX_GAPS:
                self._gaps.append((first, end))

    def assemble(
        self,
        sequence: int,
        fragment: DataFragment,
        inline: Parameters | None,
        piece: memoryview,
        now_s: float,
    ) -> SampleAssembly | None:
        """Add a fragment. Returns the sample if this completes it. A sample that is too large is treated as a
        gap.
        """
        assembly = self._assemblies.get(sequence)
        if assembly is None:
            if fragment.total > self._inbound.limits.payload:
                self._inbound.statistics.refused += 1
                self.skip(sequence, sequence + 1, [])
                return None
            if not self.reliable:  # older incomplete samples can never be delivered now
                for number in list(self._assemblies):
                    self._forget_assembly(number)
            assembly = SampleAssembly(fragment, inline)
            if not self._inbound.take(self, assembly.total + assembly.count):
                return None
            self._assemblies[sequence] = assembly
            self.last = max(self.last, sequence)
        assembly.touched_s = now_s
        return assembly if assembly.add(fragment, piece) else None

    def _forget_assembly(self, sequence: int) -> None:
        assembly = self._assemblies.pop(sequence, None)
        if assembly is not None:
            self._inbound.release(self, assembly.total + assembly.count)

    def discard(self) -> None:
        self._pending.clear()
        self._assemblies.clear()

    # Messages to the writer

    @property
    def complete(self) -> bool:
        return self.next > self.last

    def quiet_since_s(self) -> float:
        """Time at which the last fragment of an incomplete sample arrived."""
        return max((assembly.touched_s for assembly in self._assemblies.values()), default=0.0)

    def _missing(self) -> list[int]:
        end = min(self.last + 1, self.next + MAX_BITS)
        skipped = [(start, stop) for start, stop in self._gaps if start < end]
        return [
            number
            for number in range(self.next, end)
            if number not in self._pending
            and number not in self._assemblies
            and not any(start <= number < stop for start, stop in skipped)
        ]

    def acknowledgement(self) -> bytes:
        """An acknowledgement that lists which sample numbers have arrived and which are missing."""
        base = self.next
        self._acknowledgements += 1
        body = submessages.acknowledgement(
            self._reader, self._writer, base, self._missing(), self._acknowledgements, final=True
        )
        for sequence in list(self._assemblies)[:_MAX_REPAIRED]:
            body += self._request_fragments(sequence)
        return self._envelope + body

    def introduction(self, base: int) -> bytes:
        """The first acknowledgement, which requests a heartbeat. `base` is 0 or 1, depending on the
        vendor.
        """
        self._acknowledgements += 1
        body = submessages.acknowledgement(
            self._reader, self._writer, base, (), self._acknowledgements, final=False
        )
        return self._envelope + body

    def _request_fragments(self, sequence: int) -> bytes:
        missing = self._assemblies[sequence].missing(MAX_BITS)
        self._acknowledgements += 1
        return submessages.fragments_wanted(
            self._reader, self._writer, sequence, missing, self._acknowledgements
        )
