"""Requests and answers as JSON: the edge where everything is checked before anything happens.

All on one page, as in the schema that is published of them; but what motions are asked for, which other
documents hold too, is `cobot.motions.bodies`.
"""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field

from app.api.device_schemas import DeviceAnswer
from app.api.explain_schemas import Explain
from app.services.rights.lease import TIMEOUT_S, TIMEOUTS_S
from cobot.loose_lists import RequestModel
from cobot.motions.fields import HOME, Finite, example
from cobot.strict import StrictModel


class MoveAnswer(BaseModel):
    """How a motion ended. It has arrived and settled when `success` is true."""

    model_config = example(
        {
            "success": True,
            "message": "Motion completed successfully",
            "code": None,
            "motion_id": 12,
            "duration_s": 3.21,
            "planning_time_s": 0.01,
            "note": "",
            "explain": None,
        }
    )

    success: bool = Field(description="Whether the arm has arrived and settled.")
    message: str = Field(description="The reason, when it has not arrived.")
    code: str | None = Field(None, description="A stable word for the reason, null on success.")
    motion_id: int | None = Field(None, description="Null when nothing moved.")
    duration_s: float = Field(description="From request to answer, s.")
    planning_time_s: float = Field(description="Of that, s, until there was a plan.")
    note: str = Field(
        "",
        description="What auto took and why, how a start in collision or beyond a limit was left, and which "
        "radius of a sequence was not used.",
    )
    explain: Explain | None = Field(None, description="Of a motion that cannot be planned: why, as numbers.")


class ResetAnswer(BaseModel):
    """What a reset has led to."""

    success: bool = Field(description="Whether the robot may move.")
    message: str = Field(description="The same in words.")


class TakeControl(RequestModel):
    """The timeout of the lease, and whether to take it over."""

    model_config = example({"timeout_s": 60.0})

    timeout_s: float = Field(
        TIMEOUT_S,
        ge=TIMEOUTS_S[0],
        le=TIMEOUTS_S[1],
        description="s; it ends when nothing has moved for so long.",
    )
    force: bool = Field(
        False, description="Take it over: whatever moves the arm ends, and the former holder is notified."
    )


class ControlAnswer(BaseModel):
    """Who controls the robot."""

    held: bool = Field(description="Whether a client has control.")
    holder: str | None = Field(description="The name of the client's access token; anonymous without one.")
    address: str | None = Field(description="Where they come from.")
    how: Literal["explicit", "implicit"] | None = Field(
        description="explicit: by a lease; implicit: by what moves the arm, for as long as it does."
    )
    what: str | None = Field(description="What moves the arm now.")
    since: datetime | None = Field(description="When they took it, if that is known.")
    until: datetime | None = Field(description="When a lease ends, if nothing moves until then.")
    speed_fraction: float = Field(description="How fast motions go, as a share of their planned speed.")


class TakenAnswer(ControlAnswer):
    """The control is the caller's."""

    token: str = Field(description="To be sent as the header X-Control-Token.")
    stopped: list[str] = Field(description="What was ended to take over.")


class JointStates(BaseModel):
    """The measured joints, in the order of `name`."""

    model_config = example(
        {
            "name": [f"joint{n}" for n in range(1, 8)],
            "position": HOME,
            "velocity": [0.0] * 7,
            "effort": [0.0, -14.35, 0.0, 14.36, -0.34, 0.0, 0.0],
        }
    )

    name: list[str] = Field(description="The joints' names, from the base to the flange.")
    position: list[float] = Field(description="rad")
    velocity: list[float] = Field(description="rad/s")
    effort: list[float] = Field(description="N·m")


class Position(BaseModel):
    x: float = Field(description="m")
    y: float = Field(description="m")
    z: float = Field(description="m")


class Quaternion(BaseModel):
    """Unit quaternion; w is the scalar part."""

    x: float = Field(description="Of the axis, times the sine of half the angle.")
    y: float = Field(description="The same.")
    z: float = Field(description="The same.")
    w: float = Field(description="The scalar part.")


