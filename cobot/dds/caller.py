"""Clients for services and actions of other ROS 2 nodes."""

from __future__ import annotations

import asyncio
import base64
import math
import uuid
from collections.abc import Callable

from cobot.dds.inbox import SampleInbox
from cobot.dds.names import reply_name, request_name, type_name
from cobot.dds.node import LATCHED_QOS, SERVICE_QOS, DdsNode, Message, NodeSubscription
from cobot.dds.rtps import Sample, SampleIdentity
from cobot.errors import CobotError

ENDED = (4, 5, 6)
"""The values of action_msgs/msg/GoalStatus for goals that have ended."""


class ServiceCaller:
    """Calls a service of another node.

    Args:
        lifespan_s: age after which a lost request is not repeated, s.

    Raises:
        InputError: the type is unknown.
    """

    def __init__(self, node: DdsNode, name: str, type_: str, *, lifespan_s: float = math.inf) -> None:
        self._node, self._type = node, type_
        self._waiting: dict[int, asyncio.Future[Message]] = {}
        self._inbox = SampleInbox(name, node.loop, self._take)
        participant = node.participant
        self._reader = participant.create_reader(
            reply_name(name), type_name(f"{type_}_Response"), SERVICE_QOS, self._inbox.put
        )
        self._writer = participant.create_writer(
            request_name(name), type_name(f"{type_}_Request"), SERVICE_QOS, lifespan_s=lifespan_s
        )
        node.graph.add(self._reader.guid, self._writer.guid)

    @property
    def is_ready(self) -> bool:
        """Whether a server of the service exists."""
        return bool(self._writer.matched) and bool(self._reader.matched)

    async def call(self, request: Message) -> Message:
        """Call the service and wait for the answer, without a timeout.

        Raises:
            InputError: the request does not match the type, or the answer cannot be read.
        """
        content = self._node.messages.to_cdr(f"{self._type}_Request", request)
        number = self._writer.write(content, related=SampleIdentity(self._reader.guid, 0))
        answer: asyncio.Future[Message] = self._node.loop.create_future()
        self._waiting[number] = answer
        try:
            return await answer
        finally:
            del self._waiting[number]

    def close(self) -> None:
        """Close the client. Calls in progress get no answer."""
        self._node.graph.remove(self._reader.guid, self._writer.guid)
        self._reader.close()
        self._writer.close()

    def _take(self, sample: Sample) -> None:
        """Process an answer. Answers to other clients also arrive here."""
        asked = sample.related
        if asked is None or asked.writer not in (self._reader.guid, self._writer.guid):
            return
        answer = self._waiting.get(asked.sequence)
        if answer is None or answer.done():
            return
        try:
            answer.set_result(self._read(sample.payload))
        except CobotError as exc:
            answer.set_exception(exc)

    def _read(self, payload: bytes) -> Message:
        """Read an answer, which is encoded as CDR."""
        return self._node.messages.from_cdr(f"{self._type}_Response", payload)


class ActionCaller:
    """Sends goals to an action of another node.

    Args:
        on_feedback: called with each feedback of the newest goal.
        on_last: called with the result of the last goal that ended before this client connected. With None,
            this result is not requested.
        on_status: called with the list of the states of the server's goals.
        goal_lifespan_s: age after which a lost goal is not repeated, s.
    """

    def __init__(
        self,
        node: DdsNode,
        name: str,
        type_: str,
        on_feedback: Callable[[Message], None],
        on_last: Callable[[Message], None] | None,
        on_status: Callable[[list[Message]], None] | None = None,
        *,
        goal_lifespan_s: float = math.inf,
    ) -> None:
        below = f"{name}/_action"
        self._send = ServiceCaller(
            node, f"{below}/send_goal", f"{type_}_SendGoal", lifespan_s=goal_lifespan_s
        )
        self._result = ServiceCaller(node, f"{below}/get_result", f"{type_}_GetResult")
        self._cancel = ServiceCaller(node, f"{below}/cancel_goal", "action_msgs/srv/CancelGoal")
        self._on_feedback, self._on_last, self._on_status = on_feedback, on_last, on_status
        self._goal: Message | None = None
        self._asked: asyncio.Task[None] | None = None
        self._loop = node.loop
        self._ends = [
            node.subscription(f"{below}/feedback", f"{type_}_FeedbackMessage", self._take_feedback),
            NodeSubscription(
                node, f"{below}/status", "action_msgs/msg/GoalStatusArray", self._take_status, LATCHED_QOS
            ),
        ]

    @property
    def is_ready(self) -> bool:
        """Whether a server of the action exists."""
        return all(each.is_ready for each in (self._send, self._result, self._cancel))

    async def send(self, goal: Message, goal_id: Message | None = None) -> Message | None:
        """Send a goal. Returns its id; None if the goal is rejected.

        Args:
            goal_id: id for the goal; None for a new one.
        """
        self._goal = goal_id = goal_id or {"uuid": base64.b64encode(uuid.uuid4().bytes).decode()}
        answer = await self._send.call({"goal_id": goal_id, "goal": goal})
        return goal_id if answer["accepted"] else None

    async def result(self, goal_id: Message) -> Message:
        """Wait until a goal has ended, and return its status and its result."""
        return await self._result.call({"goal_id": goal_id})

    async def cancel(self, goal_id: Message) -> Message:
        """Ask the server to cancel a goal. Returns the answer with its `return_code`; the goal ends later,
        when the server ends it.
        """
        return await self._cancel.call({"goal_info": {"goal_id": goal_id}})

    def close(self) -> None:
        """Close the client. Goals that are running in the server continue."""
        for topic in self._ends:
            topic.close()
        for service in (self._send, self._result, self._cancel):
            service.close()

    def _take_feedback(self, message: Message) -> None:
        if message["goal_id"] == self._goal:
            self._on_feedback(message["feedback"])

    def _take_status(self, message: Message) -> None:
        if self._on_status is not None:
            self._on_status(message["status_list"])
        if self._on_last is None:
            return
        ended = [each for each in message["status_list"] if each["status"] in ENDED]
        if self._goal is not None or self._asked is not None or len(ended) != len(message["status_list"]):
            return
        if ended:
            newest = max(ended, key=lambda each: _moment(each["goal_info"]["stamp"]))
            self._asked = self._loop.create_task(self._ask_last(newest["goal_info"]["goal_id"]))

    async def _ask_last(self, goal_id: Message) -> None:
        answer = await self.result(goal_id)
        if self._goal is None and self._on_last is not None and answer["status"] in ENDED:
            self._on_last(answer)


def _moment(stamp: Message) -> tuple[int, int]:
    return stamp["sec"], stamp["nanosec"]
