"""What stands in the shared memory of a robot: records, and the words for what is in them.

`cobot.ipc.shm` maps them. The record of the state block and the version of all records, which a change of any
raises, are in `cobot.ipc.state_fields`. Long, so that one file shows all the others.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

MAGIC = b"COBOTRT\0"
RING = 32
SLOTS = 2
LOADED_SEGMENTS = 96
"""So much of a motion rtloop takes over from its slot in a cycle."""
HISTOGRAM_BUCKETS = 1024
CHUNK_POINTS = 64
POINTS = 1024
"""So many servo points may wait for rtloop."""
TEXT = "S200"


class Command(IntEnum):
    START = 1  # run the motion in a slot
    SET_RATE = 2  # path time per clock time, 0 (pause) to 1
    RESET = 3  # leave ESTOP or FAULT
    TOOL = 4  # carry the tool that stands in its block
    SCENE = 5  # read the scene's file anew, for streams
    REPLACE = 6  # go on with the trajectory in a slot, which begins as what is left of the one under way
    ACKNOWLEDGE = 7  # somebody has seen what the first contact has found: full speed
    OUTPUT = 8  # have the device set the output that stands in its block


class Ack(IntEnum):
    ACCEPTED = 1
    REJECTED = 2


class MotionResult(IntEnum):
    """How the motion `motion_id` stands."""

    NONE = 0  # there has been none
    RUNNING = 1
    ARRIVED = 2  # at rest at its goal, settled
    STOPPED = 3  # at rest on its path, by request
    FAILED = 4  # ended by a fault or an e-stop: the state's `reason` says why
    STOPPED_ASIDE = 5  # at rest by request, but not on its path: that left no room to slow down


class Phase(IntEnum):
    """The parts of a cycle whose times are counted in the statistics' histograms."""

    WAKEUP = 0  # how late the cycle began
    READ = 1
    UPDATE = 2
    WRITE = 3
    TOTAL = 4  # compute time: read, update, write and publishing


class Intervention(IntEnum):
    """What the safety layer counted."""

    NOT_FINITE = 0
    POSITION = 1
    VELOCITY = 2
    ACCELERATION = 3
    JERK = 4
    TRACKING = 5
    SERVICE_TIMEOUT = 6
    OVERRUN = 7
    JUMP = 8  # a streamed target further from the last one than an arm can get: refused
    COMMAND_TIMEOUT = 9  # no streamed target for too long: held
    COLLISION = 10  # a stream led into the arm itself or its surroundings: held
    PROXIMITY = 11  # a stream came near them: slowed down
    CONTACT = 12  # the surroundings push harder than the session permits: stopped
    LATE = 13  # timed targets whose time had passed: dropped


class Stream(IntEnum):
    """What a streaming session streams."""

    JOINT_IMPEDANCE = 1
    CARTESIAN = 2
    JOINT_TORQUE = 3


class Interpolation(IntEnum):
    """How rtloop goes from one streamed target to the next."""

    NONE = 0  # at once, as fast as the limits permit
    LINEAR = 1  # at constant velocity, within one command period
    QUINTIC = 2  # with continuous velocity and acceleration, within one command period
    RUCKIG = 3  # re-planned in every cycle, jerk-limited


