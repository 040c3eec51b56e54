"""The sequence file: JSON, with an optional home and the points to visit."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationError, model_validator

from cobot.errors import InputError
from cobot.strict import StrictModel, sentences, without_repetition

SCHEMA_FILE = Path(__file__).with_name("sequence.schema.json")
TAGS = ("joint target", "named target", "pose target")
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Target(StrictModel):
    """What every target may say."""

    speed: float = Field(0.1, ge=0.01, le=1.0, description="Share of the velocity limits.")
    accel_scale: float = Field(
        0.0, ge=0.0, le=1.0, description="Share of the acceleration and jerk limits; 0 takes speed."
    )
    label: str = Field("", max_length=200, description="For the log.")
    radius: float = Field(
        0.0,
        ge=0.0,
        le=1.0,
        allow_inf_nan=False,
        description="How far from here, m, the TCP may leave its path to go on without a stop; 0: it stops.",
    )


class JointTarget(Target):
    """Joint angles, reached by ptp."""

    joints: list[Finite] = Field(min_length=1, max_length=64, description="rad, one for each joint")


class NamedTarget(Target):
    """A named position, reached by ptp."""

    named: str = Field(min_length=1, max_length=200, description="One of GET /robot/positions.")


class Point(StrictModel):
    """m"""

    x: Finite
    y: Finite
    z: Finite


class PoseTarget(Target):
    """A pose of the TCP."""

    x: Finite = Field(description="m")
    y: Finite = Field(description="m")
    z: Finite = Field(description="m")
    a: Finite = Field(description="KUKA angle A about z, rad")
    b: Finite = Field(description="KUKA angle B about the new y, rad")
    c: Finite = Field(description="KUKA angle C about the newest x, rad")
    planner: Annotated[
        Literal["ompl", "ptp", "lin", "circ", "chomp", "auto"],
        BeforeValidator(lambda value: value.lower() if isinstance(value, str) else value),
    ] = "ptp"
    frame_id: str = ""
    via: Point | None = Field(None, description="A point on the arc, for circ.")


def _kind(value: Any) -> str:
    """A target with joints is a joint target, one with a name a named one; everything else is a pose."""
    keys = value if isinstance(value, dict) else vars(value) if isinstance(value, Target) else ()
    return TAGS[0] if "joints" in keys else TAGS[1] if "named" in keys else TAGS[2]


AnyTarget = Annotated[
    Annotated[JointTarget, Tag(TAGS[0])]
    | Annotated[NamedTarget, Tag(TAGS[1])]
    | Annotated[PoseTarget, Tag(TAGS[2])],
    Discriminator(_kind),
]


LONGEST_CHAIN = 50
"""So many targets are planned as one motion at the most."""


class Sequence(StrictModel):
    """Targets that are visited in order, as often as one likes; home first in each iteration."""

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
            if len(chain) > LONGEST_CHAIN:
                first, end = chain[0][0], chain[-1][0]
                raise ValueError(
                    f"waypoints[{max(first - 1, 0)}] to [{end - 1}] are {len(chain)} without a stop, "
                    f"possible are {LONGEST_CHAIN}; let one between them have no radius"
                )
        return self

    def chains(self) -> list[list[tuple[int, AnyTarget]]]:
        """The targets, each with its number from 1 (0 for home), by what is visited without a stop."""
        chains: list[list[tuple[int, AnyTarget]]] = [[]]
        home = [] if self.home is None else [(0, self.home)]
        for number, target in [*home, *enumerate(self.waypoints, start=1)]:
            chains[-1].append((number, target))
            if target.radius == 0.0:
                chains.append([])
        return [chain for chain in chains if chain]


def read_file(path: Path) -> bytes:
    """The bytes of a file; "-" is standard input.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return sys.stdin.buffer.read() if str(path) == "-" else path.read_bytes()
    except OSError as exc:
        raise InputError(f"cannot be read: {exc}") from exc


def read_sequence(path: Path) -> Sequence:
    """Read and validate a sequence file; "-" is standard input.

    Raises:
        InputError: naming each place, what stands there and what is valid.
    """
    raw = read_file(path)
    try:
        content = json.loads(raw.decode("utf-8-sig"), object_pairs_hook=without_repetition)
    except UnicodeDecodeError as exc:
        raise InputError(f"cannot be read: {exc}") from exc
    except ValueError as exc:  # JSONDecodeError, and Python's refusal of integers without end
        raise InputError(f"not valid JSON: {exc}") from exc
    except RecursionError as exc:
        raise InputError("not valid JSON: nested too deeply") from exc
    try:
        return Sequence.model_validate(content)
    except ValidationError as exc:
        raise InputError(sentences(exc.errors(), ignored=TAGS)) from exc


def schema_text() -> str:
    """The published JSON schema, as `sequence.schema.json` holds it."""
    schema = Sequence.model_json_schema()
    return json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, indent=2) + "\n"
