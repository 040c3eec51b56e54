"""The nouns that every package shares: plain frozen data, SI units, quaternions (w, x, y, z)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from typing import Any, ClassVar, Literal

import numpy as np

from cobot.errors import InputError
from cobot.motions.planners import PlannerName as PlannerName
from cobot.pose import Numbers7 as Numbers7
from cobot.pose import Pose as Pose
from cobot.vectors import Array as Array
from cobot.vectors import vector as vector


class LoopMode(IntEnum):
    """What rtloop does in its cycle. Values are part of the shared-memory layout.

    HOLD keeps the last commanded position; only here may a motion or a streaming session begin.
    TRAJECTORY follows a planned motion; STOPPING brings the arm to rest, on its path if it is on one.
    JOINT_IMPEDANCE, CARTESIAN and JOINT_TORQUE follow what a client streams.
    ESTOP is latched by command or by a broken invariant, FAULT by the backend or the tracking;
    both come to rest, hold, and permit nothing until RESET.
    """

    HOLD = 0
    TRAJECTORY = 1
    STOPPING = 2
    ESTOP = 3
    FAULT = 4
    JOINT_IMPEDANCE = 5
    CARTESIAN = 6
    JOINT_TORQUE = 7


RESTING = frozenset({LoopMode.HOLD, LoopMode.ESTOP, LoopMode.FAULT})
"""In these modes nothing moves the arm, but for the end of a motion."""

STREAMING = frozenset({LoopMode.JOINT_IMPEDANCE, LoopMode.CARTESIAN, LoopMode.JOINT_TORQUE})
"""In these modes a client streams."""


Algorithm = Literal[
    "RRTConnect",
    "RRT",
    "RRTstar",
    "InformedRRTstar",
    "SORRTstar",
    "BITstar",
    "FMT",
    "BFMT",
    "PRM",
    "PRMstar",
    "KPIECE1",
    "BKPIECE1",
    "LBKPIECE1",
]
"""What planner ompl can search with, by OMPL's names."""
RRT_CONNECT: Algorithm = "RRTConnect"


FreeAxis = Literal["rx", "ry", "rz"]
"""A rotation of the TCP about its own x, y or z axis that a goal leaves free."""
FREE_AXES: tuple[FreeAxis, ...] = ("rx", "ry", "rz")


class Synchronization(StrEnum):
    """How the joints of a ptp motion keep together.

    TIME: they start and end together, each as it likes in between: the shortest time, and in general not
    straight in joint space. PHASE: they keep in proportion all the way, which is straight in joint space.
    """

    TIME = "time"
    PHASE = "phase"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """The limits of all joints, each shape (dof,): rad, rad/s, rad/s², rad/s³, N·m; of a slide (prismatic
    joint) m, m/s, m/s², m/s³, N.

    Attributes:
        slides: of each joint whether it is one; empty for none.
        QUANTITIES: the fields that are arrays.
    """

    QUANTITIES: ClassVar[tuple[str, ...]] = (
        "min_position", "max_position", "max_velocity", "max_acceleration", "max_jerk", "max_effort"
    )  # fmt: skip

    names: tuple[str, ...]
    min_position: Array
    max_position: Array
    max_velocity: Array
    max_acceleration: Array
    max_jerk: Array
    max_effort: Array
    slides: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        for quantity in self.QUANTITIES:
            value = vector(getattr(self, quantity), len(self.names), name=quantity)
            object.__setattr__(self, quantity, value)

    @property
    def dof(self) -> int:
        return len(self.names)

    def unit(self, joint: int, derivative: int = 0) -> str:
        """Of a joint's position, or of its velocity (1), acceleration (2) or jerk (3)."""
        length = "m" if self.slides and self.slides[joint] else "rad"
        return length + ("", "/s", "/s²", "/s³")[derivative]

    def effort_unit(self, joint: int) -> str:
        return "N" if self.slides and self.slides[joint] else "N·m"

    @property
    def units(self) -> str:
        """Of the positions of all joints together."""
        return "rad, of slides m" if any(self.slides) else "rad"

    def take_over(self, other: JointLimits) -> None:
        """Become these limits, of the same joints: whoever holds this object goes by them at once."""
        for quantity in self.QUANTITIES:
            mine = getattr(self, quantity)
            mine.flags.writeable = True
            mine[:] = getattr(other, quantity)
            mine.flags.writeable = False

    def including(self, position: Array) -> JointLimits:
        """The same, but no tighter than this position: an arm that was pushed beyond may go back."""
        if ((self.min_position <= position) & (position <= self.max_position)).all():
            return self
        low, high = np.minimum(self.min_position, position), np.maximum(self.max_position, position)
        return replace(self, min_position=low, max_position=high)

    def scaled(self, velocity: float, acceleration: float, jerk: float) -> JointLimits:
        """The same positions and efforts with the rates multiplied by the given fractions."""
        return self.with_rates(
            self.max_velocity * velocity, self.max_acceleration * acceleration, self.max_jerk * jerk
        )

    def with_rates(self, velocity: Array, acceleration: Array, jerk: Array) -> JointLimits:
        """The same with other rates, which are such arrays already and not looked at: every plan does this
        some times."""
        other = object.__new__(JointLimits)
        object.__setattr__(other, "names", self.names)
        object.__setattr__(other, "slides", self.slides)
        kept = (self.min_position, self.max_position, velocity, acceleration, jerk, self.max_effort)
        for quantity, value in zip(self.QUANTITIES, kept, strict=True):
            copied = value.copy()
            copied.flags.writeable = False
            object.__setattr__(other, quantity, copied)
        return other


