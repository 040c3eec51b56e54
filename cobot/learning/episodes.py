"""Episodes as MCAP files, with the arm's states, its commands, camera pictures and the task.

The messages are ROS 2 messages (JointState, CompressedImage), which Foxglove and rosbags can read. A file is
named NAME.mcap.part until its episode has ended.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self, cast

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cobot.client.states import GripperReading
from cobot.errors import InputError
from cobot.folders import open_new
from cobot.ipc.layout import GripperObject
from cobot.ipc.state_fields import GRIPPER as GRIPPER_TOPIC
from cobot.learning.png import pixels_of_png
from cobot.recording.bounds import bounded_reader, require_room
from cobot.recording.messages import DEFINITIONS, GRIPPER, GRIPPER_VALUES
from cobot.recording.reader import UNREADABLE
from cobot.recording.store import UNFINISHED
from cobot.robot.geometry.rays import png
from cobot.types import Array, vector

JOINT_STATE, IMAGE = "sensor_msgs/msg/JointState", "sensor_msgs/msg/CompressedImage"
STATE_TOPIC, ACTION_TOPIC, CAMERA_TOPIC = "/joint_states", "/action", "/camera/"
SECOND_NS = 1_000_000_000


class EpisodeWriter:
    """Writes one episode. Used as a context manager, it keeps the file only if no exception occurs.

    Raises (constructor, `add` and `finish`):
        OSError: the file cannot be created, or the disk is full.
    """

    def __init__(
        self, path: Path, joint_names: Sequence[str], rate_hz: float, *, task: str = "", robot: str = ""
    ) -> None:
        if path.suffix != ".mcap":
            raise InputError(f"{path}: the file of an episode must end with .mcap")
        if not 0.0 < rate_hz <= 1000.0:
            raise InputError(f"rate_hz must be above 0 and at most 1000, got {rate_hz}")
        self._names, self._path = list(joint_names), path
        self._about = {
            "robot": robot,
            "joint_names": json.dumps(self._names),
            "rate_hz": repr(float(rate_hz)),
            "task": task,
        }
        self._store = _types()
        self._part = path.with_name(path.name + UNFINISHED)
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._file = open_new(self._part)
        try:
            self._writer = Writer(self._file, compression=CompressionType.ZSTD)
            self._writer.start("ros2", f"cobot {version('cobot')}")
            self._schemas = {
                name: self._writer.register_schema(
                    name, "ros2msg", str(self._store.generate_msgdef(name, ros_version=2)[0]).encode()
                )
                for name in (JOINT_STATE, IMAGE, GRIPPER)
            }
        except OSError:
            self.abandon()
            raise
        self._channels: dict[str, int] = {}
        self.frames = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._file.closed:
            return
        if kind is None:
            self.finish()
        else:
            self.abandon()

    def add(
        self,
        time_s: float,
        position: Sequence[float] | Array,
        velocity: Sequence[float] | Array,
        action: Sequence[float] | Array,
        pictures: Mapping[str, np.ndarray] | None = None,
        gripper: GripperReading | None = None,
    ) -> None:
        """Add one frame.

        Args:
            time_s: time since 1970, or since any origin that all frames of the file share.
            position, velocity: measured state of the joints, rad and rad/s.
            action: commanded joint positions, rad.
            pictures: pictures by camera name, uint8, shape (height, width, 3).
            gripper: gripper reading. It must be given in each frame or in none.
        """
        time_ns = round(time_s * 1e9)
        dof = len(self._names)
        measured = vector(position, dof, name="position"), vector(velocity, dof, name="velocity")
        self._joint_state(STATE_TOPIC, time_ns, *measured)
        self._joint_state(ACTION_TOPIC, time_ns, vector(action, dof, name="action"), np.zeros(0))
        for name, picture in (pictures or {}).items():
            if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
                raise InputError(
                    f"picture {name!r}: must be uint8 of shape (height, width, 3), "
                    f"got {picture.dtype} of {picture.shape}"
                )
            fields = {"format": "png", "data": np.frombuffer(png(picture), np.uint8)}
            self._message(CAMERA_TOPIC + name, IMAGE, time_ns, name, fields)
        if gripper is not None:
            seen = {name: getattr(gripper, name.removeprefix("gripper_")) for name, _ in GRIPPER_VALUES}
            self._message(GRIPPER_TOPIC, GRIPPER, time_ns, "", seen)
        self.frames += 1

    def finish(self, *, success: bool | None = None, **about: str) -> Path:
        """Complete the file and rename it.

        Args:
            success: whether the task succeeded; None if this is unknown.
            about: further metadata of the episode.
        """
        said = "" if success is None else str(success).lower()
        self._writer.add_metadata(
            "episode", self._about | {"success": said, "frames": str(self.frames)} | about
        )
        cast(Any, self._writer).finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        os.replace(self._part, self._path)
        return self._path

    def abandon(self) -> None:
        """Close and delete the unfinished file."""
        with contextlib.suppress(OSError):
            self._file.close()
        self._part.unlink(missing_ok=True)

    def _joint_state(self, topic: str, time_ns: int, position: Array, velocity: Array) -> None:
        fields = {"name": self._names, "position": position, "velocity": velocity, "effort": np.zeros(0)}
        self._message(topic, JOINT_STATE, time_ns, "", fields)

    def _message(self, topic: str, kind: str, time_ns: int, frame: str, fields: Mapping[str, Any]) -> None:
        types = cast(Any, self._store.types)
        sec, nanosec = divmod(time_ns, SECOND_NS)
        stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)
        content = self._store.serialize_cdr(types[kind](header=header, **fields), kind, little_endian=True)
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        self._writer.add_message(self._channels[topic], time_ns, bytes(content), time_ns, self.frames)


@dataclass(frozen=True, slots=True)
class Episode:
    """The content of an episode file, with n frames.

    Attributes:
        about: metadata: robot, task, success ("true", "false" or ""), and more.
        joint_names: joint names, `dof` of them.
        rate_hz: nominal rate of the frames.
        times_s: times of the frames, shape (n,).
        position, velocity, action: measured positions, rad; measured velocities, rad/s; and commanded
            positions, rad; shape (n, dof) each.
        pictures: the pictures of each camera, by its name: uint8, shape (n, height, width, 3).
        gripper: one reading for each frame; empty for a robot without a gripper.
    """

    about: dict[str, str]
    joint_names: list[str]
    rate_hz: float
    times_s: Array
    position: Array
    velocity: Array
    action: Array
    pictures: dict[str, np.ndarray]
    gripper: list[GripperReading]


def read_episode(path: Path) -> Episode:
    """Read a whole episode file.

    Raises:
        InputError: the file cannot be read or is not an episode. The error gives the reason.
    """
    try:
        content = path.read_bytes()
    except OSError as exc:
        raise InputError(f"{path}: {exc.strerror or exc}") from exc
    try:
        return _read(io.BytesIO(content))
    except UNREADABLE as exc:
        raise InputError(f"{path}: is not a complete episode of cobot: {exc}") from exc


def _types() -> Any:
    """The message types of ROS 2, and the type for the gripper."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(DEFINITIONS[GRIPPER], GRIPPER))
    return store


