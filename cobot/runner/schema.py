"""The sequence file: JSON, with an optional home, and waypoints or steps."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import ConfigDict, Field, ValidationError, model_validator

from cobot import shipped
from cobot.errors import InputError
from cobot.loose_lists import RequestModel
from cobot.runner.blocks import Numbered, groups, require_stops, walk
from cobot.runner.steps import IGNORED_TAGS, MAX_DEPTH, MAX_STEPS, Block, Step
from cobot.runner.targets import AnyTarget, Target
from cobot.strict import sentences, without_repetition

SCHEMA_FILE = shipped.FOLDER / "sequences" / "sequence.schema.json"
MAX_JSON_DEPTH = 2 * MAX_DEPTH + 20
"""Maximum depth of a document. Each list of steps adds two levels, and a waypoint has some additional
levels.
"""
Waypoints = Annotated[list[AnyTarget], Field(min_length=1, max_length=MAX_STEPS)]


class Sequence(RequestModel):
    """Steps that run in order, in each iteration after the motion to home. `waypoints` are steps that only
    move.
    """

    model_config = ConfigDict(
        json_schema_extra={"oneOf": [{"required": ["waypoints"]}, {"required": ["steps"]}]}
    )

    home: AnyTarget | None = None
    waypoints: Waypoints = Field(default_factory=list, description="Only waypoints. Give this or `steps`.")
    steps: Block = Field(default_factory=list, description="Waypoints and other steps.")

    @property
    def items(self) -> list[Target | Step]:
        """The steps, or the waypoints."""
        return list(self.steps or self.waypoints)

    @property
    def word(self) -> str:
        """The word for an entry of this sequence in the log: "step" or "waypoint"."""
        return "step" if self.steps else "waypoint"

    @model_validator(mode="after")
    def _require_one_list(self) -> Self:
        if bool(self.steps) == bool(self.waypoints):
            given = "both are given" if self.steps else "waypoints and steps are both missing"
            raise ValueError(f"{given}; a sequence has either waypoints or steps")
        return self

    @model_validator(mode="after")
    def _require_stops(self) -> Self:
        first = self.items[0]
        if self.home is not None and self.home.radius > 0.0 and not isinstance(first, Target):
            raise ValueError("home.radius: the first step is not a waypoint; leave the radius out")
        require_stops(self.items, f"{self.word}s", self.word, self.home)
        for place, depth, step in walk(self.items, f"{self.word}s"):
            if depth > MAX_DEPTH:
                raise ValueError(f"{place}: steps are nested more than {MAX_DEPTH} deep; flatten them")
            if isinstance(step, Step):
                for key, block in step.blocks().items():
                    require_stops(block, f"{place}.{key}", "step")
        return self

    def groups(self) -> list[list[Numbered]]:
        """The numbered steps, grouped so that the arm does not stop within a group. The first step is number
        1, and home is number 0.
        """
        if self.home is None:
            return groups(self.items)
        return groups([self.home, *self.items], first=0)

    def groups_from(self, number: int) -> list[list[Numbered]]:
        """The groups of an iteration that begins with this step. The step may be in the middle of a group.

        Raises:
            InputError: there is no such step.
        """
        found = self.groups()
        for index, group in enumerate(found):
            if group[-1][0] >= number:
                return [[each for each in group if each[0] >= number], *found[index + 1 :]]
        raise InputError(f"there is no {self.word} {number}: the last one is {len(self.items)}")


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
        InputError: the file is not valid; the message names each place, its value and the valid values.
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


def _require_flat(content: Any) -> None:
    """Check the nesting of a document, because pydantic recurses over it with a limited stack.

    Raises:
        InputError: the document is nested too deeply.
    """
    level = [content]
    for _ in range(MAX_JSON_DEPTH):
        level = [item for each in level for item in _items(each)]
        if not level:
            return
    raise InputError(f"steps are nested too deeply, allowed: {MAX_DEPTH} levels of lists; flatten them")


def _items(value: Any) -> Iterator[Any]:
    if isinstance(value, dict):
        return iter(value.values())
    return iter(value if isinstance(value, list) else ())


def sequence_of(content: Any) -> Sequence:
    """Validate a sequence from a file or a program.

    Raises:
        InputError: the content is not valid; the message names each place, its value and the valid values.
    """
    _require_flat(content)
    try:
        return Sequence.model_validate(content)
    except ValidationError as exc:
        raise InputError(sentences(exc.errors(), ignored=IGNORED_TAGS)) from exc


def schema_text() -> str:
    """The published JSON schema, the content of `sequence.schema.json`."""
    schema = Sequence.model_json_schema()
    return json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, indent=2) + "\n"
