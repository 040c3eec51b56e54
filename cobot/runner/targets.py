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

Label = Annotated[str, Field(max_length=200, description="For the log.")]
Comment = Annotated[str, Field(max_length=1000, description="For people; the program does not use it.")]


class Target(SignalFields):
    """Fields of every target in addition to its motion, which is a body of POST /robot/move/..."""

    label: Label = ""
    comment: Comment = ""
    radius: Radius = Field(
        0.0,
        description="How far from here, m, the TCP may leave its path to go on without a stop; 0: it stops.",
    )

    def body(self) -> dict[str, Any]:
        """The body of its motion request: the fields that were given."""
        return self.model_dump(exclude={"label", "comment", "radius"}, exclude_unset=True, by_alias=True)


class JointTarget(Target, MoveJoints):
    """Joint angles."""


class NamedTarget(Target, JointMotion):
    """A named position."""

    named: str = Field(min_length=1, max_length=200, description="One of GET /robot/positions.")

    def body(self) -> dict[str, Any]:
        body = super().body()
        return {"name": body.pop("named"), **body}


class ArcTarget(Target, MoveArc):
    """Wherever an angle about an axis leads the TCP: arcs, full circles, helices."""


class PoseTarget(Target, MovePose):
    """A pose of the TCP."""

    through_radius: Radius = Field(
        0.0, description="What `radius` is of a motion alone: that of the poses of `through`, of polyline."
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
