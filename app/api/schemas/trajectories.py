"""Trajectories through timed points as JSON: requests and answers."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field

from app.api.schemas.robot import WAIT
from cobot.loose_lists import RequestModel
from cobot.motions.fields import HOME, Finite, example
from cobot.strict import StrictModel

VALIDATE = "false: skip this check. The safety layer of the real-time process remains active."
RETIME = (
    "true: slow the motion down where the limits require it, by any amount; false: reject it if it becomes "
    "more than 5 % slower."
)
SMOOTHING = (
    "Maximum deviation from the curve through the points, where the curve exceeds the limits, rad; 0: "
    "follow it exactly. Default: the setting planning.smoothing_rad."
)
MAX_SMOOTHING_RAD = 0.01
MOVE_TO_START = "true: first move to the first point by ptp; false: the arm must already be there."


class TrajectoryPoint(RequestModel):
    """Positions of the joints at a time. Velocities and accelerations that are not given come from a smooth
    curve through all points.
    """

    positions: list[Finite] = Field(max_length=64, description="Joint positions, rad.")
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
        min_length=1, max_length=100_000, description="The points, at strictly increasing times."
    )
    validate_limits: bool = Field(True, description=VALIDATE)
    retime: bool = Field(False, description=RETIME)
    move_to_start: bool = Field(False, description=MOVE_TO_START)
    smoothing_rad: Finite | None = Field(None, ge=0.0, le=MAX_SMOOTHING_RAD, description=SMOOTHING)


class CsvQuery(StrictModel):
    """Format of a CSV file, and options of the motion; see SendTrajectory."""

    model_config = ConfigDict(strict=False)  # a query consists of strings

    separator: str | None = Field(
        None,
        min_length=1,
        max_length=1,
        description="Separator of the columns, one character. Default: the separator in the header, which "
        "is a semicolon, a tab, a comma or white space. Numbers may have decimal commas only "
        "with semicolons.",
    )
    validate_limits: bool = Field(True, description=VALIDATE)
    retime: bool = Field(False, description=RETIME)
    move_to_start: bool = Field(False, description=MOVE_TO_START)
    smoothing_rad: Finite | None = Field(None, ge=0.0, le=MAX_SMOOTHING_RAD, description=SMOOTHING)
    wait: bool = Field(True, description=WAIT)


class SentAnswer(BaseModel):
    """The real-time process has verified the motion and begun it; /trajectory/logs reports its end."""

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

    status: Annotated[Literal["sent"], Field(description="Always sent: the motion has begun.")] = "sent"
    motion_id: int = Field(description="Number of the motion, as in /trajectory/logs and in the state.")
    duration_s: float = Field(
        description="Duration of the whole motion, s, including the motion to the start."
    )
    points: int = Field(description="Number of points that were sent.")
    note: str = Field(
        "", description="Differences between the motion and the request, with the reason; empty: none."
    )
    blended_rad: float = Field(
        0.0,
        description="Distance of the arm from the first point at the start. The motion removes it smoothly.",
    )
    smoothed_rad: float = Field(0.0, description="Maximum deviation of the motion from the curve, rad.")
    stretch: float = Field(1.0, description="Duration of the motion relative to that of the points.")
    slowed_s: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        None, description="Time range of the points in which the motion is slower than requested."
    )
