"""Limits repeated messages. Each interval lets a limited number of messages of each kind pass, and ends with
a count of the others.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Generic, TypeVar

MAX_KINDS = 1000

Item = TypeVar("Item")


@dataclass(slots=True)
class _Kind(Generic[Item]):
    begun_s: float
    count: int
    held_back: int
    last: Item


class Repeats(Generic[Item]):
    """Lets at most `burst` items of a kind pass in each interval. Any thread may call its methods.

    Args:
        now_s: returns the time in seconds, from any origin.
    """

    def __init__(self, burst: int, interval_s: float, now_s: Callable[[], float]) -> None:
        self._burst = burst
        self._interval_s = interval_s
        self._now_s = now_s
        self._kinds: dict[Hashable, _Kind[Item]] = {}
        self._lock = threading.RLock()  # a garbage collection may log while this thread holds it

    def passes(self, key: Hashable, item: Item) -> bool:
        """Whether an item may pass. An item that may not pass is counted in a later `summary`."""
        with self._lock:
            now_s = self._now_s()
            if key not in self._kinds and len(self._kinds) >= MAX_KINDS:
                self._forget(now_s)
                if len(self._kinds) >= MAX_KINDS:
                    key = None  # with so many kinds, all further kinds share one count
            kind = self._kinds.get(key)
            if kind is None or (now_s - kind.begun_s >= self._interval_s and not kind.held_back):
                self._kinds[key] = _Kind(now_s, 1, 0, item)
                return True
            kind.count += 1
            if kind.count <= self._burst:
                return True
            kind.held_back += 1
            kind.last = item
            return False

    def summary(self, *, all_of_them: bool = False) -> list[tuple[Item, int]]:
        """For each kind whose interval has ended: its last item, and the number of items held back."""
        with self._lock:
            now_s = self._now_s()
            found = []
            for key, kind in list(self._kinds.items()):
                if kind.held_back and (all_of_them or now_s - kind.begun_s >= self._interval_s):
                    found.append((kind.last, kind.held_back))
                    self._kinds[key] = _Kind(now_s, self._burst, 0, kind.last)
            return found

    @property
    def held_back(self) -> bool:
        """Whether items are held back, so that a summary will follow."""
        with self._lock:
            return any(kind.held_back for kind in self._kinds.values())

    def _forget(self, now_s: float) -> None:
        for key, kind in list(self._kinds.items()):
            if not kind.held_back and now_s - kind.begun_s >= self._interval_s:
                del self._kinds[key]
