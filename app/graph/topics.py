"""Topics: who publishes, who has subscribed, and what was published last.

A message is a ROS message as a dict, complete and checked against its type when it is published; who gets one
must not change it. Delivery is a call: a subscriber that needs time keeps a queue of its own, so that nobody
who publishes ever waits.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
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
        binding: its type applies to all clients while it lasts.
        latch: who subscribes later gets `last`.
        on_demand: called with the number of subscribers when it has changed.
    """

    def __init__(
        self, topics: Topics, topic: _Topic, type_: str, latch: bool, owner: object, binding: bool
    ) -> None:
        self.topic = topic.name
        self.type = type_
        self.binding = binding
        self.owner = owner
        self.last: Message | None = None
        self.on_demand: Callable[[int], None] | None = None
        self._topics = topics
        self._topic = topic
        self.latch = latch

    @property
    def subscribers(self) -> int:
        """How many subscriptions take messages of this type."""
        return sum(each.takes(self.type) for each in self._topic.subscriptions)

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
            if subscription.takes(self.type) and (echo or subscription.owner is not self.owner):
                subscription.deliver(content)

    def close(self) -> None:
        """Done with it. May be called again."""
        self.last = None  # which may be large, and whoever holds this may be garbage that nobody collects yet
        self._topics.drop(self._topic, self)


