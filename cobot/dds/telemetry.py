"""Topics of a robot that are published directly from its shared memory: joint states at up to 1 kHz, poses,
forces and frames.

One thread per robot publishes at absolute deadlines. The stamp of a message is the time of its measurement,
and no measurement is sent twice. If rtloop crashes or the robot cannot be read, these topics stop.
`/{robot}/status` continues and gives the reason.
"""

from __future__ import annotations

import json
import logging
import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cobot.cell.surroundings import tool_file
from cobot.config import Settings
from cobot.dds.node import DdsNode, Message, NodePublisher
from cobot.errors import CobotError, TornReadError
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.robot.description import load_robot
from cobot.ros.fingers import FINGER_JOINTS, FRESH_S, FingerState
from cobot.ros.robot_messages import JOINT_STATES, MEASURED, POSE, STRING, TRANSFORMS, WRENCH, RobotMessages

IDLE_S = 0.02
"""Interval at which this process looks for subscribers while there are no subscribers, s."""
RETRY_S = 0.5
_STAMP = struct.Struct("<iI")
_STAMP_AT = 4
"""Offset of the header's stamp. All CDR data begin with four other bytes."""
_SECOND_NS = 1_000_000_000

log = logging.getLogger("cobot.ros2")


class JointStateWriter:
    """Writes sensor_msgs/msg/JointState as CDR by filling in a template, which takes 6 µs. Encoding the whole
    message would take 90 µs.

    Args:
        template: a message for the same joints, as CDR.
        joints: number of joints, including fingers.
    """

    def __init__(self, template: bytes, joints: int) -> None:
        self._bytes = bytearray(template)
        self._joints = struct.Struct(f"<{joints}d")
        # The three arrays are at the end of the message. Before each array are its length and four bytes of
        # padding.
        step = self._joints.size + 8
        self._at = [len(template) - self._joints.size - step * place for place in (2, 1, 0)]

    def cdr(self, state: np.ndarray, stamp_ns: int, fingers: FingerState | None = None) -> bytes:
        """Write the message for a record of `cobot.ipc.state_fields.state_dtype`, in rad, rad/s and N·m."""
        _STAMP.pack_into(self._bytes, _STAMP_AT, *divmod(stamp_ns, _SECOND_NS))
        rows = {} if fingers is None else fingers.rows
        for at, name in zip(self._at, MEASURED, strict=True):
            self._joints.pack_into(self._bytes, at, *state[name].tolist(), *rows.get(name, ()))
        return bytes(self._bytes)


@dataclass(slots=True)
class TelemetryTopic:
    """A topic with its own rate.

    Attributes:
        due_ns: time of the next message, on the monotonic clock.
    """

    publisher: NodePublisher
    rate_hz: float
    make: Callable[[np.ndarray], bytes]
    due_ns: int = 0
    sent_ns: int = 0

    @property
    def period_ns(self) -> int:
        return int(_SECOND_NS / self.rate_hz)

    def advance(self, now_ns: int) -> None:
        """Set the time of the next message on the time grid of the rate. After a delay of more than a period,
        the grid restarts.
        """
        self.due_ns += self.period_ns
        if self.due_ns <= now_ns:
            self.due_ns = now_ns + self.period_ns


