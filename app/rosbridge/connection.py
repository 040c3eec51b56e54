"""The connection of a rosbridge v2 client, without its WebSocket.

When the client disconnects, its advertisements, subscriptions and offers end, and its goals are cancelled.
This includes goals that the client has sent through the services of a ROS action. Messages to the client wait
in an `Outbox`.

cobot adds one operation: with `{"op": "cobot_gateway"}` a client declares that it mirrors the graph to
another network. The topic /cobot/graph lists what such a gateway must mirror, without the gateway's own
advertisements, subscriptions and offers. A gateway does not get its own messages back. It may advertise one
topic with several types; the field `type` of `publish` and `unadvertise` then selects one of them.

Calls and goals run as tasks while further messages are handled. At most `MAX_PENDING` run at a time.
"""

from __future__ import annotations

import asyncio
import json
import logging
import re
import uuid
from collections.abc import Coroutine
from typing import Any

from app.graph.action_server import ASKER
from app.graph.ends import Publisher
from app.graph.graph import Graph
from app.rosbridge import operations as op
from app.rosbridge.actionlib import refuse_topic
from app.rosbridge.fragments import MessageAssembly
from app.rosbridge.offers import Offers
from app.rosbridge.outbox import MAX_PER_TOPIC, Outbox
from app.rosbridge.roles import ROLES
from cobot import audit
from cobot.access.roles import SERVICE, Identity
from cobot.codes import Code, code_of
from cobot.errors import CobotError, ConflictError, InputError, PayloadError, UnavailableError
from cobot.ros.message_limits import MAX_MESSAGE
from cobot.ros.messages import Message
from cobot.strict import shown

MAX_PENDING = 1024
"""Maximum number of unanswered calls and unfinished goals of one client."""
MAX_ENDS = 1024
"""Maximum number of topics that one client may advertise, and maximum number of topics that it may subscribe
to.
"""
MAX_LATCHED = 16 * 2**20
"""Maximum total length of a client's latched messages, in characters. They are kept until the client
disconnects.
"""
UNREAD_CHARACTERS = 1024
"""Number of characters at the start of an undecoded message that are searched for `UNREAD`."""
UNREAD = re.compile(r'"(op|id|service|action)"\s*:\s*("(?:[^"\\]|\\.){0,512}"|\d{1,18}\b)')
"""Pattern of the fields that are read from an undecoded message."""
ANSWERS = {"call_service": "service_response", "send_action_goal": "action_result"}
"""For each operation with an answer, the operation of the answer."""
LEVELS = ("none", "error", "warning", "info")

log = logging.getLogger("cobot.rosbridge")


