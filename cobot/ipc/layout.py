"""The records in a robot's shared memory, and the enumerations for their values.

`cobot.ipc.shm` maps the records. `cobot.ipc.state_fields` defines the record of the state block, and the
version of all records, which must be increased with each change.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from cobot.types import MAX_ACTIONS

MAGIC = b"COBOTRT\0"
RING = 32
SLOTS = 2
LOADED_SEGMENTS = 256
"""Number of segments of a motion that rtloop copies from its slot per cycle. Together with the checks, this
takes 40 µs.
"""
HISTOGRAM_BUCKETS = 1024
CHUNK_POINTS = 64
POINTS = 1024
"""Number of servo points that can wait for rtloop."""
TEXT = "S200"


class Command(IntEnum):
    START = 1  # run the motion in a slot
    SET_RATE = 2  # path time per clock time, 0 (pause) to 1
    RESET = 3  # leave ESTOP or FAULT
    TOOL = 4  # carry the tool in the tool block
    SCENE = 5  # read the scene file again, which streams use
    REPLACE = 6  # continue with the trajectory in a slot, which begins as the rest of the current one
    ACKNOWLEDGE = 7  # a user has seen the findings of the first contact: full speed
    OUTPUT = 8  # set the output in the output block
    RESET_CELL = 9  # put the simulated cell back to its state at the start
    RESTART = 10  # put the simulated arm, and its cell, back to the start
    PULL = 11  # pull the simulated arm as the pull block defines
    TIME_FACTOR = 12  # robot time per wall time while a planned motion of a simulated arm runs


class Ack(IntEnum):
    ACCEPTED = 1
    REJECTED = 2


class MotionResult(IntEnum):
    """The result of the motion `motion_id`."""

    NONE = 0  # no motion yet
    RUNNING = 1
    ARRIVED = 2  # settled at its goal
    STOPPED = 3  # stopped on its path, by request
    FAILED = 4  # ended by a fault or an e-stop; see `reason` in the state
    STOPPED_ASIDE = 5  # stopped by request, but not on its path, because there was no room to slow down on it
    MET = 6  # stopped because its condition `until` was met


class Phase(IntEnum):
    """The parts of a cycle whose durations are counted in the histograms of the statistics."""

    WAKEUP = 0  # delay with which the cycle began
    READ = 1
    UPDATE = 2
    WRITE = 3
    TOTAL = 4  # compute time: read, update, write and publishing


class Intervention(IntEnum):
    """The kinds of intervention that the safety layer counts."""

    NOT_FINITE = 0
    POSITION = 1
    VELOCITY = 2
    ACCELERATION = 3
    JERK = 4
    TRACKING = 5
    SERVICE_TIMEOUT = 6
    OVERRUN = 7
    JUMP = 8  # a streamed target was farther from the last one than an arm can move: rejected
    COMMAND_TIMEOUT = 9  # no streamed target arrived for too long: stopped
    COLLISION = 10  # a stream led into the arm itself or its surroundings: stopped
    PROXIMITY = 11  # a stream came near them: slowed down
    CONTACT = 12  # contact forces exceeded the session's limits: stopped
    LATE = 13  # timed targets that arrived after their time: dropped


class GripperObject(IntEnum):
    """The object between the fingers, as in `cobot.grippers.HeldObject`, and whether its presence is
    known.
    """

    ABSENT = 0  # there is no gripper, or it has not been read yet
    UNKNOWN = 1  # the gripper does not detect objects
    NONE = 2
    HELD_INSIDE = 3
    HELD_OUTSIDE = 4
    LOST = 5

    @property
    def is_held(self) -> bool:
        return self in (GripperObject.HELD_INSIDE, GripperObject.HELD_OUTSIDE)


class Stream(IntEnum):
    """The kind of target of a streaming session."""

    JOINT_IMPEDANCE = 1
    CARTESIAN = 2
    JOINT_TORQUE = 3
    GUIDED = 4  # no targets: the device lets a person guide the arm by hand


class Interpolation(IntEnum):
    """How rtloop interpolates between streamed targets."""

    NONE = 0  # to the target immediately, as fast as the limits permit
    LINEAR = 1  # at constant velocity, within one command period
    QUINTIC = 2  # with continuous velocity and acceleration, within one command period
    RUCKIG = 3  # re-planned in every cycle, jerk-limited


class ServoMode(IntEnum):
    """How rtloop follows the points of a servo session. The vendor's manual defines the numbers."""

    NONE = 0  # there is no servo session
    REPLANNED = 1  # to the newest point immediately, jerk-limited
    DIRECT = 2  # the newest point is the reference
    BUFFERED = 3  # one point after the other, each in its own time
    BUFFERED_1MS = 4  # one point per millisecond
    THROUGH = 5  # planned through all points
    REPLANNED_FORCE = 6  # as REPLANNED, with force control along the force axes
    THROUGH_FORCE = 7  # as THROUGH, with force control along the force axes


