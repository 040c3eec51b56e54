"""Requests to the planners, and the result of blending. All of them are picklable, because they are sent to
planning processes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cobot.motions.checks import check_request
from cobot.motions.constraints import Constraints
from cobot.motions.planners import PLANNERS, PlannerName, PlannerTraits
from cobot.motions.points import REST, WaysOut
from cobot.motions.signals import NO_SIGNALS, PathSignals
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
        check_request(self)

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


@dataclass(frozen=True, slots=True)
class WaypointRequest:
    """A motion through timed points.

    Attributes:
        start: the arm's joint positions, shape (dof,), rad.
        points: the timed points.
        start_tolerance_rad: maximum distance between `start` and a first point at time 0, rad.
        check_limits: whether the position, velocity, acceleration and jerk limits are checked. Collisions are
            always checked.
        retime: whether the motion is slowed down until it keeps the rate limits, instead of being rejected.
        corridor_rad: maximum deviation of each joint from the curve through the points if it violates the
            limits, shape (dof,) or one value for all joints. 0 means that the curve is kept, and the whole
            motion is slowed down.
        longest_s: maximum duration after `retime`, s, without `approach`.
        approach: scaling of a ptp motion to the first point; None means that the first point must be at
            `start`.
        ways: advice for error messages.
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