@dataclass(frozen=True, slots=True)
class CartesianLimits:
    """The limits of the TCP along a path: m/s, m/s², m/s³ and rad/s, rad/s², rad/s³."""

    max_linear_velocity: float
    max_linear_acceleration: float
    max_linear_jerk: float
    max_angular_velocity: float
    max_angular_acceleration: float
    max_angular_jerk: float

    def scaled(self, velocity: float, acceleration: float, jerk: float) -> CartesianLimits:
        return CartesianLimits(
            self.max_linear_velocity * velocity,
            self.max_linear_acceleration * acceleration,
            self.max_linear_jerk * jerk,
            self.max_angular_velocity * velocity,
            self.max_angular_acceleration * acceleration,
            self.max_angular_jerk * jerk,
        )


@dataclass(frozen=True, slots=True)
class NamedPosition:
    """A `group_state` of the SRDF: joint angles in rad, in the order of the joint limits."""

    name: str
    group: str
    joints: tuple[float, ...]
    description: str = ""


PLANNED_JERK = 0.8
"""The share of the jerk limits that planned motions use at the most: a stop on the path has to add jerk of
its own, and can begin at once only if the motion has left some."""
PLANNED_ACCELERATION = 0.95
"""The share of the acceleration limits that motions timed along a path use at the most: such a motion is at
some limit nearly all the time, and whoever pauses, resumes or stops it needs some room."""
PLANNED_EFFORT = 0.98
"""The share of the efforts that planned motions use at the most, except where holding the arm needs nearly as
much: a drive that gives all it has cannot correct its position."""


@dataclass(frozen=True, slots=True)
class Scaling:
    """How much of the limits a motion may use, as fractions in (0, 1].

    Velocity is scaled by `speed`; acceleration by `accel_scale`, or by `speed` when `accel_scale`
    is 0; jerk by the same fraction as acceleration, but to no more than `PLANNED_JERK` of its limit.
    """

    speed: float = 0.1
    accel_scale: float = 0.0

    def __post_init__(self) -> None:
        if not 0.01 <= self.speed <= 1.0:
            raise InputError(f"speed must be from 0.01 to 1.0, got {self.speed}")
        if not 0.0 <= self.accel_scale <= 1.0:
            raise InputError(f"accel_scale must be from 0 to 1.0, got {self.accel_scale}")

    @property
    def acceleration(self) -> float:
        return self.accel_scale or self.speed

    @property
    def jerk(self) -> float:
        return min(self.acceleration, PLANNED_JERK)


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A timed point of a joint trajectory: rad, s, and optionally rad/s and rad/s²."""

    positions: Sequence[float]
    time_from_start_s: float
    velocities: Sequence[float] | None = None
    accelerations: Sequence[float] | None = None
    label: str = field(default="", compare=False)

    def __reduce__(self) -> tuple[type[Waypoint], tuple[Any, ...]]:
        """For pickle, several times faster than a dataclass's own way: there may be 100,000 of them."""
        values = (self.positions, self.time_from_start_s, self.velocities, self.accelerations, self.label)
        return Waypoint, values
