"""A recording under way: which cycles it is of, and how far it is."""

from __future__ import annotations

import time
from concurrent.futures import Future
from pathlib import Path

import numpy as np

from cobot.ipc.layout import text
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.ring import Ring
from cobot.recorder.files import RecordingFile
from cobot.recording.events import events_of
from cobot.recording.messages import RecordMessages

GROWTH_BYTES = 1_000_000


class Writing:
    """
    Attributes:
        run: what its files are called, without part and suffix.
        first, last: its cycles; None: it goes on until it is stopped.
        next: the cycle that it goes on with.
        trigger: the cycle that it is about, 0 for none.
        waiting: who wants to know when it is whole.
        wrote_s: when there were cycles to write last, on the monotonic clock.

    Raises (constructor):
        OSError: the file cannot be made.
    """

    def __init__(
        self,
        run: str,
        path: Path,
        memory: RecordingMemory,
        messages: RecordMessages,
        ahead_ns: int,
        *,
        reason: str,
        first: int,
        last: int | None,
    ) -> None:
        about = {"reason": reason, "first_cycle": str(first)}
        self.run = run
        self.file = RecordingFile(path, memory, messages, ahead_ns, about)
        self.first = self.next = first
        self.last = last
        self.trigger = 0
        self.waiting: list[Future[dict[str, object]]] = []
        self.wrote_s = time.monotonic()
        self._before: np.ndarray | None = None
        self._lost = 0
        self._seen_bytes = 0

    def extend(self, last: int) -> None:
        """Have it end later."""
        self.last = max(last, self.last or 0)

    def write(self, history: Ring, notes: Ring, batch: int) -> bool:
        """Add the next cycles that there are, `batch` at the most; whether there were any."""
        newest = history.newest if self.last is None else min(history.newest, self.last)
        count = min(batch, newest + 1 - self.next)
        if count <= 0:
            return False
        records = history.read(self.next, count)
        self._lost += count - len(records)
        if len(records):
            self.file.write(records, events_of(records, self._before, _reasons(notes, records)))
            self._before = records[-1].copy()
        self.next += count
        self.wrote_s = time.monotonic()
        return True

    def waits(self, history: Ring, batch: int) -> bool:
        """Whether cycles wait to be written: the last ones, or a whole batch."""
        if self.last is None:
            return self.next + batch <= history.newest
        return self.next <= min(self.last, history.newest)

    def has_grown(self) -> bool:
        """Whether the file has become larger by a good deal since this was answered with yes."""
        grown = self.file.size >= self._seen_bytes + GROWTH_BYTES
        if grown:
            self._seen_bytes = self.file.size
        return grown

    def take_lost(self) -> int:
        """How many cycles were not there any more since the last call."""
        lost, self._lost = self._lost, 0
        return lost


def _reasons(notes: Ring, records: np.ndarray) -> dict[int, str]:
    """The sentences that the records refer to."""
    first, last = int(records["note"].min()), int(records["note"].max())
    if last == 0:
        return {}
    found = notes.read(max(first, last - notes.capacity + 1), last - first + 1)
    return {int(note["number"]): text(note["reason"]) for note in found}
