"""`python -m cobot.dds.arm_client SETTINGS`: a client of an arm's joint trajectory controller.

The client is a separate process, so that network traffic never delays rtloop. When its standard input ends,
it cancels its goal and ends. SETTINGS is a JSON object: `domain_id`, `interfaces`, `localhost_only`, `peers`,
`robot`, `joints` (names in the arm's order), `namespace`, `controller`, `action`, `controller_manager`,
`joint_states`, `speed_scaling`, `gpio`, `answer_timeout_s`, `tolerances`.

Each line of the input is a JSON object. Its field `ask` names the request, as listed below. The answer is one
line with a JSON object. If a request was not executed, the field `error` gives the reason.

    facts    the received data: the fields of `rtloop.backends.ros2_control.link.Facts`
    load     take a motion of `points`; `bytes` doubles follow: times, positions, velocities, accelerations
    start    send the motion as a goal; answered after the controller's answer or `answer_timeout_s`
    cancel   cancel all goals of the action; if that fails, `failed` in the answer gives the reason
    output   send the `value` of an `interface`, an output of the driver; the facts report a later failure
    forget   forget the last goal, and choose the controller again

With `stream`, the descriptor of a socket, there are no goals. Each datagram that arrives contains doubles,
which are published as a command of a forward command controller. Each joint state is sent there as doubles:
the time on the monotonic clock, positions, velocities, efforts.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import gc
import json
import math
import signal
import socket
import struct
import sys
import time
import uuid
from collections import deque
from typing import Any

import numpy as np

from cobot.dds.arm_io import ArmIo, arm_io
from cobot.dds.caller import ENDED, ActionCaller
from cobot.dds.controller_state import ControllerState
from cobot.dds.controllers import ControllerLister, takes_positions, takes_trajectories
from cobot.dds.names import ENCLAVE, NodeName
from cobot.dds.node import DdsNode, Message, NodePublisher
from cobot.dds.recent_positions import RecentPositions
from cobot.dds.rtps import Participant
from cobot.errors import CobotError
from cobot.foreign import cut, plain_text
from cobot.launch.process import leave_real_time
from cobot.ros.messages import Messages
from cobot.ros.robot_messages import JOINT_STATES

FOLLOW = "control_msgs/action/FollowJointTrajectory"
FLOAT, COMMANDS = "std_msgs/msg/Float64", "std_msgs/msg/Float64MultiArray"
COMMANDS_READER, COMMANDS_BEGIN, COMMANDS_END = "std_msgs::msg::dds_::Float64MultiArray_", "rt", "/commands"
DATAGRAM_BYTES = 4096
SEND_GOAL = "control_msgs::action::dds_::FollowJointTrajectory_SendGoal_Request_"
BEGIN, END = "rq", "/_action/send_goalRequest"
OWN = "/cobot"
"""Name prefix of cobot's participants. Their actions are never those of an arm."""
LIST_S, LIST_WAIT_S, LIST_OLD_S = 0.5, 2.0, 4.0
RATE_S = 1.0
COMMAND_LIFESPAN_S = 0.1
"""Age after which a lost command is not repeated, s. After a fault, the arm may be at a different
position.
"""
REJECTED = 1
MAX_TEXT, MAX_LISTED = 500, 24
"""Maximum length of strings and lists in the facts. The driver and the network define their real sizes."""
ALL: Message = {"uuid": base64.b64encode(bytes(16)).decode()}
"""A request to cancel with this id and time stamp 0 cancels all goals."""
LINE_BYTES = 1 << 16
OWN_GOALS = 100
"""Number of own goals whose ids are stored; older ids are dropped. Only goals that are still running are
looked up.
"""


class TrajectoryGoal:
    """The newest goal.

    Attributes:
        id: id of the goal.
        facts: see `rtloop.backends.ros2_control.link.GoalFacts`, without its times.
        sent_s, ended_s, feedback_s: times of sending, of the end and of the last feedback, on the monotonic
            clock.
    """

    def __init__(self) -> None:
        self.id: Message = {"uuid": base64.b64encode(uuid.uuid4().bytes).decode()}
        self.facts: dict[str, Any] = {"accepted": None, "status": None, "lost": False, "stopping": False}
        self.sent_s = time.monotonic()
        self.ended_s: float | None = None
        self.feedback_s = -math.inf
        self.late = False  # whether the goal was given up before the answer arrived

    @property
    def is_active(self) -> bool:
        return bool(self.facts["accepted"]) and self.facts["status"] is None and not self.facts["lost"]

    def facts_at(self, now_s: float) -> dict[str, Any]:
        """The facts about the goal at `now_s`, including its running time and the age of its feedback."""
        running_s = (self.ended_s or now_s) - self.sent_s
        age_s = min(now_s - self.feedback_s, 1e9)
        return {**self.facts, "running_s": running_s, "feedback_age_s": age_s}


