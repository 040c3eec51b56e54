"""A queue with a thread that writes its items. Adding an item never blocks, and items that do not fit are
counted.

The standard library's QueueHandler is not used, because it acquires a lock. If a garbage collection in the
thread that holds this lock logs a line, the thread waits for itself. A SimpleQueue is reentrant.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable, Hashable
from enum import Enum
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar

from cobot.logs.repeats import Repeats

CAPACITY = 2000
LOOK_S = 1.0
"""Interval at which the thread checks whether repetitions have ended and whether writing works again, in
seconds.
"""

Item = TypeVar("Item")


class _Sign(Enum):
    LOOK = "check for ended repetitions"
    END = "no more items follow"


class Outlet(Generic[Item]):
    """Writes items in a separate thread, which may block indefinitely.

    Args:
        write: writes one item. If it raises, the item is lost.
        lost: makes the item that reports the number of lost items as soon as there is room.
        settle: called after all items have been written.
        repeats: suppresses repeated items.
        repeated: makes the item that reports how many items like this one were suppressed.

    Attributes:
        dropped: number of items lost so far.
        error: errno of the latest attempt to write; 0 after a success. A failed attempt is repeated
            periodically, even if no further item arrives.
    """

    def __init__(
        self,
        write: Callable[[Item], None],
        lost: Callable[[int], Item],
        *,
        settle: Callable[[], None] = lambda: None,
        repeats: Repeats[Item] | None = None,
        repeated: Callable[[Item, int], Item] = lambda item, count: item,
        capacity: int = CAPACITY,
    ) -> None:
        self._write = write
        self._lost = lost
        self._settle = settle
        self._repeats = repeats
        self._repeated = repeated
        self._capacity = capacity
        self._queue: SimpleQueue[Item | _Sign] = SimpleQueue()
        self._lock = threading.RLock()
        self._waiting = self._told = 0
        self._looks = self._ended = False
        self.dropped = 0
        self.error = 0
        self._thread = threading.Thread(target=self._run, name="outlet", daemon=True)
        self._thread.start()

    def put(self, item: Item, kind: Hashable = None) -> None:
        """Queue an item for writing. An item is suppressed if there are too many of its kind. If the queue is
        full, the item is dropped and counted as lost.

        Args:
            kind: key that equal items share; None for an item that is never suppressed.
        """
        if kind is not None and self._repeats is not None and not self._repeats.passes(kind, item):
            if not self._looks:
                self._looks = True
                self._queue.put(_Sign.LOOK)
        else:
            with self._lock:
                full = self._ended or self._waiting >= self._capacity
                if full:
                    self.dropped += 1
                else:
                    self._waiting += 1
            if not full:
                self._queue.put(item)

    def wait(self, timeout_s: float) -> None:
        """Wait until all items have been written or the timeout has passed."""
        deadline_s = time.monotonic() + timeout_s
        while self._waiting and time.monotonic() < deadline_s:
            time.sleep(0.002)

    def close(self, timeout_s: float) -> bool:
        """Write the remaining items. Returns whether they were written within the timeout."""
        self._ended = True
        self._queue.put(_Sign.END)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        item: Item | _Sign | None = None
        while item is not _Sign.END:
            try:
                item = self._queue.get(timeout=LOOK_S if self._looks or self.error else None)
            except Empty:
                item = _Sign.LOOK
            if item is _Sign.END or self._looks:
                self._summarise(ending=item is _Sign.END)
            if item is _Sign.LOOK and self.error:
                self._try_again()
            if not isinstance(item, _Sign):
                self._try(item)
                with self._lock:
                    self._waiting -= 1
            if self._queue.empty():
                self._try_settle()

    def _summarise(self, *, ending: bool) -> None:
        if self._repeats is None:
            return
        for last, count in self._repeats.summary(all_of_them=ending):
            self._try(self._repeated(last, count))
        self._looks = False  # comes first: a later `put` that suppresses an item must find False
        if self._repeats.held_back:
            self._looks = True

    def _try(self, item: Item) -> None:
        try:
            self._tell_losses()
            self._write(item)
            self.error = 0
        except Exception as exc:  # noqa: BLE001  no error may end the thread
            self.error = getattr(exc, "errno", None) or -1
            with self._lock:
                self.dropped += 1

    def _try_again(self) -> None:
        """Report earlier losses while there is no new item to write."""
        try:
            self._tell_losses()
            self.error = 0
        except Exception as exc:  # noqa: BLE001  see `_try`
            self.error = getattr(exc, "errno", None) or -1

    def _tell_losses(self) -> None:
        if self.dropped > self._told:
            count = self.dropped
            self._write(self._lost(count - self._told))
            self._told = count

    def _try_settle(self) -> None:
        try:
            self._settle()
        except OSError as exc:
            self.error = exc.errno or -1


def write_all(descriptor: int, piece: bytes) -> None:
    """Write a whole piece to a descriptor, and wait as long as necessary. The descriptor may be a pipe, a
    terminal or a file, in blocking or non-blocking mode.

    Raises:
        OSError: the descriptor cannot be written.
    """
    rest = memoryview(piece)
    while rest:
        try:
            rest = rest[os.write(descriptor, rest) :]
        except BlockingIOError:
            poll = select.poll()
            poll.register(descriptor, select.POLLOUT)
            poll.poll()
