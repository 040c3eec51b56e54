"""Mirrors the graph of the web service to DDS, in both directions: services, actions and topics.

The service's topic /cobot/graph lists everything, so no name is known here in advance. A service of the graph
becomes a ROS service. If a topic has a publisher in the graph, the gateway publishes it on DDS. If a topic
has a subscriber in the graph, the gateway subscribes to it on DDS. No message returns to its origin: the
service does not send a gateway its own messages, and a participant does not receive its own messages. Actions
consist of services and topics. If the subscribers of a topic use several types, the gateway has one reader
for each type.

While the service is not connected, all endpoints stay, and calls report that it is not connected.
"""

from __future__ import annotations

import gc
import json
import logging
import time
from collections.abc import Callable
from typing import Any, TypeVar

from cobot.access.roles import ROS, Identity, Role, require
from cobot.codes import code_of
from cobot.dds.inbox import LossCounter
from cobot.dds.node import CLIENT, DdsNode, Handler, Message, NodePublisher, NodeService, NodeSubscription
from cobot.dds.rosbridge import Rosbridge
from cobot.errors import CobotError, PayloadError
from cobot.ros.failures import failed_result
from cobot.ros.messages import ros_time

GRAPH = "/cobot/graph"
STATUS_OF_ACTIONS = "/_action/status"
"""Topics with this ending are latched, as in ROS, so that late subscribers see the current status of
goals.
"""
DEPTH = 1000
GOAL_ABORTED, CANCEL_REJECTED = 6, 1
SEND_GOAL, GET_RESULT = "/_action/send_goal", "/_action/get_result"
MAX_UNREAD = 64
"""Maximum number of stored reasons for goals that were too large to read. The newest ones are kept."""

Made = TypeVar("Made", NodeService, NodePublisher, NodeSubscription)
Key = TypeVar("Key", str, tuple[str, str])

log = logging.getLogger("cobot.ros2")


