"""Answers and requests about the arm, as JSON.

Requests for motions are in `cobot.motions.bodies`, because files contain them too.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from app.api.errors import ErrorCode
from app.api.paging import LIMIT, deprecated_value
from app.api.schemas.explain import Details, Explain
from app.api.schemas.plan_answers import PlanningAnswer
from app.api.schemas.signals import ActionAnswer, ContactAnswer
from app.services.rights.lease import TIMEOUT_S, TIMEOUTS_S
from cobot.errors import InputError
from cobot.loose_lists import RequestModel
from cobot.motions.fields import HOME, example
from cobot.strict import StrictModel

WAIT = "false: answer 202 with the job at once, instead of the result at the end."
"""Description of the parameter `wait`, which several requests have."""


class MoveAnswer(BaseModel):
    """The result of a motion. If `success` is true, the arm has arrived and settled."""

    model_config = example(
        {
            "success": True,
            "message": "Motion completed successfully",
            "code": None,
            "motion_id": 12,
            "duration_s": 3.21,
            "planning_time_s": 0.01,
            "planning": None,
            "note": "",
            "explain": None,
            "actions": [],
            "stopped_by": None,
            "contact": None,
        }
    )

    success: bool = Field(
        description="true: the arm has arrived and settled, or has stopped because the condition `until` "
        "was met."
    )
    message: str = Field(description="The reason, if `success` is false.")
    code: ErrorCode | None = Field(None, description="A stable word for the reason, null on success.")
    motion_id: int | None = Field(None, description="Number of the motion; null if nothing moved.")
    duration_s: float = Field(description="Time from request to answer, s.")
    planning_time_s: float = Field(description="Part of that time that planning took, s.")
    planning: PlanningAnswer | None = Field(
        None, description="How good the planned motion is; null for several motions and for plans."
    )
    note: str = Field(
        "",
        description="The planner that auto chose and the reason; how the motion left a start in collision "
        "or beyond a limit; and blend radii of a sequence that were not used.",
    )
    explain: Explain | None = Field(
        None, description="If the motion cannot be planned: the reason, as numbers."
    )
    actions: list[ActionAnswer] = Field([], description="Results of the actions on the path.")
    stopped_by: str | None = Field(None, description="The condition that has ended the motion.")
    contact: ContactAnswer | None = Field(
        None, description="The state of the arm when the condition was met."
    )
    details: Details = None


class ResetAnswer(BaseModel):
    """Result of a reset."""

    success: Literal[True] = Field(description="Always true: the robot may move.")
    message: str = Field(description="The result in words.")


class TakeControl(RequestModel):
    """The timeout of the lease, and whether to take it over."""

    model_config = example({"timeout_s": 60.0})

    timeout_s: float = Field(
        TIMEOUT_S,
        ge=TIMEOUTS_S[0],
        le=TIMEOUTS_S[1],
        description="Control ends when nothing has moved for this time, s.",
    )
    force: bool = Field(
        False,
        description="true: take control even if another client has it. The current motion ends, and "
        "the previous holder is informed.",
    )


class ControlAnswer(BaseModel):
    """The client that controls the robot."""

    held: bool = Field(description="Whether a client has control.")
    holder: str | None = Field(
        description="Name of the client's access token; without one its own name in quotes, or anonymous."
    )
    address: str | None = Field(description="Address of the client.")
    how: Literal["explicit", "implicit"] | None = Field(
        description="explicit: by a lease; implicit: by the current motion, until it ends."
    )
    what: str | None = Field(description="The request that is moving the arm.")
    since: datetime | None = Field(description="Time when the client took control, if known.")
    until: datetime | None = Field(description="Time when the lease ends, if nothing moves until then.")
    speed_fraction: float = Field(description="The speed override: share of the planned speed.")


class TakenAnswer(ControlAnswer):
    """The caller has control now."""

    token: str = Field(description="Token of the lease. Send it as the header X-Control-Token.")
    stopped: list[str] = Field(description="The request that was stopped to take control over.")


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

    x: float = Field(description="x of the rotation axis, times the sine of half the angle.")
    y: float = Field(description="y of the rotation axis, times the sine of half the angle.")
    z: float = Field(description="z of the rotation axis, times the sine of half the angle.")
    w: float = Field(description="The scalar part.")


class Angles(BaseModel):
    """KUKA angles A, B, C: rotations about z, then the new y, then the newest x."""

    a: float = Field(description="Angle about z.")
    b: float = Field(description="Angle about the new y.")
    c: float = Field(description="Angle about the newest x.")


class Orientation(BaseModel):
    quaternion: Quaternion = Field(description="The rotation as a unit quaternion.")
    euler_rad: Angles = Field(description="The same rotation as angles, rad.")
    euler_deg: Angles = Field(description="The same rotation as angles, degrees.")


class PoseAnswer(BaseModel):
    """The pose of the TCP, calculated from the measured joints."""

    position: Position = Field(description="Position of the TCP, m.")
    orientation: Orientation = Field(description="Orientation of the TCP.")
    frame_id: str = Field(description="The frame of position and orientation: the robot's base.")


class NamedPositionAnswer(BaseModel):
    """A `group_state` of the SRDF, or a taught position."""

    name: str = Field(description="Name of the position, for POST /robot/move/named.")
    label: str = Field(description="Displayed name; `name` if it has no other.")
    group: str = Field(description="The group of joints in the SRDF; `taught` for a taught position.")
    description: str = Field(description="The description from the SRDF, or from the client that taught it.")
    joints: list[float] = Field(description="rad")
    taught: bool = Field(description="true: a taught position, which can be deleted; false: from the SRDF.")


LogLines = Annotated[int, Field(ge=1, le=300, description="Number of lines, the newest ones.")]
MAX_LINE = 1000
"""Maximum length of a line in `after`, in characters. Even percent-encoded it then fits into a request's
header.
"""
MAX_LINES = 1_000_000


class LogQuery(StrictModel):
    """The number of log lines that a client requests."""

    model_config = ConfigDict(strict=False)

    limit: int | None = Field(None, ge=1, le=300, description=f"{LIMIT} Default: 50, the newest ones.")
    after: str | None = Field(
        None,
        max_length=MAX_LINE,
        description=f"A line of an earlier response, or its first {MAX_LINE} characters: the list continues "
        "after it.",
    )
    n: int = Field(
        50, ge=1, le=300, deprecated=True, description="The same as `limit`, which takes precedence."
    )

    def lines_of(self, newest: Callable[[int], list[str]]) -> list[str]:
        """Return the requested lines.

        Args:
            newest: returns this number of the newest lines, the oldest first.

        Raises:
            InputError: `after` is not among the kept lines.
        """
        limit: int = self.limit or deprecated_value(self, "n")
        if self.after is None:
            return newest(limit)
        kept = newest(MAX_LINES)
        keys = [line[:MAX_LINE] for line in kept]
        if self.after not in keys:
            raise InputError(
                "after: the log has no such line; it may be too old. Omit `after` for the newest lines"
            )
        begin = len(kept) - keys[::-1].index(self.after)
        return kept[begin : begin + limit]


class LogAnswer(BaseModel):
    """The newest log lines, in order of time, each with its time."""

    lines: list[str] = Field(description="The lines, the oldest first.")


class StartedAnswer(BaseModel):
    """The process of the sequence has started. /sequences/status reports whether the sequence file is
    valid.
    """

    status: Annotated[
        Literal["started"], Field(description="Always started: the sequence's process is running.")
    ] = "started"
    sequence_id: int = Field(description="Number of the sequence, counted from 1.")
    pid: int = Field(description="Process id.")


class SequenceStatusAnswer(BaseModel):
    """State of the newest sequence."""

    status: Literal["idle", "running", "finished"] = Field(
        description="State; idle: there was no sequence yet."
    )
    sequence_id: int | None = Field(description="Number of the sequence, counted from 1.")
    pid: int | None = Field(description="Process id.")
    iteration: int | None = Field(description="Number of the current iteration, counted from 1.")
    n_iterations: int | None = Field(description="Requested number of iterations.")
    waypoint: int | None = Field(
        description="Number of the current waypoint or step, from 1; 0 is the way home."
    )
    n_waypoints: int | None = Field(description="Number of waypoints or steps in an iteration.")
    step: str | None = Field(description="Current step, as in the log, including steps inside other steps.")
    started_at: datetime | None = Field(description="Time of the start.")
    finished_at: datetime | None = Field(description="Time of the end; null while the sequence is running.")
    returncode: int | None = Field(
        description="Exit code of the process. 0: success; negative: the signal that ended it."
    )
    bag_path: str | None = Field(description="The recording's folder; null without one.")


class StopAnswer(BaseModel):
    """The result of a stop: what was stopped, and where the arm is."""

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
            "confirmed_by": "cobot",
        }
    )

    success: bool = Field(
        description="true: the arm is known to be at rest, and no pending motion will move it."
    )
    message: str = Field(description="A sentence about what was stopped and what could not be confirmed.")
    stopped: list[str] = Field(description="The request that was in progress.")
    position: list[float] | None = Field(description="Measured joint positions, rad; null if unknown.")
    at_rest: bool = Field(description="Whether the arm is known to be at rest.")
    duration_s: float = Field(description="Time from request to answer, s.")
    category: int = Field(
        description="The stop category that was carried out. 2: the drives hold the arm; 1: the drives are "
        "off."
    )
    confirmed: bool = Field(
        description="Whether the device itself reports that the arm is at rest. Use `confirmed_by` instead.",
        json_schema_extra={"deprecated": True},
    )
    confirmed_by: Literal["cobot", "device"] | None = Field(
        description="The source that confirms the arm at rest: the device itself, or only cobot; null: "
        "neither."
    )