def _reading(message: Any) -> GripperReading:
    values = {name.removeprefix("gripper_"): getattr(message, name) for name, _ in GRIPPER_VALUES}
    return GripperReading(**{**values, "object": GripperObject(values["object"])})


def _read(file: io.BytesIO) -> Episode:
    store = _types()
    times_ns: list[int] = []
    rows: dict[str, list[Array]] = {"position": [], "velocity": [], "action": []}
    pictures: dict[str, list[np.ndarray]] = {}
    gripper: list[GripperReading] = []
    pixels = 0
    reader = bounded_reader(file)
    about = {each.name: each.metadata for each in reader.iter_metadata()}["episode"]
    for _, channel, message in reader.iter_messages(log_time_order=False):
        if channel.topic == STATE_TOPIC:
            state: Any = store.deserialize_cdr(message.data, JOINT_STATE)
            times_ns.append(message.log_time)
            rows["position"].append(state.position)
            rows["velocity"].append(state.velocity)
        elif channel.topic == ACTION_TOPIC:
            action: Any = store.deserialize_cdr(message.data, JOINT_STATE)
            rows["action"].append(action.position)
        elif channel.topic == GRIPPER_TOPIC:
            gripper.append(_reading(store.deserialize_cdr(message.data, GRIPPER)))
        elif channel.topic.startswith(CAMERA_TOPIC):
            image: Any = store.deserialize_cdr(message.data, IMAGE)
            name = channel.topic.removeprefix(CAMERA_TOPIC)
            picture = pixels_of_png(image.data.tobytes())
            pictures.setdefault(name, []).append(picture)
            pixels += picture.nbytes
            require_room("the pictures of the file", 2 * pixels)  # the pictures are copied into one array
    if not times_ns:
        raise ValueError("it contains no frames")
    lengths = {len(each) for each in (*rows.values(), *pictures.values())}
    if lengths != {len(times_ns)} or len(gripper) not in (0, len(times_ns)):
        raise ValueError("its topics have different lengths")
    return Episode(
        about=dict(about),
        joint_names=list(json.loads(about["joint_names"])),
        rate_hz=float(about["rate_hz"]),
        times_s=np.array(times_ns) * 1e-9,
        position=np.array(rows["position"]),
        velocity=np.array(rows["velocity"]),
        action=np.array(rows["action"]),
        pictures={name: np.array(each) for name, each in pictures.items()},
        gripper=gripper,
    )
