"""Topics: who publishes, who has subscribed, and what was published last.

A message is a ROS message as a dict, complete and checked against its type when it is published; who gets one
must not change it. Delivery is a call: a subscriber that needs time keeps a queue of its own, so that nobody
who publishes ever waits.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from cobot.errors import InputError, PermissionDenied
from cobot.ros.messages import Message, Messages
from cobot.strict import shown

_NAME = re.compile(r"(/[A-Za-z0-9_-]+)+")
MAX_NAME = 255

log = logging.getLogger("cobot.graph")


class Publisher:
    """Somebody's right to publish on a topic. Made by `Graph.advertise`.

    Attributes:
        latch: who subscribes later gets `last`.
        on_demand: called with the number of subscribers when it has changed.
    """

    def __init__(self, topics: Topics, topic: _Topic, latch: bool, owner: object) -> None:
        self.topic = topic.name
        self.type = topic.type
        self.owner = owner
        self.last: Message | None = None
        self.on_demand: Callable[[int], None] | None = None
        self._topics = topics
        self._topic = topic
        self.latch = latch

    @property
    def subscribers(self) -> int:
        return len(self._topic.subscriptions)

    def publish(self, message: Message | bytes) -> None:
        """Give a message to all who have subscribed.

        Args:
            message: a dict, in which ROS's defaults may be missing, or CDR.

        Raises:
            InputError: it is no message of the topic's type; nobody gets it.
        """
        messages = self._topics.messages
        if isinstance(message, bytes):
            content = messages.from_cdr(self.type, message)
        else:
            content = messages.checked(self.type, message)
        if self.latch:
            self.last = content
        echo = self.owner not in self._topics.gateways
        for subscription in tuple(self._topic.subscriptions):
            if echo or subscription.owner is not self.owner:
                subscription.deliver(content)

    def close(self) -> None:
        """Done with it. May be called again."""
        self.last = None  # which may be large, and whoever holds this may be garbage that nobody collects yet
        self._topics.drop(self._topic, self)


class Subscription:
    """Somebody's subscription to a topic. Made by `Graph.subscribe`."""

    def __init__(
        self, topics: Topics, topic: _Topic, callback: Callable[[Message], None], owner: object
    ) -> None:
        self.topic = topic.name
        self.type = topic.type
        self.owner = owner
        self._topics = topics
        self._topic = topic
        self._callback = callback

    def deliver(self, message: Message) -> None:
        try:
            self._callback(message)
        except Exception as exc:
            log.error("a subscriber of %s failed", self.topic, exc_info=exc)

    def close(self) -> None:
        """Done with it. May be called again."""
        self._topics.drop(self._topic, self)


@dataclass(slots=True, eq=False)
class _Topic:
    """Lives as long as somebody publishes or subscribes.

    Attributes:
        local: the DDS process has this topic itself.
        owner: who alone may publish here; None for everybody.
    """

    name: str
    type: str
    local: bool = False
    owner: object | None = None
    publishers: list[Publisher] = field(default_factory=list)
    subscriptions: list[Subscription] = field(default_factory=list)


