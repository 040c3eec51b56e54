"""Topics by name, with their types, publishers and subscribers.

A message is a ROS message as a dict. It is completed and validated when it is published, and delivered by
function calls. Subscribers must not change it. A slow subscriber must have its own queue, because publishers
never wait.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from app.graph.ends import Publisher, Subscription, Topic
from cobot.errors import InputError, PermissionDenied
from cobot.ros.messages import Message, Messages
from cobot.strict import shown

_NAME = re.compile(r"(/[A-Za-z0-9_-]+)+")
MAX_NAME = 255


class Topics:
    """All topics, by name.

    The first advertisement of a topic determines its type until the last advertisement ends. Subscriptions do
    not determine the type. Neither do gateways, which only mirror the subscriptions of others.

    Attributes:
        messages: the known message types.
        gateways: owners that only mirror the graph to another network. They do not appear in the graph, and
            do not get their own messages back.
    """

    def __init__(self, messages: Messages) -> None:
        self.messages = messages
        self.gateways: set[object] = set()
        self._topics: dict[str, Topic] = {}

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
            topic: topic name, such as "/iiwa/status".
            type_: message type, such as "std_msgs/msg/String".
            latch: whether later subscribers get the last message.
            owner: the client or part of the service that publishes.
            local: whether the DDS process publishes this topic itself and must not mirror it.
            alone: whether to reserve the topic for this owner.
            inferred: whether the type was taken from a subscription, because the client gave none.
            on_demand: function that is called with the number of subscribers, now and whenever it changes.

        Raises:
            InputError: the name or the type is invalid, or the topic is advertised with a different type.
            PermissionDenied: the topic belongs to another owner.
        """
        entry, known = self._topic(topic, type_)
        assert known is not None
        if entry.owner is not None and entry.owner is not owner:
            raise PermissionDenied(
                f"{entry.name} belongs to its publisher; no other client may publish there"
            )
        if alone:
            entry.owner = owner
        entry.local |= local
        binding = not inferred and owner not in self.gateways
        publisher = Publisher(self, entry, known, latch, owner, binding)
        publisher.on_demand = on_demand
        entry.publishers.append(publisher)
        if binding:
            entry.report_type(known)
        if on_demand is not None:
            on_demand(publisher.subscribers)
        self.note_change()
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
        """Subscribe to a topic. The callback first gets the last message of each latched publisher.

        Args:
            type_: message type; None for all types that are published.
            callback: function that is called with each message in the event loop. It must return quickly.
            declares: whether the topic belongs to the service and always has this type.
            on_other_type: see `Subscription`.

        Raises:
            InputError: see `advertise`; or no type is given and the topic has no publisher.
        """
        entry, known = self._topic(topic, type_)
        if declares:
            entry.declared = known
        subscription = Subscription(self, entry, known, callback, owner, on_other_type)
        entry.subscriptions.append(subscription)
        for publisher in entry.publishers:
            if publisher.last is not None and subscription.takes(publisher.type):
                subscription.deliver(publisher.last)
        entry.report_demand()
        self.note_change()
        return subscription

    def drop(self, topic: Topic, end: Publisher | Subscription) -> None:
        """Remove a publisher or a subscription. Does nothing if it has already been removed."""
        ends: list[Any] = topic.publishers if isinstance(end, Publisher) else topic.subscriptions
        if end not in ends:
            return
        ends.remove(end)
        if end.owner is topic.owner and not any(each.owner is topic.owner for each in topic.publishers):
            topic.owner = None
        if not topic.publishers and not topic.subscriptions:
            del self._topics[topic.name]
        elif isinstance(end, Subscription):
            topic.report_demand()
        self.note_change()

    def topics(self) -> dict[str, str]:
        """Return the type of each topic; for a topic without an advertiser, the first type in use."""
        return {topic.name: next(iter(topic.types), "") for topic in self._topics.values()}

    def type_of(self, topic: str) -> str | None:
        """Return the advertised type of a topic; None if it is not advertised."""
        entry = self._topics.get(absolute(topic))
        return None if entry is None else entry.advertised

    def types_of(self, topic: str) -> list[str]:
        """Return the advertised type of a topic; for a topic without an advertiser, all types in use."""
        entry = self._topics.get(absolute(topic))
        return [] if entry is None else entry.types

    def ends_of(self, topic: str) -> tuple[int, int]:
        """Return the number of publishers and the number of subscriptions of a topic."""
        entry = self._topics.get(absolute(topic))
        return (0, 0) if entry is None else (len(entry.publishers), len(entry.subscriptions))

    def note_change(self) -> None:
        """Called when a topic, a publisher or a subscription has been added or removed."""

    def graph_of_topics(self) -> list[dict[str, Any]]:
        """List the topics that a gateway may offer to another network. Topics for which only gateways publish
        or subscribe are left out.

        A topic without an advertiser is listed once for each subscribed type, so that no subscription
        determines the type for the others.
        """
        made = []
        for topic in self._topics.values():
            for type_ in () if topic.local else topic.types:
                publishers = self._own([each for each in topic.publishers if each.type == type_])
                takers = [each for each in topic.subscriptions if each.takes(type_)]
                # Messages from another network are not delivered to a topic that belongs to one publisher.
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

    def _topic(self, name: str, type_: str | None) -> tuple[Topic, str | None]:
        """Return a topic, and the full name of the requested type. The topic is created if it does not
        exist.
        """
        name = absolute(name)
        entry = self._topics.get(name)
        if type_ is not None:
            type_ = self.messages.resolved(type_, "msg")
        advertised = None if entry is None else entry.advertised
        if type_ is None and (entry is None or not (advertised or entry.publishers)):
            raise InputError(f"{name} has no publisher, so its type must be given")
        if type_ is not None and advertised is not None and type_ != advertised:
            raise InputError(f"{name} is of type {advertised}, not {type_}")
        if entry is None:
            entry = self._topics[name] = Topic(name)
        return entry, type_


def absolute(name: str) -> str:
    """Return the name with its leading slash, which clients may omit.

    Raises:
        InputError: the name is invalid.
    """
    if not name.startswith("/"):
        name = f"/{name}"
    if len(name) > MAX_NAME or not _NAME.fullmatch(name):
        raise InputError(f"{shown(name)} is not a name such as /robot/joint_states")
    return name