class ServoMode(IntEnum):
    """What rtloop makes of the points of a servo session, as the manual numbers it."""

    NONE = 0  # no servo session
    REPLANNED = 1  # to the newest point at once, jerk-limited
    DIRECT = 2  # the newest point is the reference
    BUFFERED = 3  # one point after the other, each in its time
    BUFFERED_1MS = 4  # one point per millisecond
    THROUGH = 5  # planned through all points
    REPLANNED_FORCE = 6  # as 1, with force control along the force axes
    THROUGH_FORCE = 7  # as 5, with force control along the force axes


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
        ("checksum", "u8"),  # the last one: of all that stands before it
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
        ("permissions", "S400"),  # what was not granted, and why
        ("cycles", "u8"),
        ("max_us", "f8", (len(Phase),)),
        ("histogram", "u4", (len(Phase), HISTOGRAM_BUCKETS)),  # 1 µs each, the last one is "more"
    ],
    align=True,
)
ACK = np.dtype([("id", "u8"), ("result", "u4"), ("message", TEXT)], align=True)
HEARTBEAT = np.dtype([("pid", "u4"), ("monotonic_ns", "i8")], align=True)
REQUESTS = np.dtype([("stops", "u8"), ("estops", "u8"), ("fast_stops", "u8")], align=True)
"""fast_stops: of the stops those of category 1."""
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
"""stops: the count of stop requests that the sender knew of; a START or REPLACE that a stop has overtaken is
refused. Of a RESET that of e-stops is added: it ends no e-stop but those that its sender knew of.
value: the rate of a SET_RATE; of a REPLACE the path time, s, of the motion under way at which its own begins.
tool: the version that a START or REPLACE was planned with, another one is refused; of a TOOL that in the
block.
scene: of a SCENE or a TOOL, the version of the scene whose file is to be read."""
TOOL = np.dtype(
    [
        ("version", "u8"),
        ("mass", "f8"),  # kg
        ("centre", "f8", (3,)),  # of the mass, m, in the flange's frame
        ("inertia", "f8", (6,)),  # about it: xx, xy, xz, yy, yz, zz, kg·m²; NaN: a point
        ("tcp", "f8", (7,)),  # in the flange's frame; NaN: the model's
        ("gravity", "f8", (3,)),  # in the base frame, m/s²; NaN: the model's
    ]
)
"""A `cobot.robot.tool.Tool`, without its name and shapes."""
SLOT = np.dtype(
    [("motion_id", "u8"), ("segments", "u8"), ("checksum", "u8"), ("fence", "f8", (7,))], align=True
)
"""fence: as `cobot.motions.fence.Fence`; NaN: none."""
MAX_PERIODS = 8
DEVICE = np.dtype(
    [
        ("periods_s", "f8", (MAX_PERIODS,)),  # of the cycle, that it can be driven with; the others are 0
        ("measured", "u1", (6,)),  # 1: this row of what is measured is real
        ("able", "u1", (8,)),  # as `cobot.robot.device.FLAGS`
        ("stops", "u1", (3,)),  # categories 0 to 2, as `cobot.ipc.device_record` counts
        ("hardware", "u1"),
        ("says", "u8"),  # 1: what follows is what the device says of itself
        ("connection", "S64"),
        ("quality", "S64"),
        ("operation_mode", "S16"),
        ("safety_stop", "S128"),
        ("drives", "S64"),
        ("brakes", "S64"),
        ("speed_scaling", "f8"),
        ("packets_lost", "u8"),
        ("device_time_s", "f8"),  # NaN: it does not say
        ("text", "S400"),
        ("share", "f8"),  # of the speed of planned motions
        ("unacknowledged", "S800"),  # what the first contact has found; "" when it is acknowledged
        ("drives_off", "u1"),  # 1: by a stop of category 1, until a reset
    ],
    align=True,
)
"""A `cobot.ipc.device_record.Device`."""
IO_POINTS = 64
IO_NAME_BYTES = 64
IO = np.dtype(
    [
        ("number", "u8"),  # of the report
        ("count", "u8"),  # so many of the places are in use
        ("names", f"S{IO_NAME_BYTES}", (IO_POINTS,)),
        ("kinds", "u1", (IO_POINTS,)),  # as `cobot.ipc.io_record.KINDS`
        ("outputs", "u1", (IO_POINTS,)),  # 1: an output
        ("values", "f8", (IO_POINTS,)),
    ],
    align=True,
)
"""A `cobot.ipc.io_record.IoReport`."""
OUTPUT = np.dtype([("name", f"S{IO_NAME_BYTES}"), ("value", "f8")])
INFO_TEXT = "S64"


def info_dtype(dof: int) -> np.dtype:
    """What rtloop knows of its robot from the beginning; what hangs on the tool changes with that."""
    joints = ("f8", (dof,))
    return np.dtype(
        [
            ("model", INFO_TEXT),
            ("period_s", "f8"),  # of the cycle
            ("joint_names", INFO_TEXT, (dof,)),
            ("min_position", *joints),
            ("max_position", *joints),
            ("max_velocity", *joints),
            ("max_acceleration", *joints),
            ("max_jerk", *joints),
            ("max_effort", *joints),
            ("stiffness", *joints),  # nominal, N·m/rad; zeros: the drives do not give way
            ("cartesian_stiffness", "f8", (6,)),  # nominal, N/m and N·m/rad
            ("flange", "f8", (7,)),  # in the TCP's frame
            ("tool_version", "u8"),  # of the tool that it carries, with what is attached
            ("scene_version", "u8"),  # of the scene that it was told of last
        ]
    )


