"""The interface that an action on the graph implements. `app.graph.action_server` does the rest."""

from __future__ import annotations

import asyncio
from enum import IntEnum
from typing import TYPE_CHECKING, Protocol

from cobot.errors import CobotError, InputError
from cobot.ros.messages import Message

if TYPE_CHECKING:
    from app.graph.action_server import ActionGoal, ActionServer


class RejectedGoalError(InputError):
    """Raised if a goal is not accepted. Nothing has happened."""


class GoalStatus(IntEnum):
    """The values of action_msgs/msg/GoalStatus."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class CancelCode(IntEnum):
    """The values of action_msgs/srv/CancelGoal."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL_ID = 2
    GOAL_TERMINATED = 3


class GraphAction(Protocol):
    """An action that the graph offers.

    Attributes:
        name: action name, such as "/iiwa/servo_mode".
        type_: type of the action, such as "aubo_interfaces/action/ServoMode".
        definition: the text of the .action file; "" if `cobot.ros` knows the type.
    """

    name: str
    type_: str
    definition: str

    async def execute(self, goal: Message, handle: GoalHandle) -> Message:
        """Execute a goal and return its result.

        Implementations call `handle.accept()` once the goal is known to be executable. Before returning, they
        set `handle.status` to SUCCEEDED, CANCELED or ABORTED. They must return soon after
        `handle.cancel_requested` is set. If a CobotError is raised before `accept`, the goal is rejected with
        the error text; after `accept`, the goal is aborted.

        Raises:
            RejectedGoalError: the goal is rejected.
        """
        ...


class GoalHandle:
    """The interface through which an action handles a goal.

    Attributes:
        goal_id: id of the goal, 32 hexadecimal digits.
        cancel_requested: event that is set when a client cancels the goal.
        status: the status of the goal.
    """

    def __init__(self, goal: ActionGoal, server: ActionServer) -> None:
        self.goal_id = goal.id.hex
        self.cancel_requested = asyncio.Event()
        self.status = GoalStatus.UNKNOWN
        self._goal = goal
        self._server = server

    def accept(self) -> None:
        """Accept the goal, whose execution then begins. Further calls do nothing."""
        self._server.accept(self._goal)

    def explain(self, error: CobotError) -> None:
        """Report why the goal failed, for action types whose result has no field for it."""
        self._server.explain("fails", error)

    def feedback(self, values: Message) -> None:
        """Send feedback to the listeners. Before `accept` there are no listeners."""
        self._server.feedback(self._goal, values)