class Topics:
    """All topics, by name.

    Attributes:
        messages: the types.
        gateways: owners that only mirror what others have, on another network: they do not show in the
            graph, and what they publish they do not get back.
    """

    def __init__(self, messages: Messages) -> None:
        self.messages = messages
        self.gateways: set[object] = set()
        self._topics: dict[str, _Topic] = {}

    def advertise(
        self,
        topic: str,
        type_: str,
        *,
        latch: bool = False,
        owner: object,
        local: bool = False,
        alone: bool = False,
        on_demand: Callable[[int], None] | None = None,
    ) -> Publisher:
        """Publish on a topic.

        Args:
            topic: "/iiwa/status".
            type_: "std_msgs/msg/String".
            latch: who subscribes later gets the last message.
            owner: whose it is.
            local: the DDS process has this topic itself and shall not mirror it.
            alone: nobody else may publish there from now on.
            on_demand: called with the number of subscribers, when it changes and now.

        Raises:
            InputError: no valid name, no known type, or another type than the topic has.
            PermissionDenied: somebody else publishes there alone.
        """
        entry = self._topic(topic, type_)
        if entry.owner is not None and entry.owner is not owner:
            raise PermissionDenied(f"{entry.name} tells what its owner knows: nobody else publishes there")
        if alone:
            entry.owner = owner
        entry.local |= local
        publisher = Publisher(self, entry, latch, owner)
        publisher.on_demand = on_demand
        entry.publishers.append(publisher)
        if on_demand is not None:
            on_demand(publisher.subscribers)
        self.changed()
        return publisher

    def subscribe(
        self, topic: str, type_: str | None, callback: Callable[[Message], None], *, owner: object
    ) -> Subscription:
        """Get a topic's messages, the last one of each latched publisher first.

        Args:
            type_: None for what the topic has.
            callback: called with each message, in the event loop; it must be quick.

        Raises:
            InputError: see `advertise`; or no type is given and nobody publishes.
        """
        entry = self._topic(topic, type_)
        subscription = Subscription(self, entry, callback, owner)
        entry.subscriptions.append(subscription)
        for publisher in entry.publishers:
            if publisher.last is not None:
                subscription.deliver(publisher.last)
        self._demand(entry)
        self.changed()
        return subscription

    def drop(self, topic: _Topic, end: Publisher | Subscription) -> None:
        """Forget a publisher or a subscription; nothing happens if that was done already."""
        ends: list[Any] = topic.publishers if isinstance(end, Publisher) else topic.subscriptions
        if end not in ends:
            return
        ends.remove(end)
        if end.owner is topic.owner and not any(each.owner is topic.owner for each in topic.publishers):
            topic.owner = None
        if not topic.publishers and not topic.subscriptions:
            del self._topics[topic.name]
        elif isinstance(end, Subscription):
            self._demand(topic)
        self.changed()

    def topics(self) -> dict[str, str]:
        """The type of each topic."""
        return {topic.name: topic.type for topic in self._topics.values()}

    def type_of(self, topic: str) -> str | None:
        """A topic's type; None if there is no such topic."""
        entry = self._topics.get(absolute(topic))
        return None if entry is None else entry.type

    def ends_of(self, topic: str) -> tuple[int, int]:
        """How many publish on a topic, and how many have subscribed."""
        entry = self._topics.get(absolute(topic))
        return (0, 0) if entry is None else (len(entry.publishers), len(entry.subscriptions))

    def changed(self) -> None:
        """Called when there is another topic, publisher or subscription, or one less."""

    def graph_of_topics(self) -> list[dict[str, Any]]:
        """The topics that another network may mirror: without what is its own, and what it has itself."""
        made = []
        for topic in self._topics.values():
            publishers = self._own(topic.publishers)
            # Nobody waits for what another network says on a topic that has one publisher alone.
            subscribers = self._own(topic.subscriptions) if topic.owner is None else 0
            if not topic.local and (publishers or subscribers):
                made.append(
                    {
                        "name": topic.name,
                        "type": topic.type,
                        "publishers": publishers,
                        "subscribers": subscribers,
                        "latched": any(publisher.latch for publisher in topic.publishers),
                    }
                )
        return made

    def _own(self, ends: list[Any]) -> int:
        return sum(end.owner not in self.gateways for end in ends)

    def _topic(self, name: str, type_: str | None) -> _Topic:
        name = absolute(name)
        entry = self._topics.get(name)
        if type_ is not None:
            type_ = self.messages.resolved(type_, "msg")
        if entry is None:
            if type_ is None:
                raise InputError(f"nobody publishes {name}, so its type must be given")
            entry = self._topics[name] = _Topic(name, type_)
        elif type_ is not None and type_ != entry.type:
            raise InputError(f"{name} is of type {entry.type}, not {type_}")
        return entry

    def _demand(self, topic: _Topic) -> None:
        for publisher in tuple(topic.publishers):
            if publisher.on_demand is not None:
                publisher.on_demand(len(topic.subscriptions))


def absolute(name: str) -> str:
    """The name with the slash in front that clients may leave out.

    Raises:
        InputError: it is no valid name.
    """
    if not name.startswith("/"):
        name = f"/{name}"
    if len(name) > MAX_NAME or not _NAME.fullmatch(name):
        raise InputError(f"{shown(name)} is no name such as /robot/joint_states")
    return name
