"""Sequence files: what is valid, and what the published schema says about it.

Oracle: jsonschema_rs, a validator of others, reads the published schema.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema_rs
import pytest
from pydantic import BaseModel

from cobot.errors import InputError
from cobot.motions.bodies import MoveArc, MoveJoints, MoveNamed, MovePose
from cobot.runner.schema import (
    SCHEMA_FILE,
    ArcTarget,
    JointTarget,
    NamedTarget,
    PoseTarget,
    Target,
    read_sequence,
    schema_text,
)

EXAMPLES = Path(__file__).parents[3] / "examples"
POSE = {"x": 0.4, "y": 0.0, "z": 0.5, "a": 0.0, "b": 3.14, "c": 0.0}
UP = {"x": 0, "y": 0, "z": 1}
ARC = {"centre": {"x": 0.4, "y": 0.1, "z": 0.5}, "axis": UP, "angle": 7.0}
JOINTS = {"joints": [0, 0, 0, -1.57, 0, 1.57, 0]}


@pytest.fixture(scope="module")
def validator() -> Any:
    return jsonschema_rs.validator_for(json.loads(SCHEMA_FILE.read_text(encoding="utf-8")))


def written(folder: Path, content: object) -> Path:
    file = folder / "sequence.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return file


def test_the_published_schema_is_the_one_that_the_code_has() -> None:
    assert SCHEMA_FILE.read_text(encoding="utf-8") == schema_text()


@pytest.mark.parametrize("name", ["motion_sequence_config.json", "paths.json"])
def test_the_examples_are_valid_for_both(validator: Any, name: str) -> None:
    validator.validate(json.loads((EXAMPLES / name).read_text(encoding="utf-8")))
    assert len(read_sequence(EXAMPLES / name).waypoints) > 0


@pytest.mark.parametrize(
    ("target", "motion", "named"),
    [
        (JointTarget, MoveJoints, {}),
        (NamedTarget, MoveNamed, {"name": "named"}),
        (ArcTarget, MoveArc, {}),
        (PoseTarget, MovePose, {"radius": "through_radius"}),
    ],
)
def test_a_target_takes_all_that_its_motion_takes(
    target: type[Target], motion: type[BaseModel], named: dict[str, str]
) -> None:
    of_motion = {named.get(name, name) for name in motion.model_fields}
    assert target.model_fields.keys() == of_motion | {"label", "radius"}


@pytest.mark.parametrize(
    "waypoint",
    [
        JOINTS,
        {"named": "work"},
        POSE,
        {**POSE, "planner": "circ", "via": {"x": 0, "y": 0, "z": 0}, "speed": 1},
        {**POSE, "planner": "circ", "centre": UP, "axis": UP, "speed_rad_s": 0.5, "frame_id": "tool"},
        {**POSE, "planner": "polyline", "through": [POSE], "through_radius": 0.1, "speed_m_s": 0.5},
        {"x": 0.4, "y": 0.0, "z": 0.5, "planner": "auto", "algorithm": "PRM"},
        {**JOINTS, "planner": "ompl", "constraints": {"orientation": {"within_rad": 0.1}}},
        {"named": "work", "planner": "chomp", "synchronization": "time"},
        ARC,
        {**ARC, "rise": 0.1, "turn_tool": True, "constraints": {"joints": {"joint1": [-1.0, 1.0]}}},
    ],
)
def test_every_kind_of_target_is_valid_for_both(
    tmp_path: Path, validator: Any, waypoint: dict[str, Any]
) -> None:
    content = {"home": JOINTS, "waypoints": [waypoint]}
    validator.validate(content)
    assert len(read_sequence(written(tmp_path, content)).waypoints) == 1


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({}, "waypoints: is missing"),
        ({"waypoints": []}, "waypoints"),
        ({"waypoints": [{**JOINTS, "sped": 1}]}, "waypoints[0]: unknown key 'sped' (did you mean 'speed'?)"),
        ({"waypoints": [{"joints": ["0"]}]}, "waypoints[0].joints[0]"),
        ({"waypoints": [{**JOINTS, "speed": 0}]}, "waypoints[0].speed"),
        ({"waypoints": [{**JOINTS, "speed": True}]}, "waypoints[0].speed"),
        ({"waypoints": [{**JOINTS, "radius": -0.1}, JOINTS]}, "waypoints[0].radius"),
        ({"waypoints": [{**JOINTS, "radius": "wide"}, JOINTS]}, "waypoints[0].radius"),
        ({"waypoints": [{"x": 0.4, "y": 0}]}, "waypoints[0].z: is missing"),
        ({"waypoints": [{**POSE, "planner": "stomp"}]}, "waypoints[0].planner"),
        ({"waypoints": [{**JOINTS, "planner": "lin"}]}, "waypoints[0].planner"),
        ({"waypoints": [{**POSE, "through_radius": 2}]}, "waypoints[0].through_radius"),
        ({"waypoints": [{**POSE, "through": [UP, {"x": 1}]}]}, "waypoints[0].through[1].y: is missing"),
        ({"waypoints": [{"angle": 1.0}]}, "waypoints[0].centre: is missing"),
        ({"waypoints": [{**ARC, "angle": 1e3}]}, "waypoints[0].angle"),
        ({"waypoints": [{**ARC, "planner": "circ"}]}, "waypoints[0]: unknown key 'planner'"),
        ({"waypoints": [{"name": "home"}]}, "unknown key 'name' (did you mean 'named'?)"),
        ({"waypoints": ["home"]}, "waypoints[0]"),
        ({"waypoints": [{**POSE, "constraints": {"orientation": {}}}]}, "within_rad: is missing"),
        ({"waypoints": [JOINTS], "hom": None}, "unknown key 'hom'"),
        ([], ""),
    ],
)
def test_what_one_refuses_the_other_refuses_too(
    tmp_path: Path, validator: Any, content: object, words: str
) -> None:
    assert not validator.is_valid(content)
    with pytest.raises(InputError) as caught:
        read_sequence(written(tmp_path, content))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("waypoints", "words"),
    [
        ([JOINTS, {**JOINTS, "radius": 0.1}], "waypoints[1].radius: the last waypoint has a radius"),
        ([{**JOINTS, "radius": 0.1}] * 50 + [JOINTS], "waypoints[0] to [50] are 51 without a stop, allowed"),
    ],
)
def test_a_sequence_comes_to_rest_at_its_end_and_now_and_then(
    tmp_path: Path, waypoints: list[object], words: str
) -> None:
    with pytest.raises(InputError) as caught:
        read_sequence(written(tmp_path, {"waypoints": waypoints}))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not valid JSON"),
        ('{"waypoints": [NaN', "not valid JSON"),
        ('{"waypoints": [{"joints": [NaN]}]}', "joints[0]"),
        ('{"waypoints": [{"joints": [1e999]}]}', "joints[0]"),
        ('{"waypoints": [{"named": "a", "named": "b"}]}', "the key 'named' occurs twice"),
        ("[" * 100_000, "not valid JSON"),
        ("\x00\x01", "not valid JSON"),
    ],
)
def test_what_is_no_json_is_refused_with_its_place(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        read_sequence(written(tmp_path, text))
    assert words in str(caught.value)


def test_a_file_with_many_errors_names_the_first_and_counts_the_rest(tmp_path: Path) -> None:
    content = {"waypoints": [{"joints": []} | {"speed": 9}] * 40}
    with pytest.raises(InputError, match=r"and \d+ more$") as caught:
        read_sequence(written(tmp_path, content))
    assert len(str(caught.value)) < 2000
