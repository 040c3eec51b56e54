"""The common part of all action servers: acceptance, execution, feedback, cancellation, and kept results.

As in ROS 2, an action `/a` of type T consists of the services `/a/_action/send_goal` (T_SendGoal),
`/a/_action/get_result` (T_GetResult) and `/a/_action/cancel_goal` (action_msgs/srv/CancelGoal), and the
topics `/a/_action/feedback` and `/a/_action/status`. A transport that supports services and topics needs
nothing else for actions.

Source: https://design.ros2.org/articles/actions.html
"""

from __future__ import annotations

import asyncio
import logging
import uuid
from collections.abc import Callable
from contextvars import ContextVar
from typing import TYPE_CHECKING

from app.graph.actions import CancelCode, GoalHandle, GoalStatus, GraphAction, RejectedGoalError
from cobot import audit
from cobot.access.roles import Role
from cobot.errors import CobotError, ConflictError, UnavailableError
from cobot.ros.failures import failed_result
from cobot.ros.messages import Message, ros_time

if TYPE_CHECKING:
    from app.graph.graph import Graph

MAX_RUNNING = 16
MAX_KEPT = 64
KEPT_S = 900.0
"""How long the newest `MAX_KEPT` results are kept for clients that request them late, s."""

ASKER: ContextVar[object] = ContextVar("asker", default=None)
"""The client for which the current task sends goals. `ActionServer.abandon` ends these goals when the client
disconnects.
"""

ENDS = "the service is shutting down"

log = logging.getLogger("cobot.graph")


class ActionGoal:
    """A goal, from the request until its result is dropped.

    Attributes:
        id: the id that the client chose.
        asker: the client that sent the goal, see `ASKER`.
        status: current status of the goal.
        result: goal result; {} until `ended` is set.
        accepted_ns: time of acceptance, ns since 1970.
        accepted: future that is done when the goal is accepted. If the goal is rejected, it contains the
            exception.
        ended: event that is set when the result is known.
    """

    def __init__(self, goal_id: uuid.UUID, on_feedback: Callable[[Message], None] | None) -> None:
        self.id = goal_id
        self.asker = ASKER.get()
        self.on_feedback = on_feedback
        self.status = GoalStatus.UNKNOWN
        self.result: Message = {}
        self.accepted_ns = 0
        self.ended_s = 0.0
        self.accepted: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self.ended = asyncio.Event()
        self.handle: GoalHandle

    @property
    def running(self) -> bool:
        return not self.ended.is_set()


