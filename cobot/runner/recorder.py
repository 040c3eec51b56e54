"""Records the robot's states in a rosbag2. It reads them over HTTP, as all parts of a sequence do."""

from __future__ import annotations

import json
import threading
import time
from concurrent.futures import Future
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_typestore

from cobot.client import Client
from cobot.errors import CobotError, InputError

JOINT_STATES = "/joint_states"
MOTION_EVENTS = "/motion_events"
TOPICS = {JOINT_STATES: "sensor_msgs/msg/JointState", MOTION_EVENTS: "std_msgs/msg/String"}
PERIOD_S = 0.02
POLL_TIMEOUT_S = 0.5
"""Timeout for a request, in seconds. It is short because after SIGTERM the bag must be closed before the
process is killed.
"""
BAG_VERSION = 8
"""Version of the bag's metadata. rosbags can write two versions; more tools can read this older one."""


def parse_topics(text: str) -> list[str]:
    """The topics in a comma-separated list. An empty list means all topics.

    Raises:
        InputError: a topic does not exist. The error lists the valid ones.
    """
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in TOPICS:
            raise InputError(f"topics: there is no {name!r}; valid names: {', '.join(TOPICS)}")
    return names or list(TOPICS)


class Recorder:
    """Writes a bag from `start` to `close`.

    A separate thread opens, writes and closes the bag, so that an exception that a signal raises in the main
    thread cannot interrupt the writing of a record. The storage is MCAP, because rosbags' sqlite storage
    treats the path as a URI, in which "%2e%2e" means "..".

    Attributes:
        topics: topics that are recorded.
        problem: reason why the robot's state cannot be read or the bag cannot be written; "" if both work.
    """

    def __init__(self, path: Path, topics: list[str], url: str) -> None:
        self.problem = ""
        self._path = path
        self.topics = topics
        self._url = url
        self._types = get_typestore(Stores.ROS2_HUMBLE)
        self._events: SimpleQueue[tuple[int, str]] = SimpleQueue()
        self._opened: Future[None] = Future()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    def start(self) -> None:
        """Create the bag and record until `close`.

        Raises:
            InputError: the bag already exists or cannot be created.
        """
        self._thread.start()
        self._opened.result()

    def event(self, content: dict[str, Any]) -> None:
        """Record a motion event, as JSON."""
        self._events.put((time.time_ns(), json.dumps(content)))

    def close(self) -> None:
        """Finish the bag, so that it is readable."""
        self._end.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        try:
            with (
                Client(self._url, timeout_s=POLL_TIMEOUT_S) as client,
                Writer(self._path, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP) as writer,
            ):
                self._record(client, writer)
        except (WriterError, OSError, CobotError) as exc:
            error = InputError(f"bag {self._path}: cannot be written: {exc}")
            if self._opened.done():
                self.problem = str(error)
            else:
                self._opened.set_exception(error)

    def _record(self, client: Client, writer: Writer) -> None:
        connections = {
            topic: writer.add_connection(topic, TOPICS[topic], typestore=self._types) for topic in self.topics
        }

        def write(topic: str, time_ns: int, message: Any) -> None:
            if topic in connections:
                data = self._types.serialize_cdr(message, TOPICS[topic])
                writer.write(connections[topic], time_ns, data)

        def record_state() -> None:
            try:
                state = client.joint_states()
            except CobotError as exc:
                self.problem = str(exc)
                return
            self.problem = ""
            now_ns = time.time_ns()
            write(JOINT_STATES, now_ns, self._joint_state(state, now_ns))

        if JOINT_STATES in connections:
            record_state()  # the state before the first motion, because `start` returns after this
        self._opened.set_result(None)
        due_s = time.monotonic()
        ended = False
        while not ended:
            due_s = max(due_s + PERIOD_S, time.monotonic())
            ended = self._end.wait(due_s - time.monotonic())
            while not self._events.empty():
                time_ns, text = self._events.get()
                write(MOTION_EVENTS, time_ns, self._types.types[TOPICS[MOTION_EVENTS]](data=text))
            if JOINT_STATES in connections and not ended:
                record_state()

    def _joint_state(self, state: dict[str, Any], time_ns: int) -> Any:
        types = self._types.types
        stamp = types["builtin_interfaces/msg/Time"](
            sec=time_ns // 1_000_000_000, nanosec=time_ns % 1_000_000_000
        )
        return types[TOPICS[JOINT_STATES]](
            header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
            name=state["name"],
            position=np.array(state["position"], dtype=np.float64),
            velocity=np.array(state["velocity"], dtype=np.float64),
            effort=np.array(state["effort"], dtype=np.float64),
        )
