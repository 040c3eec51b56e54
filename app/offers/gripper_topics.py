"""Publishes the joint states of a gripper's fingers on the graph as /{robot}/gripper/joint_states, with each
new reading.

The DDS process copies these joint states into /{robot}/joint_states.
"""

from __future__ import annotations

import math

from app.graph.graph import Graph
from app.services.gripping.service import GripperService
from cobot.clock import Clock, WallTime
from cobot.ros.fingers import FRESH_S, FingerState, gripper_states
from cobot.ros.messages import ros_time
from cobot.ros.robot_messages import JOINT_STATES


class GripperTopics:
    """The topic of one gripper. A gripper without a width has no fingers and publishes nothing.

    Args:
        name: robot name.
    """

    def __init__(self, graph: Graph, gripper: GripperService, name: str, clock: Clock) -> None:
        self._gripper, self._clock, self._wall_time = gripper, clock, WallTime(clock)
        self._fingers: tuple[float, FingerState] | None = None
        self._publisher = graph.advertise(gripper_states(name), JOINT_STATES, owner=self, alone=True)
        gripper.on_reading.append(self._read)

    def close(self) -> None:
        """Stop publishing."""
        self._gripper.on_reading.remove(self._read)

    @property
    def fingers(self) -> FingerState | None:
        """Return the joint states of the fingers; None if they are unknown now."""
        if self._fingers is None or self._clock.now_s() - self._fingers[0] > FRESH_S:
            return None
        return self._fingers[1]

    def _read(self) -> None:
        report = self._gripper.report()
        state = report.state
        if report.problem or state is None or state.width is None:
            self._fingers = None
            return
        now_s = self._clock.now_s() - report.age_s
        speed = 0.0
        if self._fingers is not None and now_s > (before_s := self._fingers[0]):
            speed = (state.width - self._fingers[1].width) / (now_s - before_s)
        force = math.nan if state.force is None else state.force
        fingers = FingerState(state.width, speed, force)
        self._fingers = now_s, fingers
        if self._publisher.subscribers:
            stamp = ros_time(self._wall_time.at(round(1e9 * now_s)))
            self._publisher.publish({"header": {"stamp": stamp}, **fingers.message})
