"""The state block of a robot, field by field. rtloop publishes it in each cycle.

A field is declared only in `STATE_FIELDS`. The following are derived from this table: the record in shared
memory; the struct and the rows of the compiled modules and the attributes of `rtloop.backends.Measured`,
which `python -m cobot.ipc.generate` writes; the JSON of `GET /robot/state` with its schema, and of the
WebSocket; the record of a cycle in recordings; and the messages in recordings and in Foxglove.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from cobot.ipc.layout import TEXT, GripperObject, Intervention, MotionResult
from cobot.types import LoopMode

LAYOUT_VERSION = 24
"""Version of all records in shared memory. Any change of a record increases it."""
PER_JOINT = -1
CYCLE, GRIPPER = "/cycle", "/gripper"
"""Topics in recordings and in Foxglove whose messages are derived from this table."""
_STRUCT_CODES = {"u8": "Q", "i8": "q", "f8": "d"}
"""The kinds of numbers, and the code of each kind in `struct`."""


@dataclass(frozen=True, slots=True)
class StateField:
    """A field of the state block.

    Attributes:
        name: name of the field in shared memory, in JSON and in recordings.
        kind: numpy's type in shared memory: "u8", "i8", "f8", or `TEXT`.
        unit: unit; "" for counts, flags and text. For a field with a value per joint, the units for a rotary
            joint and for a linear joint.
        meaning: a phrase for the documents and the JSON schema, with the frame of a vector.
        length: number of values; 0 for a single number or text; or `PER_JOINT`.
        member: enumeration. JSON contains the name of the member instead of the number.
        keys: enumeration. The field contains a number for each of its members, and JSON contains an object
            with the members as keys.
        measured: whether backends measure it in each cycle, as an attribute of `rtloop.backends.Measured`.
        recorded: type of the field in the record of a recording; "" if it is not recorded.
        message: position and ROS type in the message of `topic`, which recordings and Foxglove show. A
            position is never given to another field, because readers depend on it. A new field gets the next
            position.
        topic: the topic whose message contains the field: cobot_msgs/msg/Cycle or cobot_msgs/msg/Gripper.
    """

    name: str
    kind: str
    unit: str
    meaning: str
    length: int = 0
    member: type[IntEnum] | None = None
    keys: type[IntEnum] | None = None
    measured: bool = False
    recorded: str = ""
    message: tuple[int, str] | None = None
    topic: str = CYCLE

    @property
    def is_scalar(self) -> bool:
        """Whether the field is a single number. The cycle writes all such fields at once."""
        return self.length == 0 and not self.is_text

    @property
    def is_text(self) -> bool:
        """Whether the field is a UTF-8 text."""
        return self.kind not in _STRUCT_CODES

    def shape(self, dof: int) -> tuple[int, ...]:
        """Shape of the field's array; () for a single number or text."""
        return (dof if self.length == PER_JOINT else self.length,) if self.length else ()


def _members(kind: type[IntEnum]) -> str:
    return ", ".join(f"{member.value} {member.name.lower()}" for member in kind)


GRIPPER_FIELDS = (
    StateField(
        "gripper_width",
        "f8",
        "m",
        "Width between the fingers",
        recorded="f4",
        message=(1, "float64"),
        topic=GRIPPER,
    ),
    StateField(
        "gripper_commanded_width",
        "f8",
        "m",
        "Width that the fingers were commanded to",
        recorded="f4",
        message=(2, "float64"),
        topic=GRIPPER,
    ),
    StateField(
        "gripper_force",
        "f8",
        "N",
        "Force at the fingers",
        recorded="f4",
        message=(3, "float64"),
        topic=GRIPPER,
    ),
    StateField(
        "gripper_moving",
        "u8",
        "",
        "1 while a command to the gripper is running",
        recorded="u1",
        message=(4, "bool"),
        topic=GRIPPER,
    ),
    StateField(
        "gripper_object",
        "u8",
        "",
        "Object in the gripper; `ABSENT` without a gripper",
        member=GripperObject,
        recorded="u1",
        message=(5, "uint8"),
        topic=GRIPPER,
    ),
    StateField(
        "gripper_monotonic_ns",
        "i8",
        "ns",
        "CLOCK_MONOTONIC when the gripper was last read, 0 without a gripper",
    ),
)
"""Fields of the gripper, which the service writes and rtloop publishes. A value that the gripper does not
know is NaN, which becomes null in JSON.
"""

