"""`ros_peer.cpp` from Python: a ROS 2 node on Fast DDS, which is the library under rmw_fastrtps."""

from __future__ import annotations

import contextlib
import itertools
import queue
import subprocess
import threading
import time
from collections.abc import Callable
from typing import Any

from dds_peers import built
from folders import TESTS

from cobot.ros.messages import Messages

SOURCE = TESTS / "cobot" / "dds" / "ros_peer.cpp"
WAIT_S = 30.0
Arrival = tuple[int, bytes]


def dds_type(name: str) -> str:
    """std_msgs::msg::dds_::String_ of std_msgs/msg/String."""
    package, kind, last = name.split("/")
    return f"{package}::{kind}::dds_::{last}_"


class Peer:
    """One such node, in a process of its own.

    Attributes:
        messages: the types, for CDR.
    """

    def __init__(self, domain: int, messages: Messages) -> None:
        self.messages = messages
        self._found: set[tuple[str, str, str]] = set()
        self._samples: dict[str, queue.Queue[Arrival]] = {}
        self._replies: dict[str, queue.Queue[bytes]] = {}
        self._matched: queue.Queue[tuple[int, int]] = queue.Queue()
        self._numbers = itertools.count()
        self._ready = threading.Event()
        self._writing = threading.Lock()
        self.failures: list[str] = []
        self.process = subprocess.Popen(
            [str(built(SOURCE)), str(domain)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        assert self._ready.wait(WAIT_S), "the peer does not start"

    def close(self) -> None:
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        try:
            self.process.wait(10.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._thread.join(10.0)

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def publisher(self, topic: str, type_: str, *, depth: int = 10, latched: bool = False) -> Publisher:
        return Publisher(self, self._make("pub", topic, type_, depth, latched, True), type_)

    def subscription(
        self, topic: str, type_: str, *, depth: int = 10, latched: bool = False, reliable: bool = True
    ) -> Subscription:
        number = self._make("sub", topic, type_, depth, latched, reliable)
        return Subscription(self, number, type_, self._samples[number])

    def raw_subscription(self, topic: str, type_: str, *, latched: bool = False) -> Subscription:
        """Of a topic of DDS that is none of ROS's."""
        number = self._make("sub", topic, type_, 10, latched, True, prefix="")
        return Subscription(self, number, type_, self._samples[number])

    def client(self, service: str, type_: str) -> Client:
        number = str(next(self._numbers))
        self.tell(f"client {number} {service} {dds_type(type_).removesuffix('_')}")
        return Client(self, number, type_)

    def tell(self, line: str) -> None:
        assert self.process.stdin is not None
        with self._writing:
            self.process.stdin.write(line + "\n")

    def matched(self, number: str) -> tuple[int, int]:
        """How many writers and readers of others an endpoint of ours talks to."""
        self.tell(f"matched {number}")
        return self._matched.get(timeout=WAIT_S)

    @property
    def found(self) -> set[tuple[str, str, str]]:
        """(kind, topic, type) of each endpoint that was discovered and is still there; kind is w or r."""
        return self._found.copy()  # a thread goes on adding to it

    def until_matched(self, number: str, *, writers: int = 0, readers: int = 0) -> None:
        until(
            lambda: all(
                n >= least for n, least in zip(self.matched(number), (writers, readers), strict=True)
            ),
            f"endpoint {number} found nobody",
        )

    def expect(self, tag: str) -> queue.Queue[bytes]:
        """Where the reply with this tag will be."""
        return self._replies.setdefault(tag, queue.Queue())

    def tag(self) -> str:
        return f"t{next(self._numbers)}"

    def _make(
        self, verb: str, topic: str, type_: str, depth: int, latched: bool, reliable: bool, prefix: str = "rt"
    ) -> str:
        number = str(next(self._numbers))
        self._samples[number] = queue.Queue()
        self.tell(f"{verb} {number} {prefix}{topic} {dds_type(type_)} {depth} {latched:d} {reliable:d}")
        return number

    def _listen(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as lines:
            for line in lines:
                self._take(*line.split())

    def _take(self, verb: str, *words: str) -> None:
        match verb:
            case "ready":
                self._ready.set()
            case "sample":
                self._samples[words[0]].put((int(words[1]), bytes.fromhex(words[2])))
            case "reply":
                self.expect(words[1]).put(bytes.fromhex(words[2]))
            case "matched":
                self._matched.put((int(words[1]), int(words[2])))
            case "found":
                self._found.add((words[0], words[1], words[2]))
            case "lost":
                self._found.discard((words[0], words[1], words[2]))
            case _:
                self.failures.append(" ".join((verb, *words)))


class Publisher:
    """Publishes messages, which are dicts."""

    def __init__(self, peer: Peer, number: str, type_: str) -> None:
        self._peer, self._number, self._type = peer, number, type_

    def publish(self, message: dict[str, Any]) -> None:
        self._peer.tell(f"write {self._number} {self._peer.messages.to_cdr(self._type, message).hex()}")

    def until_matched(self, readers: int = 1) -> None:
        self._peer.until_matched(self._number, readers=readers)


class Subscription:
    """Collects messages."""

    def __init__(self, peer: Peer, number: str, type_: str, samples: queue.Queue[Arrival]) -> None:
        self._peer, self._number, self._type, self._samples = peer, number, type_, samples

    def get(self, timeout_s: float = WAIT_S) -> dict[str, Any]:
        """The next message.

        Raises:
            queue.Empty: none comes.
        """
        return self.arrival(timeout_s)[1]

    def arrival(self, timeout_s: float = WAIT_S) -> tuple[int, dict[str, Any]]:
        """The next message, and when it came: ns on the wall clock."""
        came_ns, content = self._samples.get(timeout=timeout_s)
        return came_ns, self._peer.messages.from_cdr(self._type, content)

    def drain(self) -> list[dict[str, Any]]:
        """All that have come."""
        return [message for _, message in self.arrivals()]

    def arrivals(self) -> list[tuple[int, dict[str, Any]]]:
        """All that have come, with their times."""
        return [self.arrival(0.0) for _ in range(self._samples.qsize())]

    def until(self, condition: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """The first message from now on that is as wanted."""
        deadline_s = time.monotonic() + WAIT_S
        while time.monotonic() < deadline_s:
            with contextlib.suppress(queue.Empty):
                message = self.get(1.0)
                if condition(message):
                    return message
        raise AssertionError(f"no such message within {WAIT_S} s")

    def until_matched(self, writers: int = 1) -> None:
        self._peer.until_matched(self._number, writers=writers)


class Client:
    """Calls a service."""

    def __init__(self, peer: Peer, number: str, type_: str) -> None:
        self._peer, self._number, self._type = peer, number, type_

    def matches(self) -> tuple[int, int]:
        """How many servers there are, by their writers and readers."""
        return self._peer.matched(self._number)

    def ready(self) -> bool:
        return all(self.matches())

    def until_ready(self) -> Client:
        self._peer.until_matched(self._number, writers=1, readers=1)
        return self

    def begin(self, request: dict[str, Any]) -> Callable[[float], dict[str, Any]]:
        """Send a request. What is returned waits for the response, so many seconds (`queue.Empty`)."""
        peer, tag = self._peer, self._peer.tag()
        replies = peer.expect(tag)
        peer.tell(f"call {self._number} {tag} {peer.messages.to_cdr(f'{self._type}_Request', request).hex()}")
        return lambda timeout_s: peer.messages.from_cdr(
            f"{self._type}_Response", replies.get(timeout=timeout_s)
        )

    def call(self, request: dict[str, Any] | None = None, timeout_s: float = WAIT_S) -> dict[str, Any]:
        return self.begin(request or {})(timeout_s)


def until(condition: Callable[[], Any], what: str) -> Any:
    """What the condition gave when it first held."""
    deadline_s = time.monotonic() + WAIT_S
    while time.monotonic() < deadline_s:
        value = condition()
        if value:
            return value
        time.sleep(0.02)
    raise AssertionError(f"{what} within {WAIT_S} s")
