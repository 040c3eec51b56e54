"""A sequence file as the program of a study.

A study plans and simulates motions from one position to the next. All other steps of the sequence, such as
gripper commands, are left out; the arm only stops at these steps.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import Field, TypeAdapter, ValidationError

from cobot.config import Location
from cobot.config.section import parse
from cobot.errors import ConfigError
from cobot.motions.bodies import MOTION_TAGS, AnyMotion, MoveArc, MoveNamed, MovePose
from cobot.motions.signal_bodies import SignalFields
from cobot.strict import StrictModel, sentences, shown, unknown_key, without_repetition
from cobot.types import Pose

STANDING = {"gripper", "set", "wait_for", "wait_s"}
"""Keys of steps during which the arm does not move."""
USED = {"name", "joints", *"xyzabc", "frame_id", "planner", "speed", "speed_m_s", "accel_scale"}
"""Fields of motions that a study uses."""
LEFT_OUT = set(SignalFields.model_fields)
"""Fields of motions that are ignored, because each motion runs to its goal."""
INSTEAD = "list the moves in program instead of the file"
COPIED = ("planner", "speed", "speed_m_s", "accel_scale")
OTHER_STEPS = ("repeat", "if", "call", "pallet", "press", "follow", "search", "insert")
HOME = "home"

_MOTION: TypeAdapter[Any] = TypeAdapter(AnyMotion)


class SequenceProgram(StrictModel):
    """The motions of a sequence file.

    Attributes:
        moves: further keys of motions, by their locations in the file: `home`, `waypoints[2]` or `steps[0]`.
    """

    file: Location
    moves: dict[str, dict[str, Any]] = Field(default_factory=dict)


def with_programs(document: dict[str, Any], folder: Path, name: str) -> dict[str, Any]:
    """A copy of a study's document, in which the names of sequence files are replaced by the motions from
    these files.

    The results of a study then do not depend on these files, and workers do not need them.

    Args:
        folder: folder for relative paths.
        name: name of the document, for errors.

    Raises:
        ConfigError: a file is missing or invalid, or contains motions that a study cannot compute.
    """
    found = dict(document)
    if isinstance(program := document.get("program"), dict):
        choice = parse(SequenceProgram, folder / Path(name).name, program, "program: ")
        found["program"] = program_of(_read(choice.file), str(choice.file), choice.moves)
    if isinstance(study := document.get("study"), dict):
        found["study"] = with_programs(study, folder, name)
    if isinstance(variants := document.get("variants"), dict):
        found["variants"] = {
            variant: with_programs(changes, folder, name) if isinstance(changes, dict) else changes
            for variant, changes in variants.items()
        }
    return found


def program_of(text: str, name: str, changes: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The motions of one iteration, from `home` to all waypoints and back. Without `home`, they begin at the
    first waypoint.

    Args:
        text: content of a sequence file.
        name: file name, for errors.
        changes: see `SequenceProgram.moves`.

    Raises:
        ConfigError: see `with_programs`.
    """
    content = _parsed(text, name)
    word = "waypoints" if "waypoints" in content else "steps"
    if not isinstance(items := content.get(word), list):
        raise ConfigError(f"{name}: has no list of waypoints or steps, so it is not a sequence file")
    moves: dict[str, dict[str, Any]] = {}
    if content.get(HOME) is not None:
        moves[HOME] = _move(name, HOME, content[HOME])
    for place, step in _motions(word, items):
        if step is not None:
            moves[place] = _move(name, place, step)
        elif moves:
            moves[next(reversed(moves))]["stop"] = True
    for place, change in changes.items():
        if place not in moves:
            raise ConfigError(f"program.moves: {unknown_key(place, list(moves), 'motion')}")
        moves[place] |= change
    return [*moves.values(), *([moves[HOME]] if HOME in moves else [])]


def _read(path: Path) -> str:
    try:
        return path.read_text("utf-8-sig")
    except OSError as exc:
        raise ConfigError(f"program.file: {path}: cannot be read: {exc.strerror}") from exc
    except UnicodeDecodeError as exc:
        raise ConfigError(f"program.file: {path}: is not UTF-8: {exc}") from exc


def _parsed(text: str, name: str) -> dict[str, Any]:
    try:
        content = json.loads(text, object_pairs_hook=without_repetition)
    except (ValueError, RecursionError) as exc:
        raise ConfigError(f"{name}: not valid JSON: {exc}") from exc
    if not isinstance(content, dict):
        raise ConfigError(f"{name}: is not a JSON object, so it is not a sequence file")
    return content


def _motions(place: str, steps: list[Any]) -> Iterator[tuple[str, Any]]:
    """The steps with their locations in the file. A step during which the arm does not move is None."""
    for number, step in enumerate(steps):
        here = f"{place}[{number}]"
        keys = set(step) if isinstance(step, dict) else set()
        if "on_error" in keys and isinstance(step.get("do"), list):
            yield from _motions(f"{here}.do", step["do"])
        elif keys & STANDING:
            yield here, None
        else:
            yield here, step


def _move(name: str, place: str, step: Any) -> dict[str, Any]:
    """Convert a waypoint to a move of a study."""
    if not isinstance(step, dict):
        raise ConfigError(f"{name}: {place}: must be a waypoint, got {shown(step)}")
    if other := [key for key in OTHER_STEPS if key in step]:
        raise ConfigError(f"{name}: {place}: a study does not compute {other[0]}; {INSTEAD}")
    fields = {key: value for key, value in step.items() if key not in ("label", "radius")}
    if "named" in fields:
        fields["name"] = fields.pop("named")
    try:
        body = _MOTION.validate_python(fields)
    except ValidationError as exc:
        raise ConfigError(f"{name}: {place}: {sentences(exc.errors(), ignored=MOTION_TAGS)}") from exc
    unused = sorted(body.model_fields_set - USED - LEFT_OUT)
    if isinstance(body, MoveArc) or unused or fields.get("frame_id"):
        what = "arcs" if isinstance(body, MoveArc) else ", ".join(unused or ["frame_id"])
        raise ConfigError(f"{name}: {place}: a study does not compute {what}; {INSTEAD}")
    label = f"{place} {step['label']}" if step.get("label") else place
    found = {"label": label} | {key: getattr(body, key) for key in COPIED if hasattr(body, key)}
    if found.get("speed_m_s") is not None and "speed" not in body.model_fields_set:
        found["speed"] = 1.0
    if isinstance(body, MovePose):
        return found | {"pose": list(Pose.from_abc(body.x, body.y, body.z, body.a, body.b, body.c).numbers)}
    return found | {"to": body.name if isinstance(body, MoveNamed) else body.joints}
