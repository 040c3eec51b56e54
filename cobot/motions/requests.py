"""Requests to the planners, and the result of blending. All of them are picklable, because they are sent to
planning processes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cobot.errors import InputError
from cobot.motions.constraints import Constraints
from cobot.motions.planners import BODY_FIELDS, PLANNERS, PlannerName, PlannerTraits, Way, users_of
from cobot.motions.signals import NO_SIGNALS, PathSignals
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import (
    FREE_AXES,
    RRT_CONNECT,
    Algorithm,
    Array,
    CartesianLimits,
    FreeAxis,
    JointLimits,
    Pose,
    Scaling,
    Synchronization,
)

MIN_AXIS_LENGTH = 1e-3
"""Minimum length of a vector that gives a direction."""


@dataclass(frozen=True, slots=True)
class Arc:
    """An arc that is defined by its centre, not by a point that it passes through.

    Attributes:
        centre: centre of the arc in the base frame, shape (3,), m.
        axis: vector of any length in the base frame, shape (3,). The arc turns about it by the right-hand
            rule. None means the shorter arc to the goal.
        angle_rad: angle of the arc, rad, which may be more than one turn. None means that the arc ends at the
            goal.
        rise_m: distance of the TCP along the axis during the arc, for a helix.
        turns_tool: whether the tool turns with the arc instead of keeping its orientation. Needs an angle.
    """

    centre: Array
    axis: Array | None = None
    angle_rad: float | None = None
    rise_m: float = 0.0
    turns_tool: bool = False


@dataclass(frozen=True, slots=True)
class TcpSpeed:
    """Maximum speed of the TCP along a path. None means as fast as the limits permit."""

    linear_m_s: float | None = None
    angular_rad_s: float | None = None


ANY_SPEED = TcpSpeed()


NO_START = np.empty(0)
"""The value of `start` for a motion that will begin at a position that is not known yet."""


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """A motion from rest to rest. The constructor validates everything that does not depend on the robot.
    Picklable.

    A goal is a request whose start is not known yet: its `start` is `NO_START`.

    Attributes:
        start: joint angles at the start, shape (dof,), rad.
        goal: joint angles, shape (dof,), rad, or a pose of the TCP in the base frame.
        planner: planner name. `cobot.motions.planners` lists the fields that each planner uses.
        via: a point on the arc in the base frame, shape (3,), m.
        seed: seed for planners that draw random samples.
        timeout_s: time limit of a search.
        budget_s: time for planning, s. The time that remains after the first motion is used to find faster
            ones. 0 means that the first motion is the result.
        algorithm: algorithm of planner ompl.
        synchronization: synchronization of the joints.
        arc: definition of the arc, which replaces `via`. If it gives an angle, the goal is ignored.
        through: poses on the way to the goal.
        radius_m: blend radius at these poses; 0 means that the TCP stops there.
        tcp_speed: maximum TCP speed.
        constraints: path constraints; None means that only the limits apply.
        free_axes: axes of the TCP about which its rotation is free: none, one or all three.
        cyclic: whether a closed path of the TCP ends at the joint angles at which it began. With None, full
            circles do so if possible, and other paths end at the joint angles that follow from the path.
        end_joints: joints at the end of a TCP path to a pose, shape (dof,), rad; None means any.
        signals: actions on the path, and conditions. Planners do not use them.
        in_tool: whether all poses and points are in the TCP's frame at the start instead of the base frame.

    Raises:
        InputError: fields do not match the planner or each other.
    """

    start: Array
    goal: Array | Pose
    planner: PlannerName
    scaling: Scaling
    via: Array | None = None
    seed: int = 0
    timeout_s: float = 10.0
    algorithm: Algorithm = RRT_CONNECT
    synchronization: Synchronization = Synchronization.TIME
    arc: Arc | None = None
    through: tuple[Pose, ...] = ()
    radius_m: float = 0.0
    tcp_speed: TcpSpeed = ANY_SPEED
    constraints: Constraints | None = None
    free_axes: tuple[FreeAxis, ...] = ()
    cyclic: bool | None = None
    end_joints: Array | None = None
    in_tool: bool = False
    signals: PathSignals = NO_SIGNALS
    budget_s: float = 0.0

    def __post_init__(self) -> None:
        traits = self.traits
        if traits.way is Way.PATH and not isinstance(self.goal, Pose):
            raise InputError(f"{self.planner} needs a pose as its goal, not joint angles")
        given = [field for field in BODY_FIELDS if _is_given(self, field)]
        for field in given:
            if field not in traits.fields:
                users = users_of(field)
                planners = users if "," in users else f"planner {users}"
                raise InputError(f"{_named(self, field)} is for {planners} only, not for {self.planner}")
        _require_one(self, given)
        if self.constraints is not None and self.algorithm != RRT_CONNECT:
            raise InputError(
                f"constraints: {self.algorithm} does not support them; use algorithm {RRT_CONNECT}"
            )
        if self.cyclic and self.end_joints is not None:
            raise InputError("cyclic, end_joints: give one of them, not both")
        if self.arc is not None:
            _check_arc(self.arc)
        if self.free_axes:
            _check_free_axes(self.free_axes)

    @property
    def traits(self) -> PlannerTraits:
        """The traits of the requested planner."""
        return PLANNERS[self.planner]

    @property
    def is_by_angle(self) -> bool:
        """Whether the angle of an arc determines the end."""
        return self.arc is not None and self.arc.angle_rad is not None

    @property
    def is_relative(self) -> bool:
        """Whether the end depends on the start."""
        return self.in_tool or self.is_by_angle

    def scaled_limits(self, robot: RobotDescription) -> JointLimits:
        """The joint limits, scaled as the request demands."""
        return robot.limits.scaled(*self.scaling.shares)

    def check_for(self, robot: RobotDescription) -> None:
        """Check that the number of end joints and the TCP speed are allowed for a robot.

        Raises:
            InputError: a value is not allowed; the message names the field, its value and what is allowed.
        """
        end, dof = self.end_joints, robot.limits.dof
        if end is not None and len(end) != dof:
            raise InputError(f"end_joints: must have {dof} angles, got {len(end)}")
        speed, tcp = self.tcp_speed, robot.cartesian_limits
        for name, value, limit, setting, unit in (
            ("speed_m_s", speed.linear_m_s, tcp.max_linear_velocity, "max_linear_velocity", "m/s"),
            ("speed_rad_s", speed.angular_rad_s, tcp.max_angular_velocity, "max_angular_velocity", "rad/s"),
        ):
            if value is not None and not 0.0 < value <= limit:
                raise InputError(
                    f"{name}: is {value:g} {unit}, allowed: above 0 and up to {limit:g} {unit} "
                    f"(planning.{setting})"
                )


def _is_given(request: MotionRequest, field: str) -> bool:
    """Whether a request gives an optional field. A false `cyclic` is treated as not given."""
    value = getattr(request, field)
    if value is None or value is False or isinstance(value, np.ndarray):
        return isinstance(value, np.ndarray)
    return bool(value != request.__dataclass_fields__[field].default)


def _named(request: MotionRequest, field: str) -> str:
    """A field as the beginning of an error: its name in JSON, and its value if that is a word."""
    value = getattr(request, field)
    if field == "tcp_speed" and value.linear_m_s is None:
        return f"{BODY_FIELDS[field][1]}:"
    name = BODY_FIELDS[field][0]
    return f"{name}: {value}" if isinstance(value, str) else f"{name}:"


def _require_one(request: MotionRequest, given: list[str]) -> None:
    """Check that the request gives exactly one of the fields that its planner needs."""
    traits = request.traits
    needed = [field for field in traits.needs if field in given]
    if traits.needs and not needed:
        raise InputError(traits.missing)
    if len(needed) > 1:
        names = ", ".join(BODY_FIELDS[field][0] for field in needed)
        raise InputError(f"{names}: give only one of them; it defines the path of planner {request.planner}")


def _check_arc(arc: Arc) -> None:
    """Check that an arc has an angle other than 0, and that its axis gives a direction."""
    if arc.angle_rad == 0.0:
        raise InputError("angle: is 0 rad, so there is no arc, even with a rise; for a line use lin")
    if arc.axis is not None and not math.hypot(*arc.axis) > MIN_AXIS_LENGTH:
        length = math.hypot(*arc.axis)
        raise InputError(
            f"axis: has a length of {length:g}, so it has no direction; the length must be above "
            f"{MIN_AXIS_LENGTH:g}"
        )


def _check_free_axes(free: Sequence[str]) -> None:
    """Check that one axis or all three are free. A free rotation about two axes would also free the third."""
    valid = ", ".join(FREE_AXES)
    for index, axis in enumerate(free):
        if axis not in FREE_AXES:
            raise InputError(
                f"free_axes[{index}]: there is no axis {axis!r}; valid names: {valid}, the rotations "
                "about the tool's x, y and z axis"
            )
        if axis in free[:index]:
            raise InputError(f"free_axes[{index}]: {axis} is given twice")
    if len(free) == len(FREE_AXES) - 1:
        raise InputError(
            f"free_axes: {' and '.join(free)} together already allow every orientation; "
            f"give one of {valid}, or all three if only the position matters"
        )


@dataclass(frozen=True, slots=True)
class Envelope:
    """Limits that apply to all motions. They may be lower than those of the robot."""

    limits: JointLimits
    cartesian: CartesianLimits


@dataclass(frozen=True, slots=True)
class RatedMove:
    """A motion whose velocity and acceleration are given in units, not as shares of the limits. Picklable.

    Attributes:
        request: the motion. Its `scaling` also applies; of two limits, the lower one applies.
        velocity, acceleration: limits of the fastest joint, rad/s and rad/s². For a TCP path they are the TCP
            limits, m/s and m/s², and its rotation is limited in proportion.
        envelope: the limits that apply to all motions.
        duration_s: motion duration. If it is above 0, velocity and acceleration are ignored.
    """

    request: MotionRequest
    velocity: float
    acceleration: float
    envelope: Envelope
    duration_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Blended:
    """Several motions joined into one.

    Attributes:
        ends_s: the time, s, at which each motion ends and the next begins. It is the middle of their blend.
        blended: for each corner, whether the arm passes it without a stop.
        used_m: for each corner, the distance from the corner at which the TCP leaves the path, m. It is at
            most the blend radius.
    """

    trajectory: Trajectory
    ends_s: tuple[float, ...]
    blended: tuple[bool, ...]
    used_m: tuple[float, ...] = ()
