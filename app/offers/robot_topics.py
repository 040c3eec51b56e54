"""The topics of a robot on the graph.

The DDS process publishes all of these topics itself, directly from shared memory, except `status` and
`joint_cmd`.
"""

from __future__ import annotations

import numpy as np

from app.graph.graph import Graph
from app.offers.gripper_topics import GripperTopics
from app.robot_services import Services
from cobot.clock import Ticks
from cobot.ros.messages import Message
from cobot.ros.robot_messages import JOINT_STATES, POSE, STRING, TRANSFORMS, WRENCH, RobotMessages

RATE_HZ = 100.0
STATUS_TICKS = 10
"""Number of states per status message."""


class RobotTopics:
    """Offers the topics joint_states, tcp_pose, wrench, status, joint_cmd and robot_description below
    /{robot}, and the topics /tf and /tf_static.

    The last joints in joint_states are the fingers of a gripper.

    States are read only while there is a subscriber. Only the service may publish these topics; but any
    client may publish frames.

    Args:
        prefix: prefix of the names of frames.
    """

    def __init__(self, graph: Graph, services: Services, name: str, tcp: str, prefix: str = "") -> None:
        robot = services.robot
        self._streams, self._tool = services.streams, services.tool
        self._clock = services.link.clock
        self._ticker: Ticks | None = None
        self._publication = self._ticks = 0
        self._gripper: GripperTopics | None = None
        if services.gripper.exists:
            self._gripper = GripperTopics(graph, services.gripper, name, self._clock)
        messages = RobotMessages(robot.model, robot.base_frame, tcp, prefix, self._clock)
        self._messages = messages
        self._made = {
            graph.advertise(topic, type_, owner=self, local=True, alone=alone): make
            for topic, type_, make, alone in (
                (f"/{name}/joint_states", JOINT_STATES, self._joint_state, True),
                (f"/{name}/tcp_pose", POSE, messages.pose, True),
                (f"/{name}/wrench", WRENCH, messages.wrench, True),
                ("/tf", TRANSFORMS, messages.transforms, False),
            )
        }
        self._status = graph.advertise(f"/{name}/status", STRING, owner=self, alone=True)
        self._make_status = messages.status
        for publisher in (*self._made, self._status):
            publisher.on_demand = self._follow_demand
        self._latched = {
            graph.advertise(topic, type_, latch=True, owner=self, local=True, alone=alone): make
            for topic, type_, make, alone in (
                ("/tf_static", TRANSFORMS, messages.static_transforms, False),
                (f"/{name}/robot_description", STRING, messages.description, True),
            )
        }
        self._publish_latched()
        services.tool.on_change.append(self._publish_latched)  # both messages contain the TCP
        servo = services.servo
        graph.subscribe(
            f"/{name}/joint_cmd",
            STRING,
            lambda message: servo.receive(message["data"]),
            owner=self,
            declares=True,
        )

    def close(self) -> None:
        """Stop reading states."""
        self._tool.on_change.remove(self._publish_latched)
        if self._gripper is not None:
            self._gripper.close()
        if self._ticker is not None:
            self._ticker.close()

    def _joint_state(self, state: np.ndarray) -> Message:
        return self._messages.joint_state(state, None if self._gripper is None else self._gripper.fingers)

    def _publish_latched(self) -> None:
        for publisher, make in self._latched.items():
            publisher.publish(make())

    def _follow_demand(self, _: int) -> None:
        wanted = any(publisher.subscribers for publisher in (*self._made, self._status))
        if wanted and self._ticker is None:
            self._ticker = self._clock.ticker(RATE_HZ, self._tick)
        elif not wanted and self._ticker is not None:
            self._ticker.close()
            self._ticker = None

    def _tick(self, times: int) -> None:
        self._publication, state = self._streams.state_since(self._publication)
        if state is None:
            return
        for publisher, make in self._made.items():
            if publisher.subscribers:
                publisher.publish(make(state))
        self._ticks += times
        if self._ticks >= STATUS_TICKS:
            self._ticks = 0
            if self._status.subscribers:
                self._status.publish(self._make_status(state))