HEADER = np.dtype(
    [
        ("magic", "S8"),
        ("layout", "u4"),
        ("dof", "u4"),
        ("capacity", "u4"),
        ("ring", "u4"),
        ("period_s", "f8"),
        ("created_ns", "i8"),
        ("robot", "S64"),
        ("url", "S128"),
        ("checksum", "u8"),  # of all fields before it
    ]
)
STATISTICS = np.dtype(
    [
        ("pid", "u4"),
        ("sched_fifo", "u4"),
        ("memory_locked", "u4"),
        ("started_ns", "i8"),  # CLOCK_REALTIME
        ("backend", "S64"),
        ("clock", "S16"),
        ("permissions", "S400"),  # those that were not granted, and the reasons
        ("cycles", "u8"),
        ("max_us", "f8", (len(Phase),)),
        ("histogram", "u4", (len(Phase), HISTOGRAM_BUCKETS)),  # 1 µs per bucket, the last is "more"
    ],
    align=True,
)
ACK = np.dtype([("id", "u8"), ("result", "u4"), ("message", TEXT)], align=True)
HEARTBEAT = np.dtype([("pid", "u4"), ("monotonic_ns", "i8")], align=True)
REQUESTS = np.dtype([("stops", "u8"), ("estops", "u8"), ("fast_stops", "u8")], align=True)
"""Counters of requested stops. `fast_stops` counts the category 1 stops."""
HEAD = np.dtype([("id", "u8")], align=True)
COMMAND = np.dtype(
    [
        ("id", "u8"),
        ("kind", "u4"),
        ("slot", "u4"),
        ("motion_id", "u8"),
        ("stops", "u8"),
        ("value", "f8"),
        ("tool", "u8"),
        ("scene", "u8"),
    ],
    align=True,
)
"""stops: number of stop requests that the sender knows of. A START or REPLACE is rejected if rtloop knows of
more. For a RESET, the number of e-stops is added, because a RESET ends only e-stops that its sender knew of.
value: rate of a SET_RATE; for a REPLACE the path time, s, of the current motion at which the new one begins.
tool: for a START or REPLACE, the version of the tool for which it was planned. It is rejected if the current
tool has a different version. For a TOOL, the version in the tool block.
scene: for a SCENE or a TOOL, the version of the scene file to read.
"""
TOOL = np.dtype(
    [
        ("version", "u8"),
        ("mass", "f8"),  # kg
        ("centre", "f8", (3,)),  # centre of mass, m, in the flange's frame
        ("inertia", "f8", (6,)),  # about the centre: xx, xy, xz, yy, yz, zz, kg·m²; NaN: a point mass
        ("tcp", "f8", (7,)),  # in the flange's frame; NaN: the model's
        ("gravity", "f8", (3,)),  # in the base frame, m/s²; NaN: the model's
        ("mounted_mass", "f8"),  # without the parts of a simulated cell, which are separate bodies
        ("mounted_centre", "f8", (3,)),
        ("mounted_inertia", "f8", (6,)),
    ]
)
"""A `cobot.robot.tool.Tool` without its name and its shapes."""
IO_POINTS = 64
IO_NAME_BYTES = 64
CONDITION = np.dtype(
    [
        ("quantity", "u8"),  # as `cobot.motions.signals.Quantity`
        ("name", f"S{IO_NAME_BYTES}"),  # of the input
        ("joint", "u8"),
        ("edge", "u8"),
        ("in_tool", "u8"),
        ("low", "f8"),
        ("high", "f8"),
        ("direction", "f8", (3,)),  # NaN: any
        ("zero", "f8", (6,)),  # NaN: the value that is measured when evaluation begins
        ("from_s", "f8"),  # path times between which it is evaluated
        ("to_s", "f8"),
    ],
    align=True,
)
"""A `cobot.motions.signals.Condition`."""
SIGNALS = np.dtype(
    [
        ("count", "u8"),  # of the actions
        ("path_times_s", "f8", (MAX_ACTIONS,)),  # in their order
        ("numbers", "u8", (MAX_ACTIONS,)),  # unique in the motion
        ("outputs", f"S{IO_NAME_BYTES}", (MAX_ACTIONS,)),  # "": the service executes the action
        ("values", "f8", (MAX_ACTIONS,)),
        ("stops", "u1", (MAX_ACTIONS,)),  # 1: the motion stops if the device rejects it
        ("start_when", CONDITION),
        ("pause_while", CONDITION),
        ("until", CONDITION),
        ("fast", "u8"),  # 1: `until` stops each joint as fast as it can
    ],
    align=True,
)
"""A `cobot.motions.signals.Placed`."""
SLOT = np.dtype(
    [
        ("motion_id", "u8"),
        ("segments", "u8"),
        ("checksum", "u8"),
        ("fence", "f8", (7,)),
        ("signals", SIGNALS),
    ],
    align=True,
)
"""fence: values of a `cobot.motions.fence.Fence`; NaN: none."""


