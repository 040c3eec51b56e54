"""A robot's state and events, as the messages that its recordings contain."""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from app.services.state.link import RobotLink
from app.services.state.robot_state import RobotState
from cobot.clock import WallTime
from cobot.errors import UnavailableError
from cobot.ipc.records import record_dtype
from cobot.ipc.state_fields import GRIPPER, RECORDED
from cobot.robot.description import RobotDescription

if TYPE_CHECKING:
    from cobot.recording.messages import RecordMessages

EVENTS = "/events"
LATE_S = 0.1
"""Maximum age of a measured state, s. An older one is reported as not measured in this cycle."""


@lru_cache(maxsize=64)
def _messages(names: tuple[str, ...], base_frame: str, period_s: float) -> RecordMessages:
    """Create the message types for a robot. Call this in a thread, because the first call imports rosbags,
    which takes a second.
    """
    from cobot.recording.messages import RecordMessages

    return RecordMessages(names, base_frame, period_s)


class RobotChannels:
    """The channels of one robot for one client. Create this object in a thread, see `_messages`.

    Args:
        has_gripper: whether the robot has a gripper, which has its own topic.

    Attributes:
        schemas: type name and type definition of each topic.
    """

    def __init__(self, robot: RobotDescription, link: RobotLink, *, has_gripper: bool) -> None:
        from cobot.recording.messages import TOPICS

        names = tuple(robot.limits.names)
        self._link, self._wall_time = link, WallTime(link.clock)
        self._messages = _messages(names, robot.base_frame, link.memory.period_s)
        self.schemas = {
            topic: (kind, self._messages.definition(kind))
            for topic, kind in TOPICS.items()
            if has_gripper or topic != GRIPPER
        }
        self._record = np.zeros(1, record_dtype(len(names)))
        self._caught: np.ndarray | None = None

    def states(self) -> dict[str, tuple[int, bytes]]:
        """Return the newest state as one message for each topic, with its time, ns since 1970. The result is
        empty if there is no state.
        """
        try:
            state = self._link.state()
        except UnavailableError:
            return {}
        record = self._record
        for field in RECORDED:
            record[field.name] = state.record[field.name]
        record["number"] = state.record["cycle"]
        record["fresh"] = state.measured_age_s < LATE_S
        record["interventions"] = self._interventions(state)
        ahead_ns = self._wall_time.ahead_ns()
        moment_ns = int(record["monotonic_ns"][0]) + ahead_ns
        return {
            topic: (moment_ns, content) for topic, (content, _) in self._messages.of(record, ahead_ns).items()
        }

    def event(self, text: str) -> tuple[int, bytes]:
        """Convert a service event to a message, with its time, ns since 1970."""
        from cobot.recording.events import RunEvent

        event = json.loads(text)
        mode, cycle = "", 0
        try:
            state = self._link.state()
            mode, cycle = state.mode.name, int(state.record["cycle"])
        except UnavailableError:
            pass
        now_ns = self._link.clock.now_ns()
        made = RunEvent(cycle, now_ns, event["type"], mode, json.dumps(event["data"]))
        return self._wall_time.at(now_ns), self._messages.event(made, self._wall_time.ahead_ns())

    def _interventions(self, state: RobotState) -> int:
        """Return a bit mask with one bit for each kind of intervention since the last message."""
        counts = np.array(state.record["interventions"])
        before, self._caught = self._caught, counts
        return 0 if before is None else bit_mask(np.flatnonzero(counts != before))


def bit_mask(places: Iterable[int]) -> int:
    """Return an integer whose bits are set at the given positions. All other bits are 0."""
    return sum(1 << int(place) for place in places)
