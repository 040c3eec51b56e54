"""Answers about plans as JSON: the path, its use of the limits, and its dry run."""

from __future__ import annotations

from pydantic import BaseModel, Field

from app.api.schemas.reason_fields import ReasonFields
from cobot.motions.fields import HOME, example
from cobot.motions.forecast import Closest
from cobot.motions.improving import PlanQuality
from cobot.robot.nearest import Nearest
from cobot.trajectory import NoticeKind

CLOSEST_SELF = {
    "between": ["link3", "link5"],
    "distance_m": 0.0415,
    "points": [[0.075, 0.0, 0.7801], [0.1165, 0.0, 0.7801]],
}
CLOSEST_ENVIRONMENT = {
    "between": ["floor", "link2"],
    "distance_m": 0.28,
    "points": [[0.0, 0.0, 0.0], [0.0, 0.0, 0.28]],
}
PLANNING = {
    "quality": "improved",
    "first_duration_s": 1.3,
    "tries": 61,
    "improvements": 5,
    "lower_bound_s": 1.05,
}
PLANNED = {
    "plan_id": "plan_2f1c9a0b7d3e4855",
    "expires_in_s": 600.0,
    "duration_s": 1.1,
    "planning_time_s": 0.5,
    "planning": PLANNING,
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
    "closest_self": CLOSEST_SELF | {"share": 0.0},
    "closest_environment": CLOSEST_ENVIRONMENT | {"share": 0.0},
    "signals": ["0.550 s: set glue to 1"],
}


class PlanPoint(BaseModel):
    """A point of a plan."""

    time_s: float = Field(description="Time since the motion's start, s.")
    joints: list[float] = Field(description="rad")
    velocities: list[float] = Field(description="Joint velocities, rad/s.")
    position: list[float] = Field(description="Position of the TCP in the base frame: x, y, z, m.")
    quaternion: list[float] = Field(description="Orientation of the TCP in the base frame: x, y, z, w.")


class MotionPoint(BaseModel):
    """A point of the current motion."""

    time_s: float = Field(description="Path time, s: time since the start at full speed.")
    joints: list[float] = Field(description="rad")


class MotionAnswer(BaseModel):
    """The path of the current motion, of any client."""

    motion_id: int | None = Field(description="Number of the current motion; null without one.")
    duration_s: float = Field(description="Duration of the path at full speed, s.")
    note: str = Field(description="Differences between the motion and the request.")
    path: list[MotionPoint] = Field(
        description="Points of the path, evenly spaced in time, both ends included."
    )


class PlanUse(BaseModel):
    """How much of one limit a motion uses, for each joint."""

    peak: list[float] = Field(description="Largest absolute value: rad/s, rad/s², rad/s³ or N·m.")
    share: list[float] = Field(description="That value as a share of the robot's limit; 1 is the limit.")


class DistanceAnswer(BaseModel):
    """The distance between two bodies."""

    between: list[str] = Field(description="Names of the two bodies.")
    distance_m: float = Field(description="Distance, m; negative if the bodies overlap.")
    points: list[list[float]] = Field(
        description="Nearest points of the first and the second body in the base frame: x, y, z, m."
    )

    @classmethod
    def of(cls, nearest: Nearest | Closest) -> DistanceAnswer:
        return DistanceAnswer(
            between=[nearest.first, nearest.second],
            distance_m=nearest.distance_m,
            points=[list(point) for point in nearest.points],
        )


class PlanDistance(DistanceAnswer):
    """The smallest distance between two bodies, at 200 points of a motion."""

    share: float = Field(description="Place, as a share of the motion's duration.")


class ClearanceAnswer(BaseModel):
    """The smallest distances at the arm's current position."""

    model_config = example({"closest_self": CLOSEST_SELF, "closest_environment": CLOSEST_ENVIRONMENT})

    closest_self: DistanceAnswer | None = Field(
        description="Smallest distance between two parts of the robot; null above 1 m."
    )
    closest_environment: DistanceAnswer | None = Field(
        description="Smallest distance between the robot and its surroundings; null above 1 m."
    )


