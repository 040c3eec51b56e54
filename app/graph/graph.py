"""The graph: the topics, services and actions inside the web service. It is the same for every transport.

Everything runs on one event loop. The topic /cobot/graph describes the graph for networks that mirror it. Its
messages are of type std_msgs/msg/String and contain a JSON object. The object consists of `topics` with name,
type, publishers, subscribers and latched; `services` and `actions` with name and type; and `definitions`, the
texts of their types. A subscriber gets the current description, and a new one after each change.
"""

from __future__ import annotations

import asyncio
import json
import uuid
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from app.graph.action_server import ActionServer
from app.graph.actions import GoalStatus, GraphAction
from app.graph.topics import Topics, absolute
from cobot.access.roles import Role
from cobot.clock import SYSTEM, Clock
from cobot.errors import ConflictError, InputError, NotFoundError
from cobot.ros.messages import Message, Messages
from cobot.strict import shown

GRAPH_TOPIC = "/cobot/graph"
GRAPH_DELAY_S = 0.02
"""Time within which changes are collected and published together, s."""


@dataclass(frozen=True, slots=True, eq=False)
class GraphService:
    """A service on the graph. Its `type` is of the form pkg/srv/Name or, for parts of an action,
    pkg/action/Name_SendGoal and similar.
    """

    name: str
    type: str
    function: Callable[[Message], Awaitable[Message]]
    owner: object
    local: bool
    role: Role


class Graph(Topics):
    """Topics, services and actions. The object must be created in the running event loop.

    Attributes:
        actions: the actions by name.
        clock: clock of the service.
        services: the services by name.
        warn: function that shows a warning to users, for cases in which the ROS message has no field for it.
    """

    def __init__(self, messages: Messages, clock: Clock = SYSTEM) -> None:
        super().__init__(messages)
        self.clock = clock
        self.actions: dict[str, ActionServer] = {}
        self.services: dict[str, GraphService] = {}
        self.warn: Callable[[str], None] = lambda _: None
        self._loop = asyncio.get_running_loop()
        self._changing: asyncio.TimerHandle | None = None
        self._graph = self.advertise(GRAPH_TOPIC, "std_msgs/msg/String", owner=self, local=True, alone=True)
        self._graph.on_demand = lambda _: self.note_change()

    def add_service(
        self,
        name: str,
        type_: str,
        function: Callable[[Message], Awaitable[Message]],
        *,
        owner: object,
        local: bool = False,
        role: Role = Role.OPERATOR,
    ) -> GraphService:
        """Offer a service.

        Args:
            name: service name, such as "/iiwa/RobotConfig/getDof".
            type_: service type, such as "aubo_interfaces/srv/GetDof".
            function: function that is called with the complete request and returns the response.
            local: whether the service is hidden from other networks.
            role: role that a client needs.

        Raises:
            InputError: the name is invalid, or the type is unknown.
            ConflictError: a service with this name exists.
        """
        name = absolute(name)
        type_ = self.messages.resolved(type_, "srv")
        if name in self.services:
            raise ConflictError(f"the service {name} already exists")
        made = self.services[name] = GraphService(name, type_, function, owner, local, role)
        self.note_change()
        return made

    def remove_service(self, service: GraphService) -> None:
        if self.services.get(service.name) is service:
            del self.services[service.name]
            self.note_change()

    def service(self, name: str) -> GraphService:
        """Return a service by name.

        Raises:
            NotFoundError: there is no such service.
        """
        service = self.services.get(absolute(name))
        if service is None:
            raise NotFoundError(f"there is no service {shown(name)}; /rosapi/services lists them")
        return service

    async def call_service(self, name: str, arguments: Message) -> Message:
        """Call a service. Fields that are missing in the request get ROS's default values.

        Raises:
            NotFoundError: there is no such service.
            InputError: the request is invalid.
            CobotError: any error that the service raises.
        """
        service = self.service(name)
        request = self.messages.checked(f"{service.type}_Request", arguments)
        return self.messages.checked(f"{service.type}_Response", await service.function(request))

    def add_action(self, action: GraphAction, owner: object = None) -> ActionServer:
        """Offer an action.

        Raises:
            InputError: the name or the type is invalid.
            ConflictError: an action with this name exists.
        """
        if action.definition:
            self.messages.add({action.type_: action.definition})
        self.messages.resolved(action.type_, "action")
        if action.name in self.actions:
            raise ConflictError(f"the action {action.name} already exists")
        server = self.actions[action.name] = ActionServer(self, action, owner)
        self.note_change()
        return server

    async def remove_action(self, server: ActionServer) -> None:
        """Withdraw an action. Its running goals are cancelled."""
        if self.actions.get(server.action.name) is server:
            del self.actions[server.action.name]
            await server.close()
            self.note_change()

    async def send_goal(
        self,
        name: str,
        goal_id: str,
        arguments: Message,
        on_feedback: Callable[[Message], None] | None = None,
    ) -> tuple[GoalStatus, Message]:
        """Send a goal to an action, and wait for the goal's end. Returns the status and the result of the
        goal.

        Args:
            goal_id: id of the goal: 32 hexadecimal digits that were never used before.

        Raises:
            InputError: the action is unknown, or the goal is invalid or rejected (`RejectedGoalError`).
        """
        server = self.action(name)
        checked = self.messages.checked(f"{server.action.type_}_Goal", arguments)
        goal = await server.begin(_uuid(goal_id), checked, on_feedback)
        await goal.ended.wait()
        return goal.status, goal.result

    def cancel(self, name: str, goal_id: str) -> None:
        """Cancel a goal. `send_goal` returns once it has ended.

        Raises:
            InputError: the action is unknown, or it has no such running goal.
        """
        code = self.action(name).cancel(_uuid(goal_id))
        if code:
            raise InputError(f"{name}: goal {goal_id} cannot be cancelled: {code.name.lower()}")

    def action(self, name: str) -> ActionServer:
        """Return an action by name.

        Raises:
            NotFoundError: there is no such action.
        """
        server = self.actions.get(absolute(name))
        if server is None:
            valid = ", ".join(self.actions) or "none"
            raise NotFoundError(f"there is no action {shown(name)}; valid names: {valid}")
        return server

    def graph(self) -> dict[str, Any]:
        """Return the part of the graph that other networks may mirror. It omits the entries that come from
        these networks, and the entries that they already have.
        """
        services = [
            {"name": service.name, "type": service.type}
            for service in self.services.values()
            if not service.local and service.owner not in self.gateways
        ]
        actions = [
            {"name": name, "type": server.action.type_}
            for name, server in self.actions.items()
            if server.owner not in self.gateways
        ]
        definitions = self.messages.definitions
        return {
            "topics": self.graph_of_topics(),
            "services": services,
            "actions": actions,
            "definitions": definitions,
        }

    def note_change(self) -> None:
        """Record a change of the graph. Its new description is published after `GRAPH_DELAY_S`."""
        if self._changing is None:
            self._changing = self._loop.call_later(GRAPH_DELAY_S, self._publish_graph)

    async def close(self) -> None:
        """Cancel all goals."""
        if self._changing is not None:
            self._changing.cancel()
        for server in tuple(self.actions.values()):
            await server.close()

    def _publish_graph(self) -> None:
        self._changing = None
        if self._graph.subscribers:
            self._graph.publish({"data": json.dumps(self.graph())})


def _uuid(goal_id: str) -> uuid.UUID:
    try:
        return uuid.UUID(hex=goal_id)
    except ValueError as exc:
        raise InputError(f"a goal's id is 32 hexadecimal digits, got {shown(goal_id)}") from exc
