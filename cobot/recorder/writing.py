"""A recording in progress: its cycles and its progress."""

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
    """A recording in progress.

    Attributes:
        run: name that the files of the recording share, without part and suffix.
        first, last: first and last cycle; `last` is None for a recording without an end.
        next: next cycle to write.
        trigger: cycle of the fault or e-stop that is recorded; 0 for a continuous recording.
        waiting: answers that must be set when the recording is complete.
        wrote_s: time at which cycles were last written, on the monotonic clock.

    Raises (constructor):
        OSError: the file cannot be created.
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
        """Move the end of the recording to a later cycle."""
        self.last = max(last, self.last or 0)

    def write(self, history: Ring, notes: Ring, batch: int) -> bool:
        """Write the next available cycles, at most `batch` of them. Returns whether there were any."""
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
        """Whether enough cycles are waiting: a whole batch, or any number if the last cycle is known."""
        if self.last is None:
            return self.next + batch <= history.newest
        return self.next <= min(self.last, history.newest)

    def has_grown(self) -> bool:
        """Whether the file has grown by `GROWTH_BYTES` since the last call that returned True."""
        grown = self.file.size >= self._seen_bytes + GROWTH_BYTES
        if grown:
            self._seen_bytes = self.file.size
        return grown

    def take_lost(self) -> int:
        """The number of cycles that were lost since the last call."""
        lost, self._lost = self._lost, 0
        return lost


def _reasons(notes: Ring, records: np.ndarray) -> dict[int, str]:
    """The reasons to which the records refer: a sentence for each note number."""
    first, last = int(records["note"].min()), int(records["note"].max())
    if last == 0:
        return {}
    found = notes.read(max(first, last - notes.capacity + 1), last - first + 1)
    return {int(note["number"]): text(note["reason"]) for note in found}
