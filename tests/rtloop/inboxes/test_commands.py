"""The ring of commands: first in, first out, whatever the rate.

Oracle: the list of what was sent. Covers libpyflexiv's suite RealTimeBuffer for what is queued here; streamed
targets are not queued: the newest counts (test_streaming.py). For what a wild writer leaves:
the same rules in plain Python, on a mapping of its own.
"""

from __future__ import annotations

from math import isclose

import numpy as np
import pytest
from rig import Rig
from sample_counts import samples
from wild_writer import Writer

from cobot.ipc.layout import RING, Ack, Command, text
from cobot.ipc.shm import RobotMemory
from rtloop.inboxes.commands import UNREADABLE_CYCLES, CommandInbox

OPERATIONS = samples(100_000)
NOW_NS = 10**15


def taken(rig: Rig, cycles: int) -> list[int]:
    """The numbers of the commands that so many cycles answer, in their order."""
    numbers: list[int] = []
    for _ in range(cycles):
        before = rig.loop.controller.commands.command_seen
        rig.step()
        after = rig.loop.controller.commands.command_seen
        numbers.extend(range(before + 1, after + 1))
    return numbers


def test_an_empty_ring_gives_nothing(rig: Rig) -> None:
    assert taken(rig, 5) == []


def test_one_command_comes_out_once(rig: Rig) -> None:
    number = rig.send(Command.RESET)
    assert taken(rig, 5) == [number]


@pytest.mark.parametrize("count", [2, RING // 2, RING])
def test_commands_come_out_in_their_order(rig: Rig, count: int) -> None:
    sent = [rig.send(Command.RESET) for _ in range(count)]
    assert taken(rig, count) == sent
    assert taken(rig, 3) == []


def test_the_ring_wraps_around_without_losing_or_repeating_any(rig: Rig) -> None:
    sent, got = [], []
    for burst in range(200):
        sent += [rig.send(Command.RESET) for _ in range(burst % RING)]
        got += taken(rig, burst % RING)
    assert got == sent
    assert len(sent) > 50 * RING


def test_each_answer_stands_in_its_commands_place(rig: Rig) -> None:
    numbers = [rig.send(kind) for kind in (Command.RESET, 99, Command.SET_RATE, Command.RESET)]
    taken(rig, 4)
    answers = [rig.memory.acks[number % RING] for number in numbers]
    assert all(answer.try_read() for answer in answers)
    assert [int(answer.data["id"]) for answer in answers] == numbers
    results = [int(answer.data["result"]) for answer in answers]
    assert results == [Ack.ACCEPTED, Ack.REJECTED, Ack.REJECTED, Ack.ACCEPTED]
    assert text(answers[1].data["message"]) == "there is no command 99"


def test_of_a_flood_beyond_the_ring_the_newest_are_taken_in_order(rig: Rig) -> None:
    sent = [rig.send(Command.RESET) for _ in range(10 * RING)]
    rig.step(2 * RING)
    assert rig.loop.controller.commands.command_seen == sent[-1]
    newest = [int(ack.data["id"]) for ack in rig.memory.acks if ack.try_read()]
    assert sorted(newest) == sent[-RING:]


class PlainCommandInbox:
    def __init__(self, memory: RobotMemory) -> None:
        self._memory = memory
        self._sequences = dict.fromkeys(("requests", "heartbeat", "head"), -1)
        self.stops = self.estops = self.command_seen = self.torn_reads = 0
        self._beat_ns = self._newest = self._unreadable = 0
        self._service = [0, 0]

    def _look(self, name: str) -> bool | None:
        """Whether there is news in a block; None if it cannot be read."""
        block = getattr(self._memory, name)
        sequence = block.sequence
        if sequence == self._sequences[name]:
            return False
        if not block.try_read():
            self.torn_reads += 1
            return None
        self._sequences[name] = sequence
        return True

    def poll_requests(self) -> tuple[bool, bool]:
        if self._look("requests"):
            self._service = [int(self._memory.requests.data[name]) for name in ("stops", "estops")]
        outside = self._memory.outside_stops.value, self._memory.outside_estops.value
        stops, estops = ((own + other) % 2**64 for own, other in zip(self._service, outside, strict=True))
        asked = stops != self.stops, estops != self.estops
        self.stops, self.estops = stops, estops
        return asked

    def service_silence_s(self, now_ns: int) -> float:
        if self._look("heartbeat"):
            self._beat_ns = int(self._memory.heartbeat.data["monotonic_ns"])
        return (now_ns - self._beat_ns) * 1e-9

    def next_command(self) -> np.ndarray | None:
        news = self._look("head")
        if news is None:
            return None
        if news:
            self._newest = int(self._memory.head.data["id"])
        if self._newest <= self.command_seen:
            return None
        number = max(self.command_seen + 1, self._newest - RING + 1)
        block = self._memory.commands[number % RING]
        if block.try_read() and int(block.data["id"]) == number:
            self._unreadable = 0
            return block.data
        self.torn_reads += 1
        self._unreadable += 1
        if self._unreadable > UNREADABLE_CYCLES:
            self._unreadable = 0
            self.command_seen = number
        return None


def test_requests_and_commands_are_read_as_by_the_plain_rules(memories: list[RobotMemory]) -> None:
    written, read, read_plainly = memories
    random = np.random.default_rng(24)
    writer, inbox, plain = Writer(random), CommandInbox(read), PlainCommandInbox(read_plainly)
    number = got = 0
    for _ in range(OPERATIONS):
        match random.integers(200):
            case 0:
                blocks = written.requests, written.heartbeat, written.head
                writer.disturb(blocks[random.integers(3)])
            case 1:
                writer.disturb(written.commands[(plain.command_seen + random.integers(1, 4)) % RING])
            case 2:
                name = ("stops", "estops")[random.integers(2)]
                written.requests.data[name] = random.integers(2**64, dtype=np.uint64)
                written.requests.publish()
            case 3:
                info = np.iinfo(np.int64)
                beats = (info.min, info.max, NOW_NS - int(random.integers(10**12)))
                written.heartbeat.data["monotonic_ns"] = beats[random.integers(3)]
                written.heartbeat.publish()
            case 5:
                (written.outside_stops, written.outside_estops)[random.integers(2)].add()
            case 4 if random.random() < 0.02:
                written.head.data["id"] = random.integers(2**64, dtype=np.uint64)
                written.head.publish()
            case choice if choice < 60:
                number += int(random.integers(1, 3))
                command = written.commands[number % RING]
                command.data["id"] = number
                command.publish()
                written.head.data["id"] = number
                written.head.publish()
        assert inbox.poll_requests() == plain.poll_requests()
        assert (inbox.stops, inbox.estops) == (plain.stops, plain.estops)
        assert isclose(inbox.service_silence_s(NOW_NS), plain.service_silence_s(NOW_NS), rel_tol=1e-12)
        command, expected = inbox.next_command(), plain.next_command()
        assert (command is None) == (expected is None)
        if command is not None and expected is not None:
            got += 1
            assert command.tobytes() == expected.tobytes()
            inbox.acknowledge(int(command["id"]), Ack.ACCEPTED)
            plain.command_seen = int(command["id"])
        assert (inbox.command_seen, inbox.torn_reads) == (plain.command_seen, plain.torn_reads)
        if plain.command_seen > 2**63:  # a wild head: the next rtloop begins anew
            inbox, plain, number = CommandInbox(read), PlainCommandInbox(read_plainly), 0
    assert got > OPERATIONS / 100
    assert plain.torn_reads > OPERATIONS / 100