class ArmClient:
    """The client for the arm's controller; see the module."""

    def __init__(self, settings: dict[str, Any], node: DdsNode) -> None:
        self._settings, self._node = settings, node
        self._joints: list[str] = settings["joints"]
        self._action: ActionCaller | None = None
        self._commands: NodePublisher | None = None
        self._state: ControllerState | None = None
        self._held, self._stated = RecentPositions(), RecentPositions()
        stream = settings.get("stream")
        self._socket = None if stream is None else socket.socket(fileno=stream)
        self._name, self._controller = settings["action"] or "", settings["controller"] or ""
        if self._controller and not self._name:
            self._name = self._name_of(self._controller)
        self._fixed = bool(self._name)
        self._choices: list[str] = []
        self._controllers: list[dict[str, Any]] | None = None
        self._listed_s = -math.inf
        self._lister = ControllerLister(node, settings["controller_manager"])
        self._look = asyncio.Event()
        self._goal: TrajectoryGoal | None = None
        self._own: deque[str] = deque(maxlen=OWN_GOALS)
        self._statuses: list[Message] = []
        self._scaling: float | None = None
        self._io: ArmIo | None = None
        self._joint_s: deque[float] = deque(maxlen=2000)
        self._names: list[str] = []
        self._missing: list[str] = []
        self._rows: dict[str, list[float] | None] = dict.fromkeys(("position", "velocity", "effort"))
        self._motion: tuple[np.ndarray, np.ndarray] | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        node.subscription(settings["joint_states"], JOINT_STATES, self._take_joints, reliable=False)
        node.subscription(settings["speed_scaling"], FLOAT, self._take_scaling, reliable=False)
        gpio = settings["gpio"]
        if interfaces := set(gpio["interfaces"]):
            timeout_s = settings["answer_timeout_s"]
            self._io = arm_io(node, gpio["driver"], gpio["controller"], interfaces, timeout_s)
        if self._fixed:
            self._connect(self._name)
        if self._socket is not None:
            self._socket.setblocking(False)
            node.loop.add_reader(self._socket, self._take_commands)
        for type_ in (f"{FOLLOW}_SendGoal_Request", "action_msgs/srv/CancelGoal_Request"):
            node.messages.to_cdr(type_, {})  # otherwise the first goal and the first stop take 0.05 s longer

    async def serve(self) -> None:
        """Answer the lines of standard input, until it ends."""
        reader = asyncio.StreamReader(limit=LINE_BYTES)
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        listing = asyncio.create_task(self._keep_listing())
        try:
            while line := await reader.readline():
                question = json.loads(line)
                content = await reader.readexactly(question.get("bytes", 0))
                try:
                    answer = await self._answer(question, content)
                except CobotError as exc:
                    answer = {"error": plain_text(exc, MAX_TEXT)}
                sys.stdout.write(json.dumps(answer) + "\n")
                sys.stdout.flush()
        except (asyncio.IncompleteReadError, BrokenPipeError):
            pass  # rtloop has ended
        finally:
            listing.cancel()
            await self._leave_nothing()

    async def _leave_nothing(self) -> None:
        """Cancel the goal, even if its answer arrives late."""
        goal = self._goal
        if goal is None:
            return
        deadline_s = time.monotonic() + self._settings["answer_timeout_s"]
        while goal.facts["accepted"] is None and time.monotonic() < deadline_s:
            await asyncio.sleep(0.01)
        if goal.is_active:
            await self._cancel()

    async def _answer(self, question: dict[str, Any], content: bytes) -> dict[str, Any]:
        ask = question["ask"]
        if ask == "facts":
            facts: dict[str, Any] = cut(self._facts(), MAX_TEXT, MAX_LISTED)
            return facts
        if ask == "load":
            values = np.frombuffer(content, "<f8")
            count = question["points"]
            self._motion = values[:count], values[count:].reshape(3, count, len(self._joints))
        elif ask == "start":
            await self._start()
        elif ask == "cancel":
            return {"failed": await self._cancel()}
        elif ask == "output":
            assert self._io is not None
            self._io.set_output(question["interface"], float(question["value"]))
        elif ask == "forget":
            self._goal = None
            if not self._fixed and not self._is_active(self._controller):
                self._controller = ""
            self._look.set()
        return {}

    def _facts(self) -> dict[str, Any]:
        now_s, ready = time.monotonic(), self._is_ready
        goal = self._goal
        if goal is not None and goal.is_active and not ready:
            goal.facts["lost"] = True
        while self._joint_s and now_s - self._joint_s[0] > RATE_S and len(self._joint_s) > 2:
            self._joint_s.popleft()
        moments = self._joint_s
        span_s = moments[-1] - moments[0] if len(moments) > 1 else 0.0
        listed = now_s - self._listed_s < LIST_OLD_S
        return {
            "action": self._name,
            "ready": ready,
            "choices": self._choices,
            "controllers": self._listed() if listed else None,
            "controller": self._controller,
            "age_s": now_s - moments[-1] if moments else None,
            "rate_hz": (len(moments) - 1) / span_s if span_s > 0.0 else 0.0,
            "names": self._names if self._missing else [],
            "missing": self._missing,
            **self._rows,
            "goal": None if goal is None else goal.facts_at(now_s),
            "others": self._others() if ready else 0,
            "scaling": self._scaling,
            "position_range": self._stated.range(),
            "held": self._held.newest,
            "held_range": self._held.range(),
            "held_age_s": min(now_s - self._held.heard_s, 1e9),
            "gpio": self._io.values if self._io is not None else {},
            "gpio_age_s": now_s - self._io.heard_s if self._io is not None and self._io.values else None,
            "gpio_problem": self._io.problem if self._io is not None else "",
        }

    def _listed(self) -> list[dict[str, Any]] | None:
        """The controllers; the chosen one is first, because a long list is cut off."""
        found = self._controllers
        return None if found is None else sorted(found, key=lambda each: each["name"] != self._controller)

    # Controllers

    @property
    def _is_ready(self) -> bool:
        if self._commands is not None:
            return self._commands.readers > 0
        return self._action is not None and self._action.is_ready

    def _name_of(self, controller: str) -> str:
        """The name of a controller's action, or of the topic for its commands."""
        end = "follow_joint_trajectory" if self._socket is None else "commands"
        return f"{self._settings['namespace']}/{controller}/{end}"

    def _is_active(self, name: str) -> bool:
        return any(each["name"] == name and each["state"] == "active" for each in self._controllers or ())

    async def _keep_listing(self) -> None:
        """Request the list of controllers repeatedly, and choose one of them."""
        while True:
            self._look.clear()
            if self._lister.is_ready:
                with contextlib.suppress(TimeoutError, CobotError):
                    self._controllers = await asyncio.wait_for(self._lister.controllers(), LIST_WAIT_S)
                    self._listed_s = time.monotonic()
            if not self._fixed and (self._goal is None or not self._goal.is_active):
                self._choose()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._look.wait(), LIST_S)

    def _choose(self) -> None:
        """Choose the controller that moves the arm's joints, and its action."""
        namespace = self._settings["namespace"]
        if self._lister.is_ready or self._controllers is not None:
            able_one = takes_trajectories if self._socket is None else takes_positions
            able = [each for each in self._controllers or () if able_one(each)]
            mine = [each for each in able if set(self._joints) <= set(each["joints"])] or able
            found = [each for each in mine if each["state"] == "active"] or mine
            if self._controller and any(each["name"] == self._controller for each in found):
                return
            names = [each["name"] for each in found]
            actions = {self._name_of(name): name for name in names}
        else:
            actions = dict.fromkeys(self._actions(f"{namespace}/"), "")
        self._choices = sorted(actions) if len(actions) > 1 else []
        if len(actions) == 1:
            ((name, self._controller),) = actions.items()
            if name != self._name:
                self._connect(name)

    def _actions(self, below: str) -> list[str]:
        """The actions in the graph, or the topics for commands."""
        goals = self._socket is None
        begin, last, type_name = (
            (BEGIN, END, SEND_GOAL) if goals else (COMMANDS_BEGIN, COMMANDS_END, COMMANDS_READER)
        )
        return [
            end.topic.removeprefix(begin).removesuffix(last if goals else "")
            for end in self._node.participant.discovered()
            if end.kind == "reader"
            and end.type_name == type_name
            and end.topic.startswith(f"{begin}{below}")
            and end.topic.endswith(last)
            and not end.participant.name.startswith(OWN)
        ]

    def _connect(self, name: str) -> None:
        if self._action is not None:
            self._action.close()
        self._name, self._statuses = name, []
        if self._socket is not None:
            if self._commands is not None:
                self._commands.close()
            self._commands = self._node.publisher(name, COMMANDS, depth=1, lifespan_s=COMMAND_LIFESPAN_S)
            return
        self._action = ActionCaller(
            self._node,
            name,
            FOLLOW,
            self._take_feedback,
            None,
            self._take_statuses,
            goal_lifespan_s=self._settings["answer_timeout_s"],
        )
        if self._state is not None:
            self._state.close()
        self._held = RecentPositions()
        self._state = ControllerState(self._node, name.rpartition("/")[0], self._take_state)

    # Goals

    async def _start(self) -> None:
        if self._action is None or self._motion is None or not self._is_ready:
            raise CobotError(f"there is no server for the action {self._name or 'of the arm'}")
        self._goal = goal = TrajectoryGoal()
        self._own.append(goal.id["uuid"])
        task = asyncio.create_task(self._run(self._action, goal, self._message(*self._motion)))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        deadline_s = time.monotonic() + self._settings["answer_timeout_s"]
        while goal.facts["accepted"] is None and time.monotonic() < deadline_s:
            if task.done() and (exc := task.exception()) is not None:
                raise CobotError(f"the goal cannot be sent: {exc}")
            await asyncio.sleep(0.001)
        goal.late = goal.facts["accepted"] is None

    async def _run(self, action: ActionCaller, goal: TrajectoryGoal, message: Message) -> None:
        goal.sent_s = time.monotonic()
        goal.facts["accepted"] = await action.send(message, goal.id) is not None
        if not goal.facts["accepted"]:
            return
        if goal.late:
            await action.cancel(goal.id)
        answer = await action.result(goal.id)
        goal.ended_s = time.monotonic()
        result = answer["result"]
        goal.facts |= {"status": answer["status"], "error_code": result["error_code"]}
        goal.facts["error_string"] = result["error_string"]

    async def _cancel(self) -> str:
        if self._socket is not None:
            return ""
        action, goal = self._action, self._goal
        if action is None or not self._is_ready:
            return (
                f"there is no server for the action {self._name or 'of the arm'}, so nothing can be cancelled"
            )
        if goal is not None:
            goal.facts["stopping"] = True
        active = [goal.id] if goal is not None and goal.is_active else []
        others = [each["goal_info"]["goal_id"] for each in self._running()]
        ids = [*active, *(each for each in others if each not in active), ALL]
        timeout_s = self._settings["answer_timeout_s"]
        deadline_s = time.monotonic() + timeout_s
        try:
            answers = await asyncio.wait_for(
                asyncio.gather(*(action.cancel(each) for each in ids)), timeout_s
            )
        except TimeoutError:
            return f"{self._name} has not answered a cancel request within {timeout_s:g} s"
        if active and goal is not None and answers[0]["return_code"] == REJECTED and goal.is_active:
            return f"{self._name} has rejected the request to cancel the motion"
        while self._running() and time.monotonic() < deadline_s:
            await asyncio.sleep(0.002)
        return ""

    def _running(self) -> list[Message]:
        return [each for each in self._statuses if each["status"] not in ENDED and each["status"] > 0]

    def _others(self) -> int:
        return sum(each["goal_info"]["goal_id"]["uuid"] not in self._own for each in self._running())

    def _message(self, times_s: np.ndarray, rows: np.ndarray) -> Message:
        points = []
        nanoseconds = np.rint(times_s * 1e9).astype(np.int64)
        for place, total in enumerate(nanoseconds.tolist()):
            sec, nanosec = divmod(total, 1_000_000_000)
            points.append(
                {
                    "positions": rows[0, place].tolist(),
                    "velocities": rows[1, place].tolist(),
                    "accelerations": rows[2, place].tolist(),
                    "time_from_start": {"sec": sec, "nanosec": nanosec},
                }
            )
        goal: Message = {"trajectory": {"joint_names": self._joints, "points": points}}
        tolerances = self._settings["tolerances"]
        for name in ("path", "goal"):
            if tolerances[name] is not None:
                goal[f"{name}_tolerance"] = [
                    {"name": joint, "position": tolerances[name]} for joint in self._joints
                ]
        sec, rest = divmod(tolerances["time_s"], 1.0)
        goal["goal_time_tolerance"] = {"sec": int(sec), "nanosec": int(rest * 1e9)}
        return goal

    def _take_feedback(self, feedback: Message) -> None:
        goal = self._goal
        if goal is None:
            return
        names = feedback["joint_names"] or self._joints
        with contextlib.suppress(ValueError, IndexError):
            order = [names.index(name) for name in self._joints]
            desired = [feedback["desired"]["positions"][place] for place in order]
            goal.facts["desired"] = desired
            goal.feedback_s = time.monotonic()
            self._held.add([feedback["actual"]["positions"][place] for place in order], goal.feedback_s)

    def _take_state(self, positions: dict[str, float]) -> None:
        """Read the positions at which the controller holds the arm's joints."""
        with contextlib.suppress(KeyError):
            self._held.add([positions[name] for name in self._joints], time.monotonic())

    def _take_statuses(self, statuses: list[Message]) -> None:
        self._statuses = statuses

    # Topics

    def _take_joints(self, message: Message) -> None:
        """Read the joints by name, because other devices may publish their joints on the same topic."""
        places = {name: place for place, name in enumerate(message["name"])}
        missing = [
            name for name in self._joints if name not in places or places[name] >= len(message["position"])
        ]
        if missing:
            if len(missing) < len(self._joints) or not self._joint_s:
                self._missing, self._names = missing, message["name"]
            return
        self._missing = []
        self._joint_s.append(time.monotonic())
        order = [places[name] for name in self._joints]
        for row in self._rows:
            values = message[row]
            complete = len(values) > max(order)
            self._rows[row] = [values[place] for place in order] if complete else None
        self._stated.add([message["position"][place] for place in order], self._joint_s[-1])

        if self._socket is not None:
            nothing = [math.nan] * len(self._joints)
            rows = [value for row in self._rows.values() for value in row or nothing]
            with contextlib.suppress(OSError):  # rtloop has not read the last ones: busy or gone
                self._socket.send(struct.pack(f"<{1 + len(rows)}d", self._joint_s[-1], *rows))

    def _take_commands(self) -> None:
        """Publish only the newest command, because the controller uses no other."""
        assert self._socket is not None
        newest = b""
        with contextlib.suppress(OSError):
            while content := self._socket.recv(DATAGRAM_BYTES):
                newest = content
        if newest and self._commands is not None:
            self._commands.publish({"data": list(struct.unpack(f"<{len(newest) // 8}d", newest))})

    def _take_scaling(self, message: Message) -> None:
        self._scaling = message["data"]


def make_participant(settings: dict[str, Any], name: NodeName) -> Participant:
    """Create a participant on the networks that the settings name."""
    return Participant(
        settings["domain_id"],
        settings["interfaces"] or None,
        localhost_only=settings["localhost_only"],
        peers=settings["peers"],
        name=name.full,
        user_data=ENCLAVE,
    )


async def _serve(settings: dict[str, Any]) -> None:
    name = NodeName(f"cobot_arm_{''.join(c if c.isalnum() else '_' for c in settings['robot'])}")
    participant = make_participant(settings, name)
    node = DdsNode(participant, name, Messages(), None, asyncio.get_running_loop())
    try:
        client = ArmClient(settings, node)
        gc.freeze()
        await client.serve()
    finally:
        node.close()
        participant.close()


if __name__ == "__main__":
    leave_real_time()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)  # ends with rtloop, after the goal has been cancelled
    try:
        asyncio.run(_serve(json.loads(sys.argv[1])))
    except CobotError as exc:
        print(json.dumps({"error": f"ROS 2: {exc}"}), flush=True)
        sys.exit(1)
