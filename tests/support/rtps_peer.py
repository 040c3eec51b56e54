"""`ros2/peer.cpp` from Python: a DDS peer on Fast DDS, the library under rmw_fastrtps."""

from __future__ import annotations

import json
import queue
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from dds_peers import built
from folders import TESTS

SOURCE = TESTS / "cobot" / "dds" / "peer.cpp"
HEAD = struct.Struct("<4xId")
WAIT_S = 60.0


def numbered(number: int, size: int = 0) -> bytes:
    """A payload that the peer can check; see peer.cpp."""
    head = b"\0\1\0\0" + HEAD.pack(number, time.monotonic())[4:]
    pattern = bytes(range(256)) * (size // 256 + 2)
    start = (number + len(head)) & 0xFF
    return head + pattern[start : start + max(0, size - len(head))]


def number_of(payload: bytes) -> int:
    """The number in a payload of the peer; its other bytes are checked."""
    number: int = HEAD.unpack_from(payload)[0]
    assert payload[16:] == numbered(number, len(payload))[16:]
    return number


class Peer:
    """`peer.cpp` as a process."""

    def __init__(self, domain: int) -> None:
        self._process = subprocess.Popen(
            [str(built(SOURCE)), str(domain)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._collect, daemon=True).start()
        self.expect("ready")

    def _collect(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as output:
            for line in output:
                self._lines.put(line.strip())

    def tell(self, *words: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(" ".join(map(str, words)) + "\n")

    def expect(self, *words: str) -> str:
        """What follows these words, which must begin the next line."""
        line = self._lines.get(timeout=WAIT_S)
        assert line.split()[: len(words)] == list(words), line
        return line.split(" ", len(words))[-1]

    def writer(self, topic: str, *, reliable: bool = True, latched: bool = False, depth: int = 0) -> None:
        self.tell("writer", topic, topic, "Type", int(reliable), int(latched), depth)

    def reader(self, topic: str, *, reliable: bool = True, latched: bool = False, depth: int = 0) -> None:
        self.tell("reader", topic, topic, "Type", int(reliable), int(latched), depth)

    def wait(self, name: str) -> None:
        self.tell("wait", name)
        self.expect("matched", name)

    def write(self, name: str, count: int, size: int = 0, period_us: int = 0) -> None:
        self.tell("write", name, count, size, period_us)
        self.expect("wrote", name)

    def report(self, name: str) -> dict[str, Any]:
        self.tell("report", name)
        report: dict[str, Any] = json.loads(self.expect("report", name))
        return report

    def delete(self, name: str) -> None:
        self.tell("delete", name)
        self.expect("deleted", name)

    def quit(self) -> None:
        self.tell("quit")
        self.expect("left")
        self._process.wait(WAIT_S)

    def kill(self) -> None:
        """End it without a word to the others."""
        self._process.kill()
        self._process.wait(WAIT_S)
        if self._process.stdin is not None and not self._process.stdin.closed:
            self._process.stdin.close()


@contextmanager
def running(domain: int) -> Iterator[Peer]:
    """A peer until the context ends."""
    peer = Peer(domain)
    try:
        yield peer
    finally:
        peer.kill()
