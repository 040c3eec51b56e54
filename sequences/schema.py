"""The sequence file: JSON, with an optional home and the points to visit."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationError

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


class Sequence(StrictModel):
    """Targets that are visited in order, as often as one likes; home first in each iteration."""

    home: AnyTarget | None = None
    waypoints: list[AnyTarget] = Field(min_length=1, max_length=100_000)


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