class Firing(IntEnum):
    """The state of an action of a motion."""

    PENDING = 0
    FIRED = 1
    REJECTED = 2  # the device rejects it


class Waiting(IntEnum):
    """The condition for which a motion waits."""

    NO = 0
    START = 1  # `start_when` does not hold yet
    PAUSE = 2  # `pause_while` holds


REASON = "S120"
SIGNAL_REPORT = np.dtype(
    [
        ("motion_id", "u8"),
        ("waiting", "u8"),  # as `Waiting`
        ("count", "u8"),
        ("numbers", "u8", (MAX_ACTIONS,)),
        ("firings", "u1", (MAX_ACTIONS,)),  # as `Firing`
        ("path_times_s", "f8", (MAX_ACTIONS,)),  # of the cycle, since the start of the motion
        ("robot_times_s", "f8", (MAX_ACTIONS,)),
        ("poses", "f8", (MAX_ACTIONS, 7)),  # measured pose of the TCP in that cycle
        ("reasons", REASON, (MAX_ACTIONS,)),  # reasons of rejections
        ("met", "u8"),  # 1: `until` was met; the fields below describe how
        ("met_path_time_s", "f8"),
        ("met_robot_time_s", "f8"),
        ("met_value", "f8"),  # value that the condition compares
        ("met_wrench", "f8", (6,)),  # wrench at the TCP, in the base frame; the zero is subtracted
        ("met_pose", "f8", (7,)),  # of the TCP, measured
    ],
    align=True,
)
"""The report of rtloop about the actions and conditions of the last motion that has any."""
MAX_PERIODS = 8
DEVICE = np.dtype(
    [
        ("periods_s", "f8", (MAX_PERIODS,)),  # supported cycle periods; unused entries are 0
        ("measured", "u8"),  # a bit for each name of `cobot.ipc.state_fields.MEASURED_NAMES`
        ("able", "u1", (8,)),  # one for each name in `cobot.robot.device.FLAGS`
        ("stops", "u1", (3,)),  # categories 0 to 2, with values as in `cobot.ipc.device_record`
        ("hardware", "u1"),
        ("guides", "u1"),
        ("says", "u8"),  # 1: the device reports the status below
        ("connection", "S64"),
        ("quality", "S64"),
        ("operation_mode", "S16"),
        ("safety_stop", "S128"),
        ("drives", "S64"),
        ("brakes", "S64"),
        ("speed_scaling", "f8"),
        ("packets_lost", "u8"),
        ("device_time_s", "f8"),  # NaN: not reported
        ("text", "S400"),
        ("share", "f8"),  # current speed of planned motions, as a share
        ("unacknowledged", "S800"),  # findings of the first contact; "" after they are acknowledged
        ("drives_off", "u1"),  # 1: switched off by a category 1 stop, until a reset
    ],
    align=True,
)
"""A `cobot.ipc.device_record.DeviceReport`."""
IO = np.dtype(
    [
        ("number", "u8"),  # of the report
        ("count", "u8"),  # number of entries in use
        ("names", f"S{IO_NAME_BYTES}", (IO_POINTS,)),
        ("kinds", "u1", (IO_POINTS,)),  # numbers of `cobot.ipc.io_record.KINDS`
        ("outputs", "u1", (IO_POINTS,)),  # 1: an output
        ("values", "f8", (IO_POINTS,)),
    ],
    align=True,
)
"""A `cobot.ipc.io_record.IoReport`."""
OUTPUT = np.dtype([("name", f"S{IO_NAME_BYTES}"), ("value", "f8")])
PULL = np.dtype([("link", "S64"), ("point", "f8", (3,)), ("target", "f8", (3,))])
"""A pull by hand. `point` is a point of the link, in the link's frame, m. `target` is the position to which
this point is pulled, in the base frame, m. Without a link, the pull ends.
"""
PULL_S = 0.2
"""Time after which the simulation ends a pull that is not renewed, s."""
CELL_PARTS = 32
CELL = np.dtype(
    [
        ("number", "u8"),  # of the report
        ("count", "u8"),  # number of entries in use
        ("names", "S32", (CELL_PARTS,)),
        ("poses", "f8", (CELL_PARTS, 7)),  # in the base frame
    ],
    align=True,
)
"""The loose parts of a simulated cell."""
INFO_TEXT = "S64"


