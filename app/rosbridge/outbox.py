"""Messages that wait to be sent to one client: answers, which must all arrive, and topic messages, of which
only the newest matter.
"""

from __future__ import annotations

import asyncio
import itertools
import json
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

from app.graph.ends import Subscription
from app.graph.graph import Graph
from app.rosbridge.fragments import in_pieces
from app.rosbridge.operations import MAX_QUEUE, Id, Subscribe
from cobot.errors import ConflictError, InputError
from cobot.ros.codec import without_nan
from cobot.ros.messages import Message

MAX_BYTES = 32 * 2**20
"""Maximum size of the waiting answers, in bytes. If it is exceeded, the client is disconnected."""
MAX_OPTIONAL = 256
"""Number of waiting messages above which feedback and status messages are dropped."""
MAX_PER_TOPIC = 100
"""Maximum number of subscriptions or advertisements of one topic by one client. Their ids distinguish
them.
"""
DEFAULT_QUEUE = 100
"""Maximum number of waiting messages of a topic, if the client gives none or 0."""


def dumps(content: Message) -> str:
    """Convert to JSON, with null for numbers that are not finite."""
    try:
        return json.dumps(content, allow_nan=False)
    except ValueError:
        return json.dumps(without_nan(content))


class TopicFeed:
    """A topic that one client has subscribed to, possibly several times. The smallest interval between
    messages, the longest queue and the smallest fragments of all these subscriptions apply.
    """

    def __init__(
        self,
        graph: Graph,
        request: Subscribe,
        wake: asyncio.Event,
        owner: object,
        tell: Callable[[str], None],
    ) -> None:
        self.topic = request.topic
        self._requests: dict[Id, Subscribe] = {}
        self._queue: deque[Message] = deque()
        self._wake = wake
        self._loop = asyncio.get_running_loop()
        self._due_s = 0.0
        self._timer: asyncio.TimerHandle | None = None
        self.add(request)
        self._subscription: Subscription = graph.subscribe(
            request.topic, request.type, self._take, owner=owner, on_other_type=tell
        )

    def add(self, request: Subscribe) -> None:
        if request.id not in self._requests and len(self._requests) >= MAX_PER_TOPIC:
            raise ConflictError(f"a client may subscribe to a topic at most {MAX_PER_TOPIC} times")
        self._requests[request.id] = request
        self._settle()

    def remove(self, request_id: Id) -> bool:
        """Remove a subscription request, or all of them if `request_id` is None. Returns whether none is
        left.
        """
        if request_id is None:
            self._requests.clear()
        else:
            self._requests.pop(request_id, None)
        if self._requests:
            self._settle()
        return not self._requests

    def close(self) -> None:
        self._subscription.close()
        self._queue.clear()
        if self._timer is not None:
            self._timer.cancel()

    def next(self) -> Message | None:
        """Return the next message; None if none may be sent now."""
        if not self._queue:
            return None
        now_s = self._loop.time()
        if now_s < self._due_s:
            if self._timer is None:
                self._timer = self._loop.call_at(self._due_s, self._wake_up)
            return None
        # Messages are sent at multiples of the interval, unless none has arrived for a while.
        behind = now_s - self._due_s >= self._period_s
        self._due_s = (now_s if behind else self._due_s) + self._period_s
        return self._queue.popleft()

    def texts(self, message: Message, name: str) -> Iterator[str]:
        content = {"op": "publish", "topic": self.topic, "msg": message}
        return in_pieces(dumps(content), self._fragment_size, name)

    @property
    def type(self) -> str | None:
        """The type of the topic's messages; None if messages of every type are accepted."""
        return self._subscription.type

    def _wake_up(self) -> None:
        self._timer = None
        self._wake.set()

    def _settle(self) -> None:
        requests = self._requests.values()
        self._period_s = min(request.throttle_rate or 0.0 for request in requests) / 1000.0
        lengths = [request.queue_length or 0 for request in requests]
        self._length = min(max(lengths) or DEFAULT_QUEUE, MAX_QUEUE)
        self._sparse = self._period_s > 0.0 and not max(lengths)
        sizes = [request.fragment_size for request in requests if request.fragment_size is not None]
        self._fragment_size = min(sizes, default=None)

    def _take(self, message: Message) -> None:
        if self._sparse and (self._queue or self._loop.time() < self._due_s):
            return  # throttled, and no message is kept for later
        if len(self._queue) >= self._length:
            self._queue.popleft()
        self._queue.append(message)
        self._wake.set()


class Outbox:
    """All messages for one client, in the order of sending: first answers, then one message from each topic
    in turn.
    """

    def __init__(self) -> None:
        self.feeds: dict[str, TopicFeed] = {}
        self.wake = asyncio.Event()
        self.overfull = asyncio.Event()
        self._answers: deque[str] = deque()
        self._bytes = 0
        self._closed = False
        self._numbers = itertools.count()

    def answer(self, content: dict[str, Any], fragment_size: int | None = None) -> None:
        """Queue an answer. Sets `overfull` if too much data is waiting."""
        if self._closed:
            return
        for text in in_pieces(dumps(content), fragment_size, f"fragment:{next(self._numbers)}"):
            self._bytes += len(text)
            self._answers.append(text)
        if self._bytes > MAX_BYTES:
            self.overfull.set()
        self.wake.set()

    def mention(self, content: dict[str, Any], fragment_size: int | None = None) -> None:
        """Queue an optional message, unless the client is too slow."""
        if len(self._answers) < MAX_OPTIONAL:
            self.answer(content, fragment_size)

    def texts(self) -> Iterator[str]:
        """Yield messages as long as one can be sent."""
        while True:
            found = False
            yield from self._take_answers()
            for feed in tuple(self.feeds.values()):
                message = feed.next()
                if message is not None:
                    found = True
                    yield from feed.texts(message, f"fragment:{next(self._numbers)}")
                    yield from self._take_answers()
            if not found and not self._answers:
                return

    def subscribe(self, graph: Graph, request: Subscribe, owner: object, tell: Callable[[str], None]) -> None:
        """Subscribe the client to a topic.

        Args:
            tell: function that is called with a sentence if the topic is later advertised with a different
                type.

        Raises:
            InputError: see `Graph.subscribe`.
            ConflictError: the client has too many subscriptions of this topic.
        """
        feed = self.feeds.get(request.topic)
        if feed is None:
            self.feeds[request.topic] = TopicFeed(graph, request, self.wake, owner, tell)
            return
        known = feed.type or graph.type_of(request.topic)
        if request.type is not None and known not in (None, graph.messages.resolved(request.type, "msg")):
            raise InputError(f"{request.topic} is of type {known}, not {request.type}")
        feed.add(request)

    def unsubscribe(self, topic: str, request_id: Id) -> None:
        feed = self.feeds.get(topic)
        if feed is None:
            raise InputError(f"{topic} is not subscribed")
        if feed.remove(request_id):
            feed.close()
            del self.feeds[topic]

    def close(self) -> None:
        """Close the outbox, because the client has disconnected."""
        self._closed = True
        self._answers.clear()
        for feed in self.feeds.values():
            feed.close()
        self.feeds.clear()

    def _take_answers(self) -> Iterator[str]:
        while self._answers:
            text = self._answers.popleft()
            self._bytes -= len(text)
            yield text
