"""The samples that a writer keeps for readers that are late or slow, or that have lost samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from cobot.dds.rtps.types import ParticipantLimits


@dataclass(slots=True, eq=False)
class Change:
    """One sample in the history of a writer.

    inline: the inline parameters, without their end marker.
    time_s: time at which it was written, on the system clock, for readers.
    only: the only reader that gets the sample; None for all readers.
    key: key in keyed (discovery) topics; a later change with the same key replaces this one.
    disposes: whether the payload is only the key of an entity that is gone.
    written_s: the same time on CLOCK_MONOTONIC, for this process.
    """

    sequence: int
    payload: bytes
    inline: bytes
    time_s: float
    only: bytes | None = None
    key: bytes | None = None
    disposes: bool = False
    written_s: float = 0.0


class History:
    """A writer's changes by sequence number. The oldest ones are removed when the depth or a limit is
    exceeded.
    """

    def __init__(self, depth: int | None, limits: ParticipantLimits) -> None:
        self._most = limits.history_samples if depth is None else depth
        self._most_bytes = limits.history
        self._changes: dict[int, Change] = {}
        self._by_key: dict[bytes, int] = {}
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._changes)

    def __iter__(self) -> Iterator[Change]:
        """The changes in the order of their sequence numbers."""
        return iter(self._changes.values())

    def __contains__(self, sequence: int) -> bool:
        return sequence in self._changes

    def get(self, sequence: int) -> Change | None:
        return self._changes.get(sequence)

    def first(self, default: int) -> int:
        return next(iter(self._changes), default)

    def add(self, change: Change) -> int:
        """Add a change. Returns the number of changes that were removed to stay within the limits, not
        counting changes with the same key.
        """
        if change.key is not None:
            replaced = self._by_key.get(change.key)
            if replaced is not None:
                self.remove((replaced,))
            self._by_key[change.key] = change.sequence
        self._changes[change.sequence] = change
        self._bytes += len(change.payload)
        gone = 0
        while len(self._changes) > self._most or (self._bytes > self._most_bytes and len(self._changes) > 1):
            self.remove((next(iter(self._changes)),))
            gone += 1
        return gone

    def remove(self, sequences: Iterable[int]) -> None:
        for sequence in sequences:
            change = self._changes.pop(sequence)
            self._bytes -= len(change.payload)
            if change.key is not None and self._by_key.get(change.key) == sequence:
                del self._by_key[change.key]
