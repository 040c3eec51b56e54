"""Data types that all packages share: frozen dataclasses in SI units, with quaternions (w, x, y, z)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from typing import Any, ClassVar, Literal

import numpy as np

from cobot.errors import InputError
from cobot.motions.planners import PlannerName as PlannerName
from cobot.pose import Array as Array
from cobot.pose import Numbers3 as Numbers3
from cobot.pose import Numbers6 as Numbers6
from cobot.pose import Numbers7 as Numbers7
from cobot.pose import Pose as Pose
from cobot.pose import vector as vector


class LoopMode(IntEnum):
    """Mode of the real-time loop. The values are part of the shared-memory layout.

    HOLD keeps the last commanded position. Motions and streaming sessions can start only in this mode.
    TRAJECTORY executes a planned motion. STOPPING stops the arm, on its path if it has one.
    JOINT_IMPEDANCE, CARTESIAN and JOINT_TORQUE follow the targets that a client streams.
    ESTOP is latched by a command or a violated invariant, FAULT by the backend or a tracking error. Both stop
    the arm, hold it, and permit no motion until RESET.
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
"""Modes in which nothing moves the arm. Exception: a motion may still be ending."""

STREAMING = frozenset({LoopMode.JOINT_IMPEDANCE, LoopMode.CARTESIAN, LoopMode.JOINT_TORQUE})
"""Modes in which a client streams targets."""

TIME_FACTORS = (0.1, 4.0)
"""Smallest and largest time factor of a simulation."""
MAX_BUDGET_S = 10.0
"""Maximum planning budget of a motion, s."""
MAX_ACTIONS = 64
"""Maximum number of actions of a motion. It does not depend on the number of its segments."""

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
"""Search algorithms of the planner `ompl`, by OMPL's names."""
RRT_CONNECT: Algorithm = "RRTConnect"


PictureView = Literal["iso", "front", "side", "top"]
"""Position of the camera for a picture."""
FreeAxis = Literal["rx", "ry", "rz"]
"""A rotation of the TCP about its own x, y or z axis that a goal leaves free."""
FREE_AXES: tuple[FreeAxis, ...] = ("rx", "ry", "rz")


class Synchronization(StrEnum):
    """Synchronization of the joints in a ptp motion.

    TIME: all joints start and end together, but move independently in between. The motion takes the shortest
    time and is usually not straight in joint space. PHASE: all joints move in proportion, so the motion is
    straight in joint space.
    """

    TIME = "time"
    PHASE = "phase"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """The limits of all joints, each of shape (dof,).

    Units are rad, rad/s, rad/s², rad/s³ and N·m. For a linear joint they are m, m/s, m/s², m/s³ and N.

    Attributes:
        slides: whether each joint is linear; empty if no joint is.
        QUANTITIES: names of the fields that are arrays.
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
        """The unit of a joint's position, velocity (1), acceleration (2) or jerk (3)."""
        length = "m" if self.slides and self.slides[joint] else "rad"
        return length + ("", "/s", "/s²", "/s³")[derivative]

    def effort_unit(self, joint: int) -> str:
        return "N" if self.slides and self.slides[joint] else "N·m"

    @property
    def units(self) -> str:
        """The unit of the positions of all joints together."""
        return "rad, of slides m" if any(self.slides) else "rad"

    def take_over(self, other: JointLimits) -> None:
        """Copy the limits of another object for the same joints into this one.

        All users of this object then have the new limits.
        """
        for quantity in self.QUANTITIES:
            mine = getattr(self, quantity)
            mine.flags.writeable = True
            mine[:] = getattr(other, quantity)
            mine.flags.writeable = False

    def including(self, position: Array) -> JointLimits:
        """Return limits that are wide enough to include the given position, so that an arm pushed beyond its
        limits can move back.
        """
        if ((self.min_position <= position) & (position <= self.max_position)).all():
            return self
        low, high = np.minimum(self.min_position, position), np.maximum(self.max_position, position)
        return replace(self, min_position=low, max_position=high)

    def scaled(self, velocity: float, acceleration: float, jerk: float) -> JointLimits:
        """The limits with velocity, acceleration and jerk multiplied by the given fractions."""
        return self.with_rates(
            self.max_velocity * velocity, self.max_acceleration * acceleration, self.max_jerk * jerk
        )

    def with_rates(self, velocity: Array, acceleration: Array, jerk: Array) -> JointLimits:
        """The same limits with different velocities, accelerations and jerks. These must be valid arrays.
        They are not checked, because each plan calls this several times.
        """
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
    """The limits of the TCP along a path, in m/s, m/s², m/s³ and rad/s, rad/s², rad/s³."""

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
    """A `group_state` of the SRDF, with joint angles in rad in the order of the joint limits.

    Attributes:
        label: display name, in any language; "" if `name` is also the display name.
    """

    name: str
    group: str
    joints: tuple[float, ...]
    description: str = ""
    label: str = ""


PLANNED_JERK = 0.8
"""Maximum share of the jerk limits in planned motions. A stop on the path adds jerk, and can start
immediately only if the motion leaves a margin.
"""
PLANNED_ACCELERATION = 0.95
"""Maximum share of the acceleration limits in motions that are time-parameterized along a path. Such a motion
is almost always at some limit. Pausing, resuming or stopping it needs a margin.
"""


@dataclass(frozen=True, slots=True)
class Scaling:
    """The share of the limits that a motion may use, as fractions in (0, 1].

    `speed` scales the velocity. `accel_scale` scales the acceleration; if it is 0, `speed` also scales the
    acceleration. The jerk is scaled like the acceleration, up to `PLANNED_JERK` of its limit.
    """

    speed: float = 0.1
    accel_scale: float = 0.0

    def __post_init__(self) -> None:
        if not 0.01 <= self.speed <= 1.0:
            raise InputError(f"speed must be from 0.01 to 1.0, got {self.speed}")
        if not 0.0 <= self.accel_scale <= 1.0:
            raise InputError(f"accel_scale must be from 0 to 1.0, got {self.accel_scale}")

    @property
    def shares(self) -> tuple[float, float, float]:
        """The shares of the velocity, acceleration and jerk limits."""
        acceleration = self.accel_scale or self.speed
        return self.speed, acceleration, min(acceleration, PLANNED_JERK)


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A timed point of a joint trajectory, in rad and s. Velocities, rad/s, and accelerations, rad/s², are
    optional.
    """

    positions: Sequence[float]
    time_from_start_s: float
    velocities: Sequence[float] | None = None
    accelerations: Sequence[float] | None = None
    label: str = field(default="", compare=False)

    def __reduce__(self) -> tuple[type[Waypoint], tuple[Any, ...]]:
        """Pickle the waypoint, several times faster than the default for dataclasses.

        A motion may contain 100,000 waypoints.
        """
        values = (self.positions, self.time_from_start_s, self.velocities, self.accelerations, self.label)
        return Waypoint, values
