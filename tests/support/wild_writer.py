"""A writer of shared memory that goes wild, now and then or all the time, and readers that bear it.

python -m shaken ROBOT write | pester | read
"""

from __future__ import annotations

import sys

import numpy as np

from cobot.ipc.layout import Ack
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import MemoryRole, RobotMemory
from rtloop.inboxes.commands import CommandInbox
from rtloop.inboxes.point_queue import PointQueue
from rtloop.inboxes.stream import Inbox, StreamInbox
from rtloop.results import Rejected

READS = 100_000
ASKS = ("requests", "stream_requests", "session", "head")
"""What ends what the arm does, if it is right but for its content."""


class Writer:
    """Writes what no client writes: as one that has died in the middle, or one gone wild."""

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random
        self._kept: dict[str, tuple[int, bytes]] = {}

    def disturb(self, block: Block) -> None:
        match self._random.integers(6):
            case 0:
                block._head[0] = int(self._random.integers(2**64, dtype=np.uint64))
            case 1:
                block._head[0] |= 1
            case 2:
                place = int(self._random.integers(len(block._shared)))
                block._shared[place] ^= 1 << int(self._random.integers(8))
            case 3:
                self._kept[block.name] = block._head[0], bytes(block._shared)
            case 4 if block.name in self._kept:
                block._head[0], block._shared[:] = self._kept[block.name]
            case _:
                block.publish()

    def scribble(self, block: Block) -> None:
        """Random bytes, half of the times with a checksum that fits."""
        noise = self._random.bytes(len(block._shared))
        if self._random.random() < 0.5:
            block.buffer[:] = np.frombuffer(noise, np.uint8)
            block.publish()
        else:
            block._shared[:] = noise
            block._head.cast("B")[:] = self._random.bytes(16)


def all_blocks(memory: RobotMemory) -> list[Block]:
    """Of the points, the first ones."""
    single = [value for value in vars(memory).values() if isinstance(value, Block)]
    slots = [slot.head for slot in memory.slots]
    return [*single, *slots, *memory.acks, *memory.commands, *memory.points[:40]]


def write(memory: RobotMemory) -> None:
    """Without end."""
    random = np.random.default_rng(25)
    writer, blocks = Writer(random), all_blocks(memory)
    while True:
        for index in random.permutation(len(blocks)):
            writer.scribble(blocks[index])
        # What leads a reader on: points and commands that are announced although they are noise.
        memory.point_head.data["session"], memory.point_head.data["number"] = 1, random.integers(2**63)
        memory.point_head.publish()
        memory.head.data["id"] = random.integers(2**63)
        memory.head.publish()


def pester(memory: RobotMemory) -> None:
    """Without end, but so that the arm may go on."""
    random = np.random.default_rng(26)
    writer, blocks = Writer(random), all_blocks(memory)
    asks = [getattr(memory, name) for name in ASKS]
    while True:
        for index in random.permutation(len(blocks)):
            block = blocks[index]
            if any(block is each for each in asks):
                block._shared[:] = random.bytes(len(block._shared))
            else:
                writer.scribble(block)
        for slot in memory.slots:
            slot.coefficients.data.cast("B")[:4096] = random.bytes(4096)


def read(memory: RobotMemory) -> list[int]:
    """How many reads were accepted, and how many were not."""
    blocks = all_blocks(memory)
    inboxes = [Inbox(block) for block in blocks]
    stream, commands, queue = StreamInbox(memory), CommandInbox(memory), PointQueue(memory)
    queue.begin(1)
    counts = [0, 0]
    while sum(counts) < READS:
        for inbox in inboxes:
            inbox.take_news()
        for block in blocks:
            counts[not block.try_read()] += 1
        commands.poll_requests()
        commands.service_silence_s(10**15)
        command = commands.next_command()
        if command is not None:
            commands.acknowledge(int(command["id"]), Ack.REJECTED, "noise")
        if stream.asks():
            stream.answer(Rejected("noise"))
        stream.wants(1)
        stream.take_estop()
        queue.poll()
        queue.next()
        if queue.seen > 10 * len(memory.points):
            queue.begin(1)
    return counts


if __name__ == "__main__":
    robot_memory = RobotMemory.attach(sys.argv[1], MemoryRole.READER)
    if sys.argv[2] != "read":
        {"write": write, "pester": pester}[sys.argv[2]](robot_memory)
    print(*read(robot_memory))
