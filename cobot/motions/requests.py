"""What a planner is asked for, and what comes of several motions: data that travels to planning processes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cobot.motions.checks import check_request
from cobot.motions.constraints import Constraints
from cobot.motions.planners import PLANNERS, PlannerName, PlannerTraits
from cobot.motions.points import REST, WaysOut
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import (
    RRT_CONNECT,
    Algorithm,
    Array,
    CartesianLimits,
    FreeAxis,
    JointLimits,
    Pose,
    Scaling,
    Synchronization,
    Waypoint,
)


@dataclass(frozen=True, slots=True)
class Arc:
    """What makes an arc without a point on it.

    Attributes:
        centre: shape (3,), m in the base frame.
        axis: shape (3,), any length, in the base frame: the arc turns about it by the right hand; None for an
            arc that leads to the goal the short way.
        angle_rad: how far it turns about the axis; several turns too. None: it leads to the goal.
        rise_m: how far the TCP moves along the axis meanwhile: a helix.
        turns_tool: the hand turns with the arc instead of keeping its orientation. With an angle only.
    """

    centre: Array
    axis: Array | None = None
    angle_rad: float | None = None
    rise_m: float = 0.0
    turns_tool: bool = False


@dataclass(frozen=True, slots=True)
class TcpSpeed:
    """How fast the TCP may be at the most along a path: m/s and rad/s; None for what the limits permit."""

    linear_m_s: float | None = None
    angular_rad_s: float | None = None


ANY_SPEED = TcpSpeed()


NO_START = np.empty(0)
"""The start of a motion that begins where the arm will be."""


@dataclass(frozen=True, slots=True)
class MotionRequest:
    """A motion from rest to rest, valid for some robot once it is made. Picklable: it travels to the planning
    workers.

    A goal is a request whose start is not known yet: its `start` is `NO_START`.

    Attributes:
        start: shape (dof,), rad.
        goal: joint angles, shape (dof,), rad, or a pose of the TCP in the base frame.
        planner: what plans it; `cobot.motions.planners` says which of the fields below it uses.
        via: shape (3,), m in the base frame: a point on the arc.
        seed: of the planners that draw random samples.
        timeout_s: after which a search gives up.
        algorithm: of ompl.
        synchronization: of the joints.
        arc: instead of `via`. With an angle the goal does not count.
        through: poses on the way to the goal.
        radius_m: how far from each of them the TCP may leave its path to go on without a stop; 0: it stops.
        tcp_speed: of a path of the TCP.
        constraints: what the whole motion keeps to; None: nothing but the limits.
        free_axes: the rotations of the TCP that poses do not fix, about its own axes: none, one or all three.
        cyclic: a path of the TCP that leads back to its start ends in the joints it began with. None: full
            circles do if they can, all others end where they lead.
        end_joints: in which a path of the TCP to a pose ends, shape (dof,), rad; None: where it leads.
        in_tool: all poses and points are in the TCP's frame at the start, not yet in the base frame.

    Raises:
        InputError: fields that do not fit the planner or each other.
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

    def __post_init__(self) -> None:
        check_request(self)

    @property
    def traits(self) -> PlannerTraits:
        """What is known of its planner."""
        return PLANNERS[self.planner]

    @property
    def is_by_angle(self) -> bool:
        """Whether it is an arc that ends where its angle leads."""
        return self.arc is not None and self.arc.angle_rad is not None

    @property
    def is_relative(self) -> bool:
        """Whether it ends elsewhere if it begins elsewhere."""
        return self.in_tool or self.is_by_angle

    def scaled_limits(self, robot: RobotDescription) -> JointLimits:
        """The share of the joint limits that this motion may use."""
        scaling = self.scaling
        return robot.limits.scaled(scaling.speed, scaling.acceleration, scaling.jerk)


@dataclass(frozen=True, slots=True)
class WaypointRequest:
    """A motion through timed points.

    Attributes:
        start: where the arm is, shape (dof,), rad.
        points: see `through`.
        start_tolerance_rad: how far a first point at time 0 may be from `start`.
        check_limits: velocity, acceleration, jerk and position limits; collisions are always checked.
        retime: slow the motion down by as much as the rate limits need, instead of refusing it.
        corridor_rad: how far each joint may be beside the curve through the points where that exceeds the
            limits, shape (dof,) or one for all; 0: nothing is smoothed, and all is slowed down evenly.
        longest_s: what `retime` may make of the duration, without `approach`.
        approach: go to the first point by ptp before, with this scaling; None: it must be at `start`.
        ways: what an error advises.
    """

    start: Array
    points: Sequence[Waypoint]
    start_tolerance_rad: float
    check_limits: bool = True
    retime: bool = False
    approach: Scaling | None = None
    corridor_rad: Array | float = 0.0
    longest_s: float = math.inf
    ways: WaysOut = REST


@dataclass(frozen=True, slots=True)
class Envelope:
    """What holds for all motions: the limits, which may be tighter than the robot's."""

    limits: JointLimits
    cartesian: CartesianLimits


@dataclass(frozen=True, slots=True)
class RatedMove:
    """A motion whose velocity and acceleration are given in units. Picklable.

    Attributes:
        request: the motion. Its `scaling` counts too, if it is lower.
        velocity, acceleration: of the fastest joint, rad/s and rad/s²; for a path of the TCP those of the
            tool's tip, m/s and m/s², which turns in proportion.
        envelope: the limits.
        duration_s: if above 0, how long the motion takes; velocity and acceleration do not count then.
    """

    request: MotionRequest
    velocity: float
    acceleration: float
    envelope: Envelope
    duration_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Blended:
    """Several motions as one.

    Attributes:
        ends_s: when each motion gives way to the next one: in the middle of their overlap.
        blended: for each corner, whether the arm goes through without a stop.
        used_m: for each corner, how far from it the TCP leaves its path, of the radius.
    """

    trajectory: Trajectory
    ends_s: tuple[float, ...]
    blended: tuple[bool, ...]
    used_m: tuple[float, ...] = ()
