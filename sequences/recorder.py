"""Records what the robot does to a rosbag2, over HTTP like everything in a sequence."""

from __future__ import annotations

import json
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from cobot.client import Client
from cobot.errors import CobotError, InputError

JOINT_STATES = "/joint_states"
MOTION_EVENTS = "/motion_events"
TOPICS = {JOINT_STATES: "sensor_msgs/msg/JointState", MOTION_EVENTS: "std_msgs/msg/String"}
PERIOD_S = 0.02
BAG_VERSION = 8
"""Of the bag's metadata: what ROS 2 Humble writes reads as well."""


def parse_topics(text: str) -> list[str]:
    """The topics of a comma-separated list; all of them for an empty one.

    Raises:
        InputError: there is no such topic; lists the valid ones.
    """
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in TOPICS:
            raise InputError(f"topics: there is no {name!r}; valid are: {', '.join(TOPICS)}")
    return names or list(TOPICS)


class Recorder:
    """Writes a bag from its construction until `close`.

    Attributes:
        problem: what the robot's state could not be read for, "" while all is well.

    Raises:
        InputError: the bag exists already or cannot be made.
    """

    def __init__(self, path: Path, topics: list[str], url: str) -> None:
        self._types = get_typestore(Stores.ROS2_HUMBLE)
        try:
            self._writer = Writer(path, version=BAG_VERSION)
            self._writer.open()
        except Exception as exc:  # rosbags' own WriterError, and what the file system says
            raise InputError(f"bag {path}: cannot be written: {exc}") from exc
        self._connections = {
            topic: self._writer.add_connection(topic, TOPICS[topic], typestore=self._types)
            for topic in topics
        }
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._client = Client(url)
        self.problem = ""
        self._thread = threading.Thread(target=self._record, name="recorder", daemon=True)
        if JOINT_STATES in topics:
            self._thread.start()

    def event(self, content: dict[str, Any]) -> None:
        """Record a motion event, as JSON."""
        String = self._types.types["std_msgs/msg/String"]
        self._write(MOTION_EVENTS, String(data=json.dumps(content)))

    def close(self) -> None:
        """Finish the bag, so that it can be read."""
        self._end.set()
        if self._thread.is_alive():
            self._thread.join(2.0)
        with self._lock:
            self._connections.clear()
            self._writer.close()
        self._client.close()

    def _record(self) -> None:
        while not self._end.wait(PERIOD_S):
            try:
                state = self._client.joint_states()
            except CobotError as exc:
                self.problem = str(exc)
                continue
            self.problem = ""
            self._write(JOINT_STATES, self._joint_state(state))

    def _joint_state(self, state: dict[str, Any]) -> Any:
        types = self._types.types
        now_ns = time.time_ns()
        stamp = types["builtin_interfaces/msg/Time"](
            sec=now_ns // 1_000_000_000, nanosec=now_ns % 1_000_000_000
        )
        return types[TOPICS[JOINT_STATES]](
            header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
            name=state["name"],
            position=np.array(state["position"], dtype=np.float64),
            velocity=np.array(state["velocity"], dtype=np.float64),
            effort=np.array(state["effort"], dtype=np.float64),
        )

    def _write(self, topic: str, message: Any) -> None:
        with self._lock:
            connection = self._connections.get(topic)
            if connection is not None:
                data = self._types.serialize_cdr(message, TOPICS[topic])
                self._writer.write(connection, time.time_ns(), data)
