"""The sequence file: JSON with an optional home and the waypoints to visit."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from cobot import shipped
from cobot.errors import InputError
from cobot.loose_lists import RequestModel
from cobot.motions.bodies import (
    ARC,
    JOINT,
    MAX_MOTIONS,
    MOTION_TAGS,
    NAMED,
    POSE,
    JointMotion,
    MoveArc,
    MoveJoints,
    MovePose,
    Radius,
    kind_of,
)
from cobot.strict import sentences, without_repetition

SCHEMA_FILE = shipped.FOLDER / "sequences" / "sequence.schema.json"


class Target(RequestModel):
    """Fields of every target in addition to its motion, which is a body of POST /robot/move/..."""

    label: str = Field("", max_length=200, description="For the log.")
    radius: Radius = Field(
        0.0,
        description="How far from here, m, the TCP may leave its path to go on without a stop; 0: it stops.",
    )

    def body(self) -> dict[str, Any]:
        """The body of its motion request: the fields that were given."""
        return self.model_dump(exclude={*Target.model_fields}, exclude_unset=True)


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


class Sequence(RequestModel):
    """Targets that are visited in order, any number of times; each iteration begins at home, if given."""

    home: AnyTarget | None = None
    waypoints: list[AnyTarget] = Field(min_length=1, max_length=100_000)

    @model_validator(mode="after")
    def _ends_at_rest(self) -> Self:
        if self.waypoints[-1].radius > 0.0:
            last = len(self.waypoints) - 1
            raise ValueError(
                f"waypoints[{last}].radius: the last waypoint has a radius, but the arm stops there; "
                "leave it out"
            )
        for chain in self.chains():
            if len(chain) > MAX_MOTIONS:
                first, end = chain[0][0], chain[-1][0]
                raise ValueError(
                    f"waypoints[{max(first - 1, 0)}] to [{end - 1}] are {len(chain)} without a stop, "
                    f"allowed are {MAX_MOTIONS}; remove the radius of one between them"
                )
        return self

    def chains(self) -> list[list[tuple[int, AnyTarget]]]:
        """The targets, each with its number from 1 (0 for home), grouped by what is visited without a
        stop."""
        chains: list[list[tuple[int, AnyTarget]]] = [[]]
        home = [] if self.home is None else [(0, self.home)]
        for number, target in [*home, *enumerate(self.waypoints, start=1)]:
            chains[-1].append((number, target))
            if target.radius == 0.0:
                chains.append([])
        return [chain for chain in chains if chain]


def read_file(path: Path) -> bytes:
    """Read the bytes of a file; "-" is standard input.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        return sys.stdin.buffer.read() if str(path) == "-" else path.read_bytes()
    except OSError as exc:
        raise InputError(f"cannot be read: {exc}") from exc


def read_sequence(path: Path) -> Sequence:
    """Read and validate a sequence file; "-" is standard input.

    Raises:
        InputError: names each place, its value and what is valid.
    """
    raw = read_file(path)
    try:
        content = json.loads(raw.decode("utf-8-sig"), object_pairs_hook=without_repetition)
    except UnicodeDecodeError as exc:
        raise InputError(f"cannot be read: {exc}") from exc
    except ValueError as exc:  # also an integer with too many digits for Python
        raise InputError(f"not valid JSON: {exc}") from exc
    except RecursionError as exc:
        raise InputError("not valid JSON: nested too deeply") from exc
    return sequence_of(content)


def sequence_of(content: Any) -> Sequence:
    """Validate a sequence from a file or a program.

    Raises:
        InputError: names each place, its value and what is valid.
    """
    try:
        return Sequence.model_validate(content)
    except ValidationError as exc:
        raise InputError(sentences(exc.errors(), ignored=MOTION_TAGS)) from exc


def schema_text() -> str:
    """The published JSON schema, the content of `sequence.schema.json`."""
    schema = Sequence.model_json_schema()
    return json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, indent=2) + "\n"
