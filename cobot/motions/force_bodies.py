"""Requests for motions with force, as JSON: press, follow, search, insert."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cobot.loose_lists import RequestModel
from cobot.motions.bodies import MovePose, PathPoint
from cobot.motions.conditions import StepCondition
from cobot.motions.fields import Direction, Finite, example
from cobot.motions.planners import PATHS, PLANNERS, PlannerName, Way, in_words
from cobot.motions.signal_bodies import SignalFields

MIN_LENGTH = 1e-9
Pattern = Literal["spiral", "raster", "tilt"]
NotMet = Annotated[
    Literal["error", "success"],
    Field(
        description="Result if the requested end is not reached. error: `success` is false. success: it is "
        "true. In both cases `stopped_by` reports what ended the motion."
    ),
]


class ForceMotion(RequestModel):
    """Fields of all motions with force: direction and force of the TCP, and the limits of the motion."""

    direction: Direction = Field(
        Direction(x=0.0, y=0.0, z=1.0), description="Direction in which the TCP pushes, in `frame`."
    )
    frame: Literal["tool", "base"] = Field(
        "tool", description="Frame of `direction`: that of the TCP, or that of the robot's base."
    )
    force: Finite = Field(ge=0.1, le=1000.0, description="Force that the TCP exerts, N.")
    max_force: Finite | None = Field(
        None,
        ge=1.0,
        le=10_000.0,
        description="External force along an axis of the base frame beyond which the real-time loop stops "
        "the arm, checked in every cycle, N. Default: twice `force`, at least 20 N more. Less than 1 N is "
        "within the noise of the measurement.",
    )
    speed: Finite = Field(0.02, ge=0.001, le=0.1, description="Maximum speed towards the contact, m/s.")
    max_distance: Finite = Field(
        0.1, gt=0.0, le=1.0, description="Maximum distance along `direction` from the start of the TCP, m."
    )
    max_time_s: Finite = Field(30.0, gt=0.0, le=600.0, description="Maximum duration without pauses, s.")
    retract: Finite = Field(
        0.0,
        ge=0.0,
        le=0.5,
        description="Distance that the TCP retracts against `direction` at the end, m. 0: only the force is "
        "switched off.",
    )
    if_not_met: NotMet = "error"

    @model_validator(mode="after")
    def _require_push(self) -> Self:
        if math.hypot(self.direction.x, self.direction.y, self.direction.z) < MIN_LENGTH:
            raise ValueError("direction: is zero; give a direction such as {x: 0, y: 0, z: 1}")
        if self.max_force is not None and self.max_force <= self.force:
            raise ValueError(f"max_force is {self.max_force:g} N; it must be above force, {self.force:g} N")
        return self


class PressMotion(ForceMotion):
    """Approach until contact, then hold a force."""

    model_config = example({"force": 10.0, "duration_s": 1.0, "max_distance": 0.02, "if_not_met": "success"})

    duration_s: Finite = Field(1.0, ge=0.0, le=600.0, description="Time for which the force is held, s.")


class FollowMotion(ForceMotion):
    """Approach until contact, then move along a path while holding the force."""

    model_config = example(
        {
            "force": 10.0,
            "motion": {
                "x": 0.0,
                "y": 0.05,
                "z": 0.0,
                "planner": "lin",
                "frame_id": "tool",
                "speed_m_s": 0.05,
            },
            "max_distance": 0.02,
            "if_not_met": "success",
        }
    )

    motion: MovePose = Field(
        description=f"Path of the TCP from its start: planner {in_words(PATHS, 'or')}. Along `direction`, "
        "the force determines the motion instead."
    )
    max_deviation: Finite = Field(
        0.02,
        gt=0.0,
        le=0.5,
        description="Maximum deviation of the TCP from the path along `direction`, relative to the contact, "
        "m.",
    )

    @model_validator(mode="after")
    def _require_path(self) -> Self:
        given = [name for name in SignalFields.model_fields if getattr(self.motion, name)]
        if given:
            raise ValueError(
                f"motion.{given[0]}: a path with force cannot have actions or conditions; leave this key "
                "out, and use steps before and after the motion"
            )
        planner = PlannerName(self.motion.planner)
        if PLANNERS[planner].way is not Way.PATH:
            raise ValueError(
                f"motion.planner: {planner} does not follow a TCP path; valid planners: {in_words(PATHS)}"
            )
        return self


class SearchMotion(ForceMotion):
    """Approach until contact, then search for a hole or an edge while keeping contact."""

    model_config = example(
        {"force": 8.0, "radius": 0.004, "pitch": 0.0005, "max_distance": 0.02, "if_not_met": "success"}
    )

    pattern: Pattern = Field(
        "spiral",
        description="spiral: outwards around the start. raster: lines across a square. tilt: the tool "
        "tilts in all directions around the TCP, which stays in place.",
    )
    radius: Finite = Field(
        0.005, gt=0.0, le=0.2, description="Radius of the spiral, or half the side of the raster's square, m."
    )
    pitch: Finite = Field(0.001, ge=1e-5, le=0.05, description="Distance between two turns or lines, m.")
    angle: Finite = Field(
        0.05, gt=0.0, le=0.5, description="Largest tilt of the tool in the pattern tilt, rad."
    )
    search_speed: Finite = Field(
        0.01, ge=0.0005, le=0.1, description="Speed of the TCP along the pattern, m/s."
    )
    drop: Finite = Field(
        0.001,
        ge=1e-4,
        le=0.5,
        description="The hole is found when the TCP is this far beyond its position at full force, m.",
    )
    target: PathPoint | None = Field(
        None,
        description="The hole is also found when the TCP is within `tolerance` of this point of the base "
        "frame.",
    )
    tolerance: Finite = Field(
        0.001,
        ge=1e-4,
        le=0.1,
        description="Largest distance from `target` at which the search ends, m.",
    )
    until: StepCondition | None = Field(
        None, description="The hole is also found when an input has this value after the contact."
    )


class InsertMotion(SearchMotion):
    """Search, then push in compliantly to a depth."""

    model_config = example(
        {
            "force": 10.0,
            "radius": 0.003,
            "pitch": 0.0004,
            "depth": 0.01,
            "max_distance": 0.02,
            "if_not_met": "success",
        }
    )

    depth: Finite = Field(gt=0.0, le=0.5, description="Depth beyond the contact, m.")
    compliance: Finite = Field(
        0.05,
        ge=0.01,
        le=1.0,
        description="Stiffness of the TCP against tilting, as a share of the robot's nominal stiffness. "
        "With a low value, a peg that is not quite parallel to its hole aligns itself with it.",
    )


AnyForceMotion = PressMotion | FollowMotion | SearchMotion | InsertMotion
FORCE_MOTIONS: dict[str, type[AnyForceMotion]] = {
    "press": PressMotion,
    "follow": FollowMotion,
    "search": SearchMotion,
    "insert": InsertMotion,
}
"""The motions with force, by their names in REST, sequences, Lua and Python."""
