"""Requests for motions as JSON: the bodies of the REST API, the targets of sequences and programs.

Their form and bounds have their home here and in `cobot.motions.fields`. What depends on the robot (joints,
frames, reach) is checked by `cobot.motions.checks`, the services and the planners.
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
    Coordinate,
    Finite,
    JointPlanner,
    OmplAlgorithm,
    Planner,
    Speed,
    SynchronizationName,
    Within,
    example,
    few,
)
from cobot.motions.planners import users_of
from cobot.types import RRT_CONNECT, FreeAxis
from cobot.units import require_angle


class PathPoint(RequestModel):
    """A point in the frame of the motion, m."""

    x: Coordinate = Field(description="m")
    y: Coordinate = Field(description="m")
    z: Coordinate = Field(description="m")


class Direction(RequestModel):
    """A direction, of any length but 0."""

    x: Coordinate = Field(description="Of any unit.")
    y: Coordinate = Field(description="Of any unit.")
    z: Coordinate = Field(description="Of any unit.")


class KeptOrientation(RequestModel):
    """An axis of the tool stays near a direction: a glass stays upright."""

    tool_axis: Direction = Field(Direction(x=0.0, y=0.0, z=1.0), description="In the TCP's frame.")
    direction: Direction | None = Field(
        None, description="In the base frame; without it where the axis points at the start."
    )
    within_rad: Finite = Field(gt=0.0, le=math.pi, description="So near it stays, rad.")


class KeptBox(RequestModel):
    """The TCP stays in a box along the axes of the base frame."""

    min: PathPoint = Field(description="The corner with the least coordinates, m.")
    max: PathPoint = Field(description="The opposite corner, m.")


class MotionConstraints(RequestModel):
    """What the whole motion keeps to, its start and goal included."""

    orientation: KeptOrientation | None = Field(None, description="Of the tool.")
    box: KeptBox | None = Field(None, description="For the TCP.")
    joints: Annotated[dict[str, Annotated[list[Finite], Field(min_length=2, max_length=2)]], few(64)] = Field(
        {}, max_length=64, description="Joints by their names, each with its least and greatest angle, rad."
    )


KeptTo = Annotated[
    MotionConstraints | None,
    Field(
        description="What the motion keeps to beside the limits. ompl (RRTConnect) plans so; motions of all "
        "others are refused where they do not."
    ),
]


class JointMotion(RequestModel):
    """How, where the goal is joint angles."""

    speed: Speed = 0.1
    accel_scale: AccelScale = 0.0
    planner: JointPlanner = "ptp"
    algorithm: OmplAlgorithm = RRT_CONNECT
    synchronization: SynchronizationName = "time"
    constraints: KeptTo = None


PositionName = Annotated[str, Field(max_length=200, description="One of GET /robot/positions.")]
Joints = Annotated[list[Finite], Field(min_length=1, max_length=64, description="rad, one for each joint")]


class MoveNamed(JointMotion):
    """Where to, by name."""

    model_config = example({"name": "home", "speed": 0.25})

    name: PositionName


class MoveJoints(JointMotion):
    """Where to, joint by joint."""

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
    Field(
        description=f"How fast the TCP may be, m/s, in {users_of('tcp_speed')}; without `speed` that is 1."
    ),
]
RadPerSecond = Annotated[Finite | None, Field(description="How fast the TCP may turn, rad/s, likewise.")]
FrameId = Annotated[
    str,
    Field(
        max_length=200,
        description="The frame of all poses and points: empty for the default frame, the base, world, tool "
        "(the TCP's where the motion begins), or a body or site of the model that no joint moves.",
    ),
]


Radius = Annotated[Finite, Field(ge=0.0, le=1.0)]


FreeAxes = Annotated[
    list[FreeAxis],
    Field(
        max_length=3,
        description="Rotations of the tool that the pose does not fix, about its own axes: one of rx, ry and "
        "rz, or all three if only the position counts. An arm with five joints points its tool down with rz.",
    ),
]


Cyclic = Annotated[
    bool | None,
    Field(
        description="Of a path that leads back to its start: it ends in the joints it began with, so that it "
        "can be repeated. null: full circles do so where they can, other paths end where they lead."
    ),
]


class TcpMotion(RequestModel):
    """How, where the TCP has somewhere to go."""

    speed: Speed = 0.1
    accel_scale: AccelScale = 0.0
    speed_m_s: MetresPerSecond = None
    speed_rad_s: RadPerSecond = None
    frame_id: FrameId = ""
    constraints: KeptTo = None
    free_axes: FreeAxes = Field([])
    cyclic: Cyclic = None


class MoveArc(TcpMotion):
    """An arc by an angle about an axis; circles and helices too."""

    model_config = example(
        {"centre": {"x": 0.5, "y": 0.0, "z": 0.5}, "axis": {"x": 0.0, "y": 0.0, "z": 1.0}, "angle": 0.5}
    )

    centre: PathPoint = Field(description="A point on the axis, m.")
    axis: PathPoint = Field(description="The direction of the axis, of any length; by the right hand.")
    angle: Annotated[float, Field(allow_inf_nan=False), Within(require_angle, MAX_ARC_RAD)] = Field(
        description="How far about the axis, rad; several turns too."
    )
    rise: Finite = Field(0.0, ge=-10.0, le=10.0, description="How far along the axis meanwhile, m: a helix.")
    turn_tool: bool = Field(False, description="The hand turns with the arc, or keeps its orientation.")


class MovePose(TcpMotion, PathPose):
    """Where to with the TCP."""

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
    algorithm: OmplAlgorithm = RRT_CONNECT
    synchronization: SynchronizationName = "time"
    via: PathPoint | None = Field(
        None, description=f"Of {users_of('via')}: a point on the arc. It needs this or `centre`."
    )
    centre: PathPoint | None = Field(None, description=f"Of {users_of('arc')}: the centre of the arc, m.")
    axis: PathPoint | None = Field(
        None, description="With `centre`: the arc turns about it by the right hand; else the short way."
    )
    end_joints: Annotated[list[Finite], Field(min_length=1, max_length=64)] | None = Field(
        None,
        description=f"Of {users_of('end_joints')}: the joints in which the motion ends, rad, with the TCP at "
        "the pose; so a line back to where the arm was ends in the joints it had there.",
    )
    through: Annotated[list[PathPose], FailFast()] = Field(
        [], max_length=200, description=f"Of {users_of('through')}: poses on the way."
    )
    radius: Radius = Field(
        0.0,
        description=f"Of {users_of('radius_m')}: how far from each of them, m, the TCP may leave its path to "
        "go on without a stop; 0: it stops.",
    )


NAMED, JOINT, ARC, POSE = MOTION_TAGS = ("named motion", "joint motion", "arc motion", "pose motion")
KINDS = {"name": NAMED, "named": NAMED, "joints": JOINT, "angle": ARC}


def kind_of(value: Any) -> str:
    """Which of `MOTION_TAGS` a motion is: by the first of `KINDS` that it has; without any to a pose."""
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
"""So many are planned as one at the most."""


class MoveSequence(RequestModel):
    """Motions one after the other, round where one goes over into the next."""

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
        description="For each motion but the last: how far from its end, m, the TCP may leave its path to go "
        "on without a stop; 0: it stops. Without any it stops at each.",
    )
