"""Converts records of cycles to ROS 2 messages in CDR, a thousand at a time.

Messages of one topic differ only in numbers, so their bytes are a template with gaps. The positions of the
gaps are found by serialising messages that differ in one field. So only `rosbags` needs to know CDR.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import itemgetter
from typing import Any, cast

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cobot.ipc.layout import GripperObject, Intervention, MotionResult
from cobot.ipc.records import TIMED
from cobot.ipc.state_fields import CYCLE as CYCLE_TOPIC
from cobot.ipc.state_fields import GRIPPER as GRIPPER_TOPIC
from cobot.ipc.state_fields import STATE_FIELDS
from cobot.recording.events import RunEvent
from cobot.types import LoopMode

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
CYCLE = "cobot_msgs/msg/Cycle"
GRIPPER = "cobot_msgs/msg/Gripper"
EVENT = "cobot_msgs/msg/Event"
TOPICS = {
    "/joint_states": JOINT_STATE,
    "/commanded": JOINT_STATE,
    "/wrench": WRENCH,
    CYCLE_TOPIC: CYCLE,
    "/events": EVENT,
    GRIPPER_TOPIC: GRIPPER,
}
"""The message types by topic. The gripper topic is used only for a robot with a gripper."""
SECOND_NS = 1_000_000_000
ROS_POSE = [0, 1, 2, 4, 5, 6, 3]
"""For a ROS pose (x, y, z, then x, y, z, w), the index of each number in a pose of cobot (x, y, z, then w, x,
y, z).
"""


def _constants(prefix: str, names: Sequence[tuple[str, int]], kind: str) -> str:
    return "".join(f"{kind} {prefix}{name}={value}\n" for name, value in names)


_PHASES = tuple(f"{phase.name.lower()}_ns" for phase in TIMED)
_OWN = (
    (1, "uint64", "cycle"),
    (2, "float64", "robot_time_s"),
    (6, "bool", "measured"),
    (12, "uint32", "interventions"),
    *((13, "uint32", name) for name in _PHASES),
)
"""Fields of a /cycle message that are not copied from the record: position, type and name."""
_COPIED = tuple(
    (*field.message, field.name) for field in STATE_FIELDS if field.message and field.topic == CYCLE_TOPIC
)
_CYCLE_FIELDS = tuple((name, type_) for _, type_, name in sorted((*_OWN, *_COPIED), key=itemgetter(0)))
"""Name and type of each field after the header in a /cycle message, in order."""
GRIPPER_VALUES = tuple(
    (field.name, field.message[1]) for field in STATE_FIELDS if field.message and field.topic == GRIPPER_TOPIC
)
"""Name and type of each field after the header in a /gripper message, in order."""
_FORMATS = {
    "bool": "u1",
    "uint8": "u1",
    "uint32": "<u4",
    "uint64": "<u8",
    "int64": "<i8",
    "float64": "<f8",
    "geometry_msgs/Pose": "(7,)<f8",
    "geometry_msgs/Wrench": "(6,)<f8",
}
DEFINITIONS = {
    CYCLE: (
        _constants("MODE_", [(mode.name, mode) for mode in LoopMode], "uint8")
        + _constants("RESULT_", [(result.name, result) for result in MotionResult], "uint8")
        + _constants("INTERVENTION_", [(kind.name, 1 << kind) for kind in Intervention], "uint32")
        + "std_msgs/Header header\n"
        + "".join(f"{type_} {name}\n" for name, type_ in _CYCLE_FIELDS)
    ),
    GRIPPER: (
        _constants("OBJECT_", [(kind.name, kind) for kind in GripperObject], "uint8")
        + "std_msgs/Header header\n"
        + "".join(f"{type_} {name}\n" for name, type_ in GRIPPER_VALUES)
    ),
    EVENT: "std_msgs/Header header\nuint64 cycle\nstring kind\nstring mode\nstring text\n",
}


class Template:
    """Messages of one type that differ only in numbers.

    Args:
        serialized: function that returns the CDR of a message with given values by field. All other fields
            are zero.
        fields: the format of each field, little-endian.
    """

    def __init__(self, serialized: Callable[[Mapping[str, Any]], bytes], fields: Mapping[str, str]) -> None:
        self._zero = np.frombuffer(serialized({}), np.uint8)
        offsets = []
        for name, kind in fields.items():
            dtype = np.dtype(kind)
            # In a number whose bytes are all 0x01, no byte equals the corresponding byte of a zero.
            ones = np.frombuffer(b"\1" * dtype.itemsize, np.dtype((dtype.base, dtype.shape)))[0]
            differ = np.flatnonzero(np.frombuffer(serialized({name: ones}), np.uint8) != self._zero)
            if len(differ) != dtype.itemsize or differ[-1] - differ[0] + 1 != dtype.itemsize:
                raise ValueError(
                    f"{name} takes {len(differ)} bytes in CDR; it must take {dtype.itemsize} "
                    "consecutive bytes"
                )
            offsets.append(int(differ[0]))
        self.dtype = np.dtype(
            {
                "names": list(fields),
                "formats": list(fields.values()),
                "offsets": offsets,
                "itemsize": len(self._zero),
            }
        )

    def messages(self, count: int) -> np.ndarray:
        """`count` messages whose fields must be filled in."""
        return np.tile(self._zero, count).view(self.dtype)


class RecordMessages:
    """Converts the records of one robot to messages.

    Args:
        joint_names: the robot's joint names.
        base_frame: name of the frame of poses and forces.
        period_s: cycle period.
    """

    def __init__(self, joint_names: Sequence[str], base_frame: str, period_s: float) -> None:
        self._names, self._frame, self._period_s = list(joint_names), base_frame, period_s
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        for name, definition in DEFINITIONS.items():
            self._store.register(get_types_from_msg(definition, name))
        many = f"({len(self._names)},)<f8"
        stamp = {"sec": "<i4", "nanosec": "<u4"}
        self._joints = Template(
            self._joint_state, {**stamp, "position": many, "velocity": many, "effort": many}
        )
        self._wrench = Template(self._wrench_stamped, {**stamp, "wrench": "(6,)<f8"})
        formats = {**_FORMATS, "float64[]": many}
        self._cycle, self._gripper = (
            Template(
                partial(self._table_message, type_, fields),
                {**stamp, **{name: formats[kind] for name, kind in fields}},
            )
            for type_, fields in ((CYCLE, _CYCLE_FIELDS), (GRIPPER, GRIPPER_VALUES))
        )

    def definition(self, type_: str) -> str:
        """The definition of a type in the format `ros2msg`, followed by the definitions of the types that it
        contains.
        """
        return str(self._store.generate_msgdef(type_, ros_version=2)[0])

    def of(self, records: np.ndarray, ahead_ns: int) -> dict[str, tuple[bytes, int]]:
        """The messages for these records, by topic: the bytes of all messages, and the size of one message.

        The gripper topic is only included if a record has a gripper.

        Args:
            records: array of `cobot.ipc.records.record_dtype`.
            ahead_ns: offset of the system clock from CLOCK_MONOTONIC, in ns.
        """
        count = len(records)
        measured = self._joints.messages(count)
        commanded = self._joints.messages(count)
        wrench = self._wrench.messages(count)
        cycle = self._cycle.messages(count)
        for made, moment in (
            (measured, "measured_monotonic_ns"),
            (commanded, "monotonic_ns"),
            (wrench, "measured_monotonic_ns"),
            (cycle, "monotonic_ns"),
        ):
            made["sec"], made["nanosec"] = np.divmod(records[moment] + ahead_ns, SECOND_NS)
        for name in ("position", "velocity", "effort"):
            measured[name] = records[name]
        commanded["position"] = records["commanded_position"]
        commanded["velocity"] = records["commanded_velocity"]
        commanded["effort"] = records["desired_effort"]
        wrench["wrench"] = records["wrench"]
        for _, type_, name in _COPIED:
            values = records[name]
            cycle[name] = values[:, ROS_POSE] if type_ == "geometry_msgs/Pose" else values
        for name, nanoseconds in zip(_PHASES, records["phases_ns"].T, strict=True):
            cycle[name] = nanoseconds
        cycle["cycle"], cycle["measured"] = records["number"], records["fresh"]
        cycle["interventions"] = records["interventions"]
        cycle["robot_time_s"] = records["number"] * self._period_s
        made_of = {"/joint_states": measured, "/commanded": commanded, "/wrench": wrench}
        if (records["gripper_object"] != GripperObject.ABSENT).any():
            gripper = made_of[GRIPPER_TOPIC] = self._gripper.messages(count)
            gripper["sec"], gripper["nanosec"] = cycle["sec"], cycle["nanosec"]
            for name, _ in GRIPPER_VALUES:
                gripper[name] = records[name]
        made_of[CYCLE_TOPIC] = cycle  # the last one: a reader that finds it finds all messages of its cycle
        return {topic: (rows.tobytes(), rows.dtype.itemsize) for topic, rows in made_of.items()}

    def event(self, event: RunEvent, ahead_ns: int) -> bytes:
        """Convert an event to a message."""
        sec, nanosec = divmod(event.monotonic_ns + ahead_ns, SECOND_NS)
        return self._serialized(
            EVENT,
            header=self._header({"sec": sec, "nanosec": nanosec}),
            cycle=event.cycle,
            kind=event.kind,
            mode=event.mode,
            text=event.text,
        )

    def cycle_of(self, content: bytes) -> int:
        """The number of the cycle in a /cycle message."""
        return int(np.frombuffer(content, self._cycle.dtype)["cycle"][0])

    def _serialized(self, type_: str, **fields: Any) -> bytes:
        return bytes(self._store.serialize_cdr(self._made(type_, **fields), type_, little_endian=True))

    def _made(self, type_: str, **fields: Any) -> Any:
        return cast(Any, self._store.types[type_])(**fields)

    def _header(self, values: Mapping[str, Any]) -> Any:
        stamp = self._made(
            "builtin_interfaces/msg/Time",
            sec=int(values.get("sec", 0)),
            nanosec=int(values.get("nanosec", 0)),
        )
        return self._made("std_msgs/msg/Header", stamp=stamp, frame_id=self._frame)

    def _joint_state(self, values: Mapping[str, Any]) -> bytes:
        zeros = np.zeros(len(self._names))
        arrays = {name: values.get(name, zeros) for name in ("position", "velocity", "effort")}
        return self._serialized(JOINT_STATE, header=self._header(values), name=self._names, **arrays)

    def _wrench_stamped(self, values: Mapping[str, Any]) -> bytes:
        wrench = self._wrench_of(values.get("wrench", np.zeros(6)))
        return self._serialized(WRENCH, header=self._header(values), wrench=wrench)

    def _wrench_of(self, values: Sequence[float]) -> Any:
        vector = "geometry_msgs/msg/Vector3"
        force, torque = (
            self._made(vector, **dict(zip("xyz", map(float, part), strict=True)))
            for part in (values[:3], values[3:])
        )
        return self._made("geometry_msgs/msg/Wrench", force=force, torque=torque)

    def _pose_of(self, values: Sequence[float]) -> Any:
        """Create a pose message from seven numbers in ROS order."""
        x, y, z, *turn = map(float, values)
        return self._made(
            "geometry_msgs/msg/Pose",
            position=self._made("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self._made("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True))),
        )

    def _table_message(
        self, message: str, kinds: Sequence[tuple[str, str]], values: Mapping[str, Any]
    ) -> bytes:
        """Create a message whose fields after the header come from a table."""
        makers: dict[str, tuple[Callable[[Any], Any], Any]] = {
            "bool": (bool, 0),
            "float64": (float, 0.0),
            "float64[]": (np.asarray, np.zeros(len(self._names))),
            "geometry_msgs/Pose": (self._pose_of, np.zeros(7)),
            "geometry_msgs/Wrench": (self._wrench_of, np.zeros(6)),
        }
        fields = {}
        for name, type_ in kinds:
            make, zero = makers.get(type_, (int, 0))
            fields[name] = make(values.get(name, zero))
        return self._serialized(message, header=self._header(values), **fields)