STATE_FIELDS = (
    StateField("cycle", "u8", "", "Cycle number since rtloop started"),
    StateField("robot_time_s", "f8", "s", "Clock of the robot: number of cycles times the period"),
    StateField(
        "time_factor", "f8", "", "Robot time per wall time while a planned motion runs; 1 for a real robot"
    ),
    StateField("mode", "u8", "", "Mode of rtloop", member=LoopMode, recorded="u1", message=(3, "uint8")),
    StateField(
        "settled",
        "u8",
        "",
        "1 when the arm is at rest at the commanded position",
        recorded="u1",
        message=(5, "bool"),
    ),
    StateField(
        "motion_id",
        "u8",
        "",
        "Number of the running motion, or of the last one",
        recorded="u8",
        message=(7, "uint64"),
    ),
    StateField(
        "motion_result",
        "u8",
        "",
        f"Result of that motion: {_members(MotionResult)}",
        recorded="u1",
        message=(4, "uint8"),
    ),
    StateField("slot", "u8", "", "Slot in shared memory that holds that motion"),
    StateField("path_time_s", "f8", "s", "Path time of the motion", recorded="f8", message=(9, "float64")),
    StateField("path_duration_s", "f8", "s", "Path time at the end of the motion"),
    StateField(
        "path_rate",
        "f8",
        "",
        "Path time per clock time: 0 at rest, 1 at full speed",
        recorded="f8",
        message=(10, "float64"),
    ),
    StateField(
        "deceleration_monotonic_ns", "i8", "ns", "CLOCK_MONOTONIC when the last stop began to take effect"
    ),
    StateField("stops_seen", "u8", "", "Number of stop requests that rtloop has acted on"),
    StateField("estops_seen", "u8", "", "Number of e-stop requests that rtloop has acted on"),
    StateField("command_seen", "u8", "", "Number of the last command that rtloop has taken"),
    StateField(
        "session",
        "u8",
        "",
        "Number of the streaming session that moves the arm, 0 for none",
        recorded="u8",
        message=(8, "uint64"),
    ),
    StateField("setpoint_seen", "u8", "", "Number of the session's last target that rtloop has taken"),
    StateField("move_seen", "u8", "", "Number of the session's last `move` that rtloop has taken"),
    StateField("move_running", "u8", "", "1 while that `move` is running"),
    StateField("chunk_seen", "u8", "", "Number of the session's last chunk that rtloop has taken"),
    StateField("point_seen", "u8", "", "Number of the last servo point that rtloop has read"),
    StateField("points_taken", "u8", "", "Number of the session's servo points that became targets"),
    StateField(
        "points_dropped",
        "u8",
        "",
        "Number of servo points that were dropped because they jump or are unreadable",
    ),
    StateField(
        "points_buffered", "u8", "", "Number of the session's servo points that wait to become targets"
    ),
    StateField("underruns", "u8", "", "Number of times that the session had to wait for a servo point"),
    StateField("overruns", "u8", "", "Number of missed cycles", recorded="u4", message=(11, "uint32")),
    StateField("torn_reads", "u8", "", "Number of inconsistent copies that rtloop found and read again"),
    StateField("monotonic_ns", "i8", "ns", "CLOCK_MONOTONIC when the state was published", recorded="i8"),
    StateField(
        "measured_monotonic_ns",
        "i8",
        "ns",
        "CLOCK_MONOTONIC when the robot was last read without an error",
        recorded="i8",
    ),
    *GRIPPER_FIELDS,
    StateField(
        "position", "f8", "rad or m", "Measured joint positions", PER_JOINT, measured=True, recorded="f8"
    ),
    StateField(
        "velocity", "f8", "rad/s or m/s", "Measured joint velocities", PER_JOINT, measured=True, recorded="f4"
    ),
    StateField("effort", "f8", "N·m or N", "Measured joint efforts", PER_JOINT, measured=True, recorded="f4"),
    StateField(
        "desired_effort",
        "f8",
        "N·m or N",
        "Joint efforts requested from the drives",
        PER_JOINT,
        measured=True,
        recorded="f4",
    ),
    StateField(
        "external_effort",
        "f8",
        "N·m or N",
        "Estimated joint efforts that the surroundings exert",
        PER_JOINT,
        measured=True,
        recorded="f4",
        message=(15, "float64[]"),
    ),
    StateField(
        "wrench",
        "f8",
        "N, N·m",
        "Estimated force and torque on the TCP, in the base frame",
        6,
        measured=True,
        recorded="f4",
    ),
    StateField(
        "sensor",
        "f8",
        "N, N·m",
        "Force and torque of the sensor, raw, in the TCP's frame",
        6,
        measured=True,
        recorded="f4",
        message=(16, "geometry_msgs/Wrench"),
    ),
    StateField("commanded_position", "f8", "rad or m", "Commanded joint positions", PER_JOINT, recorded="f8"),
    StateField(
        "commanded_velocity", "f8", "rad/s or m/s", "Commanded joint velocities", PER_JOINT, recorded="f4"
    ),
    StateField("commanded_acceleration", "f8", "rad/s² or m/s²", "Commanded joint accelerations", PER_JOINT),
    StateField(
        "tcp",
        "f8",
        "m",
        "Measured pose of the TCP in the base frame: x, y, z, then w, x, y, z",
        7,
        recorded="f4",
        message=(14, "geometry_msgs/Pose"),
    ),
    StateField("tcp_velocity", "f8", "m/s, rad/s", "Measured velocity of the TCP in the base frame", 6),
    StateField(
        "effort_rate", "f8", "N·m/s or N/s", "Rate of change of `effort`, smoothed over 10 ms", PER_JOINT
    ),
    StateField(
        "interventions",
        "u8",
        "",
        "Number of interventions of the safety layer, by kind",
        len(Intervention),
        keys=Intervention,
    ),
    StateField(
        "intervened_ns",
        "i8",
        "ns",
        "CLOCK_MONOTONIC of the last intervention of each kind",
        len(Intervention),
        keys=Intervention,
    ),
    StateField("reason", TEXT, "", "Reason of the mode ESTOP or FAULT, or of the end of the last motion"),
    StateField("reason_code", "S32", "", "Code of that reason, for programs; empty for a reason without one"),
    StateField("reason_of", TEXT, "", "Names of the joint, links or other things concerned, between commas"),
    StateField("reason_values", "f8", "", "Value and limit of that reason; NaN for none", 2),
    StateField("reason_unit", "S16", "", "Unit of these values"),
)
"""The fields in the order of the record. Arrays that the cycle copies at once are listed together: first the
measured ones, then the commanded ones. The measured fields with a value per joint come first.
`external_effort` is the last of these, because its values and those of `wrench` are also used as one array.
"""

