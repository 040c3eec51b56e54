"""Plans as JSON: motions that are looked at before they are run, if they are run at all."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from app.api.schemas import HOME, Finite, MoveJoints, MoveNamed, MovePose
from cobot.strict import StrictModel

Start = Annotated[
    list[Finite] | None,
    Field(max_length=64, description="Joint angles to plan from, rad; without it where the arm rests now."),
]
Samples = Annotated[
    int, Field(ge=2, le=1000, description="How many points of the path are answered, evenly over its time.")
]


def _example(body: Any) -> ConfigDict:
    return ConfigDict(json_schema_extra={"examples": [body]})


class PlanNamed(MoveNamed):
    """As for the motion, and from where."""

    model_config = _example({"name": "work", "speed": 0.5, "samples": 3})

    start: Start = None
    samples: Samples = 50


class PlanJoints(MoveJoints):
    """As for the motion, and from where."""

    model_config = _example({"joints": [0.0, 0.5, *HOME[2:]], "speed": 0.25, "samples": 3})

    start: Start = None
    samples: Samples = 50


class PlanPose(MovePose):
    """As for the motion, and from where."""

    model_config = _example({"x": 0.4, "y": 0.0, "z": 0.5, "b": 3.14159, "speed": 0.25, "samples": 3})

    start: Start = None
    samples: Samples = 50


class PlanPoint(BaseModel):
    """Where the arm will be."""

    time_s: float = Field(description="Since the motion's start, s.")
    joints: list[float] = Field(description="rad")
    position: list[float] = Field(description="Of the TCP in the base frame: x, y, z, m.")
    quaternion: list[float] = Field(description="Of the TCP in the base frame: x, y, z, w.")


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

    plan_id: str = Field(description="For POST /robot/execute.")
    expires_in_s: float = Field(description="After which it is forgotten, s; sooner if there are many.")
    duration_s: float = Field(description="Of the motion at full speed, s; 0 if the arm is there already.")
    note: str = Field(description="What auto took and why, and how a start in collision was left.")
    path: list[PlanPoint] = Field(description="Evenly over the time, both ends included.")
    utilisation: dict[str, PlanUse] = Field(description="Of velocity, acceleration, jerk and torque.")
    closest_self: PlanDistance | None = Field(description="Of the robot's own parts; null beyond 1 m.")
    closest_environment: PlanDistance | None = Field(description="Of the robot and the rest; the same.")


class Execute(StrictModel):
    """Which plan to run."""

    model_config = _example({"plan_id": "2f1c9a0b7d3e4855"})

    plan_id: str = Field(max_length=64, description="Of POST /robot/plan.")
