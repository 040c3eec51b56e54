"""What waits to be sent to one client: answers that must arrive, and topics of which the newest counts."""

from __future__ import annotations

import asyncio
import itertools
import json
from collections import deque
from collections.abc import Iterator
from typing import Any

from app.graph.graph import Graph
from app.graph.topics import Subscription
from app.rosbridge.fragments import in_pieces
from app.rosbridge.operations import MAX_QUEUE, Id, Subscribe
from cobot.errors import ConflictError, InputError
from cobot.ros.codec import without_nan
from cobot.ros.messages import Message

MAX_BYTES = 32 * 2**20
"""Of answers that wait; a client that lets more pile up is disconnected."""
MAX_OPTIONAL = 256
"""Messages after which feedback and status are left out."""
MAX_WISHES = 100
"""Of one client for one topic, told apart by their ids."""
QUEUE = 100
"""Of a topic, when the client says nothing or 0."""


def dumps(content: Message) -> str:
    """JSON, with null for numbers that are none."""
    try:
        return json.dumps(content, allow_nan=False)
    except ValueError:
        return json.dumps(without_nan(content))


class Feed:
    """A topic on its way to one client, which may have subscribed several times: the widest wish counts."""

    def __init__(self, graph: Graph, wish: Subscribe, wake: asyncio.Event, owner: object) -> None:
        self.topic = wish.topic
        self._wishes: dict[Id, Subscribe] = {}
        self._queue: deque[Message] = deque()
        self._wake = wake
        self._loop = asyncio.get_running_loop()
        self._due_s = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self.add(wish)
        self._subscription: Subscription = graph.subscribe(wish.topic, wish.type, self._take, owner=owner)

    def add(self, wish: Subscribe) -> None:
        if wish.id not in self._wishes and len(self._wishes) >= MAX_WISHES:
            raise ConflictError(f"a client may subscribe {MAX_WISHES} times to one topic")
        self._wishes[wish.id] = wish
        self._settle()

    def remove(self, wish_id: Id) -> bool:
        """Whether nobody wants it any more; None removes all wishes."""
        if wish_id is None:
            self._wishes.clear()
        else:
            self._wishes.pop(wish_id, None)
        if self._wishes:
            self._settle()
        return not self._wishes

    def close(self) -> None:
        self._subscription.close()
        self._queue.clear()
        if self._timer is not None:
            self._timer.cancel()

    def next(self) -> Message | None:
        """A message, if one may go now."""
        if not self._queue:
            return None
        now_s = self._loop.time()
        if now_s < self._due_s:
            if self._timer is None:
                self._timer = self._loop.call_at(self._due_s, self._due)
            return None
        # On the grid of the rate, unless nothing came for a while.
        behind = now_s - self._due_s >= self._period_s
        self._due_s = (now_s if behind else self._due_s) + self._period_s
        return self._queue.popleft()

    def texts(self, message: Message, name: str) -> Iterator[str]:
        content = {"op": "publish", "topic": self.topic, "msg": message}
        return in_pieces(dumps(content), self._fragment_size, name)

    @property
    def type(self) -> str:
        return self._subscription.type

    def _due(self) -> None:
        self._timer = None
        self._wake.set()

    def _settle(self) -> None:
        wishes = self._wishes.values()
        self._period_s = min(wish.throttle_rate or 0.0 for wish in wishes) / 1000.0
        lengths = [wish.queue_length or 0 for wish in wishes]
        self._length = min(max(lengths) or QUEUE, MAX_QUEUE)
        self._sparse = self._period_s > 0.0 and not max(lengths)
        sizes = [wish.fragment_size for wish in wishes if wish.fragment_size is not None]
        self._fragment_size = min(sizes, default=None)

    def _take(self, message: Message) -> None:
        if self._sparse and (self._queue or self._loop.time() < self._due_s):
            return  # throttled, and nothing is to be kept for later
        if len(self._queue) >= self._length:
            self._queue.popleft()
        self._queue.append(message)
        self._wake.set()


class Outbox:
    """All of it, in the order in which it is sent: answers first, then a message of each topic in turn."""

    def __init__(self) -> None:
        self.feeds: dict[str, Feed] = {}
        self.wake = asyncio.Event()
        self.overfull = asyncio.Event()
        self._answers: deque[str] = deque()
        self._bytes = 0
        self._closed = False
        self._numbers = itertools.count()

    def answer(self, content: dict[str, Any], fragment_size: int | None = None) -> None:
        """Send this; `overfull` is set when too much waits."""
        if self._closed:
            return
        for text in in_pieces(dumps(content), fragment_size, f"fragment:{next(self._numbers)}"):
            self._bytes += len(text)
            self._answers.append(text)
        if self._bytes > MAX_BYTES:
            self.overfull.set()
        self.wake.set()

    def mention(self, content: dict[str, Any], fragment_size: int | None = None) -> None:
        """Send this if the client keeps up."""
        if len(self._answers) < MAX_OPTIONAL:
            self.answer(content, fragment_size)

    def texts(self) -> Iterator[str]:
        """What can go now; ends when there is nothing."""
        while True:
            found = False
            yield from self._answered()
            for feed in tuple(self.feeds.values()):
                message = feed.next()
                if message is not None:
                    found = True
                    yield from feed.texts(message, f"fragment:{next(self._numbers)}")
                    yield from self._answered()
            if not found and not self._answers:
                return

    def subscribe(self, graph: Graph, wish: Subscribe, owner: object) -> None:
        """A wish for a topic.

        Raises:
            InputError: see `Graph.subscribe`.
            ConflictError: there are too many for this topic.
        """
        feed = self.feeds.get(wish.topic)
        if feed is None:
            self.feeds[wish.topic] = Feed(graph, wish, self.wake, owner)
            return
        if wish.type is not None and graph.messages.resolved(wish.type, "msg") != feed.type:
            raise InputError(f"{wish.topic} is of type {feed.type}, not {wish.type}")
        feed.add(wish)

    def unsubscribe(self, topic: str, wish_id: Id) -> None:
        feed = self.feeds.get(topic)
        if feed is None:
            raise InputError(f"{topic} is not subscribed")
        if feed.remove(wish_id):
            feed.close()
            del self.feeds[topic]

    def close(self) -> None:
        """Nobody is there any more."""
        self._closed = True
        self._answers.clear()
        for feed in self.feeds.values():
            feed.close()
        self.feeds.clear()

    def _answered(self) -> Iterator[str]:
        while self._answers:
            text = self._answers.popleft()
            self._bytes -= len(text)
            yield text