class Angles(BaseModel):
    """KUKA ABC: about z, then the new y, then the newest x."""

    a: float = Field(description="About z.")
    b: float = Field(description="About the new y.")
    c: float = Field(description="About the newest x.")


class Orientation(BaseModel):
    quaternion: Quaternion = Field(description="The rotation as a unit quaternion.")
    euler_rad: Angles = Field(description="The same as angles, rad.")
    euler_deg: Angles = Field(description="The same as angles, degrees.")


class PoseAnswer(BaseModel):
    """The TCP, from the measured joints."""

    position: Position = Field(description="Of the TCP, m.")
    orientation: Orientation = Field(description="Of the TCP.")
    frame_id: str = Field(description="The frame in which both are: the robot's base.")


class NamedPositionAnswer(BaseModel):
    """A `group_state` of the SRDF, or a place that was taught."""

    name: str = Field(description="For POST /robot/move/named.")
    group: str = Field(description="The group of joints in the SRDF; `taught` without one.")
    description: str = Field(description="The description from the SRDF, or from the client that taught it.")
    joints: list[float] = Field(description="rad")
    taught: bool = Field(description="Whether it was taught, and can be removed.")


VALIDATE = "False skips this check; the safety layer of the real-time process stays."
RETIME = "Slow down where the limits need it, by as much as they need; else more than 5 % is refused."
SMOOTHING = (
    "Maximum deviation from the curve through the points where they exceed the limits, rad; 0 "
    "follows it exactly. Default: the setting planning.smoothing_rad."
)
MAX_SMOOTHING_RAD = 0.01
MOVE_TO_START = "Go to the first point by ptp before; else the arm has to be there."


class TrajectoryPoint(RequestModel):
    """Where the joints are at a time. Missing rates are those of a smooth curve through all points."""

    positions: list[Finite] = Field(max_length=64, description="rad, one for each joint")
    time_from_start: Finite = Field(ge=0.0, description="s")
    velocities: list[Finite] | None = Field(None, min_length=1, max_length=64, description="rad/s")
    accelerations: list[Finite] | None = Field(None, min_length=1, max_length=64, description="rad/s²")


class SendTrajectory(RequestModel):
    """A timed joint trajectory."""

    model_config = example(
        {
            "points": [
                {"positions": HOME, "time_from_start": 0.0},
                {"positions": [0.0, 0.3, 0.0, -1.2, 0.0, 1.3, 0.0], "time_from_start": 2.0},
                {"positions": HOME, "time_from_start": 4.0},
            ],
            "move_to_start": True,
        }
    )

    points: Annotated[list[TrajectoryPoint], FailFast()] = Field(
        min_length=1, max_length=100_000, description="At strictly increasing times."
    )
    validate_limits: bool = Field(True, description=VALIDATE)
    retime: bool = Field(False, description=RETIME)
    move_to_start: bool = Field(False, description=MOVE_TO_START)
    smoothing_rad: Finite | None = Field(None, ge=0.0, le=MAX_SMOOTHING_RAD, description=SMOOTHING)


WAIT = "false: answer 202 with the job at once, instead of the ordinary answer when that is known."


class CsvQuery(StrictModel):
    """How to read a CSV file, and what to check; see SendTrajectory."""

    model_config = ConfigDict(strict=False)  # a query consists of strings

    separator: str | None = Field(
        None,
        min_length=1,
        max_length=1,
        description="One character. Without it that of the header: semicolons, tabs, commas or white space. "
        "Only with semicolons may numbers have decimal commas.",
    )
    validate_limits: bool = Field(True, description=VALIDATE)
    retime: bool = Field(False, description=RETIME)
    move_to_start: bool = Field(False, description=MOVE_TO_START)
    smoothing_rad: Finite | None = Field(None, ge=0.0, le=MAX_SMOOTHING_RAD, description=SMOOTHING)
    wait: bool = Field(True, description=WAIT)


