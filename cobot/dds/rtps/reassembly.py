"""One sample that arrives in fragments."""

from __future__ import annotations

from cobot.dds.rtps.errors import MalformedError
from cobot.dds.rtps.parameters import Parameters
from cobot.dds.rtps.submessages import DataFragment

MAX_FRAGMENTS = 1 << 16


class SampleAssembly:
    """The bytes of a sample, and a record of the fragments that have arrived.

    Errors: MalformedError: a fragment is invalid, or belongs to another sample.
    """

    __slots__ = ("_data", "_marks", "_size", "count", "inline", "touched_s")

    def __init__(self, fragment: DataFragment, inline: Parameters | None) -> None:
        if not fragment.size or not fragment.total:
            raise MalformedError("a fragment of an empty sample")
        self._size = fragment.size
        self.count = -(-fragment.total // fragment.size)
        if self.count > MAX_FRAGMENTS:
            raise MalformedError(f"a sample has {self.count} fragments, allowed: {MAX_FRAGMENTS}")
        self._data = bytearray(fragment.total)
        self._marks = bytearray(self.count)
        self.inline = inline
        self.touched_s = 0.0

    @property
    def total(self) -> int:
        return len(self._data)

    def add(self, fragment: DataFragment, payload: memoryview) -> bool:
        """Add a fragment. Returns whether the sample is now complete."""
        if fragment.size != self._size or fragment.total != len(self._data):
            raise MalformedError("a fragment belongs to another sample with the same number")
        last = fragment.first + fragment.count - 1
        if not 1 <= fragment.first <= last <= self.count:
            raise MalformedError(f"got fragments {fragment.first} to {last}, but the sample has {self.count}")
        start = (fragment.first - 1) * self._size
        length = min(last * self._size, len(self._data)) - start
        if len(payload) < length:
            raise MalformedError(f"the fragments need {length} bytes, but {len(payload)} have arrived")
        self._data[start : start + length] = payload[:length]
        self._marks[fragment.first - 1 : last] = b"\1" * fragment.count
        return 0 not in self._marks

    def missing(self, span: int) -> list[int]:
        """The missing fragments among the `span` fragments that begin with the first missing one. There is at
        least one.
        """
        first = self._marks.find(0)
        end = min(self.count, first + span)
        return [i + 1 for i in range(first, end) if not self._marks[i]]

    def payload(self) -> bytes:
        return bytes(self._data)
