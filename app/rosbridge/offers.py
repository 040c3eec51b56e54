"""Services and actions that a rosbridge client offers to all other clients."""

from __future__ import annotations

import asyncio
import itertools
from typing import TYPE_CHECKING

from app.graph.action_server import ActionServer
from app.graph.actions import GoalHandle, GoalStatus
from app.graph.graph import Graph, GraphService
from app.graph.topics import absolute
from app.rosbridge import operations as op
from app.rosbridge.outbox import Outbox
from cobot.errors import ConflictError, ExecutionError, InputError, UnavailableError
from cobot.ros.messages import Message
from cobot.strict import shown

if TYPE_CHECKING:
    from app.rosbridge.connection import RosbridgeConnection

MAX_OFFERS = 256
ENDED = (GoalStatus.SUCCEEDED, GoalStatus.CANCELED, GoalStatus.ABORTED)


class Offers:
    """The advertisements of one client: its topics, services and actions."""

    def __init__(self, graph: Graph, outbox: Outbox, owner: RosbridgeConnection) -> None:
        self._graph = graph
        self._outbox = outbox
        self._owner = owner
        self._services: dict[str, GraphService] = {}
        self._actions: dict[str, ActionServer] = {}
        self._calls: dict[op.Id, tuple[str, asyncio.Future[Message]]] = {}
        self._goals: dict[op.Id, tuple[GoalHandle, asyncio.Future[op.ActionResult]]] = {}
        self._numbers = itertools.count(1)

    def add_service(self, asked: op.AdvertiseService) -> None:
        self._require_room()

        async def call(request: Message) -> Message:
            return await self._call(asked.service, request)

        made = self._graph.add_service(asked.service, asked.type, call, owner=self._owner)
        self._services[made.name] = made

    def remove_service(self, name: str) -> None:
        service = self._services.pop(absolute(name), None)
        if service is None:
            raise InputError(f"{name} is not advertised")
        self._graph.remove_service(service)
        for about, answer in self._calls.values():
            if absolute(about) == service.name and not answer.done():
                answer.set_exception(UnavailableError(f"{name} is no longer offered"))

    def take_response(self, asked: op.ServiceResponse) -> None:
        name, answer = self._calls.get(asked.id, ("", None))
        if answer is None or answer.done() or absolute(name) != absolute(asked.service):
            raise InputError(f"no call {shown(asked.id)} of {asked.service} is waiting for an answer")
        if not asked.result:
            answer.set_exception(ExecutionError(f"{name} failed: {shown(asked.values)}"))
        else:
            answer.set_result(asked.values)

    def add_action(self, asked: op.AdvertiseAction) -> None:
        self._require_room()
        action = _ClientAction(
            self, absolute(asked.action), self._graph.messages.resolved(asked.type, "action")
        )
        self._actions[action.name] = self._graph.add_action(action, self._owner)

    async def remove_action(self, name: str) -> None:
        server = self._actions.pop(absolute(name), None)
        if server is not None:
            await self._graph.remove_action(server)

    def take_feedback(self, asked: op.ActionFeedback) -> None:
        self._goal(asked.id, asked.action)[0].feedback(asked.values)

    def take_result(self, asked: op.ActionResult) -> None:
        ended = self._goal(asked.id, asked.action)[1]
        if not ended.done():
            ended.set_result(asked)

    async def close(self) -> None:
        """Withdraw all offers of a client that has disconnected."""
        for name in tuple(self._services):
            self.remove_service(name)
        for name in tuple(self._actions):
            await self.remove_action(name)

    async def execute_goal(self, name: str, goal: Message, handle: GoalHandle) -> Message:
        """Make the client execute a goal of one of its actions."""
        goal_id = f"{name}:{handle.goal_id}"
        ended: asyncio.Future[op.ActionResult] = asyncio.get_running_loop().create_future()
        self._goals[goal_id] = handle, ended
        about = {"id": goal_id, "action": name, "action_type": self._actions[name].action.type_}
        self._outbox.answer({"op": "send_action_goal", **about, "args": goal, "feedback": True})
        handle.accept()
        cancelled = asyncio.create_task(handle.cancel_requested.wait())
        try:
            await asyncio.wait((ended, cancelled), return_when=asyncio.FIRST_COMPLETED)
            if not ended.done():
                self._outbox.answer({"op": "cancel_action_goal", "id": goal_id, "action": name})
            result = await ended
        finally:
            cancelled.cancel()
            del self._goals[goal_id]
        if not result.result:
            raise ExecutionError(f"{name} failed: {shown(result.values)}")
        status = GoalStatus(result.status)
        handle.status = status if status in ENDED else GoalStatus.ABORTED
        return result.values if isinstance(result.values, dict) else {}

    async def _call(self, name: str, request: Message) -> Message:
        number = f"call_service:{name}:{next(self._numbers)}"
        answer: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._calls[number] = name, answer
        self._outbox.answer({"op": "call_service", "id": number, "service": name, "args": request})
        try:
            return await answer
        finally:
            del self._calls[number]

    def _goal(self, goal_id: op.Id, action: str) -> tuple[GoalHandle, asyncio.Future[op.ActionResult]]:
        known = self._goals.get(goal_id)
        if known is None:
            raise InputError(f"no goal {shown(goal_id)} of {action} is running")
        return known

    def _require_room(self) -> None:
        if len(self._services) + len(self._actions) >= MAX_OFFERS:
            raise ConflictError(f"a client may offer at most {MAX_OFFERS} services and actions")


class _ClientAction:
    definition = ""

    def __init__(self, offers: Offers, name: str, type_: str) -> None:
        self.name = name
        self.type_ = type_
        self._offers = offers

    async def execute(self, goal: Message, handle: GoalHandle) -> Message:
        return await self._offers.execute_goal(self.name, goal, handle)
