"""Targets: the motions of sequence files, each a body of POST /robot/move/..."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from cobot.motions.bodies import (
    ARC,
    JOINT,
    NAMED,
    POSE,
    JointMotion,
    MoveArc,
    MoveJoints,
    MovePose,
    Radius,
    kind_of,
)
from cobot.motions.signal_bodies import SignalFields

Label = Annotated[str, Field(max_length=200, description="Name of the waypoint for the log.")]
Comment = Annotated[str, Field(max_length=1000, description="Comment for people; the program ignores it.")]


class Target(SignalFields):
    """The fields of every target in addition to its motion. The motion is a body of POST /robot/move/..."""

    label: Label = ""
    comment: Comment = ""
    radius: Radius = Field(
        0.0,
        description="Blend radius: distance from this target, m, within which the TCP may leave its path "
        "to continue without a stop. 0: the arm stops.",
    )

    def body(self) -> dict[str, Any]:
        """The body of its motion request: the fields that were given."""
        return self.model_dump(exclude={"label", "comment", "radius"}, exclude_unset=True, by_alias=True)


class JointTarget(Target, MoveJoints):
    """Joint angles."""


class NamedTarget(Target, JointMotion):
    """A named position."""

    named: str = Field(
        min_length=1, max_length=200, description="Name of a position in GET /robot/positions."
    )

    def body(self) -> dict[str, Any]:
        body = super().body()
        return {"name": body.pop("named"), **body}


class ArcTarget(Target, MoveArc):
    """The end of an arc that is given by an angle about an axis; also full circles and helices."""


class PoseTarget(Target, MovePose):
    """A pose of the TCP."""

    through_radius: Radius = Field(
        0.0,
        description="For polyline: blend radius at the poses of `through`, m. In POST /robot/move/pose "
        "this field is `radius`.",
    )

    def body(self) -> dict[str, Any]:
        body = super().body()
        return body | ({"radius": body.pop("through_radius")} if "through_radius" in body else {})


AnyTarget = Annotated[
    Annotated[JointTarget, Tag(JOINT)]
    | Annotated[NamedTarget, Tag(NAMED)]
    | Annotated[ArcTarget, Tag(ARC)]
    | Annotated[PoseTarget, Tag(POSE)],
    Discriminator(kind_of),
]