class NoticeAnswer(BaseModel):
    """A difference between a motion and its request."""

    kind: NoticeKind = Field(description="Kind of the difference, see docs/conventions.md.")
    values: dict[str, str | float] = Field(description="Values of this kind, see docs/conventions.md.")


class PlanningAnswer(BaseModel):
    """The quality of a planned motion, and statistics about its planning."""

    quality: PlanQuality = Field(
        description="first: the first motion that has passed all checks. improved: a faster one; more "
        "planning time may find a still faster one. final: more planning time does not help, because the "
        "planner has no choice, or because the duration is within 1 % of `lower_bound_s`."
    )
    first_duration_s: float = Field(description="Duration of the first motion, s.")
    tries: int = Field(
        description="Number of other motions that were tried. The same number of tries gives the same motion "
        "on any computer."
    )
    improvements: int = Field(description="Number of tries that found a faster motion.")
    lower_bound_s: float | None = Field(
        description="Lower bound of the duration, s: the time that the slowest joint needs alone. Even "
        "without obstacles, no motion to the joint positions that were considered for the goal is faster. "
        "null: not computed, because there was no budget."
    )


class PlanAnswer(BaseModel):
    """A motion that has been planned and checked, but not run."""

    model_config = example(PLANNED)

    plan_id: str = Field(description="Id of the plan, for POST /robot/execute.")
    expires_in_s: float = Field(description="How long the plan is kept, s; shorter if there are many plans.")
    duration_s: float = Field(description="Duration at full speed, s; 0 if the arm is already there.")
    planning_time_s: float = Field(0.0, description="Time that planning took, s.")
    planning: PlanningAnswer | None = Field(
        None, description="How good the motion is; null for several motions and for commands to the gripper."
    )
    note: str = Field(
        description="The planner that auto chose and the reason, and how the motion leaves a "
        "start in collision."
    )
    notices: list[NoticeAnswer] = Field([], description="The content of `note`, for programs.")
    path: list[PlanPoint] = Field(
        description="Points of the path, evenly spaced in time, both ends included."
    )
    utilisation: dict[str, PlanUse] = Field(
        description="Use of the limits: velocity, acceleration, jerk and torque."
    )
    closest_self: PlanDistance | None = Field(
        description="Smallest distance between two parts of the robot; null above 1 m."
    )
    closest_environment: PlanDistance | None = Field(
        description="Smallest distance between the robot and its surroundings; null above 1 m."
    )
    signals: list[str] = Field(description="Actions on the path and conditions of the motion, as sentences.")


class RehearsalFlaw(ReasonFields):
    """The first problem of a dry run."""

    time_s: float = Field(description="Time since the motion's start, s.")
    joint: str | None = Field(description="The joint; null for a problem of the whole arm.")
    says: str = Field(description="The problem in words.")


class RehearsalAnswer(BaseModel):
    """Result of a dry run: a plan on a simulated copy of the robot."""

    model_config = example(
        {
            "plan_id": "plan_2f1c9a0b7d3e4855",
            "runs_through": True,
            "duration_s": 1.14,
            "planned_duration_s": 1.1,
            "effort": [0.05, 0.19, 0.02, 0.11, 0.01, 0.03, 0.01],
            "off": [0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            "problem": None,
            "closest_self": CLOSEST_SELF | {"share": 0.0},
            "closest_environment": CLOSEST_ENVIRONMENT | {"share": 0.0},
        }
    )

    plan_id: str = Field(description="Id of the plan.")
    runs_through: bool = Field(description="true: the arm arrives and settles without a `problem`.")
    duration_s: float = Field(
        description="Duration at full speed until the arm settled or the motion ended otherwise, s."
    )
    planned_duration_s: float = Field(description="Duration of the plan without settling, s.")
    effort: list[float] = Field(description="Largest effort of each joint, as a share of its limit.")
    off: list[float] = Field(
        description="Largest deviation of each joint from its command, rad; for sliding joints m."
    )
    problem: RehearsalFlaw | None = Field(description="The first problem; null: no problem.")
    closest_self: PlanDistance | None = Field(
        description="As in the plan, but along the path of the simulated arm."
    )
    closest_environment: PlanDistance | None = Field(
        description="As in the plan, but along the path of the simulated arm."
    )
