"""The points of a servo session, in the order in which the service has put them into shared memory."""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import POINTS
from cobot.ipc.shm import RobotMemory
from rtloop.inboxes.stream import Inbox

UNREADABLE_CYCLES = 100
"""After so many tries a point is given up: its writer died while writing it, or another one is wild."""


class PointQueue:
    """Reads the ring of points. Real-time safe.

    Attributes:
        newest: the number of the newest point.
        seen: the number of the point read last.
        lost: points that could not be read.
        torn_reads: how often a block was not consistent.
    """

    def __init__(self, memory: RobotMemory) -> None:
        self._head = Inbox(memory.point_head)
        self._points = memory.points
        self._session = self._unreadable = self._torn = 0
        self.newest = self.seen = self.lost = 0

    @property
    def torn_reads(self) -> int:
        return self._torn + self._head.torn_reads

    @property
    def waiting(self) -> int:
        return self.newest - self.seen

    def begin(self, session: int) -> None:
        """Points of this session count from now on."""
        self._session = session
        self.newest = self.seen = self.lost = self._unreadable = 0

    def poll(self) -> bool:
        """Whether there are new points."""
        head = self._head
        if not head.changed() or int(head.data["session"]) != self._session:
            return False
        # What a wild writer claims beyond the ring's size cannot be there.
        newest = min(int(head.data["number"]), self.seen + POINTS)
        arrived = newest > self.newest
        self.newest = max(newest, self.newest)
        return arrived

    def next(self) -> np.ndarray | None:
        """The next point, valid until the next call; None if there is none, or none that can be read now."""
        if self.seen >= self.newest:
            return None
        number = self.seen + 1
        block = self._points[number % POINTS]
        if block.try_read() and int(block.data["number"]) == number:
            self._unreadable = 0
            self.seen = number
            return block.data
        self._torn += 1
        self._unreadable += 1
        if self._unreadable > UNREADABLE_CYCLES:
            self._unreadable = 0
            self.seen = number
            self.lost += 1
        return None
