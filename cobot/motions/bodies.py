"""Motion requests as JSON: request bodies of the REST API, and targets in sequences and programs.

Their form and bounds are defined here and in `cobot.motions.fields`. Values that depend on the robot (joints,
frames, reach) are checked by `MotionRequest`, the services and the planners.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    Discriminator,
    FailFast,
    Field,
    Tag,
)

from cobot.loose_lists import RequestModel
from cobot.motions.fields import (
    HOME,
    MAX_ARC_RAD,
    AccelScale,
    Angle,
    Budget,
    Coordinate,
    Direction,
    Finite,
    JointPlanner,
    OmplAlgorithm,
    Planner,
    Speed,
    SynchronizationName,
    Within,
    example,
    limit_entries,
)
from cobot.motions.planners import users_of
from cobot.motions.signal_bodies import SignalFields
from cobot.types import RRT_CONNECT, FreeAxis
from cobot.units import require_angle


class PathPoint(RequestModel):
    """A point in the frame of the motion, m."""

    x: Coordinate = Field(description="m")
    y: Coordinate = Field(description="m")
    z: Coordinate = Field(description="m")


class KeptOrientation(RequestModel):
    """Constraint that keeps an axis of the tool near a direction, for example to keep a glass upright."""

    tool_axis: Direction = Field(
        Direction(x=0.0, y=0.0, z=1.0), description="Axis of the tool, in the TCP's frame."
    )
    direction: Direction | None = Field(
        None, description="Direction of the axis, in the base frame. Default: its direction at the start."
    )
    within_rad: Finite = Field(
        gt=0.0, le=math.pi, description="Largest angle between axis and direction, rad."
    )


class KeptBox(RequestModel):
    """A box, aligned with the base frame, that the TCP does not leave."""

    min: PathPoint = Field(description="Corner with the smallest coordinates, m.")
    max: PathPoint = Field(description="Corner with the largest coordinates, m.")


class MotionConstraints(RequestModel):
    """Constraints on the whole motion, including its start and goal."""

    orientation: KeptOrientation | None = Field(
        None, description="Constraint on the orientation of the tool."
    )
    box: KeptBox | None = Field(None, description="Constraint on the position of the TCP.")
    joints: Annotated[
        dict[str, Annotated[list[Finite], Field(min_length=2, max_length=2)]], limit_entries(64)
    ] = Field({}, max_length=64, description="Smallest and largest angle of joints, by name, rad.")


KeptTo = Annotated[
    MotionConstraints | None,
    Field(
        description="Constraints in addition to the limits. ompl (RRTConnect) observes them. A motion of any "
        "other planner that violates them is rejected."
    ),
]


class JointMotion(SignalFields):
    """Fields of a motion to joint angles."""

    speed: Speed = 0.1
    accel_scale: AccelScale = 0.0
    planner: JointPlanner = "ptp"
    budget_s: Budget = None
    algorithm: OmplAlgorithm = RRT_CONNECT
    synchronization: SynchronizationName = "time"
    constraints: KeptTo = None


PositionName = Annotated[
    str, Field(max_length=200, description="Name of a position in GET /robot/positions.")
]
Joints = Annotated[list[Finite], Field(min_length=1, max_length=64, description="One angle per joint, rad.")]


class MoveNamed(JointMotion):
    """A motion to a named position."""

    model_config = example({"name": "home", "speed": 0.25})

    name: PositionName


class MoveJoints(JointMotion):
    """A motion to joint angles."""

    model_config = example({"joints": [0.0, 0.5, *HOME[2:]], "speed": 0.25})

    joints: Joints


class PathPose(RequestModel):
    """A pose of the TCP in the frame of the motion."""

    x: Coordinate = Field(description="m")
    y: Coordinate = Field(description="m")
    z: Coordinate = Field(description="m")
    a: Angle = Field(0.0, description="KUKA angle A about z, rad")
    b: Angle = Field(0.0, description="KUKA angle B about the new y, rad")
    c: Angle = Field(0.0, description="KUKA angle C about the newest x, rad")


MetresPerSecond = Annotated[
    Finite | None,
    Field(description=f"Maximum TCP speed in {users_of('tcp_speed')}, m/s. With it `speed` defaults to 1."),
]
RadPerSecond = Annotated[Finite | None, Field(description="Like `speed_m_s`, for rotation, rad/s.")]
FrameId = Annotated[
    str,
    Field(
        max_length=200,
        description="Frame of all poses and points: empty for the default frame, the base, world, tool (the "
        "TCP's frame at the start of the motion), or a body or site of the model that no joint moves.",
    ),
]


Radius = Annotated[Finite, Field(ge=0.0, le=1.0)]


FreeAxes = Annotated[
    list[FreeAxis],
    Field(
        max_length=3,
        description="Rotations of the tool that the pose does not fix, about its own axes: one of rx, ry and "
        "rz, or all three if only the position matters. An arm with five joints points its tool down with "
        "rz.",
    ),
]


Cyclic = Annotated[
    bool | None,
    Field(
        description="true: a path that leads back to its start ends at the joint angles it began with, so "
        "that it can be repeated. null: full circles do so if possible; other paths end at the joint angles "
        "that follow from them."
    ),
]


class TcpMotion(SignalFields):
    """Fields of a TCP motion to a pose or along a path."""

    speed: Speed = 0.1
    accel_scale: AccelScale = 0.0
    speed_m_s: MetresPerSecond = None
    speed_rad_s: RadPerSecond = None
    frame_id: FrameId = ""
    constraints: KeptTo = None
    free_axes: FreeAxes = Field([])
    cyclic: Cyclic = None


class MoveArc(TcpMotion):
    """An arc about an axis, given by its angle. It may be a full circle or a helix."""

    model_config = example(
        {"centre": {"x": 0.5, "y": 0.0, "z": 0.5}, "axis": {"x": 0.0, "y": 0.0, "z": 1.0}, "angle": 0.5}
    )

    centre: PathPoint = Field(description="Point on the axis, m.")
    axis: PathPoint = Field(
        description="Direction of the axis, of any length. The arc turns about it by the right-hand rule."
    )
    angle: Annotated[float, Field(allow_inf_nan=False), Within(require_angle, MAX_ARC_RAD)] = Field(
        description="Angle of the arc, rad. It may be more than one turn."
    )
    rise: Finite = Field(
        0.0,
        ge=-10.0,
        le=10.0,
        description="Distance of the TCP along the axis during the arc, m. If it is not 0, the path is a "
        "helix.",
    )
    turn_tool: bool = Field(False, description="true: the tool turns with the arc. false: it does not.")


class MovePose(TcpMotion, PathPose):
    """A motion of the TCP to a pose."""

    model_config = example(
        {
            "x": 0.4,
            "y": 0.0,
            "z": 0.5,
            "a": 0.0,
            "b": 3.14159,
            "c": 0.0,
            "speed": 0.25,
            "planner": "ptp",
        }
    )

    planner: Planner = "ptp"
    budget_s: Budget = None
    algorithm: OmplAlgorithm = RRT_CONNECT
    synchronization: SynchronizationName = "time"
    via: PathPoint | None = Field(
        None, description=f"For {users_of('via')}: point on the arc, m. Give this or `centre`."
    )
    centre: PathPoint | None = Field(None, description=f"For {users_of('arc')}: centre of the arc, m.")
    axis: PathPoint | None = Field(
        None,
        description="With `centre`: axis about which the arc turns, by the right-hand rule. Default: the "
        "short way.",
    )
    end_joints: Annotated[list[Finite], Field(min_length=1, max_length=64)] | None = Field(
        None,
        description=f"For {users_of('end_joints')}: joint angles at the end, rad; their pose must be the "
        "goal. With them a line back to an earlier pose ends at the joint angles that the arm had there.",
    )
    through: Annotated[list[PathPose], FailFast()] = Field(
        [], max_length=200, description=f"For {users_of('through')}: poses on the way."
    )
    radius: Radius = Field(
        0.0,
        description=f"For {users_of('radius_m')}: blend radius at each of these poses, m. Within it the "
        "TCP may leave its path to continue without a stop. 0: the TCP stops there.",
    )


NAMED, JOINT, ARC, POSE = MOTION_TAGS = ("named motion", "joint motion", "arc motion", "pose motion")
KINDS = {"name": NAMED, "named": NAMED, "joints": JOINT, "angle": ARC}


def kind_of(value: Any) -> str:
    """The tag of a motion, one of `MOTION_TAGS`. The first key of `KINDS` that occurs in the motion decides;
    without such a key the tag is `POSE`.
    """
    keys = value if isinstance(value, dict) else vars(value) if isinstance(value, BaseModel) else ()
    return next((tag for key, tag in KINDS.items() if key in keys), POSE)


AnyMotion = Annotated[
    Annotated[MoveNamed, Tag(NAMED)]
    | Annotated[MoveJoints, Tag(JOINT)]
    | Annotated[MoveArc, Tag(ARC)]
    | Annotated[MovePose, Tag(POSE)],
    Discriminator(kind_of),
]
MAX_MOTIONS = 50
"""Maximum number of motions that are planned as one."""


class MoveSequence(RequestModel):
    """Motions in sequence, with a blend radius between each two."""

    model_config = example(
        {
            "motions": [
                {"joints": [0.0, 0.5, *HOME[2:]], "speed": 0.25},
                {"joints": [0.5, 0.5, *HOME[2:]], "speed": 0.25},
                {"name": "home", "speed": 0.25},
            ],
            "radii": [0.05, 0.05],
        }
    )

    motions: Annotated[list[AnyMotion], FailFast()] = Field(
        min_length=1,
        max_length=MAX_MOTIONS,
        description="Bodies of move/named, move/joints, move/pose and move/arc, mixed.",
    )
    radii: list[Radius] = Field(
        [],
        max_length=MAX_MOTIONS - 1,
        description="Blend radius at the end of each motion except the last, m. Within it the TCP may "
        "leave its path to "
        "continue without a stop. 0: the arm stops. Without radii the arm stops at the end of each motion.",
    )