class DdsGateway:
    """Mirrors the graph of the service to DDS while `run` is running.

    Args:
        url: service address.
        own: topics that this process publishes itself.
        token: identifies this process to the service.
        role: role of this process in the service. An observer does not subscribe to topics that it may not
            forward.

    Attributes:
        listeners: by the name of a topic in the graph, a function that is called with each of its messages.
    """

    def __init__(
        self, node: DdsNode, url: str, own: set[str], token: str = "", role: Role = Role.OPERATOR
    ) -> None:
        self._identity = Identity(ROS, role)
        self._node = node
        self._own = own
        self._services: dict[str, NodeService] = {}
        self._out: dict[str, NodePublisher] = {}
        self._in: dict[tuple[str, str], NodeSubscription] = {}
        self._unread = UnreadGoals()
        self.listeners: dict[str, Callable[[Message], None]] = {}
        self.link = Rosbridge(url, self._greet, self._take, token)

    async def run(self) -> None:
        await self.link.run()

    def publish(self, topic: str, type_: str, message: Message) -> bool:
        """Publish a message on the graph. Returns whether the service is connected.

        Raises:
            PermissionDenied: the settings allow ROS clients only to observe.
        """
        require(self._identity, Role.OPERATOR)
        self.link.send({"op": "advertise", "topic": topic, "type": type_})
        return self.link.send({"op": "publish", "topic": topic, "type": type_, "msg": message})

    def close(self) -> None:
        for service in self._services.values():
            service.close()
        for publisher in self._out.values():
            publisher.close()
        for subscription in self._in.values():
            subscription.close()

    def _greet(self) -> None:
        """Set up a new connection. The service knows nothing about the previous connection."""
        self.link.send({"op": "cobot_gateway"})
        self.link.send({"op": "subscribe", "topic": GRAPH, "type": "std_msgs/msg/String"})
        for publisher in self._out.values():
            self._subscribe(publisher)
        for subscription in self._in.values():
            self._advertise(subscription)

    def _take(self, topic: str, message: Message) -> None:
        if topic == GRAPH:
            self._mirror(json.loads(message["data"]))
        elif topic in self._out:
            if topic in self.listeners:
                self.listeners[topic](message)
            try:
                self._out[topic].publish(message)
            except CobotError as exc:
                log.warning("a message on %s cannot be passed on: %s", topic, exc)

    def _mirror(self, graph: dict[str, Any]) -> None:
        """Create and close endpoints until they match the graph."""
        messages = self._node.messages
        new = {name: text for name, text in graph["definitions"].items() if name not in messages.definitions}
        messages.add_lazily(new)  # the graph has already validated them
        topics = [topic for topic in graph["topics"] if topic["name"] not in self._own]
        published = {each["name"]: (each["name"], each["type"]) for each in topics if each["publishers"]}
        listens = self._identity.role >= Role.OPERATOR
        readers = [(each["name"], each["type"]) for each in topics if each["subscribers"] and listens]
        heard = dict(zip(readers, readers, strict=True))
        offered = {each["name"]: (each["name"], each["type"]) for each in graph["services"]}
        # Topics come first, because a client that has found a service may publish to joint_cmd immediately.
        self._settle(self._in, heard, self._listen, self._unadvertise)
        self._settle(self._out, published, self._publish, self._unsubscribe)
        more = not offered.keys() <= self._services.keys()
        self._settle(self._services, offered, self._offer, lambda gone: None)
        if more:  # these services stay, and a garbage collection among them takes 0.1 s each time
            gc.collect()
            gc.freeze()

    def _settle(
        self,
        have: dict[Key, Made],
        wanted: dict[Key, tuple[str, str]],
        make: Callable[[str, str], Made],
        leave: Callable[[Made], None],
    ) -> None:
        for key in [key for key, made in have.items() if wanted.get(key, ("", ""))[1] != made.type]:
            gone = have.pop(key)
            leave(gone)
            gone.close()
        for key, (name, type_) in wanted.items():
            if key not in have:
                try:
                    have[key] = make(name, type_)
                except CobotError as exc:
                    log.warning("%s is not available over ROS 2: %s", name, exc)

    def _offer(self, name: str, type_: str) -> NodeService:
        return self._node.service(name, type_, self._caller(name, type_))

    def _publish(self, name: str, type_: str) -> NodePublisher:
        made = self._node.publisher(name, type_, depth=DEPTH, latched=name.endswith(STATUS_OF_ACTIONS))
        self._subscribe(made)
        return made

    def _listen(self, name: str, type_: str) -> NodeSubscription:
        losses = LossCounter(f"messages on {name} that arrived while the service was unavailable or too slow")

        def forward(message: Message) -> None:
            if not self.link.send({"op": "publish", "topic": name, "type": type_, "msg": message}):
                losses.add()

        made = self._node.subscription(name, type_, forward)
        self._advertise(made)
        return made

    def _subscribe(self, publisher: NodePublisher) -> None:
        about = {"topic": publisher.topic, "type": publisher.type}
        self.link.send({"op": "subscribe", **about, "queue_length": DEPTH})

    def _unsubscribe(self, publisher: NodePublisher) -> None:
        self.link.send({"op": "unsubscribe", "topic": publisher.topic})

    def _advertise(self, subscription: NodeSubscription) -> None:
        self.link.send({"op": "advertise", "topic": subscription.topic, "type": subscription.type})

    def _unadvertise(self, subscription: NodeSubscription) -> None:
        about = {"topic": subscription.topic, "type": subscription.type}
        self.link.send({"op": "unadvertise", **about})

    def _caller(self, name: str, type_: str) -> Handler:
        async def call(request: Message) -> Message:
            action = name.removesuffix(GET_RESULT)
            if action != name and (reason := self._unread.reason(action, request["goal_id"])):
                return failure(self._default(type_), PayloadError(reason))
            try:
                return await self.link.call(name, request, CLIENT.get())
            except PayloadError as exc:
                log.warning("%s: %s", name, exc)
                if (action := name.removesuffix(SEND_GOAL)) != name:
                    self._unread.add(action, request["goal_id"], str(exc))
                    return {**self._default(type_), "accepted": True, "stamp": ros_time(time.time_ns())}
                return failure(self._default(type_), exc)
            except CobotError as exc:
                log.warning("%s: %s", name, exc)
                return failure(self._default(type_), exc)

        return call

    def _default(self, type_: str) -> Message:
        return self._node.messages.default(f"{type_}_Response")


class UnreadGoals:
    """Goals that are too large for the service. They are accepted, so that their result can give the reason.

    ROS has no field for the reason of a rejection.
    """

    def __init__(self) -> None:
        self._reasons: dict[tuple[str, str], str] = {}

    def add(self, action: str, goal_id: Message, reason: str) -> None:
        self._reasons[action, str(goal_id)] = reason
        if len(self._reasons) > MAX_UNREAD:
            del self._reasons[next(iter(self._reasons))]

    def reason(self, action: str, goal_id: Message) -> str | None:
        """The reason why a goal was not read; None for any other goal."""
        return self._reasons.get((action, str(goal_id)))


def failure(response: Message, error: CobotError) -> Message:
    """A response that reports a failure in the fields of its type, because ROS itself defines no field for
    failures.

    Args:
        response: the defaults of the type: a goal is not accepted by default, for example.
    """
    code, text = int(code_of(error)), str(error)
    if "code" in response and "message" in response:
        response |= {"code": code, "message": text}
        if type(response.get("result")) is int:
            response["result"] = code
    elif "status" in response and "result" in response:
        response["status"] = GOAL_ABORTED
        failed_result(response["result"], error)
    elif "return_code" in response:
        response["return_code"] = CANCEL_REJECTED
    elif "success" in response and "message" in response:
        response["message"] = text
    return response
