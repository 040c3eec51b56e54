"""A topic with its publishers and its subscriptions."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from cobot.ros.messages import Message, Messages

log = logging.getLogger("cobot.graph")


class Keeper(Protocol):
    """Interface of `Topics` for its publishers and subscriptions."""

    messages: Messages
    gateways: set[object]

    def drop(self, topic: Topic, end: Publisher | Subscription) -> None:
        """Remove a publisher or a subscription of a topic."""


class Publisher:
    """The right of an owner to publish on a topic. Created by `Graph.advertise`.

    Attributes:
        binding: whether the publisher's type applies to all clients while the advertisement lasts.
        latch: whether later subscribers get the last message, `last`.
        on_demand: function that is called with the number of subscribers when it changes.
    """

    def __init__(
        self, topics: Keeper, topic: Topic, type_: str, latch: bool, owner: object, binding: bool
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
        """Number of subscriptions that accept messages of the given type."""
        return sum(each.takes(self.type) for each in self._topic.subscriptions)

    def publish(self, message: Message | bytes) -> None:
        """Deliver a message to all subscribers.

        Args:
            message: a dict, in which fields with ROS's default value may be missing, or CDR bytes.

        Raises:
            InputError: the message is not of the topic's type. No subscriber gets it.
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
        """End the advertisement of the topic. Further calls do nothing."""
        # The message may be large, and this object may live until the next garbage collection.
        self.last = None
        self._topics.drop(self._topic, self)


class Subscription:
    """A client's subscription to a topic. Created by `Graph.subscribe`.

    Attributes:
        type: message type that the subscription accepts; None for all types.
        on_other_type: function that is called with a sentence when the topic is advertised with a different
            type. The subscription gets no messages of that type.
    """

    def __init__(
        self,
        topics: Keeper,
        topic: Topic,
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
        """Whether the subscription gets messages of this type."""
        return self.type is None or self.type == type_

    def deliver(self, message: Message) -> None:
        try:
            self._callback(message)
        except Exception as exc:
            log.error("a subscriber of %s failed", self.topic, exc_info=exc)

    def close(self) -> None:
        """End the subscription. Further calls do nothing."""
        self._topics.drop(self._topic, self)


@dataclass(slots=True, eq=False)
class Topic:
    """A topic that has a publisher or a subscriber.

    Attributes:
        declared: the only type that publishers may use here, as the service itself declared it.
        local: whether the DDS process publishes this topic itself.
        owner: the only owner that may publish here; None if all may.
    """

    name: str
    declared: str | None = None
    local: bool = False
    owner: object | None = None
    publishers: list[Publisher] = field(default_factory=list)
    subscriptions: list[Subscription] = field(default_factory=list)

    @property
    def advertised(self) -> str | None:
        """The type that applies to all clients; None until a client has declared or advertised the topic."""
        return self.declared or next((each.type for each in self.publishers if each.binding), None)

    @property
    def types(self) -> list[str]:
        """The type that applies to all clients. If clients use different types, all of these are returned,
        the publishers' types first.
        """
        if advertised := self.advertised:
            return [advertised]
        used = [each.type for each in self.publishers]
        used += [each.type for each in self.subscriptions if each.type is not None]
        return list(dict.fromkeys(used))

    def report_demand(self) -> None:
        """Report to each publisher how many subscribers it has."""
        for publisher in tuple(self.publishers):
            if publisher.on_demand is not None:
                publisher.on_demand(publisher.subscribers)

    def report_type(self, type_: str) -> None:
        """Report to subscriptions with a different type that they get no messages."""
        for subscription in tuple(self.subscriptions):
            if not subscription.takes(type_) and subscription.on_other_type is not None:
                subscription.on_other_type(
                    f"{self.name} is advertised as {type_}: the subscription of type {subscription.type} "
                    f"gets nothing; subscribe with {type_}"
                )
