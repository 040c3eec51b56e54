"""A server of an action for other ROS 2 nodes. It consists of three services and two topics below
`NAME/_action/`.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from cobot.clock import SYSTEM
from cobot.dds.caller import ENDED
from cobot.dds.node import DdsNode, Message
from cobot.ros.messages import ros_time

ACCEPTED, EXECUTING, CANCELING = 1, 2, 3
UNKNOWN_GOAL, TERMINATED, REJECTED = 2, 3, 1
"""Values of `return_code` of action_msgs/srv/CancelGoal."""
KEPT = 20
"""Number of goals whose results are stored."""
NO_TIME: Message = {"sec": 0, "nanosec": 0}


class _Goal:
    def __init__(self, goal_id: Message, stamp: Message, loop: asyncio.AbstractEventLoop) -> None:
        self.id, self.stamp, self.status = goal_id, stamp, EXECUTING
        self.result: asyncio.Future[Message] = loop.create_future()


class DdsActionServer:
    """Serves an action. A goal's name is its id as text.

    Args:
        on_goal: called with the name and the goal before the answer. Returns whether the goal is accepted.
        on_accepted: called with the name and the goal after the answer.
        on_cancel: called with the name of a goal to cancel. Returns whether it is cancelled.
    """

    def __init__(
        self,
        node: DdsNode,
        name: str,
        type_: str,
        on_goal: Callable[[str, Message], bool],
        on_accepted: Callable[[str, Message], None],
        on_cancel: Callable[[str], bool],
    ) -> None:
        below = f"{name}/_action"
        self._node = node
        self._on_goal, self._on_accepted, self._on_cancel = on_goal, on_accepted, on_cancel
        self._goals: dict[str, _Goal] = {}
        self._feedback = node.publisher(f"{below}/feedback", f"{type_}_FeedbackMessage")
        self._status = node.publisher(f"{below}/status", "action_msgs/msg/GoalStatusArray", latched=True)
        messages = node.messages
        for part in ("SendGoal_Request", "SendGoal_Response", "GetResult_Response", "FeedbackMessage"):
            kind = f"{type_}_{part}"
            messages.from_cdr(kind, messages.to_cdr(kind, {}))  # otherwise the first goal takes 0.1 s longer
        self._services = [
            node.service(f"{below}/send_goal", f"{type_}_SendGoal", self._take_goal),
            node.service(f"{below}/cancel_goal", "action_msgs/srv/CancelGoal", self._cancel),
            node.service(f"{below}/get_result", f"{type_}_GetResult", self._get_result),
        ]

    def feedback(self, name: str, message: Message) -> None:
        """Send feedback on a goal to the clients."""
        self._feedback.publish({"goal_id": self._goals[name].id, "feedback": message})

    def end(self, name: str, status: int, result: Message) -> None:
        """End a goal."""
        goal = self._goals[name]
        goal.status = status
        if not goal.result.done():
            goal.result.set_result({"status": status, "result": result})
        self._tell()

    def close(self) -> None:
        """Close the server. Running goals get no result."""
        for service in self._services:
            service.close()
        for topic in (self._feedback, self._status):
            topic.close()

    async def _take_goal(self, request: Message) -> Message:
        name = request["goal_id"]["uuid"]
        stamp = ros_time(SYSTEM.wall_ns())
        if name in self._goals or not self._on_goal(name, request["goal"]):
            return {"accepted": False, "stamp": stamp}
        self._goals[name] = _Goal(request["goal_id"], stamp, self._node.loop)
        for old in [key for key, goal in self._goals.items() if goal.status in ENDED][:-KEPT]:
            del self._goals[old]
        self._on_accepted(name, request["goal"])
        self._tell()
        return {"accepted": True, "stamp": stamp}

    async def _cancel(self, request: Message) -> Message:
        """Cancel goals as action_msgs/srv/CancelGoal defines: by id, by time, or all."""
        info = request["goal_info"]
        wanted, stamp = info["goal_id"]["uuid"], info["stamp"]
        is_any = not any(self._node.messages.octets(wanted))
        moment = (stamp["sec"], stamp["nanosec"])
        names = [
            name
            for name, goal in self._goals.items()
            if name == wanted
            or (is_any and moment == (0, 0))
            or (moment > (0, 0) and (goal.stamp["sec"], goal.stamp["nanosec"]) <= moment)
        ]
        active = [name for name in names if self._goals[name].status not in ENDED]
        canceling = [self._goals[name] for name in active if self._on_cancel(name)]
        code = 0
        if not canceling and not is_any:
            code = REJECTED if active else TERMINATED if names else UNKNOWN_GOAL
        infos = [{"goal_id": goal.id, "stamp": goal.stamp} for goal in canceling]
        return {"return_code": code, "goals_canceling": infos}

    async def _get_result(self, request: Message) -> Message:
        goal = self._goals.get(request["goal_id"]["uuid"])
        return {"status": 0} if goal is None else dict(await asyncio.shield(goal.result))

    def _tell(self) -> None:
        listed = [
            {"goal_info": {"goal_id": goal.id, "stamp": goal.stamp}, "status": goal.status}
            for goal in self._goals.values()
        ]
        self._status.publish({"status_list": listed})
