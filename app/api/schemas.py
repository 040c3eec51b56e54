"""Requests and answers as JSON: the edge where everything is checked before anything happens.

All on one page, as in the schema that is published of them.
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, FailFast, Field

from cobot.strict import StrictModel

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]


def _example(body: Any) -> ConfigDict:
    """What Swagger fills in: a request that works unedited, or an answer as it looks."""
    return ConfigDict(json_schema_extra={"examples": [body]})


Finite = Annotated[float, Field(allow_inf_nan=False)]


def _lower(value: Any) -> Any:
    return value.lower() if isinstance(value, str) else value


def _as_list(value: Any) -> Any:
    """MATLAB encodes a list of one object as the object."""
    return [value] if isinstance(value, dict) else value


Speed = Annotated[
    float,
    Field(ge=0.01, le=1.0, description="Share of the velocity limits."),
]
AccelScale = Annotated[
    float,
    Field(
        ge=0.0,
        le=1.0,
        description="Share of the acceleration and jerk limits (of jerk 0.8 at the most); 0 takes `speed`.",
    ),
]
Planner = Annotated[
    Literal["ompl", "ptp", "lin", "circ", "chomp"],
    BeforeValidator(_lower),
    Field(
        description="ptp: straight in joint space; lin: the TCP on a straight line; circ: on an arc through "
        "`via`; ompl: sampling, around obstacles; chomp: optimisation, around obstacles."
    ),
]


class MoveNamed(StrictModel):
    """Where to, by name."""

    model_config = _example({"name": "home", "speed": 0.25})

    name: str = Field(max_length=200, description="One of GET /robot/positions.")
    speed: Speed = 0.1
    accel_scale: AccelScale = 0.0


class Point(StrictModel):
    """A point in the frame of the motion, m."""

    x: Finite
    y: Finite
    z: Finite


class MovePose(StrictModel):
    """Where to with the TCP."""

    model_config = _example(
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

    x: Finite = Field(description="m")
    y: Finite = Field(description="m")
    z: Finite = Field(description="m")
    a: Finite = Field(0.0, description="KUKA angle A about z, rad")
    b: Finite = Field(0.0, description="KUKA angle B about the new y, rad")
    c: Finite = Field(0.0, description="KUKA angle C about the newest x, rad")
    speed: Speed = 0.1
    accel_scale: AccelScale = 0.0
    planner: Planner = "ptp"
    frame_id: str = Field("", max_length=200, description="Frame of the pose; empty for the default frame.")
    via: Point | None = Field(None, description="A point on the arc, needed by circ and by no other planner.")


class MoveJoints(StrictModel):
    """Where to, joint by joint."""

    model_config = _example({"joints": [0.0, 0.5, *HOME[2:]], "speed": 0.25})

    joints: list[Finite] = Field(max_length=64, description="rad, one for each joint")
    speed: Speed = 0.1
    accel_scale: AccelScale = 0.0


class MoveAnswer(BaseModel):
    """How a motion ended. It has arrived and settled when `success` is true."""

    model_config = _example(
        {
            "success": True,
            "message": "Motion completed successfully",
            "code": None,
            "motion_id": 12,
            "duration_s": 3.21,
            "planning_time_s": 0.01,
        }
    )

    success: bool
    message: str = Field(description="The reason, when it has not arrived.")
    code: str | None = Field(None, description="A stable word for the reason, null on success.")
    motion_id: int | None = Field(None, description="Null when nothing moved.")
    duration_s: float = Field(description="From request to answer.")
    planning_time_s: float


class ResetAnswer(BaseModel):
    """What a reset has led to."""

    success: bool
    message: str


class JointStates(BaseModel):
    """The measured joints, in the order of `name`."""

    model_config = _example(
        {
            "name": [f"joint{n}" for n in range(1, 8)],
            "position": HOME,
            "velocity": [0.0] * 7,
            "effort": [0.0, -14.35, 0.0, 14.36, -0.34, 0.0, 0.0],
        }
    )

    name: list[str]
    position: list[float] = Field(description="rad")
    velocity: list[float] = Field(description="rad/s")
    effort: list[float] = Field(description="N·m")


class Position(BaseModel):
    x: float = Field(description="m")
    y: float
    z: float


class Quaternion(BaseModel):
    """Unit quaternion; w is the scalar part."""

    x: float
    y: float
    z: float
    w: float


class Angles(BaseModel):
    """KUKA ABC: about z, then the new y, then the newest x."""

    a: float
    b: float
    c: float


class Orientation(BaseModel):
    quaternion: Quaternion
    euler_rad: Angles
    euler_deg: Angles


class PoseAnswer(BaseModel):
    """The TCP, from the measured joints."""

    position: Position
    orientation: Orientation
    frame_id: str


class NamedPositionAnswer(BaseModel):
    """A `group_state` of the SRDF."""

    name: str
    group: str
    description: str
    joints: list[float] = Field(description="rad")


class TrajectoryPoint(StrictModel):
    """Where the joints are at a time. Missing rates are those of a smooth curve through all points."""

    positions: list[Finite] = Field(max_length=64, description="rad, one for each joint")
    time_from_start: Finite = Field(ge=0.0, description="s")
    velocities: list[Finite] | None = Field(None, max_length=64, description="rad/s")
    accelerations: list[Finite] | None = Field(None, max_length=64, description="rad/s²")


class SendTrajectory(StrictModel):
    """A timed joint trajectory."""

    model_config = _example(
        {
            "points": [
                {"positions": HOME, "time_from_start": 0.0},
                {"positions": [0.0, 0.3, 0.0, -1.2, 0.0, 1.3, 0.0], "time_from_start": 2.0},
                {"positions": HOME, "time_from_start": 4.0},
            ],
            "move_to_start": True,
        }
    )

    points: Annotated[list[TrajectoryPoint], FailFast(), BeforeValidator(_as_list)] = Field(
        min_length=1, max_length=100_000, description="At strictly increasing times."
    )
    validate_limits: bool = Field(
        True, description="False skips this check; the safety layer of the real-time process stays."
    )
    retime: bool = Field(False, description="Keep the path and stretch time until the limits hold.")
    move_to_start: bool = Field(False, description="Go to the first point by ptp before.")


class CsvQuery(StrictModel):
    """How to read a CSV file, and what to check; see SendTrajectory."""

    model_config = ConfigDict(strict=False)  # a query consists of strings

    separator: str = Field(
        ",", min_length=1, max_length=1, description="With ; numbers may have decimal commas."
    )
    validate_limits: bool = True
    retime: bool = False
    move_to_start: bool = False


class SentAnswer(BaseModel):
    """The real-time process has verified the motion and begun it; /trajectory/logs tells its end."""

    model_config = _example({"status": "sent", "motion_id": 13, "duration_s": 4.0, "points": 3})

    status: Literal["sent"] = "sent"
    motion_id: int
    duration_s: float = Field(description="Of the whole motion, the way to the start included.")
    points: int


class LogQuery(StrictModel):
    """How many log lines."""

    model_config = ConfigDict(strict=False)

    n: int = Field(50, ge=1, le=300)


class LogAnswer(BaseModel):
    """The newest lines, the oldest of them first, each with its time."""

    lines: list[str]


class StartedAnswer(BaseModel):
    """The runner has started; whether its file is any good, /sequences/status will tell."""

    status: Literal["started"] = "started"
    sequence_id: int
    pid: int


class SequenceStatusAnswer(BaseModel):
    """The newest sequence."""

    status: Literal["idle", "running", "finished"]
    sequence_id: int | None
    pid: int | None
    iteration: int | None = Field(description="From 1.")
    n_iterations: int | None
    waypoint: int | None = Field(description="From 1; 0 is the way home.")
    n_waypoints: int | None
    started_at: datetime | None
    finished_at: datetime | None
    returncode: int | None = Field(description="0: all done; negative: the signal that ended it.")
    bag_path: str | None


class StopAnswer(BaseModel):
    """What was stopped, where the arm is, how long it took."""

    model_config = _example(
        {
            "success": True,
            "message": "stopped POST /robot/move/joints (for 1.2 s, motion 12); the arm is at rest",
            "stopped": ["POST /robot/move/joints (for 1.2 s, motion 12)"],
            "position": HOME,
            "at_rest": True,
            "duration_s": 0.15,
        }
    )

    success: bool = Field(description="The arm is known to be at rest, and nothing will move it.")
    message: str
    stopped: list[str]
    position: list[float] | None = Field(description="Measured, rad; null when it is not known.")
    at_rest: bool
    duration_s: float


class RobotHealth(BaseModel):
    """How a robot is; `degraded` comes with `problems`."""

    status: Literal["ok", "degraded"]
    problems: list[str]
    robot: dict[str, Any]
    rtloop: dict[str, Any] = Field(description="The real-time process: pid, permissions, overruns.")
    service: dict[str, Any]
    planning: dict[str, Any] = Field(
        description="The planning processes: state, how many are usable and busy, how many were replaced."
    )
    sequence: dict[str, Any]
    session: dict[str, Any] | None = Field(description="The streaming session: number, client, mode.")


class HealthAnswer(RobotHealth):
    """How the product is."""

    cycle_us: dict[str, dict[str, float]] = Field(
        description="Wake-up lateness and compute time of the cycle's phases, µs."
    )
    interventions: dict[str, int] = Field(description="What the safety layer caught, by kind.")
    last_interventions_s: dict[str, float | None] = Field(
        description="Seconds since the last one of each kind; null: there was none."
    )
    versions: dict[str, str]
    robots: dict[str, RobotHealth] = Field(description="Of each robot that was asked for, by its name.")


class RobotAnswer(BaseModel):
    """A robot that is served."""

    name: str
    default: bool = Field(description="The endpoints without the name of a robot are about this one.")
    path: str = Field(description="What its own endpoints begin with.")
    base_frame: str
    joint_names: list[str]
