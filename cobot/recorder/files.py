"""A recording in progress: an MCAP file that gets its final name when it is complete."""

from __future__ import annotations

import contextlib
import json
import os
import struct
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Message
from mcap.writer import CompressionType, Writer
from zstandard import ZstdError

from cobot.folders import open_new
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.state_fields import CYCLE, GRIPPER
from cobot.recording.bounds import bounded_records
from cobot.recording.events import RunEvent
from cobot.recording.messages import TOPICS, RecordMessages
from cobot.recording.store import UNFINISHED

CHUNK_BYTES = 1 << 20
"""Uncompressed size of a chunk in bytes. A killed recorder loses at most this amount, because it passes whole
chunks to the operating system.
"""


class RecordingFile:
    """An MCAP file, written as NAME.mcap.part. `finish` renames it to NAME.mcap.

    Attributes:
        size: number of bytes in the file so far.
        cycles: number of cycles in the file so far.

    Raises (also its methods):
        OSError: the disk is full or cannot be written.
    """

    def __init__(
        self,
        path: Path,
        memory: RecordingMemory,
        messages: RecordMessages,
        ahead_ns: int,
        about: dict[str, str],
    ) -> None:
        """
        Args:
            path: path of the finished file.
            ahead_ns: offset of the wall clock from CLOCK_MONOTONIC, in ns.
            about: metadata of the file, in addition to the robot's metadata.
        """
        self.path = path
        self.cycles = 0
        self._messages, self._ahead_ns = messages, ahead_ns
        self._part = path.with_name(path.name + UNFINISHED)
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._file = open_new(self._part)
        try:
            self._writer = Writer(self._file, CHUNK_BYTES, CompressionType.ZSTD)
            self._writer.start("ros2", f"cobot {version('cobot')}")
            self._channels: dict[str, int] = {}
            self._schemas: dict[str, int] = {}
            self._write_header(memory, about)
        except OSError:
            self.abandon()
            raise

    def _write_header(self, memory: RecordingMemory, about: dict[str, str]) -> None:
        """Write the metadata, and the channels that every robot has."""
        robot = {
            "robot": memory.robot,
            "joint_names": json.dumps(memory.joint_names),
            "period_s": repr(memory.period_s),
            "monotonic_to_wall_ns": str(self._ahead_ns),
        }
        self._writer.add_metadata("cobot", robot | about)
        # Foxglove uses this record to assign a recording to a device and to recognise one that it has already
        # imported.
        device = {"deviceName": memory.robot, "key": f"{memory.robot}-{self.path.stem}"}
        self._writer.add_metadata("foxglove", device)
        for topic in TOPICS:
            if topic != GRIPPER:
                self._channel(topic)

    def _channel(self, topic: str) -> int:
        """The channel of a topic. It is written when it is needed for the first time."""
        if topic not in self._channels:
            writer, type_ = self._writer, TOPICS[topic]
            if type_ not in self._schemas:
                definition = self._messages.definition(type_).encode()
                self._schemas[type_] = writer.register_schema(type_, "ros2msg", definition)
            about = {"offered_qos_profiles": ""}
            self._channels[topic] = writer.register_channel(topic, "cdr", self._schemas[type_], about)
        return self._channels[topic]

    @property
    def size(self) -> int:
        return self._file.tell()

    def write(self, records: np.ndarray, events: Sequence[RunEvent]) -> None:
        """Add cycles and their events."""
        times = (records["monotonic_ns"] + self._ahead_ns).tolist()
        numbers = (records["number"] & 0xFFFFFFFF).tolist()
        add = self._writer.add_message
        topics = [
            (self._channel(topic), *content)
            for topic, content in self._messages.of(records, self._ahead_ns).items()
        ]
        for index, (time_ns, number) in enumerate(zip(times, numbers, strict=True)):
            for channel, content, size in topics:
                add(channel, time_ns, content[index * size : (index + 1) * size], time_ns, number)
        for event in events:
            time_ns = event.monotonic_ns + self._ahead_ns
            content = self._messages.event(event, self._ahead_ns)
            add(self._channels["/events"], time_ns, content, time_ns, event.cycle & 0xFFFFFFFF)
        self._file.flush()
        self.cycles += len(records)

    def take_over(self, part: Path) -> int:
        """Add the content of a file that a killed recorder has left.

        Returns:
            The number of the last cycle in that file; 0 if it contains none.
        """
        last, topics = 0, {}
        try:
            with part.open("rb") as file:
                for record in bounded_records(file):
                    if isinstance(record, Channel) and record.topic in TOPICS:
                        topics[record.id] = record.topic
                    elif isinstance(record, Message) and record.channel_id in topics:
                        topic = topics[record.channel_id]
                        moment_ns = record.log_time
                        self._writer.add_message(
                            self._channel(topic), moment_ns, record.data, moment_ns, record.sequence
                        )
                        if topic == CYCLE:
                            last, self.cycles = self._messages.cycle_of(record.data), self.cycles + 1
        except FileNotFoundError:
            return 0
        except (McapError, ValueError, struct.error, ZstdError):  # the recorder was killed here
            return last
        return last

    def sync(self) -> None:
        """Flush the data that have been written so far.

        A single flush at the end could take longer than the heartbeat permits.
        """
        os.fdatasync(self._file.fileno())

    def finish(self) -> None:
        """Complete the file and rename it. A file with its final name is complete, even after a power cut."""
        cast(Any, self._writer).finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        os.replace(self._part, self.path)

    def abandon(self) -> None:
        """Close and delete the unfinished file."""
        with contextlib.suppress(OSError):
            self._file.close()
        with contextlib.suppress(OSError):
            self._part.unlink(missing_ok=True)
