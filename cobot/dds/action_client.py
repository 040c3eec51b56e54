"""`python -m cobot.dds.action_client SETTINGS`: a client of one action and one joint, for a gripper's driver.

The client is a separate process, so that network traffic never delays the service. It ends when its standard
input ends. SETTINGS is a JSON object with `domain_id`, `interfaces`, `localhost_only`, `peers`, `action`,
`type`, `answer_timeout_s`, `joint_states` and `joint`. Each line of its input is a goal, `{"number": 1,
"goal": {...}}`, or a cancellation of that goal and all earlier ones, `{"cancel": 1}`. Each line of its output
is a JSON object with `what`:

    ready       the server of the action is there, or not; five times a second
    joint       position, effort of the joint
    sent        number of a goal that is sent now
    answer      number of a goal, and whether it was accepted
    result      number of a goal, its status and values; number 0 is a goal from before this process
    error       text

A goal is sent after the answer to the previous one, because a driver with several threads may execute two
goals in the wrong order if they arrive together. Of the goals that are waiting meanwhile, only the newest is
sent.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from cobot.dds.caller import ActionCaller
from cobot.dds.names import ENCLAVE, NodeName
from cobot.dds.node import DdsNode, Message
from cobot.dds.rtps import Participant
from cobot.errors import CobotError
from cobot.foreign import plain_text
from cobot.ros.codec import without_nan
from cobot.ros.messages import Messages
from cobot.ros.robot_messages import JOINT_STATES

NAME = NodeName("cobot_gripper")
READY_S = 0.2
CANCELED = 5
"""Value of action_msgs/msg/GoalStatus that is reported for a goal that was cancelled before it was sent."""


class ActionClient:
    """The client of one action; see the module."""

    def __init__(self, settings: dict[str, Any], node: DdsNode) -> None:
        self._joint = settings["joint"]
        self._answer_timeout_s = settings["answer_timeout_s"]
        self._newest = self._cancelled = 0  # numbers of goals
        self._turn = asyncio.Lock()  # held while a goal waits for its answer
        self._running: Message | None = None  # id of the last accepted goal
        self._tasks: set[asyncio.Task[None]] = set()
        self._action = ActionCaller(
            node,
            settings["action"],
            settings["type"],
            lambda feedback: None,
            lambda answer: self._tell_result(0, answer["status"], answer["result"]),
            goal_lifespan_s=self._answer_timeout_s,
        )
        node.subscription(settings["joint_states"], JOINT_STATES, self._take_joints, reliable=False)

    async def serve(self) -> None:
        """Execute the lines of standard input until it ends."""
        reader = asyncio.StreamReader()
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        telling = asyncio.create_task(self._tell_ready())
        try:
            while line := await reader.readline():
                content = json.loads(line)
                work = self._cancel(content["cancel"]) if "cancel" in content else self._run(**content)
                task = asyncio.create_task(work)
                self._tasks.add(task)
                task.add_done_callback(self._tasks.discard)
        finally:
            telling.cancel()

    async def _run(self, number: int, goal: Message) -> None:
        self._newest = number
        try:
            async with self._turn:
                if number != self._newest:
                    return
                if number <= self._cancelled:
                    self._tell_result(number, CANCELED, {})
                    return
                self._tell("sent", number=number)
                sending = asyncio.ensure_future(self._action.send(goal))
                await asyncio.wait([sending], timeout=self._answer_timeout_s)
                is_late = not sending.done()
            goal_id = await sending
            self._tell("answer", number=number, accepted=goal_id is not None)
            if goal_id is None:
                return
            if is_late and (number != self._newest or number <= self._cancelled):
                await self._action.cancel(goal_id)
            else:
                self._running = goal_id
            answer = await self._action.result(goal_id)
            self._tell_result(number, answer["status"], answer["result"])
        except CobotError as exc:
            self._tell("error", number=number, text=plain_text(exc, 300))

    async def _cancel(self, number: int) -> None:
        """Cancel the last accepted goal. If a goal has not been answered yet, wait until it is accepted."""
        self._cancelled = number
        async with self._turn:
            goal_id = self._running
        if goal_id is not None:
            await self._action.cancel(goal_id)

    async def _tell_ready(self) -> None:
        while True:
            self._tell("ready", ready=self._action.is_ready)
            await asyncio.sleep(READY_S)

    def _take_joints(self, message: Message) -> None:
        if self._joint in message["name"]:
            place = message["name"].index(self._joint)
            values = {
                name: message[name][place] if len(message[name]) > place else None
                for name in ("position", "effort")
            }
            self._tell("joint", **values)

    def _tell_result(self, number: int, status: int, values: Message) -> None:
        """Report the result without its other fields, because a driver may put anything into them."""
        stalled = bool(values.get("stalled"))
        self._tell("result", number=number, status=status, values={"stalled": stalled})

    def _tell(self, what: str, **values: Any) -> None:
        print(json.dumps(without_nan({"what": what, **values})), flush=True)


async def _serve(settings: dict[str, Any]) -> None:
    participant = Participant(
        settings["domain_id"],
        settings["interfaces"] or None,
        localhost_only=settings["localhost_only"],
        peers=settings["peers"],
        name=NAME.full,
        user_data=ENCLAVE,
    )
    node = DdsNode(participant, NAME, Messages(), None, asyncio.get_running_loop())
    try:
        await ActionClient(settings, node).serve()
    finally:
        node.close()
        participant.close()


if __name__ == "__main__":
    try:
        asyncio.run(_serve(json.loads(sys.argv[1])))
    except CobotError as exc:
        print(json.dumps({"what": "error", "number": 0, "text": str(exc)}), flush=True)
        sys.exit(1)
