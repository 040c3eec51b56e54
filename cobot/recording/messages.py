"""Records of cycles as ROS 2 messages in CDR, a thousand at a time.

Messages of one topic differ in numbers alone: their bytes are a template with holes. Where the holes are is
found by serialising messages in which one field differs, so `rosbags` alone knows CDR.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cobot.ipc.layout import Intervention, MotionResult
from cobot.ipc.records import TIMED
from cobot.recording.events import Event
from cobot.types import LoopMode

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
CYCLE = "cobot_msgs/msg/Cycle"
EVENT = "cobot_msgs/msg/Event"
TOPICS = {
    "/joint_states": JOINT_STATE,
    "/commanded": JOINT_STATE,
    "/wrench": WRENCH,
    "/cycle": CYCLE,
    "/events": EVENT,
}
SECOND_NS = 1_000_000_000


def _constants(prefix: str, names: Sequence[tuple[str, int]], kind: str) -> str:
    return "".join(f"{kind} {prefix}{name}={value}\n" for name, value in names)


_PHASES = "".join(f"uint32 {phase.name.lower()}_ns\n" for phase in TIMED)
DEFINITIONS = {
    CYCLE: (
        _constants("MODE_", [(mode.name, mode) for mode in LoopMode], "uint8")
        + _constants("RESULT_", [(result.name, result) for result in MotionResult], "uint8")
        + _constants("INTERVENTION_", [(kind.name, 1 << kind) for kind in Intervention], "uint32")
        + "std_msgs/Header header\nuint64 cycle\nfloat64 robot_time_s\nuint8 mode\nuint8 motion_result\n"
        "bool settled\nbool measured\nuint64 motion_id\nuint64 session\nfloat64 path_time_s\n"
        f"float64 path_rate\nuint32 overruns\nuint32 interventions\n{_PHASES}"
        "geometry_msgs/Pose tcp\nfloat64[] external_effort\ngeometry_msgs/Wrench sensor\n"
    ),
    EVENT: "std_msgs/Header header\nuint64 cycle\nstring kind\nstring mode\nstring text\n",
}


class Template:
    """Messages of one type that differ in numbers alone.

    Args:
        serialized: the CDR of a message with these values, by field; what is not given is zero.
        fields: the format of each, little-endian.
    """

    def __init__(self, serialized: Callable[[Mapping[str, Any]], bytes], fields: Mapping[str, str]) -> None:
        self._zero = np.frombuffer(serialized({}), np.uint8)
        offsets = []
        for name, kind in fields.items():
            dtype = np.dtype(kind)
            # No byte of a number that consists of 0x01 is that of a zero.
            ones = np.frombuffer(b"\1" * dtype.itemsize, np.dtype((dtype.base, dtype.shape)))[0]
            differ = np.flatnonzero(np.frombuffer(serialized({name: ones}), np.uint8) != self._zero)
            if len(differ) != dtype.itemsize or differ[-1] - differ[0] + 1 != dtype.itemsize:
                raise ValueError(f"{name} takes {len(differ)} bytes in CDR, not {dtype.itemsize} in a row")
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
        """So many messages, to be filled in by field."""
        return np.tile(self._zero, count).view(self.dtype)


class RecordMessages:
    """What the records of one robot become.

    Args:
        joint_names: of the robot.
        base_frame: of poses and forces.
        period_s: of a cycle.
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
        self._cycle = Template(
            self._cycle_message,
            {
                **stamp,
                **dict.fromkeys(("cycle", "motion_id", "session"), "<u8"),
                **dict.fromkeys(("robot_time_s", "path_time_s", "path_rate"), "<f8"),
                **dict.fromkeys(("mode", "motion_result", "settled", "measured"), "u1"),
                "overruns": "<u4",
                "interventions": "<u4",
                "phases_ns": f"({len(TIMED)},)<u4",
                "tcp": "(7,)<f8",
                "external_effort": many,
                "sensor": "(6,)<f8",
            },
        )

    def definition(self, type_: str) -> str:
        """The text of a type and of all that it is made of, as `ros2msg` has it."""
        return str(self._store.generate_msgdef(type_, ros_version=2)[0])

    def of(self, records: np.ndarray, ahead_ns: int) -> dict[str, tuple[bytes, int]]:
        """The messages of records, by topic: all in a row, and the size of one.

        Args:
            records: of `cobot.ipc.records.record_dtype`.
            ahead_ns: by how much the clock of the wall is ahead of CLOCK_MONOTONIC.
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
        for name in ("motion_id", "session", "path_time_s", "path_rate", "mode", "motion_result", "settled"):
            cycle[name] = records[name]
        for name in ("overruns", "interventions", "phases_ns", "external_effort", "sensor"):
            cycle[name] = records[name]
        cycle["cycle"], cycle["measured"] = records["number"], records["fresh"]
        cycle["robot_time_s"] = records["number"] * self._period_s
        cycle["tcp"] = records["tcp"][:, [0, 1, 2, 4, 5, 6, 3]]  # of ROS: x, y, z, w
        made_of = {"/joint_states": measured, "/commanded": commanded, "/wrench": wrench, "/cycle": cycle}
        return {topic: (rows.tobytes(), rows.dtype.itemsize) for topic, rows in made_of.items()}

    def event(self, event: Event, ahead_ns: int) -> bytes:
        """The message of an event."""
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
        """The number of the cycle that a message of /cycle is of."""
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

    def _cycle_message(self, values: Mapping[str, Any]) -> bytes:
        x, y, z, *turn = map(float, values.get("tcp", np.zeros(7)))
        tcp = self._made(
            "geometry_msgs/msg/Pose",
            position=self._made("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self._made("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True))),
        )
        phases = values.get("phases_ns", np.zeros(len(TIMED), np.uint32))
        numbers = ("cycle", "mode", "motion_result", "motion_id", "session", "overruns", "interventions")
        return self._serialized(
            CYCLE,
            header=self._header(values),
            **{name: int(values.get(name, 0)) for name in numbers},
            **{name: bool(values.get(name, 0)) for name in ("settled", "measured")},
            **{name: float(values.get(name, 0.0)) for name in ("robot_time_s", "path_time_s", "path_rate")},
            **{f"{phase.name.lower()}_ns": int(ns) for phase, ns in zip(TIMED, phases, strict=True)},
            tcp=tcp,
            external_effort=values.get("external_effort", np.zeros(len(self._names))),
            sensor=self._wrench_of(values.get("sensor", np.zeros(6))),
        )