SCALARS = tuple(field for field in STATE_FIELDS if field.is_scalar)
"""Fields at the beginning of the record, which have no gaps between them. Compiled modules use them as
`StateScalars`.
"""
STATE_SCALARS = tuple((field.name, field.kind) for field in SCALARS)
STATE_STRUCT = struct.Struct("=" + "".join(_STRUCT_CODES[field.kind] for field in SCALARS))
_ARRAYS = tuple(field for field in STATE_FIELDS if not field.is_scalar)
MEASURED = tuple(field for field in STATE_FIELDS if field.measured)
MEASURED_NAMES = tuple(field.name for field in MEASURED if field.name != "sensor")
"""Quantities that a device can declare to measure (`cobot.robot.device.Capabilities`). The force-torque
sensor at the flange is not declared. Without a sensor its readings are zeros.
"""
GRIPPER_RECORD = np.dtype([(field.name, field.kind) for field in GRIPPER_FIELDS])
"""The gripper's block, which rtloop copies into its state without changes."""
RECORDED = tuple(field for field in STATE_FIELDS if field.recorded)
"""Fields of each cycle in a recording."""


def state_dtype(dof: int) -> np.dtype:
    """The record of the state block."""
    return np.dtype([*STATE_SCALARS, *((field.name, field.kind, field.shape(dof)) for field in _ARRAYS)])