class SentAnswer(BaseModel):
    """The real-time process has verified the motion and begun it; /trajectory/logs tells its end."""

    model_config = example(
        {
            "status": "sent",
            "motion_id": 13,
            "duration_s": 4.0,
            "points": 3,
            "note": "",
            "blended_rad": 0.0,
            "smoothed_rad": 0.0,
            "stretch": 1.0,
            "slowed_s": None,
        }
    )

    status: Annotated[Literal["sent"], Field(description="The motion has begun.")] = "sent"
    motion_id: int = Field(description="Its number, as in /trajectory/logs and in the state.")
    duration_s: float = Field(description="Of the whole motion, s, the way to the start included.")
    points: int = Field(description="How many were sent.")
    note: str = Field("", description="What was changed and why; empty if nothing was.")
    blended_rad: float = Field(0.0, description="How far the arm was from the first point, blended in.")
    smoothed_rad: float = Field(0.0, description="Maximum deviation of the motion from the curve, rad.")
    stretch: float = Field(1.0, description="Its duration in shares of that of the points.")
    slowed_s: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        None, description="Between which times of the points it is slower than they ask for."
    )


LogLines = Annotated[int, Field(ge=1, le=300, description="How many lines, the newest ones.")]


class LogQuery(StrictModel):
    """How many log lines."""

    model_config = ConfigDict(strict=False)

    n: LogLines = 50


class LogAnswer(BaseModel):
    """The newest lines, the oldest of them first, each with its time."""

    lines: list[str] = Field(description="The oldest of them first.")


class StartedAnswer(BaseModel):
    """The runner has started; whether its file is any good, /sequences/status will tell."""

    status: Annotated[Literal["started"], Field(description="The runner's process runs.")] = "started"
    sequence_id: int = Field(description="Its number, counted from 1.")
    pid: int = Field(description="The runner's process.")


class SequenceStatusAnswer(BaseModel):
    """The newest sequence."""

    status: Literal["idle", "running", "finished"] = Field(description="idle: there was none yet.")
    sequence_id: int | None = Field(description="Its number, counted from 1.")
    pid: int | None = Field(description="The runner's process.")
    iteration: int | None = Field(description="From 1.")
    n_iterations: int | None = Field(description="How many were asked for.")
    waypoint: int | None = Field(description="From 1; 0 is the way home.")
    n_waypoints: int | None = Field(description="How many an iteration has.")
    started_at: datetime | None = Field(description="When.")
    finished_at: datetime | None = Field(description="When; null while it runs.")
    returncode: int | None = Field(description="0: all done; negative: the signal that ended it.")
    bag_path: str | None = Field(description="The recording's folder; null without one.")


class AuditQuery(StrictModel):
    """Which entries."""

    model_config = ConfigDict(strict=False)

    limit: int = Field(100, ge=1, le=1000, description="Maximum number of entries.")
    since: datetime | None = Field(None, description="Only those of then or later; without a zone it is UTC.")


class AuditEntry(BaseModel):
    """An action that a client has carried out or attempted."""

    model_config = ConfigDict(populate_by_name=True)

    time: datetime = Field(description="When, UTC.")
    who: str = Field(description="The name of the access token; anonymous; the user, for the command line.")
    from_: str = Field(alias="from", description="Address and port, or cli.")
    what: str = Field(description="Method and path; the vendor service; what a connection has done.")
    outcome: str = Field(description="HTTP's status, or ok, or what went wrong.")
    request: str | None = Field(None, description="The X-Request-Id, which lines of the log have too.")
    repeated: int | None = Field(None, description="So many more of this kind followed in the same second.")
    details: dict[str, Any] = Field({}, description="What else is known: the motion, the upload, the error.")


