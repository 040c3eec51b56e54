"""What stands in the shared memory of a robot: records, and the words for what is in them.

`cobot.shm` maps them; who changes one raises `LAYOUT_VERSION`.
"""

from __future__ import annotations

import struct
from enum import IntEnum

import numpy as np

MAGIC = b"COBOTRT\0"
LAYOUT_VERSION = 2
RING = 32
SLOTS = 2
HISTOGRAM_BUCKETS = 1024
TEXT = "S200"


class Command(IntEnum):
    START = 1  # run the motion in a slot
    SET_RATE = 2  # path time per clock time, 0 (pause) to 1
    RESET = 3  # leave ESTOP or FAULT


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


STATE_SCALARS = (
    ("cycle", "u8"),  # since rtloop's start
    ("robot_time_s", "f8"),  # the robot's clock: cycles times the period
    ("mode", "u8"),
    ("settled", "u8"),  # at rest at the commanded position
    ("motion_id", "u8"),  # the running motion or the last one
    ("motion_result", "u8"),
    ("slot", "u8"),
    ("path_time_s", "f8"),
    ("path_duration_s", "f8"),
    ("path_rate", "f8"),  # path time per clock time
    ("deceleration_monotonic_ns", "i8"),  # when the last stop began to take effect
    ("stops_seen", "u8"),  # the requests' counters as last acted upon
    ("estops_seen", "u8"),
    ("command_seen", "u8"),
    ("overruns", "u8"),
    ("torn_reads", "u8"),
    ("monotonic_ns", "i8"),  # CLOCK_MONOTONIC at publication
    ("measured_monotonic_ns", "i8"),  # and when the robot was last read without an error
)
"""They stand first, without gaps, so that the cycle can write them with one `struct.pack_into`."""
_CODES = {"u8": "Q", "i8": "q", "f8": "d"}
STATE_STRUCT = struct.Struct("=" + "".join(_CODES[kind] for _, kind in STATE_SCALARS))


def state_dtype(dof: int) -> np.dtype:
    """The state block's record; measured and commanded arrays stand together."""
    joints = ("f8", (dof,))
    return np.dtype(
        [
            *STATE_SCALARS,
            ("position", *joints),  # measured, rad
            ("velocity", *joints),  # measured, rad/s
            ("effort", *joints),  # measured, N·m
            ("commanded_position", *joints),
            ("commanded_velocity", *joints),
            ("commanded_acceleration", *joints),
            ("tcp", "f8", (7,)),  # measured: x, y, z in m, then w, x, y, z, in the base frame
            ("interventions", "u8", (len(Intervention),)),
            ("reason", TEXT),  # why ESTOP, FAULT or the last stop, UTF-8
        ]
    )


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
REQUESTS = np.dtype([("stops", "u8"), ("estops", "u8")], align=True)
HEAD = np.dtype([("id", "u8")], align=True)
COMMAND = np.dtype(
    [("id", "u8"), ("kind", "u4"), ("slot", "u4"), ("motion_id", "u8"), ("stops", "u8"), ("value", "f8")],
    align=True,
)  # stops: the count of stop requests that the sender knew of; a START that a stop has overtaken is refused
SLOT = np.dtype([("motion_id", "u8"), ("segments", "u8"), ("checksum", "u8")], align=True)
