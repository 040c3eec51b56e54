"""The packets of FANUC's Stream Motion, versions 3 and 4.

The layouts are defined in the Stream Motion manual (B-84184EN) and in `stream_motion/packets.hpp`, which
FANUC publishes. Numbers are big-endian without padding. Bytes of inputs and outputs are sent lowest first.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag

AXES = 9
"""Number of axes in each packet: the arm's axes, then extended axes. Unused axes are zero."""
IO_BYTES = 256
MIN_VERSION, FORCE_VERSION = 3, 4
"""The oldest supported version, and the first version whose status packets contain a force."""
PORT = 60015
THRESHOLDS = 20
"""Number of columns of the limits table: from 5 % to 100 % of the maximum TCP speed."""
JOINT_STYLE = 0xFFFF
"""Data style of a command with joint angles. With style 0 the controller interprets the same numbers as a
pose.
"""
MAX_PACKET = 1024
"""Maximum size of a packet, bytes. It is larger than any packet."""


class PacketType(IntEnum):
    STOP = 2
    LIMITS = 3
    CAPABILITY = 7
    START = 200
    COMMAND = 201
    STATUS_3 = 202
    IO_CONFIG = 203
    STATUS = 204


class MotionFlag(IntFlag):
    """Bits of `status`."""

    POSSIBLE = 1
    COMMAND_RECEIVED = 2
    SYSTEM_READY = 4
    IN_PROGRESS = 8


class RobotFlag(IntFlag):
    """Bits of `robot_status`."""

    ERROR = 1
    PENDANT = 2
    EMERGENCY_STOP = 4


class ContactStop(IntEnum):
    """Reaction of a collaborative robot to a contact."""

    NONE = 0
    SAFE = 1
    STOP = 2
    DISABLED = 3
    ESCAPE = 4


class LimitRate(IntEnum):
    """The derivative whose limits a table contains."""

    VELOCITY = 0
    ACCELERATION = 1
    JERK = 2


class PointType(IntEnum):
    DO = 0
    DI = 1
    RO = 2
    RI = 3
    AO = 4
    AI = 5
    F = 6


class IoBlockKind(IntEnum):
    NONE = 0
    COMMAND = 1
    STATE = 2


@dataclass(frozen=True, slots=True)
class StatusPacket:
    """The controller's state in one period.

    Attributes:
        sequence: packet number. The command that answers the packet repeats it.
        time_ms: time on the controller's clock.
        pose: pose of the face plate: x, y, z in mm and w, p, r in degrees, in the world frame.
        joints: joint positions, degrees, for linear axes mm, shape (AXES,).
        currents: motor currents, in controller units.
        safety_scale: share of the speed that the collaborative speed clamp permits.
        io: bytes of the configured blocks of inputs and outputs.
    """

    version: int
    sequence: int
    status: int
    robot_status: int
    contact_stop: int
    time_ms: int
    pose: tuple[float, ...]
    joints: tuple[float, ...]
    currents: tuple[float, ...] = (0.0,) * AXES
    safety_scale: float = 1.0
    io: bytes = b""

    @property
    def motion_possible(self) -> bool:
        return bool(self.status & MotionFlag.POSSIBLE)


@dataclass(frozen=True, slots=True)
class CommandPacket:
    """A target of all axes.

    Attributes:
        is_last: whether this command ends the motion.
        moves: False for a packet that sets outputs only.
        style: `JOINT_STYLE`, or 0 for a pose.
        position: target, degrees, for linear axes mm, shape (AXES,).
    """

    version: int
    sequence: int
    position: tuple[float, ...]
    is_last: bool = False
    moves: bool = True
    style: int = JOINT_STYLE
    io: bytes = bytes(IO_BYTES)


@dataclass(frozen=True, slots=True)
class CapabilityPacket:
    """The capabilities of the controller. A packet filled with zeros requests them.

    Attributes:
        version: newest version that the sender supports.
        period_ms: interval between two status packets.
        start_move: number of commands that the controller collects before it moves.
        at_tcp: whether poses refer to the TCP instead of the face plate.
    """

    version: int
    period_ms: int = 0
    start_move: int = 0
    at_tcp: bool = False


@dataclass(frozen=True, slots=True)
class LimitsRequest:
    version: int
    axis: int
    rate: LimitRate


@dataclass(frozen=True, slots=True)
class LimitsPacket:
    """Limits of one axis, deg/s, deg/s² or deg/s³ (for linear axes mm).

    Attributes:
        axis: axis number, starting at 1.
        max_speed: TCP speed for the last column, mm/s.
        interval_ms: interval between two checks of the controller.
        unloaded, loaded: limits without payload and at full payload, each of shape (THRESHOLDS,).
    """

    version: int
    axis: int
    rate: LimitRate
    max_speed: int
    interval_ms: int
    unloaded: tuple[float, ...]
    loaded: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class IoBlock:
    """A row of inputs or outputs with consecutive numbers, starting at 1."""

    kind: IoBlockKind
    type: PointType
    start: int
    length: int


@dataclass(frozen=True, slots=True)
class StartPacket:
    version: int


@dataclass(frozen=True, slots=True)
class StopPacket:
    version: int


@dataclass(frozen=True, slots=True)
class IoConfigRequest:
    version: int
    blocks: tuple[IoBlock, ...]


@dataclass(frozen=True, slots=True)
class IoConfigResult:
    """The reply to a configuration of inputs and outputs. `result` is 0, or the controller's error number."""

    result: int
    load: int = 0


Received = StatusPacket | CapabilityPacket | LimitsPacket | IoConfigResult
"""Packets that a controller sends."""
Sent = CommandPacket | CapabilityPacket | LimitsRequest | StartPacket | StopPacket | IoConfigRequest
"""Packets that a client of a controller sends."""