def session_dtype(dof: int) -> np.dtype:
    """What a streaming client wants; fixed from the session's beginning to its end."""
    joints = ("f8", (dof,))
    return np.dtype(
        [
            ("number", "u8"),  # of the session: a new one for each
            ("open", "u8"),  # 1 while it is wanted; 2: a servo session's points, and no more
            ("pid", "u8"),  # its writer: when that is gone, so is the session
            ("stops", "u8"),  # stops that rtloop had seen when the client asked: a later one refuses it
            ("stream", "u8"),
            ("interpolation", "u8"),
            ("decimation", "u8"),  # a new target is taken every so many cycles
            ("stiffness", *joints),
            ("damping_ratio", *joints),
            ("cartesian_stiffness", "f8", (6,)),
            ("cartesian_damping_ratio", "f8", (6,)),
            ("max_contact_torque", *joints),  # N·m, infinite for none
            ("max_contact_wrench", "f8", (6,)),  # N, N·m
            ("force_axes", "f8", (6,)),  # 1: force control along this axis of the force frame
            ("force_velocity", "f8", (6,)),  # the fastest that force control moves, m/s and rad/s
            ("force_in_tcp", "u8"),  # the force frame is given in the TCP's frame, not in the base frame
            ("force_frame", "f8", (7,)),
            ("posture", *joints),  # of the null space, rad; NaN for none
            ("servo_mode", "u8"),  # 0: targets come in the setpoint; else they are points in the queue
            ("watchdog_s", "f8"),  # of a servo session: without a point for so long, it ends
        ]
    )


def setpoint_dtype(dof: int) -> np.dtype:
    """What a streaming client wants now."""
    joints = ("f8", (dof,))
    return np.dtype(
        [
            ("session", "u8"),
            ("number", "u8"),
            ("feed_forward", "u8"),  # whether velocities are stated
            ("joints", *joints),  # rad, or N·m
            ("joint_velocity", *joints),
            ("joint_acceleration", *joints),
            ("pose", "f8", (7,)),
            ("wrench", "f8", (6,)),  # what the TCP shall exert, in the force frame
            ("twist", "f8", (6,)),
            ("twist_rate", "f8", (6,)),
            ("move", "u8"),  # number of the newest `move_to_pose`
            ("move_pose", "f8", (7,)),
            ("move_duration_s", "f8"),
            ("cancel", "u8"),  # number of the `move_to_pose` that is cancelled
        ]
    )


def chunk_dtype(dof: int) -> np.dtype:
    """Timed targets that lie ahead."""
    return np.dtype(
        [
            ("session", "u8"),
            ("number", "u8"),
            ("count", "u8"),
            ("times_s", "f8", (CHUNK_POINTS,)),  # on the robot's clock
            ("points", "f8", (CHUNK_POINTS, max(dof, 7))),  # joints, or poses
        ]
    )


def point_dtype(dof: int) -> np.dtype:
    """A servo point, in a queue of `POINTS` places."""
    return np.dtype(
        [
            ("number", "u8"),  # in its session, from 1 on
            ("time_s", "f8"),  # how long the way to it is meant to take
            ("lookahead_s", "f8"),  # of `rtloop.sources.servo_law`; 0 for none
            ("gain", "f8"),  # 1/s²
            ("joints", "f8", (dof,)),  # rad
        ]
    )


POINT_HEAD = np.dtype([("session", "u8"), ("number", "u8")])
"""The block that holds the newest point's number."""
SESSION_ACK = np.dtype([("session", "u8"), ("result", "u8"), ("message", TEXT)])
STREAM_REQUESTS = np.dtype([("estops", "u8")])


def record_of(octets: bytes, kind: np.dtype) -> np.ndarray:
    """A record of its own from the bytes of one; numpy's copy goes field by field, which takes 20 µs."""
    return np.ndarray((), kind, bytearray(octets))


def text(field: np.ndarray) -> str:
    """A text field of a record."""
    return bytes(field.item() if isinstance(field, np.ndarray) else field).decode("utf-8", "replace")
