"""Limits the memory for incomplete and out-of-order samples from all senders together."""

from __future__ import annotations

from cobot.dds.rtps.types import ParticipantLimits, ParticipantStatistics


class BufferHolder:
    """A remote writer whose bytes are buffered."""

    __slots__ = ("held",)

    def __init__(self) -> None:
        self.held = 0

    def discard(self) -> None:
        """Drop all buffered bytes. `Inbound` updates the accounting."""
        raise NotImplementedError


class Inbound:
    """Counts the buffered bytes of one participant. When the limit is reached, the holder with the most bytes
    must drop them.

    A reliable writer sends dropped samples again.
    """

    def __init__(self, limits: ParticipantLimits, statistics: ParticipantStatistics) -> None:
        self.limits = limits
        self.statistics = statistics
        self.used = 0
        self._holders: set[BufferHolder] = set()

    def take(self, holder: BufferHolder, size: int) -> bool:
        """Reserve `size` more bytes for a holder. Returns whether the limit permits this."""
        if holder.held + size > self.limits.buffered_per_writer:
            self.statistics.refused += 1
            return False
        while self.used + size > self.limits.buffered:
            largest = max(self._holders, key=lambda other: other.held)
            self.statistics.refused += 1
            self.clear(largest)
            if largest is holder:
                return False
        self.used += size
        holder.held += size
        self._holders.add(holder)
        return True

    def release(self, holder: BufferHolder, size: int) -> None:
        self.used -= size
        holder.held -= size
        if not holder.held:
            self._holders.discard(holder)

    def clear(self, holder: BufferHolder) -> None:
        holder.discard()
        self.used -= holder.held
        holder.held = 0
        self._holders.discard(holder)