class Subscription:
    """A client's subscription to a topic. Made by `Graph.subscribe`.

    Attributes:
        type: of the messages that it takes; None: of whatever is published.
        on_other_type: called with a sentence when the topic is advertised with another type, of which the
            subscription gets nothing.
    """

    def __init__(
        self,
        topics: Topics,
        topic: _Topic,
        type_: str | None,
        callback: Callable[[Message], None],
        owner: object,
        on_other_type: Callable[[str], None] | None,
    ) -> None:
        self.topic = topic.name
        self.type = type_
        self.owner = owner
        self.on_other_type = on_other_type
        self._topics = topics
        self._topic = topic
        self._callback = callback

    def takes(self, type_: str) -> bool:
        """Whether it gets messages of this type."""
        return self.type is None or self.type == type_

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
        declared: the type that the service itself accepts here from every publisher.
        local: the DDS process has this topic itself.
        owner: who alone may publish here; None for everybody.
    """

    name: str
    declared: str | None = None
    local: bool = False
    owner: object | None = None
    publishers: list[Publisher] = field(default_factory=list)
    subscriptions: list[Subscription] = field(default_factory=list)


class Topics:
    """All topics, by name.

    A topic has the type with which it is advertised, until its last advertiser ends. Neither a subscription
    nor a gateway, which only mirrors what others have subscribed, fixes it for anybody else.

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
        inferred: bool = False,
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
            inferred: the type was not given, but taken from a subscription.
            on_demand: called with the number of subscribers, when it changes and now.

        Raises:
            InputError: no valid name, no known type, or another type than the topic is advertised with.
            PermissionDenied: somebody else publishes there alone.
        """
        entry, known = self._topic(topic, type_)
        assert known is not None
        if entry.owner is not None and entry.owner is not owner:
            raise PermissionDenied(f"{entry.name} tells what its owner knows: nobody else publishes there")
        if alone:
            entry.owner = owner
        entry.local |= local
        binding = not inferred and owner not in self.gateways
        publisher = Publisher(self, entry, known, latch, owner, binding)
        publisher.on_demand = on_demand
        entry.publishers.append(publisher)
        if binding:
            _tell_others(entry, known)
        if on_demand is not None:
            on_demand(publisher.subscribers)
        self.changed()
        return publisher

    def subscribe(
        self,
        topic: str,
        type_: str | None,
        callback: Callable[[Message], None],
        *,
        owner: object,
        declares: bool = False,
        on_other_type: Callable[[str], None] | None = None,
    ) -> Subscription:
        """Get a topic's messages, the last one of each latched publisher first.

        Args:
            type_: None for what is published, whatever its type.
            callback: called with each message, in the event loop; it must be quick.
            declares: the topic is the service's own and always has this type.
            on_other_type: see `Subscription`.

        Raises:
            InputError: see `advertise`; or no type is given and nobody publishes.
        """
        entry, known = self._topic(topic, type_)
        if declares:
            entry.declared = known
        subscription = Subscription(self, entry, known, callback, owner, on_other_type)
        entry.subscriptions.append(subscription)
        for publisher in entry.publishers:
            if publisher.last is not None and subscription.takes(publisher.type):
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
        """The type of each topic; without an advertiser, the first one in use."""
        return {topic.name: next(iter(self._types(topic)), "") for topic in self._topics.values()}

    def type_of(self, topic: str) -> str | None:
        """The type with which a topic is advertised; None if it is not."""
        entry = self._topics.get(absolute(topic))
        return None if entry is None else self._advertised(entry)

    def types_of(self, topic: str) -> list[str]:
        """The type with which a topic is advertised; without an advertiser, all that are in use."""
        entry = self._topics.get(absolute(topic))
        return [] if entry is None else self._types(entry)

    def ends_of(self, topic: str) -> tuple[int, int]:
        """How many publish on a topic, and how many have subscribed."""
        entry = self._topics.get(absolute(topic))
        return (0, 0) if entry is None else (len(entry.publishers), len(entry.subscriptions))

    def changed(self) -> None:
        """Called when there is another topic, publisher or subscription, or one less."""

    def graph_of_topics(self) -> list[dict[str, Any]]:
        """The topics that another network may mirror: without what is its own, and what it has itself.

        A topic without an advertiser is listed once with each type that is subscribed, so that no
        subscription fixes the type for the others.
        """
        made = []
        for topic in self._topics.values():
            for type_ in () if topic.local else self._types(topic):
                publishers = self._own([each for each in topic.publishers if each.type == type_])
                takers = [each for each in topic.subscriptions if each.takes(type_)]
                # Nobody waits for what another network says on a topic that has one publisher alone.
                subscribers = self._own(takers) if topic.owner is None else 0
                if publishers or subscribers:
                    made.append(
                        {
                            "name": topic.name,
                            "type": type_,
                            "publishers": publishers,
                            "subscribers": subscribers,
                            "latched": any(each.latch for each in topic.publishers if each.type == type_),
                        }
                    )
        return made

    def _own(self, ends: Sequence[Publisher | Subscription]) -> int:
        return sum(end.owner not in self.gateways for end in ends)

    def _topic(self, name: str, type_: str | None) -> tuple[_Topic, str | None]:
        """A topic, made if there is none, and the type that is asked for, in full."""
        name = absolute(name)
        entry = self._topics.get(name)
        if type_ is not None:
            type_ = self.messages.resolved(type_, "msg")
        advertised = None if entry is None else self._advertised(entry)
        if type_ is None and (entry is None or not (advertised or entry.publishers)):
            raise InputError(f"nobody publishes {name}, so its type must be given")
        if type_ is not None and advertised is not None and type_ != advertised:
            raise InputError(f"{name} is of type {advertised}, not {type_}")
        if entry is None:
            entry = self._topics[name] = _Topic(name)
        return entry, type_

    @staticmethod
    def _advertised(topic: _Topic) -> str | None:
        """The type that applies to all clients; None if there is none yet."""
        return topic.declared or next((each.type for each in topic.publishers if each.binding), None)

    def _types(self, topic: _Topic) -> list[str]:
        """The type that applies to all clients; without one, all in use, those of publishers first."""
        if advertised := self._advertised(topic):
            return [advertised]
        used = [each.type for each in topic.publishers]
        used += [each.type for each in topic.subscriptions if each.type is not None]
        return list(dict.fromkeys(used))

    def _demand(self, topic: _Topic) -> None:
        for publisher in tuple(topic.publishers):
            if publisher.on_demand is not None:
                publisher.on_demand(publisher.subscribers)


def _tell_others(topic: _Topic, type_: str) -> None:
    """Tell the subscriptions of other types that they get nothing."""
    for subscription in tuple(topic.subscriptions):
        if not subscription.takes(type_) and subscription.on_other_type is not None:
            subscription.on_other_type(
                f"{topic.name} is advertised as {type_}: the subscription of type {subscription.type} gets "
                f"nothing; subscribe with {type_}"
            )


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
