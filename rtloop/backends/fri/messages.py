"""The messages of KUKA's Fast Robot Interface: monitoring messages and commands."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

MONITORING_ID = 0x245142
COMMAND_ID = 0x34001
MAX_JOINTS = 16
"""Maximum number of joints. No KUKA arm has so many; it is the size of the arrays in the compiled core."""
MAX_IO = 10
MAX_NAME = 63
"""Maximum length of the name of an input or output, bytes."""

FRAMED_VERSION = "2.7"
"""The FRI release with a frame around its messages."""


class SessionState(IntEnum):
    IDLE = 0
    MONITORING_WAIT = 1
    MONITORING_READY = 2
    COMMANDING_WAIT = 3
    COMMANDING_ACTIVE = 4


class Quality(IntEnum):
    """Connection quality, as the controller reports it. From GOOD on the controller accepts commands."""

    POOR = 0
    FAIR = 1
    GOOD = 2
    EXCELLENT = 3


class SafetyState(IntEnum):
    NORMAL_OPERATION = 0
    SAFETY_STOP_LEVEL_0 = 1
    SAFETY_STOP_LEVEL_1 = 2
    SAFETY_STOP_LEVEL_2 = 3


class OperationMode(IntEnum):
    T1 = 0
    T2 = 1
    AUT = 2


class DriveState(IntEnum):
    OFF = 0
    TRANSITIONING = 1
    ACTIVE = 2


class ControlMode(IntEnum):
    POSITION = 0
    CARTESIAN_IMPEDANCE = 1
    JOINT_IMPEDANCE = 2
    NONE = 3


class CommandMode(IntEnum):
    """Kind of command that the running motion's overlay accepts from the client."""

    NONE = 0
    POSITION = 1
    WRENCH = 2
    TORQUE = 3
    CARTESIAN_POSE = 4


class OverlayType(IntEnum):
    NONE = 0
    JOINT = 1
    CARTESIAN = 2


class IoType(IntEnum):
    BOOLEAN = 0
    DIGITAL = 1
    ANALOG = 2


class IoDirection(IntEnum):
    """Direction from the controller's point of view: the client writes an OUTPUT."""

    INPUT = 0
    OUTPUT = 1


@dataclass(slots=True)
class FriHeader:
    """
    Attributes:
        sequence: number of the message, modulo 2**32.
        reflected: `sequence` of the newest message that the sender has received.
    """

    identifier: int
    sequence: int
    reflected: int


@dataclass(slots=True)
class IoValue:
    """An input or output with the name that the cabinet's program has registered."""

    name: str
    type: IoType
    direction: IoDirection
    value: float = 0.0


@dataclass(slots=True)
class MonitoringMessage:
    """The message FRIMonitoringMessage. Joint values are tuples with one value per joint, or () if not
    reported.

    Attributes:
        send_period_ms: interval between two monitoring messages.
        receive_multiplier: number of monitoring messages after which the controller expects an answer.
        measured_position, commanded_position, ipo_position: rad.
        measured_torque, commanded_torque, external_torque: N·m.
        ipo_position: the controller's interpolator position, to which the overlay is added.
        tracking_performance: quality of the arm's tracking, 0 to 1; None if not reported.
        time_s: time on the controller's clock; None if not reported.
        measured_pose: x, y, z in mm and a quaternion, only in FRI 2.x.
        external_force: up to six values, N and N·m, only in FRI 2.7.
        framed: whether the packet has the frame of FRI 2.7.
        version: "1.x", "2.x" or "2.7"; "" if the message has no field that is specific to one of them.
    """

    header: FriHeader
    state: SessionState = SessionState.IDLE
    quality: Quality = Quality.POOR
    send_period_ms: int = 0
    receive_multiplier: int = 1
    joints: int = 0
    safety: SafetyState = SafetyState.NORMAL_OPERATION
    drives: tuple[DriveState, ...] = ()
    operation_mode: OperationMode | None = None
    control_mode: ControlMode = ControlMode.NONE
    command_mode: CommandMode = CommandMode.NONE
    overlay: OverlayType = OverlayType.NONE
    measured_position: tuple[float, ...] = ()
    commanded_position: tuple[float, ...] = ()
    ipo_position: tuple[float, ...] = ()
    measured_torque: tuple[float, ...] = ()
    commanded_torque: tuple[float, ...] = ()
    external_torque: tuple[float, ...] = ()
    measured_pose: tuple[float, ...] = ()
    tracking_performance: float | None = None
    time_s: float | None = None
    io: list[IoValue] = field(default_factory=list)
    external_force: tuple[float, ...] = ()
    framed: bool = False

    @property
    def version(self) -> str:
        if self.framed:
            return FRAMED_VERSION
        if self.commanded_position:
            return "1.x"
        return "2.x" if self.measured_pose else ""


@dataclass(slots=True)
class CommandMessage:
    """The message FRICommandMessage. Empty fields are not sent.

    Attributes:
        position: joint positions, rad.
        torque: joint torques that the controller adds to its own, N·m.
        wrench: wrench that the controller adds to its own, shape (6,), N and N·m.
        io: outputs to set.
        framed: whether the packet has the frame of FRI 2.7.
    """

    header: FriHeader
    position: tuple[float, ...] = ()
    torque: tuple[float, ...] = ()
    wrench: tuple[float, ...] = ()
    io: list[IoValue] = field(default_factory=list)
    framed: bool = False