class Telemetry:
    """The topics of one robot. The object is made in the event loop, and publishes in its own thread.

    Args:
        prefix: prefix of frame names, for several robots in one tree.
        transforms: the publisher for /tf, which all robots share.

    Attributes:
        topics: names of this robot's own topics.
        description: std_msgs/msg/String with the URDF, as CDR.
        static_transforms: transforms of the links that no joint moves, as dicts.
        problem: the reason why the last state was missing or old.
        on_tool: called in the publishing thread when the TCP changes, because the description and the
            transforms contain the TCP.
    """

    def __init__(self, node: DdsNode, settings: Settings, prefix: str, transforms: NodePublisher) -> None:
        robot = load_robot(settings)
        self._model, self._tool_file = robot.model, tool_file(settings)
        self._model.carry(self._tool_file.read())
        section = settings.ros
        name = settings.robot.name
        self.robot = name
        self._stale_ns = int(settings.web.stale_after_s * _SECOND_NS)
        self._messages = RobotMessages(robot.model, settings.robot.base_frame, settings.robot.tcp, prefix)
        self._dof = robot.limits.dof
        self._encode = node.messages.to_cdr
        self._memory: RobotMemory | None = None
        self.problem = "rtloop has not started yet"
        self._template: JointStateWriter | None = None
        self._fingers: tuple[int, FingerState] | None = None
        self._with_fingers = False
        self._ended = threading.Event()
        made = self._messages

        def feed(
            topic: str, type_: str, rate_hz: float, make: Callable[[np.ndarray], bytes]
        ) -> TelemetryTopic:
            return TelemetryTopic(node.publisher(f"/{name}/{topic}", type_), rate_hz, make)

        def by(type_: str, make: Callable[[np.ndarray], dict[str, object]]) -> Callable[[np.ndarray], bytes]:
            return lambda state: self._encode(type_, make(state))

        self.joint_states = feed(
            "joint_states", JOINT_STATES, section.joint_states_rate_hz, self._joint_state
        )
        self._feeds = [
            self.joint_states,
            feed("tcp_pose", POSE, section.pose_rate_hz, by(POSE, made.pose)),
            feed("wrench", WRENCH, section.pose_rate_hz, by(WRENCH, made.wrench)),
            TelemetryTopic(transforms, section.tf_rate_hz, by(TRANSFORMS, made.transforms)),
        ]
        self._status = feed("status", STRING, section.status_rate_hz, by(STRING, made.status))
        self._described = latched = node.publisher(f"/{name}/robot_description", STRING, latched=True)
        self.description = self._encode(STRING, made.description())
        latched.publish_cdr(self.description)
        feeds = [feed for feed in (*self._feeds, self._status) if feed.publisher is not transforms]
        self.topics = {latched.topic, *(feed.publisher.topic for feed in feeds)}
        self.static_transforms = made.static_transforms()["transforms"]
        self.on_tool: Callable[[], None] = lambda: None
        self._thread = threading.Thread(target=self._run, name=f"telemetry {name}", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def take_fingers(self, message: Message) -> None:
        """Add the gripper's fingers, which the service reads, to the joint states."""
        fingers = FingerState.of(message)
        self._fingers = None if fingers is None else (time.monotonic_ns(), fingers)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        if self._memory is not None:
            self._memory.close()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._cycle()
            except Exception as exc:
                log.error("%s: telemetry failed", self.robot, exc_info=exc)
                self._ended.wait(RETRY_S)

    def _cycle(self) -> None:
        """Publish the topics that are due, and sleep until the next topic is due."""
        now_ns = time.monotonic_ns()
        due = [feed for feed in self._feeds if feed.publisher.readers and feed.due_ns <= now_ns]
        status_due = self._status.due_ns <= now_ns
        if due or status_due:
            state = self.read()
            for feed in due:
                self.publish(feed, state, now_ns)
            if status_due:
                self._status.advance(now_ns)
                self._tell_status(state)
                if self._memory is not None and self._memory.info.try_read():
                    self._follow_tool(int(self._memory.info.data["tool_version"]))
        wanted = [feed.due_ns for feed in self._feeds if feed.publisher.readers]
        next_ns = min([self._status.due_ns, time.monotonic_ns() + int(IDLE_S * _SECOND_NS), *wanted])
        time.sleep(max(0.0, (next_ns - time.monotonic_ns()) * 1e-9))

    def _follow_tool(self, version: int) -> None:
        """If rtloop uses a new tool, publish the TCP-dependent topics again."""
        if version == self._model.tool.version:
            return
        tool = self._tool_file.read()
        if tool.version != version:  # the file has already changed again
            return
        self._model.carry(tool)
        self.description = self._encode(STRING, self._messages.description())
        self._described.publish_cdr(self.description)
        self.static_transforms = self._messages.static_transforms()["transforms"]
        self.on_tool()

    def read(self) -> np.ndarray | None:
        """The newest state if its measurement is fresh; otherwise None, and `problem` gives the reason."""
        try:
            if self._memory is None:
                self._memory = RobotMemory.attach(self.robot, MemoryRole.READER)
            state = self._memory.state.read()
        except TornReadError as exc:
            self.problem = str(exc)
            return None
        except CobotError as exc:
            self.problem = str(exc)
            self._ended.wait(RETRY_S)
            return None
        now_ns = time.monotonic_ns()
        if self._memory.state.sequence == 0:
            self.problem = "rtloop has not started yet"
        elif (age_ns := now_ns - int(state["monotonic_ns"])) > self._stale_ns:
            self.problem = f"rtloop has published nothing for {age_ns * 1e-9:.1f} s"
        elif (age_ns := now_ns - int(state["measured_monotonic_ns"])) > self._stale_ns:
            self.problem = f"rtloop has measured nothing for {age_ns * 1e-9:.1f} s"
        else:
            return state
        return None

    def publish(self, feed: TelemetryTopic, state: np.ndarray | None, now_ns: int) -> None:
        if state is None:
            feed.advance(now_ns)
            return
        measured_ns = int(state["measured_monotonic_ns"])
        if measured_ns == feed.sent_ns:
            feed.due_ns = now_ns + feed.period_ns // 4  # slightly ahead of the robot: adjust the phase
            return
        feed.advance(now_ns)
        feed.sent_ns = measured_ns
        feed.publisher.publish_cdr(feed.make(state))

    def _tell_status(self, state: np.ndarray | None) -> None:
        if state is not None:
            content = self._status.make(state)
        else:
            unknown = {"mode": "UNAVAILABLE", "settled": False, "reason": self.problem}
            content = self._encode(STRING, {"data": json.dumps(unknown)})
        self._status.publisher.publish_cdr(content)

    def _joint_state(self, state: np.ndarray) -> bytes:
        now_ns, fingers = time.monotonic_ns(), None
        if (read := self._fingers) is not None and now_ns - read[0] <= FRESH_S * _SECOND_NS:
            fingers = read[1]
        if self._template is None or self._with_fingers is not (fingers is not None):
            self._with_fingers = fingers is not None
            template = self._encode(JOINT_STATES, self._messages.joint_state(state, fingers))
            joints = self._dof + (0 if fingers is None else len(FINGER_JOINTS))
            self._template = JointStateWriter(template, joints)
        return self._template.cdr(state, self._messages.measured_at(state), fingers)
