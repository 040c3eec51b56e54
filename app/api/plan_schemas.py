"""Plans as JSON: motions that are looked at before they are run, if they are run at all."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, FailFast, Field

from cobot.loose_lists import RequestModel
from cobot.motions.bodies import (
    MoveArc,
    MoveJoints,
    MoveNamed,
    MovePose,
    MoveSequence,
    PathPose,
    Radius,
    TcpMotion,
)
from cobot.motions.fields import HOME, Finite, example
from cobot.strict import StrictModel

Start = Annotated[
    list[Finite] | None,
    Field(
        min_length=1,
        max_length=64,
        description="Joint angles to plan from, rad; without it where the arm rests now.",
    ),
]
Samples = Annotated[
    int, Field(ge=2, le=1000, description="How many points of the path are answered, evenly over its time.")
]

ExplainIt = Annotated[
    bool,
    Field(
        description="If there is no plan: try what would make one, for `planning.explain_s` at the most; "
        "false: only say what has failed."
    ),
]
PlanId = Annotated[
    str, Field(min_length=1, max_length=64, description="The plan_id that planning a motion has answered.")
]


PLANNED = {
    "plan_id": "2f1c9a0b7d3e4855",
    "expires_in_s": 600.0,
    "duration_s": 1.1,
    "note": "",
    "path": [
        {
            "time_s": 0.0,
            "joints": HOME,
            "velocities": [0.0] * 7,
            "position": [0.51, 0.0, 0.46],
            "quaternion": [0.0, 1.0, 0.0, 0.0],
        },
        {
            "time_s": 1.1,
            "joints": [0.3, *HOME[1:]],
            "velocities": [0.0] * 7,
            "position": [0.49, 0.15, 0.46],
            "quaternion": [0.15, 0.99, 0.0, 0.0],
        },
    ],
    "utilisation": {
        "velocity": {"peak": [0.49, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "share": [0.33, *[0.0] * 6]},
        "torque": {"peak": [9.8, 52.0, 3.1, 24.0, 0.9, 2.4, 0.1], "share": [0.03, 0.16, *[0.03] * 5]},
    },
    "closest_self": {"between": ["link2", "link5"], "distance_m": 0.094, "share": 0.0},
    "closest_environment": {"between": ["floor", "link1"], "distance_m": 0.098, "share": 0.0},
}


class KeptPlan(BaseModel):
    """A plan that can be run, for who has to approve it."""

    model_config = example(
        {
            "plan_id": "2f1c9a0b7d3e4855",
            "by": "agent-7",
            "planners": ["lin"],
            "duration_s": 1.1,
            "expires_in_s": 540.0,
            "approved_by": None,
        }
    )

    plan_id: str = Field(description="What approves it and runs it names.")
    by: str = Field(description="Who has had it planned: the name of its token.")
    planners: list[str] = Field(description="That it was asked of.")
    duration_s: float = Field(description="How long it moves, at full speed.")
    expires_in_s: float = Field(description="How long it is kept yet.")
    approved_by: str | None = Field(description="Who lets an agent run it, once; null: nobody yet.")


class Approve(RequestModel):
    """Which plan an agent may run, once."""

    model_config = example({"plan_id": "2f1c9a0b7d3e4855"})

    plan_id: PlanId
    approved: Annotated[bool, Field(description="false takes an approval back.")] = True


class Planning(RequestModel):
    """What a plan is asked for beside its motion."""

    start: Start = None
    samples: Samples = 50
    explain: ExplainIt = True


class PlanNamed(Planning, MoveNamed):
    """As for the motion, and from where."""

    model_config = example({"name": "work", "speed": 0.5, "samples": 3})


class PlanJoints(Planning, MoveJoints):
    """As for the motion, and from where."""

    model_config = example({"joints": [0.0, 0.5, *HOME[2:]], "speed": 0.25, "samples": 3})


class PlanPose(Planning, MovePose):
    """As for the motion, and from where."""

    model_config = example({"x": 0.4, "y": 0.0, "z": 0.5, "b": 3.14159, "speed": 0.25, "samples": 3})


class PlanArc(Planning, MoveArc):
    """As for the motion, and from where."""

    model_config = example(
        {
            "centre": {"x": 0.5, "y": 0.0, "z": 0.5},
            "axis": {"x": 0.0, "y": 0.0, "z": 1.0},
            "angle": 0.5,
            "samples": 3,
        }
    )


class PlanPath(Planning, TcpMotion):
    """Straight lines of the TCP, and from where."""

    model_config = example(
        {
            "poses": [
                {"x": 0.45, "y": 0.1, "z": 0.5, "b": 3.14159},
                {"x": 0.45, "y": -0.1, "z": 0.5, "b": 3.14159},
            ],
            "radius": 0.02,
            "start": [0.0, 0.5, 0.0, -1.57, 0.0, 1.07, 0.0],
            "samples": 3,
        }
    )

    poses: Annotated[list[PathPose], FailFast()] = Field(
        min_length=1, max_length=201, description="Where it goes through; the last is the goal."
    )
    radius: Radius = Field(
        0.0,
        description="How far from each pose but the last, m, the TCP may leave its path to go on without a "
        "stop; 0: it stops.",
    )

    def polyline(self) -> PlanPose:
        """The same as a motion to a pose through the others; to a single one it is lin."""
        given = self.model_dump(exclude={"poses"}, exclude_unset=True)
        through = [pose.model_dump() for pose in self.poses[:-1]]
        goal = self.poses[-1].model_dump()
        path: dict[str, Any] = {"planner": "polyline", "through": through}
        if not through:
            given.pop("radius", None)
            path = {"planner": "lin"}
        return PlanPose.model_validate({**given, **goal, **path})


class PlanSequence(Planning, MoveSequence):
    """As for the motion, and from where."""

    model_config = example(
        {
            "motions": [
                {"joints": [0.0, 0.5, *HOME[2:]], "speed": 0.25},
                {"name": "home", "speed": 0.25},
            ],
            "radii": [0.05],
            "samples": 3,
        }
    )


class PlanPoint(BaseModel):
    """Where the arm will be."""

    time_s: float = Field(description="Since the motion's start, s.")
    joints: list[float] = Field(description="rad")
    velocities: list[float] = Field(description="Of the joints, rad/s.")
    position: list[float] = Field(description="Of the TCP in the base frame: x, y, z, m.")
    quaternion: list[float] = Field(description="Of the TCP in the base frame: x, y, z, w.")


class MotionQuery(StrictModel):
    """How closely its path is told."""

    model_config = ConfigDict(strict=False)

    samples: Samples = 100


class MotionPoint(BaseModel):
    """Where the arm is to be."""

    time_s: float = Field(description="Of the path, s: at full speed since its beginning.")
    joints: list[float] = Field(description="rad")


class MotionAnswer(BaseModel):
    """What the arm moves along, whoever has asked for it."""

    motion_id: int | None = Field(description="Of the motion that runs; null while none does.")
    duration_s: float = Field(description="Of its path at full speed, s.")
    note: str = Field(description="How it differs from what was asked for.")
    path: list[MotionPoint] = Field(description="Evenly over its time, both ends included.")


class PlanUse(BaseModel):
    """What a motion takes of a limit, joint by joint."""

    peak: list[float] = Field(description="The greatest amount: rad/s, rad/s², rad/s³ or N·m.")
    share: list[float] = Field(description="The same as a share of the robot's limit: 1 is all of it.")


class PlanDistance(BaseModel):
    """How near two things come."""

    between: list[str] = Field(description="Their names.")
    distance_m: float = Field(description="m; of 200 points of the motion the nearest.")
    share: float = Field(description="Where: the share of the motion's duration.")


class PlanAnswer(BaseModel):
    """A motion that has been planned, checked and not run."""

    model_config = example(PLANNED)

    plan_id: str = Field(description="For POST /robot/execute.")
    expires_in_s: float = Field(description="After which it is forgotten, s; sooner if there are many.")
    duration_s: float = Field(description="Of the motion at full speed, s; 0 if the arm is there already.")
    note: str = Field(description="What auto took and why, and how a start in collision was left.")
    path: list[PlanPoint] = Field(description="Evenly over the time, both ends included.")
    utilisation: dict[str, PlanUse] = Field(description="Of velocity, acceleration, jerk and torque.")
    closest_self: PlanDistance | None = Field(description="Of the robot's own parts; null beyond 1 m.")
    closest_environment: PlanDistance | None = Field(description="Of the robot and the rest; the same.")


class RehearsalFlaw(BaseModel):
    """What goes wrong first."""

    time_s: float = Field(description="Since the motion's start.")
    joint: str | None = Field(description="Whose; null where it is about none.")
    says: str = Field(description="What it is.")


class RehearsalAnswer(BaseModel):
    """What a plan did on a simulated copy of the robot."""

    model_config = example(
        {
            "plan_id": "2f1c9a0b7d3e4855",
            "runs_through": True,
            "duration_s": 1.14,
            "planned_duration_s": 1.1,
            "effort": [0.05, 0.19, 0.02, 0.11, 0.01, 0.03, 0.01],
            "off": [0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            "problem": None,
            "closest_self": {"between": ["link2", "link5"], "distance_m": 0.094, "share": 0.0},
            "closest_environment": {"between": ["floor", "link1"], "distance_m": 0.098, "share": 0.0},
        }
    )

    plan_id: str = Field(description="Of the plan.")
    runs_through: bool = Field(description="It arrives and settles, and there is no `problem` on the way.")
    duration_s: float = Field(description="Until it had settled, or ended otherwise, at full speed.")
    planned_duration_s: float = Field(description="Of the plan; settling comes on top.")
    effort: list[float] = Field(description="The most of each joint, as a share of its limit.")
    off: list[float] = Field(
        description="The most that each joint was from where it was commanded to be, rad; of slides m."
    )
    problem: RehearsalFlaw | None = Field(description="The first one; null: none.")
    closest_self: PlanDistance | None = Field(description="As of the plan, of where the simulated arm was.")
    closest_environment: PlanDistance | None = Field(description="The same.")


class Execute(RequestModel):
    """Which plan to run."""

    model_config = example({"plan_id": "2f1c9a0b7d3e4855"})

    plan_id: PlanId