def info_dtype(dof: int) -> np.dtype:
    """Properties of the robot that rtloop publishes at its start. Those that depend on the tool change with
    the tool.
    """
    joints = ("f8", (dof,))
    return np.dtype(
        [
            ("model", INFO_TEXT),
            ("period_s", "f8"),  # cycle period
            ("joint_names", INFO_TEXT, (dof,)),
            ("min_position", *joints),
            ("max_position", *joints),
            ("max_velocity", *joints),
            ("max_acceleration", *joints),
            ("max_jerk", *joints),
            ("max_effort", *joints),
            ("stiffness", *joints),  # nominal, N·m/rad; zeros: no impedance control
            ("cartesian_stiffness", "f8", (6,)),  # nominal, N/m and N·m/rad
            ("flange", "f8", (7,)),  # in the TCP's frame
            ("tool_version", "u8"),  # of the tool that the arm carries, including attached objects
            ("scene_version", "u8"),  # of the newest scene that rtloop knows
        ]
    )


def session_dtype(dof: int) -> np.dtype:
    """A streaming client's settings, fixed for a session."""
    joints = ("f8", (dof,))
    return np.dtype(
        [
            ("number", "u8"),  # session number; each session gets a new one
            ("open", "u8"),  # 1: in use; 2: a servo session that ends after its current points
            ("pid", "u8"),  # the client's process; the session ends with it
            ("stops", "u8"),  # number of stops when the client sent the request; a later stop rejects it
            ("stream", "u8"),
            ("interpolation", "u8"),
            ("decimation", "u8"),  # number of cycles per target
            ("stiffness", *joints),
            ("damping_ratio", *joints),
            ("cartesian_stiffness", "f8", (6,)),
            ("cartesian_damping_ratio", "f8", (6,)),
            ("max_contact_torque", *joints),  # N·m; infinite for no limit
            ("max_contact_wrench", "f8", (6,)),  # N, N·m
            ("force_axes", "f8", (6,)),  # 1: force control along this axis of the force frame
            ("force_velocity", "f8", (6,)),  # maximum speed of force control, m/s and rad/s
            ("force_in_tcp", "u8"),  # 1: the force frame is given in the TCP's frame; 0: in the base frame
            ("force_frame", "f8", (7,)),
            ("posture", *joints),  # for the null space, rad; NaN for none
            ("servo_mode", "u8"),  # 0: targets are in the setpoint; otherwise they are points in the queue
            ("watchdog_s", "f8"),  # a servo session ends after this time without a point
        ]
    )


def setpoint_dtype(dof: int) -> np.dtype:
    """A streaming client's current target."""
    joints = ("f8", (dof,))
    return np.dtype(
        [
            ("session", "u8"),
            ("number", "u8"),
            ("feed_forward", "u8"),  # 1: velocities are given
            ("joints", *joints),  # rad, or N·m
            ("joint_velocity", *joints),
            ("joint_acceleration", *joints),
            ("pose", "f8", (7,)),
            ("wrench", "f8", (6,)),  # force and torque that the TCP exerts, in the force frame
            ("twist", "f8", (6,)),
            ("twist_rate", "f8", (6,)),
            ("move", "u8"),  # number of the newest `move_to_pose`
            ("move_pose", "f8", (7,)),
            ("move_duration_s", "f8"),
            ("cancel", "u8"),  # number of the `move_to_pose` that is cancelled
        ]
    )


def chunk_dtype(dof: int) -> np.dtype:
    """Timed targets in the future."""
    return np.dtype(
        [
            ("session", "u8"),
            ("number", "u8"),
            ("count", "u8"),
            ("times_s", "f8", (CHUNK_POINTS,)),  # on the robot's clock
            ("points", "f8", (CHUNK_POINTS, max(dof, 7))),  # joint positions, or poses
        ]
    )


def point_dtype(dof: int) -> np.dtype:
    """A servo point, which is stored in a queue of `POINTS` entries."""
    return np.dtype(
        [
            ("number", "u8"),  # number of the point in its session, starting at 1
            ("time_s", "f8"),  # intended duration of the motion to the point
            ("lookahead_s", "f8"),  # see `rtloop.sources.servo_law`; 0 for none
            ("gain", "f8"),  # 1/s²
            ("joints", "f8", (dof,)),  # rad
        ]
    )


POINT_HEAD = np.dtype([("session", "u8"), ("number", "u8")])
"""The block with the number of the latest point."""
SESSION_ACK = np.dtype([("session", "u8"), ("result", "u8"), ("message", TEXT)])
STREAM_REQUESTS = np.dtype([("estops", "u8")])


def record_of(octets: bytes, kind: np.dtype) -> np.ndarray:
    """Convert bytes to a record. numpy's own conversion copies each field separately, which takes 20 µs."""
    return np.ndarray((), kind, bytearray(octets))


def text(field: np.ndarray) -> str:
    """Decode a text field of a record."""
    return bytes(field.item() if isinstance(field, np.ndarray) else field).decode("utf-8", "replace")