class ActionServer:
    """Serves one action on the graph.

    Args:
        owner: the client that offers the action; None if the service itself offers it.
    """

    def __init__(self, graph: Graph, action: GraphAction, owner: object = None) -> None:
        self.action = action
        self.owner = owner = self if owner is None else owner
        self._graph = graph
        self._messages = graph.messages
        self._goals: dict[uuid.UUID, ActionGoal] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        below, type_ = f"{action.name}/_action", action.type_
        self._feedback = graph.advertise(
            f"{below}/feedback", f"{type_}_FeedbackMessage", owner=owner, alone=True
        )
        self._status = graph.advertise(
            f"{below}/status", "action_msgs/msg/GoalStatusArray", latch=True, owner=owner, alone=True
        )
        self._services = [
            graph.add_service(f"{below}/{name}", service, function, owner=owner, role=role)
            for name, service, function, role in (
                ("send_goal", f"{type_}_SendGoal", self._serve_send_goal, Role.OPERATOR),
                ("get_result", f"{type_}_GetResult", self._serve_get_result, Role.OBSERVER),
                ("cancel_goal", "action_msgs/srv/CancelGoal", self._serve_cancel_goal, Role.OPERATOR),
            )
        ]

    async def begin(
        self, goal_id: uuid.UUID, arguments: Message, on_feedback: Callable[[Message], None] | None = None
    ) -> ActionGoal:
        """Start a goal. Returns when the action has accepted it.

        Args:
            arguments: the goal message, complete and validated.
            on_feedback: function that is called with each feedback. It must return quickly.

        Raises:
            CobotError: the goal is rejected; the error gives the reason.
        """
        self._forget()
        if goal_id in self._goals:
            raise ConflictError(f"goal {goal_id.hex} of {self.action.name} was already sent")
        if sum(goal.running for goal in self._goals.values()) >= MAX_RUNNING:
            raise ConflictError(
                f"{self.action.name} already has {MAX_RUNNING} running goals, which is the maximum"
            )
        goal = ActionGoal(goal_id, on_feedback)
        goal.handle = GoalHandle(goal, self)
        self._goals[goal_id] = goal
        task = asyncio.create_task(self._run(goal, arguments), name=f"goal of {self.action.name}")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        try:
            await asyncio.shield(goal.accepted)
            audit.note(f"goal of {self.action.name}", "accepted", goal=goal_id)
        except CobotError as exc:
            audit.note(f"goal of {self.action.name}", f"refused: {exc}", goal=goal_id)
            audit.report_refusal(f"goal of {self.action.name}", exc.code, str(exc))
            raise
        except asyncio.CancelledError:
            goal.handle.cancel_requested.set()  # the client that sent the goal has disconnected
            raise
        return goal

    def cancel(self, goal_id: uuid.UUID) -> CancelCode:
        """Ask the action to cancel a goal. It ends the goal later."""
        goal = self._goals.get(goal_id)
        if goal is None:
            return CancelCode.UNKNOWN_GOAL_ID
        if not goal.running:
            return CancelCode.GOAL_TERMINATED
        goal.handle.cancel_requested.set()
        audit.note(f"goal of {self.action.name}", "cancelled", goal=goal_id)
        if goal.status is GoalStatus.EXECUTING:
            goal.status = GoalStatus.CANCELING
            self._publish_status()
        return CancelCode.NONE

    def abandon(self, asker: object) -> None:
        """Cancel all goals of a client that has disconnected, because no other client can end them."""
        for goal in list(self._goals.values()):
            if goal.asker is asker and goal.running:
                self.cancel(goal.id)

    def accept(self, goal: ActionGoal) -> None:
        """Mark a goal as accepted and running."""
        if goal.accepted.done():
            return
        goal.accepted_ns = self._graph.clock.wall_ns()
        cancelled = goal.handle.cancel_requested.is_set()
        goal.status = GoalStatus.CANCELING if cancelled else GoalStatus.EXECUTING
        goal.accepted.set_result(None)
        self._publish_status()

    def explain(self, what: str, error: CobotError) -> None:
        """Report in the log and on /rosout what happened to a goal and why."""
        text = f"a goal of {self.action.name} {what}: {error}"
        log.warning("%s", text)
        self._graph.warn(text)

    def feedback(self, goal: ActionGoal, values: Message) -> None:
        """Send feedback about a running goal.

        Raises:
            InputError: the message is not of this action's feedback type.
        """
        if not goal.accepted_ns or not goal.running:
            return
        message = {"goal_id": _ros_id(goal.id), "feedback": values}
        self._feedback.publish(message)
        if goal.on_feedback is not None:
            goal.on_feedback(self._messages.checked(f"{self.action.type_}_Feedback", values))

    async def close(self) -> None:
        """Cancel all running goals."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for service in self._services:
            self._graph.remove_service(service)
        self._feedback.close()
        self._status.close()

    async def _run(self, goal: ActionGoal, arguments: Message) -> None:
        name, type_ = self.action.name, f"{self.action.type_}_Result"
        result, status = self._messages.default(type_), GoalStatus.ABORTED
        try:
            values = await self.action.execute(arguments, goal.handle)
            if not goal.accepted.done():
                raise RejectedGoalError(f"{name} has not accepted the goal")
            result, status = self._messages.checked(type_, values), goal.handle.status
            if status not in (GoalStatus.SUCCEEDED, GoalStatus.CANCELED, GoalStatus.ABORTED):
                log.error("%s returned without setting the status of the goal", name)
                status = GoalStatus.ABORTED
        except CobotError as exc:
            if not self._refuse(goal, exc):
                self.explain("is aborted", exc)
                result = failed_result(result, exc)
        except Exception as exc:
            log.error("%s failed", name, exc_info=exc)
            reason = CobotError("an error in cobot itself; its log has the details")
            if not self._refuse(goal, reason):
                result = failed_result(result, reason)
        except asyncio.CancelledError:
            result = failed_result(result, UnavailableError(ENDS))
            raise
        finally:
            self._refuse(goal, UnavailableError(ENDS))
            goal.result, goal.status, goal.ended_s = result, status, self._graph.clock.now_s()
            goal.ended.set()
            if goal.accepted_ns:
                self._publish_status()

    def _refuse(self, goal: ActionGoal, reason: CobotError) -> bool:
        """Reject a goal that has not been accepted yet. Returns whether it could still be rejected."""
        if goal.accepted.done():
            return False
        goal.accepted.set_exception(reason)
        goal.accepted.exception()  # without this, asyncio would complain if no client waits for the result
        del self._goals[goal.id]
        return True

    def _forget(self) -> None:
        """Drop results that no client has requested in time, the oldest first."""
        ended = [goal for goal in self._goals.values() if not goal.running]
        oldest_s = self._graph.clock.now_s() - KEPT_S
        for index, goal in enumerate(ended):
            if goal.ended_s < oldest_s or index < len(ended) - MAX_KEPT:
                del self._goals[goal.id]

    def _publish_status(self) -> None:
        goals = [goal for goal in self._goals.values() if goal.accepted_ns]
        self._status.publish(
            {"status_list": [{"goal_info": _info(goal), "status": int(goal.status)} for goal in goals]}
        )

    async def _serve_send_goal(self, request: Message) -> Message:
        goal_id = self._uuid(request["goal_id"])
        try:
            goal = await self.begin(goal_id, request["goal"])
        except CobotError as exc:  # ROS has no field for the reason
            self.explain("is refused", exc)
            return {"accepted": False, "stamp": ros_time(0)}
        return {"accepted": True, "stamp": ros_time(goal.accepted_ns)}

    async def _serve_get_result(self, request: Message) -> Message:
        goal = self._goals.get(self._uuid(request["goal_id"]))
        if goal is None or not goal.accepted_ns:
            return {
                "status": int(GoalStatus.UNKNOWN),
                "result": self._messages.default(f"{self.action.type_}_Result"),
            }
        await goal.ended.wait()
        return {"status": int(goal.status), "result": goal.result}

    async def _serve_cancel_goal(self, request: Message) -> Message:
        """Serve CancelGoal. A request without an id and a time cancels all goals. A request with a time also
        cancels all goals that were accepted until this time.
        """
        info = request["goal_info"]
        goal_id, stamp = self._uuid(info["goal_id"]), info["stamp"]
        until_ns = stamp["sec"] * 1_000_000_000 + stamp["nanosec"]
        everything = not goal_id.int and not until_ns
        wanted = [
            goal
            for goal in self._goals.values()
            if goal.running
            and goal.accepted_ns
            and (everything or goal.id == goal_id or goal.accepted_ns <= until_ns)
        ]
        code = self.cancel(goal_id) if goal_id.int else CancelCode.NONE
        cancelled = [goal for goal in wanted if self.cancel(goal.id) is CancelCode.NONE]
        return {
            "return_code": int(CancelCode.NONE if cancelled else code),
            "goals_canceling": [_info(goal) for goal in cancelled],
        }

    def _uuid(self, message: Message) -> uuid.UUID:
        return uuid.UUID(bytes=self._messages.octets(message["uuid"]))


def _ros_id(goal_id: uuid.UUID) -> Message:
    return {"uuid": list(goal_id.bytes)}


def _info(goal: ActionGoal) -> Message:
    return {"goal_id": _ros_id(goal.id), "stamp": ros_time(goal.accepted_ns)}
