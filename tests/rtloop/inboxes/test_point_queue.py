"""The ring of servo points, as compiled code reads it.

Oracle: the same rules in plain Python, on a mapping of its own, after each of many operations of a writer.
"""

from __future__ import annotations

import numpy as np
import pytest
from cobot_run import unique_name
from sample_counts import samples
from wild_writer import Writer

from cobot.errors import InputError
from cobot.ipc.layout import POINTS
from cobot.ipc.shm import RobotMemory
from rtloop.inboxes.point_queue import UNREADABLE_CYCLES, PointQueue

OPERATIONS = samples(100_000)


class PlainPointQueue:
    def __init__(self, memory: RobotMemory) -> None:
        self._head = memory.point_head
        self._points = memory.points
        self._sequence = -1
        self.torn_reads = 0
        self.begin(0)

    def begin(self, session: int) -> None:
        self._session = session
        self.newest = self.seen = self.lost = self._unreadable = 0

    def poll(self) -> bool:
        sequence = self._head.sequence
        if sequence == self._sequence:
            return False
        if not self._head.try_read():
            self.torn_reads += 1
            return False
        self._sequence = sequence
        if int(self._head.data["session"]) != self._session:
            return False
        newest = min(int(self._head.data["number"]), self.seen + POINTS)
        arrived = newest > self.newest
        self.newest = max(newest, self.newest)
        return arrived

    def next(self) -> np.ndarray | None:
        if self.seen >= self.newest:
            return None
        number = self.seen + 1
        block = self._points[number % POINTS]
        if block.try_read() and int(block.data["number"]) == number:
            self._unreadable = 0
            self.seen = number
            return block.data
        self.torn_reads += 1
        self._unreadable += 1
        if self._unreadable > UNREADABLE_CYCLES:
            self._unreadable = 0
            self.seen = number
            self.lost += 1
        return None


def test_points_come_out_as_from_the_plain_queue(memories: list[RobotMemory]) -> None:
    written, read, read_plainly = memories
    random = np.random.default_rng(23)
    writer, queue, plain = Writer(random), PointQueue(read), PlainPointQueue(read_plainly)
    session = number = got = 0
    for _ in range(OPERATIONS):
        match random.integers(1000):
            case 0:
                session, number = int(random.integers(2**64, dtype=np.uint64)), 0
                queue.begin(session)
                plain.begin(session)
            case 1:
                writer.disturb(written.point_head)
            case 2:
                ahead = int(random.integers(1, 5))
                writer.disturb(written.points[(plain.seen + ahead) % POINTS])
            case 3:
                written.point_head.data["number"] = random.integers(2**64, dtype=np.uint64)
                written.point_head.publish()
            case choice if choice < 400:
                number += 1
                point = written.points[number % POINTS]
                point.data["number"], point.data["joints"] = number, random.normal(size=7)
                point.data["time_s"], point.data["gain"] = number, -number
                point.publish()
                written.point_head.data["session"], written.point_head.data["number"] = session, number
                written.point_head.publish()
        assert queue.poll() == plain.poll()
        point, expected = queue.next(), plain.next()
        assert (point is None) == (expected is None)
        if expected is not None:
            got += 1
            assert point.tobytes() == expected.tobytes()
        assert (queue.newest, queue.seen, queue.lost) == (plain.newest, plain.seen, plain.lost)
        assert queue.waiting == plain.newest - plain.seen
        assert queue.torn_reads == plain.torn_reads
    assert got > OPERATIONS / 10
    assert plain.torn_reads > OPERATIONS / 100


def test_an_arm_of_more_joints_than_a_point_has_is_refused() -> None:
    memory = RobotMemory.create(unique_name(), 17, 1e-3, 2)
    try:
        with pytest.raises(InputError, match="17 joints, allowed: up to 16"):
            PointQueue(memory)
    finally:
        memory.unlink()
        memory.close()