class AuditAnswer(BaseModel):
    """The newest entries, the newest of them first."""

    entries: list[AuditEntry] = Field(description="The newest first.")
    lost: int = Field(description="Entries that could not be written since the service started.")
    problem: str = Field(description="Why nothing can be written at present; empty while all is well.")


class StopAnswer(BaseModel):
    """What was stopped, where the arm is, how long it took."""

    model_config = example(
        {
            "success": True,
            "message": "stopped POST /robot/move/joints (for 1.2 s, motion 12); the arm is at rest",
            "stopped": ["POST /robot/move/joints (for 1.2 s, motion 12)"],
            "position": HOME,
            "at_rest": True,
            "duration_s": 0.15,
            "category": 2,
            "confirmed": False,
        }
    )

    success: bool = Field(description="The arm is known to be at rest, and nothing will move it.")
    message: str = Field(description="What was stopped, and what could not be confirmed.")
    stopped: list[str] = Field(description="What was under way.")
    position: list[float] | None = Field(description="Measured, rad; null when it is not known.")
    at_rest: bool = Field(description="Whether the arm is known to stand still.")
    duration_s: float = Field(description="From request to answer, s.")
    category: int = Field(
        description="The category that was carried out: 2 the drives hold the arm, 1 they are off."
    )
    confirmed: bool = Field(description="Whether the device itself reports it, not cobot alone.")


class RobotHealth(BaseModel):
    """How a robot is; `degraded` comes with `problems`."""

    status: Literal["ok", "degraded"] = Field(description="ok: there is no problem.")
    problems: list[str] = Field(description="What is wrong, a sentence each.")
    robot: dict[str, Any] = Field(description="The arm: mode, motion, whether it is settled.")
    rtloop: dict[str, Any] = Field(description="The real-time process: pid, permissions, overruns.")
    service: dict[str, Any] = Field(description="This service: pid, time since its start, who moves the arm.")
    planning: dict[str, Any] = Field(
        description="The planning processes: state, how many are usable and busy, how many were replaced."
    )
    sequence: dict[str, Any] = Field(description="The newest sequence, as in /sequences/status.")
    session: dict[str, Any] | None = Field(description="The streaming session: number, client, mode.")
    recorder: dict[str, Any] | None = Field(
        description="What is recorded: the process, the continuous recording, lost cycles, files, problem."
    )


class HealthAnswer(RobotHealth):
    """How the product is."""

    cycle_us: dict[str, dict[str, float]] = Field(
        description="Wake-up lateness and compute time of the cycle's phases, µs."
    )
    interventions: dict[str, int] = Field(description="What the safety layer caught, by kind.")
    last_interventions_s: dict[str, float | None] = Field(
        description="Seconds since the last one of each kind; null: there was none."
    )
    versions: dict[str, str] = Field(description="Of cobot and of what it stands on.")
    robots: dict[str, RobotHealth] = Field(description="Of each robot that was asked for, by its name.")


class LiveAnswer(BaseModel):
    """The service runs."""

    status: Literal["live"] = Field(description="Who does not live gives no answer.")


class ReadyAnswer(BaseModel):
    """Every robot that was asked for takes motions."""

    status: Literal["ready"] = Field(description="If one is not ready, the answer is a 503 with why.")
    robots: list[str] = Field(description="Their names.")


class ReloadAnswer(BaseModel):
    """What the reload has done, as sentences."""

    taken_over: list[str] = Field(description="What counts from now on; empty if nothing has changed.")
    needs_restart: list[str] = Field(description="What has changed too, and counts after a restart of cobot.")


class RobotAnswer(BaseModel):
    """A robot that is served."""

    name: str = Field(description="For /robots/{robot}/...")
    default: bool = Field(description="The endpoints without the name of a robot are about this one.")
    path: str = Field(description="What its own endpoints begin with.")
    base_frame: str = Field(description="The frame of all its poses.")
    joint_names: list[str] = Field(description="From the base to the flange.")
    device: DeviceAnswer | None = Field(description="What moves it; null while that cannot be read.")
