"""A ROS 2 node with publishers, subscriptions and service servers that behave like those of rmw_fastrtps.

Callbacks and handlers run in the event loop. Messages from the network thread are passed to it in order.

Actions need no additional code. An action consists of three services and two topics below `NAME/_action/`,
see https://design.ros2.org/articles/actions.html, and a handler may take any time to answer.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from typing import Any
from weakref import WeakValueDictionary

from cobot.dds import rtps
from cobot.dds.graph import NodeGraph
from cobot.dds.inbox import LossCounter, SampleInbox
from cobot.dds.names import NodeName, reply_name, request_name, topic_name, type_hash, type_name
from cobot.dds.rtps import Participant, Qos, RtpsError, Sample, SampleIdentity
from cobot.errors import CobotError, InputError, PayloadError
from cobot.ros.message_limits import MAX_MESSAGE
from cobot.ros.messages import Messages

Message = dict[str, Any]
LARGE_BYTES = 1 << 16
"""Size above which messages are decoded in a thread, so that a trajectory does not delay other messages."""
MAX_BYTES = 4 * MAX_MESSAGE
"""Maximum size of a message in CDR. Its JSON text may be four times shorter, for example an int64 as `0,`."""
MAX_CALLS = 64
"""Maximum number of calls in progress from one client to one service. Further client requests wait."""
CYCLONE = 0x0110
CYCLONE_HEADER = slice(4, 20)
"""The position in the payload, after the first 4 bytes, where rmw_cyclonedds writes the client's guid
(uint64) and a sequence number (int64).
"""
SERVICE_QOS = Qos(reliable=True, transient_local=False, depth=None)
LATCHED_QOS = Qos(reliable=True, transient_local=True, depth=1)

log = logging.getLogger("cobot.ros2")


class NodePublisher:
    """Publishes on a topic. Made by `DdsNode.publisher`. Thread safe."""

    def __init__(self, node: DdsNode, topic: str, type_: str, qos: Qos, lifespan_s: float = math.inf) -> None:
        self.topic = topic
        self.type = type_
        self._node = node
        self._writer = node.participant.create_writer(
            topic_name(topic),
            type_name(type_),
            qos,
            type_hash(node.messages.type_hash(type_)),
            lifespan_s=lifespan_s,
        )
        node.graph.add(self._writer.guid)

    @property
    def readers(self) -> int:
        """The number of readers in other participants that receive this topic."""
        return len(self._writer.matched)

    def publish(self, message: Message) -> None:
        """Send a message. Missing fields get ROS's defaults.

        Raises:
            InputError: the message does not match the type, or is too large.
        """
        self.publish_cdr(self._node.messages.to_cdr(self.type, message))

    def publish_cdr(self, content: bytes) -> None:
        """Send a message that is encoded as CDR, including its header.

        Raises:
            InputError: the message is too large.
        """
        try:
            self._writer.write(content)
        except rtps.SampleTooLargeError as exc:
            raise InputError(str(exc)) from exc

    def close(self) -> None:
        self._node.graph.remove(self._writer.guid)
        self._writer.close()


class NodeSubscription:
    """Receives the messages of a topic. Made by `DdsNode.subscription`."""

    def __init__(
        self, node: DdsNode, topic: str, type_: str, callback: Callable[[Message], None], qos: Qos
    ) -> None:
        self.topic = topic
        self.type = type_
        self.rejected = LossCounter(f"rejected messages on {topic} ({type_})")
        self._node = node
        self._callback = callback
        self._inbox = SampleInbox(topic, node.loop, self._deliver)
        self._reader = node.participant.create_reader(
            topic_name(topic),
            type_name(type_),
            qos,
            self._inbox.put,
            type_hash(node.messages.type_hash(type_)),
        )
        node.graph.add(self._reader.guid)

    def close(self) -> None:
        self._node.graph.remove(self._reader.guid)
        self._reader.close()

    def _deliver(self, sample: Sample) -> Awaitable[None] | None:
        if len(sample.payload) > LARGE_BYTES:
            return self._deliver_large(sample)
        try:
            self._callback(self._node.messages.from_cdr(self.type, sample.payload))
        except CobotError as exc:
            self.rejected.add(str(exc))
        return None

    async def _deliver_large(self, sample: Sample) -> None:
        try:
            self._callback(await self._node.read_large(self.type, sample.payload))
        except CobotError as exc:
            self.rejected.add(str(exc))


Handler = Callable[[Message], Awaitable[Message]]
CLIENT: ContextVar[bytes] = ContextVar("client", default=b"")
"""The participant that has sent the request which the current task answers."""


class NodeService:
    """Answers requests. Made by `DdsNode.service`."""

    def __init__(self, node: DdsNode, name: str, type_: str, handler: Handler) -> None:
        self.name = name
        self.type = type_
        self._node = node
        self._handler = handler
        self._tasks: set[asyncio.Task[None]] = set()
        self._turns: WeakValueDictionary[bytes, asyncio.Semaphore] = WeakValueDictionary()
        self._inbox = SampleInbox(name, node.loop, self._begin)
        participant = node.participant
        self._writer = participant.create_writer(
            reply_name(name), type_name(f"{type_}_Response"), SERVICE_QOS
        )
        self._reader = participant.create_reader(
            request_name(name), type_name(f"{type_}_Request"), SERVICE_QOS, self._inbox.put
        )
        node.graph.add(self._reader.guid, self._writer.guid)

    def close(self) -> None:
        """Close the service. Requests in progress get no answer."""
        self._node.graph.remove(self._reader.guid, self._writer.guid)
        self._reader.close()
        self._writer.close()
        for task in self._tasks:
            task.cancel()

    def _begin(self, sample: Sample) -> None:
        task = self._node.loop.create_task(self._answer(sample), name=self.name)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _answer(self, sample: Sample) -> None:
        messages = self._node.messages
        asker = SampleIdentity(sample.related.writer if sample.related else sample.writer, sample.sequence)
        payload, header = sample.payload, b""
        if sample.vendor == CYCLONE:
            header = payload[CYCLONE_HEADER]
            payload = payload[: CYCLONE_HEADER.start] + payload[CYCLONE_HEADER.stop :]
        CLIENT.set(asker.writer.prefix)
        turn = self._turns.setdefault(asker.writer.prefix, asyncio.Semaphore(MAX_CALLS))
        try:
            async with turn:
                log.debug("a request to %s", self.name)
                content = messages.to_cdr(f"{self.type}_Response", await self._respond(payload))
            if header:
                content = content[: CYCLONE_HEADER.start] + header + content[CYCLONE_HEADER.start :]
            # Answer only to the client's reader, even if it is not discovered yet.
            only = asker.writer if asker.writer.is_reader else None
            self._writer.write(content, related=asker, only=only)
        except (CobotError, RtpsError) as exc:
            log.warning("a request to %s is not answered: %s", self.name, exc)

    async def _respond(self, payload: bytes) -> Message:
        type_ = f"{self.type}_Request"
        if len(payload) > LARGE_BYTES:
            return await self._handler(await self._node.read_large(type_, payload))
        return await self._handler(self._node.messages.from_cdr(type_, payload))


class DdsNode:
    """The only node of a participant.

    Args:
        messages: the message types. More types may be added later.
        gid_bytes: see `NodeGraph`.
        loop: runs callbacks and handlers.
    """

    def __init__(
        self,
        participant: Participant,
        name: NodeName,
        messages: Messages,
        gid_bytes: int | None,
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        self.participant = participant
        self.name = name
        self.messages = messages
        self.loop = loop
        self.graph = NodeGraph(participant, name, gid_bytes, loop)

    async def read_large(self, type_: str, payload: bytes) -> Message:
        """Decode CDR without blocking the event loop.

        Raises:
            PayloadError: the message is larger than the service accepts.
            InputError: the content is not a message of this type.
        """
        if len(payload) > MAX_BYTES:
            raise PayloadError(f"the message has {len(payload)} bytes, allowed: {MAX_BYTES}")
        self.messages.record(type_)  # only this thread may add types
        return await asyncio.to_thread(self.messages.from_cdr, type_, payload)

    def publisher(
        self,
        topic: str,
        type_: str,
        *,
        depth: int = 10,
        latched: bool = False,
        lifespan_s: float = math.inf,
    ) -> NodePublisher:
        """Create a reliable publisher for a topic.

        Args:
            type_: name of the type, such as "std_msgs/msg/String".
            depth: number of messages that are kept for slow readers.
            latched: whether readers that appear later get the last message (transient local).
            lifespan_s: age after which a lost message is not repeated, s.

        Raises:
            InputError: the type is unknown.
        """
        qos = LATCHED_QOS if latched else Qos(depth=depth)
        return NodePublisher(self, topic, type_, qos, lifespan_s)

    def subscription(
        self, topic: str, type_: str, callback: Callable[[Message], None], *, reliable: bool = True
    ) -> NodeSubscription:
        """Create a subscription for the messages of a topic.

        Args:
            callback: called with each message, in order for each publisher. It must be fast.
            reliable: whether publishers that are not reliable are ignored.

        Raises:
            InputError: the type is unknown.
        """
        return NodeSubscription(self, topic, type_, callback, Qos(reliable=reliable, depth=None))

    def service(self, name: str, type_: str, handler: Handler) -> NodeService:
        """Create a service that answers requests.

        Args:
            type_: name of the type, such as "aubo_interfaces/srv/GetDof".
            handler: receives the complete request and returns the response. Fields that are missing in the
                response get ROS's defaults. If the handler raises a CobotError there is no answer,
                because ROS defines none for failures.

        Raises:
            InputError: the type is unknown.
        """
        if not self.messages.has_service(type_):
            raise InputError(f"there is no type {type_!r} here")
        return NodeService(self, name, type_, handler)

    def close(self) -> None:
        self.graph.close()