class RosbridgeConnection:
    """The connection of one client, from its first message to its last.

    Args:
        name: client name in the log.
        identity: identity of the client.

    Attributes:
        outbox: messages that wait to be sent to the client.
    """

    def __init__(self, graph: Graph, name: str, identity: Identity = SERVICE) -> None:
        self.outbox = Outbox()
        self._graph = graph
        self._name = name
        self._identity = identity
        self._level = "error"
        self._fragments = MessageAssembly(MAX_MESSAGE)
        self._publishers: dict[tuple[str, str | None], tuple[Publisher, set[op.Id]]] = {}
        self._offers = Offers(graph, self.outbox, self)
        self._goals: dict[op.Id, tuple[str, str]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._latched: dict[str, int] = {}

    def prepared(self, content: Any) -> Any:
        """Prepare a decoded message for `take`. All work that grows with the message size is done here, and
        therefore in a separate thread.
        """
        try:
            asked = op.operation(content)
            type_ = self._type_of(asked)
            if type_ is None:
                return asked
            name = next(each for each in ("msg", "args", "values") if hasattr(asked, each))
            value = getattr(asked, name)
            if name == "args":
                value = self._arguments(value, type_)
            return asked.model_copy(update={name: self._graph.messages.examine(type_, value)})
        except (CobotError, RuntimeError):
            return content  # `take` raises the same error, unless the graph has changed in the meantime

    def take(self, content: Any, size: int = 0) -> str | None:
        """Handle a decoded message, or the result of `prepared`. Errors are reported to the client.

        Args:
            size: number of characters of the message.

        Returns:
            A message that this fragment has completed, which must be decoded and handled as well.
        """
        message_id = content.get("id") if isinstance(content, dict) else getattr(content, "id", None)
        try:
            asked = content if isinstance(content, op.Operation) else op.operation(content)
            if isinstance(asked, op.Fragment):
                return self._fragments.add(asked)
            self._carry_out(asked, size)
        except CobotError as exc:
            self.report_error(exc, message_id)
        except Exception as exc:
            log.error("a message of %s failed", self._name, exc_info=exc)
            self.report_error(CobotError("an error in cobot itself; its log has the details"), message_id)
        return None

    def report_error(self, error: CobotError, message_id: Any = None) -> None:
        """Report an error to the client, unless the client has disabled error messages."""
        if self._level != "none":
            status = {"op": "status", "level": "error", "msg": str(error), "code": int(code_of(error))}
            self.outbox.mention(status if message_id is None else {**status, "id": message_id})

    def reject_unread(self, text: str, error: PayloadError) -> None:
        """Answer a message that is too large to be decoded, so that the client does not wait in vain.

        Its operation and id are read from the start of the text, where clients usually write them.
        """
        head = {name: json.loads(value) for name, value in UNREAD.findall(text[:UNREAD_CHARACTERS])}
        answer = ANSWERS.get(str(head.get("op")))
        if answer is None or "id" not in head:
            self.report_error(error, head.get("id"))
            return
        about = {name: head[name] for name in ("id", "service", "action") if name in head}
        status = {"status": 0} if answer == "action_result" else {}
        reason = {"values": str(error), "result": False, "code": int(code_of(error))}
        self.outbox.answer({"op": answer, **about, **status, **reason}, None)

    def tell(self, sentence: str) -> None:
        """Send the client an unrequested message, unless it has disabled such messages."""
        if self._level != "none":
            self.outbox.mention({"op": "status", "level": "warning", "msg": sentence})

    async def close(self) -> None:
        """Clean up after the client has disconnected."""
        self.outbox.close()
        for server in list(self._graph.actions.values()):
            server.abandon(self)
        for publisher, _ in self._publishers.values():
            publisher.close()
        await self._offers.close()
        self._graph.gateways.discard(self)

    def _carry_out(self, asked: op.Operation, size: int) -> None:
        audit.require(self._identity, ROLES[type(asked)], "rosbridge", type(asked).__name__)
        match asked:
            case op.Publish():
                refuse_topic(self._graph.actions, asked.topic, None)
                self._publish(asked, size)
            case op.CallService():
                self._begin(self._call(asked), asked.compression)
            case op.ServiceResponse():
                self._offers.take_response(asked)
            case op.Subscribe():
                _require_plain(asked.compression)
                refuse_topic(self._graph.actions, asked.topic, asked.type)
                if asked.topic not in self.outbox.feeds and len(self.outbox.feeds) >= MAX_ENDS:
                    raise ConflictError(f"a client may subscribe to at most {MAX_ENDS} topics")
                self.outbox.subscribe(self._graph, asked, self, self.tell)
            case op.Unsubscribe():
                self.outbox.unsubscribe(asked.topic, asked.id)
            case op.Advertise():
                refuse_topic(self._graph.actions, asked.topic, asked.type)
                self._advertise(asked.topic, asked.type, asked.latch, asked.id)
            case op.Unadvertise():
                self._unadvertise(asked)
            case op.SendActionGoal():
                self._send_goal(asked)
            case op.CancelActionGoal():
                self._cancel(asked)
            case op.AdvertiseService():
                self._offers.add_service(asked)
            case op.UnadvertiseService():
                self._offers.remove_service(asked.service)
            case op.AdvertiseAction():
                self._offers.add_action(asked)
            case op.UnadvertiseAction():
                self._keep(self._offers.remove_action(asked.action))
            case op.ActionFeedback():
                self._offers.take_feedback(asked)
            case op.ActionResult():
                self._offers.take_result(asked)
            case op.SetLevel():
                self._level = asked.level
            case op.Status():
                log.info("%s says %s: %s", self._name, shown(asked.level), shown(asked.msg))
            case op.Gateway():
                self._graph.gateways.add(self)
                self._graph.note_change()

    def _publish(self, asked: op.Publish, size: int) -> None:
        key = self._key(asked.topic, asked.type)
        if key not in self._publishers:
            types = [asked.type] if asked.type else self._graph.types_of(asked.topic)
            if not types:
                raise InputError(
                    f"{shown(asked.topic)} is not advertised, so its type is unknown: give the type"
                )
            if len(types) > 1:
                raise InputError(
                    f"{shown(asked.topic)} is subscribed as {' and as '.join(types)}: advertise it with the "
                    "type of your messages, then publish"
                )
            inferred = self._graph.type_of(asked.topic) is None
            self._advertise(asked.topic, types[0], asked.latch, None, inferred=inferred)
            key = self._key(asked.topic, types[0])
        publisher, _ = self._publishers[key]
        if not publisher.latch:
            publisher.publish(asked.msg)
            return
        kept = sum(self._latched.values()) - self._latched.get(asked.topic, 0)
        if kept + size > MAX_LATCHED:
            raise ConflictError(
                f"the latched messages of a client may have {MAX_LATCHED} characters together; {kept} "
                f"are already stored, and this message has {size}"
            )
        publisher.publish(asked.msg)
        self._latched[asked.topic] = size

    def _advertise(
        self, topic: str, type_: str, latch: bool, advertise_id: op.Id, *, inferred: bool = False
    ) -> None:
        key = self._key(topic, type_)
        known = self._publishers.get(key)
        other = known is not None and self._graph.messages.resolved(type_, "msg") != known[0].type
        if known is None or (other and not known[0].binding):
            if len(self._publishers) >= MAX_ENDS:
                raise ConflictError(f"a client may advertise at most {MAX_ENDS} topics")
            publisher = self._graph.advertise(topic, type_, latch=latch, owner=self, inferred=inferred)
            if known is not None:  # an earlier publisher's type was only inferred
                known[0].close()
            self._publishers[key] = publisher, {advertise_id}
        elif other:
            raise InputError(f"{topic} is of type {known[0].type}, not {type_}")
        elif advertise_id not in known[1] and len(known[1]) >= MAX_PER_TOPIC:
            raise ConflictError(f"a client may advertise a topic at most {MAX_PER_TOPIC} times")
        else:
            known[1].add(advertise_id)

    def _unadvertise(self, asked: op.Unadvertise) -> None:
        keys = [
            key
            for key in self._publishers
            if key[0] == asked.topic and key[1] in (None, asked.type or key[1])
        ]
        if not keys:
            raise InputError(f"{asked.topic} is not advertised")
        for key in keys:
            publisher, ids = self._publishers[key]
            ids.discard(asked.id)
            if asked.id is None or not ids - {None}:
                publisher.close()
                del self._publishers[key]
                self._latched.pop(asked.topic, None)

    def _key(self, topic: str, type_: str | None) -> tuple[str, str | None]:
        """Return the key of a publisher. A gateway may have one publisher for each type."""
        return topic, type_ if self in self._graph.gateways else None

    def _begin(self, work: Coroutine[Any, Any, None], compression: str | None) -> None:
        """Start a task that answers a message. Other messages are handled in the meantime."""
        try:
            _require_plain(compression)
            if len(self._tasks) >= MAX_PENDING:
                raise UnavailableError(
                    f"this client has {MAX_PENDING} calls in progress, which is the maximum"
                )
        except CobotError:
            work.close()
            raise
        self._keep(work)

    def _keep(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _call(self, asked: op.CallService) -> None:
        ASKER.set(self)
        answer: Message = {"op": "service_response", "service": asked.service}
        if asked.id is not None:
            answer["id"] = asked.id
        try:
            service = self._graph.service(asked.service)
            audit.require(self._identity, service.role, "rosbridge", asked.service)
            arguments = self._arguments(asked.args, f"{service.type}_Request")
            async with asyncio.timeout(asked.timeout or None):
                answer["values"] = await self._graph.call_service(asked.service, arguments)
            answer["result"] = True
        except TimeoutError:
            answer |= {
                "values": f"{asked.service} has not answered within {asked.timeout} s",
                "result": False,
                "code": int(Code.DEVICE_TIMEOUT),
            }
        except CobotError as exc:
            answer |= {"values": str(exc), "result": False, "code": int(code_of(exc))}
        except Exception as exc:
            log.error("%s failed", asked.service, exc_info=exc)
            message = "an error in cobot itself; its log has the details"
            answer |= {"values": message, "result": False, "code": int(Code.ERROR)}
        self.outbox.answer(answer, asked.fragment_size)

    def _send_goal(self, asked: op.SendActionGoal) -> None:
        if asked.id in self._goals:
            raise ConflictError(f"the goal {shown(asked.id)} is already in progress")
        goal_id = uuid.uuid4().hex
        self._begin(self._execute_goal(asked, goal_id), asked.compression)
        self._goals[asked.id] = asked.action, goal_id

    async def _execute_goal(self, asked: op.SendActionGoal, goal_id: str) -> None:
        ASKER.set(self)
        about: Message = {"action": asked.action}
        if asked.id is not None:
            about["id"] = asked.id

        def tell(values: Message) -> None:
            self.outbox.mention({"op": "action_feedback", **about, "values": values}, asked.fragment_size)

        answer: Message = {"op": "action_result", **about}
        try:
            arguments = self._arguments(asked.args, f"{self._graph.action(asked.action).action.type_}_Goal")
            on_feedback = tell if asked.feedback else None
            status, values = await self._graph.send_goal(asked.action, goal_id, arguments, on_feedback)
            answer |= {"values": values, "status": int(status), "result": True}
        except CobotError as exc:
            answer |= {"values": str(exc), "status": 0, "result": False, "code": int(code_of(exc))}
        finally:
            self._goals.pop(asked.id, None)
        self.outbox.answer(answer, asked.fragment_size)

    def _cancel(self, asked: op.CancelActionGoal) -> None:
        known = self._goals.get(asked.id)
        if known is None or known[0] != asked.action:
            raise InputError(f"no goal {shown(asked.id)} of {asked.action} is running")
        self._graph.cancel(*known)

    def _type_of(self, asked: op.Operation) -> str | None:
        """Return the type of the message in an operation; None if the operation needs none."""
        graph = self._graph
        match asked:
            case op.Publish():
                known = self._publishers.get(self._key(asked.topic, asked.type))
                return known[0].type if known else next(iter(graph.types_of(asked.topic)), None)
            case op.CallService():
                return f"{graph.service(asked.service).type}_Request"
            case op.ServiceResponse():
                return f"{graph.service(asked.service).type}_Response" if asked.result else None
            case op.SendActionGoal():
                return f"{graph.action(asked.action).action.type_}_Goal"
            case op.ActionFeedback():
                return f"{graph.action(asked.action).action.type_}_Feedback"
            case op.ActionResult():
                return f"{graph.action(asked.action).action.type_}_Result" if asked.result else None
        return None

    def _arguments(self, arguments: Message | list[Any] | None, type_: str) -> Message:
        """Return the arguments as a dictionary. Clients may send only the values."""
        if not isinstance(arguments, list):
            return {} if arguments is None else arguments
        names = list(self._graph.messages.record(type_).fields)
        if len(arguments) > len(names):
            raise InputError(f"{type_} has {len(names)} fields, got {len(arguments)} values")
        return dict(zip(names, arguments, strict=False))


def _require_plain(compression: str | None) -> None:
    if compression not in (None, "", "none"):
        raise InputError(f"compression {shown(compression)} is not supported; the only valid value is none")
