"""The ring of commands: first in, first out, whatever the rate.

Oracle: the list of what was sent. Covers libpyflexiv's suite RealTimeBuffer for what is queued here; streamed
targets are not queued: the newest counts (test_streaming.py).
"""

from __future__ import annotations

import pytest
from rig import Rig

from cobot.ipc.layout import RING, Ack, Command
from cobot.ipc.shm import text


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
