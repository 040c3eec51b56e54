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
from cobot.runner.schema import SCHEMA_FILE, read_sequence, schema_text, sequence_of
from cobot.runner.targets import ArcTarget, JointTarget, NamedTarget, PoseTarget, Target

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
    assert target.model_fields.keys() == of_motion | {"label", "comment", "radius"}


def test_a_comment_is_for_people_and_never_in_a_request() -> None:
    target = {**JOINTS, "label": "above", "comment": "the part is wet"}
    steps = [target, {"wait_s": 0.1, "comment": "it drips"}]
    first, second = sequence_of({"steps": steps}).steps
    assert isinstance(first, Target)
    assert first.body() == JOINTS
    assert (first.comment, second.comment) == ("the part is wet", "it drips")
    with pytest.raises(InputError, match="comment"):
        sequence_of({"steps": [{"wait_s": 0.1, "comment": "x" * 1001}]})


def test_the_body_of_a_target_has_the_words_of_the_document() -> None:
    """Two of them, `is` and `from`, are no names of attributes in Python."""
    given = {
        **JOINTS,
        "start_when": {"input": "part", "is": True},
        "actions": [{"at": {"fraction": 0.5, "from": "end"}, "event": "half way"}],
    }
    target = JointTarget.model_validate({**given, "label": "there", "radius": 0.1})
    assert target.body() == given


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
        ({}, "waypoints and steps are both missing"),
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
        (
            [{**JOINTS, "radius": 0.1}] * 50 + [JOINTS],
            ("waypoints[0] to [50] are 51 targets without a stop, allowed"),
        ),
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


PART = {"input": "part", "is": True}
WAIT = {"wait_s": 1.5}
GRID = {"origin": POSE, "counts": [2, 3], "offsets": [{"x": 0.1}, {"y": 0.1}]}
OUTPUT = {"output": "lamp", "value": True}
PUSH = {"direction": {"x": 0, "y": 0, "z": -1}, "frame": "base", "force": 10}
ALONG = {"x": 0.5, "y": 0.1, "z": 0.4, "planner": "lin", "speed_m_s": 0.05}


def nested(depth: int) -> dict[str, Any]:
    """A step in so many others."""
    step: dict[str, Any] = WAIT
    for _ in range(depth):
        step = {"repeat": {}, "do": [step]}
    return step


@pytest.mark.parametrize(
    "step",
    [
        JOINTS,
        {"gripper": {"command": "grasp", "width": 0.04, "tolerance_inner": 0.01, "force": 20}},
        {"gripper": {"command": "move", "width": 0.08, "speed": 0.1}},
        {"gripper": {"command": "release"}},
        {"gripper": {"command": "home"}},
        {"gripper": {"command": "stop"}, "label": "stay"},
        {"press": PUSH, "label": "touch"},
        {"press": {"force": 10, "duration_s": 2, "max_force": 40, "retract": 0.01, "if_not_met": "success"}},
        {"follow": {**PUSH, "motion": ALONG, "max_deviation": 0.01}},
        {"search": {**PUSH, "pattern": "raster", "until": PART, "target": UP, "tolerance": 0.01}},
        {"insert": {**PUSH, "depth": 0.02, "compliance": 0.1, "max_time_s": 200}},
        {"set": OUTPUT, "label": "light"},
        {"set": {"output": "level", "value": 0.5}},
        {"wait_for": PART},
        {"wait_for": {"input": "level", "below": 3}, "timeout_s": 0},
        WAIT,
        {"repeat": {}, "do": [WAIT]},
        {
            "repeat": {"count": 3, "while": PART, "until": {"input": "level", "above": 1}},
            "do": [JOINTS, WAIT],
        },
        {"if": PART, "then": [WAIT]},
        {"if": PART, "then": [WAIT], "else": [JOINTS]},
        {"call": "pick.json"},
        {"pallet": GRID, "do": [{**POSE, "frame_id": "place"}]},
        {"on_error": {}, "do": [WAIT]},
        {"on_error": {"retry": 3, "run": [JOINTS], "go_on": True}, "do": [WAIT]},
        nested(19),
    ],
)
def test_every_kind_of_step_is_valid_for_both(tmp_path: Path, validator: Any, step: dict[str, Any]) -> None:
    content = {"home": JOINTS, "steps": [step]}
    validator.validate(content)
    assert len(read_sequence(written(tmp_path, content)).items) == 1


@pytest.mark.parametrize(
    ("step", "words"),
    [
        (
            {"sett": OUTPUT},
            "steps[0]: must be a step with one of gripper, press, follow, search, insert, set,",
        ),
        ("home", "steps[0]: must be a step with one of"),
        (
            {"gripper": {}},
            "steps[0].gripper: must have a command, one of move, grasp, release, home, stop, got",
        ),
        ({"gripper": {"command": "grip"}}, "steps[0].gripper: must have a command, one of move, grasp,"),
        ({"gripper": "grasp"}, "steps[0].gripper: must have a command"),
        ({"gripper": {"command": "move"}}, "steps[0].gripper.width: is missing"),
        ({"gripper": {"command": "move", "width": -1}}, "steps[0].gripper.width: must be greater than or"),
        ({"gripper": {"command": "stop", "width": 0}}, "steps[0].gripper: unknown key 'width'"),
        ({"press": {}}, "steps[0].press.force: is missing"),
        ({"press": 10}, "steps[0].press: must be an object"),
        ({"press": {"force": 0}}, "steps[0].press.force: must be greater than or equal to 0.1, got 0"),
        ({"press": {**PUSH, "depth": 1}}, "steps[0].press: unknown key 'depth'"),
        ({"press": PUSH, "follow": PUSH}, "steps[0]: unknown key 'follow'"),
        ({"follow": PUSH}, "steps[0].follow.motion: is missing"),
        ({"follow": {**PUSH, "motion": {"x": 1}}}, "steps[0].follow.motion.y: is missing"),
        ({"search": {**PUSH, "pattern": "zigzag"}}, "steps[0].search.pattern: must be"),
        ({"search": {**PUSH, "until": {"input": ""}}}, "steps[0].search.until.input"),
        ({"insert": PUSH}, "steps[0].insert.depth: is missing"),
        ({"set": {"output": "lamp"}}, "steps[0].set.value: is missing"),
        ({"set": OUTPUT, "wait_s": 1}, "steps[0]: unknown key 'wait_s'"),
        ({"wait_for": {**PART, "iss": 1}}, "steps[0].wait_for: unknown key 'iss' (did you mean 'is'?)"),
        (
            {"wait_for": PART, "timeout_s": 1e6},
            "steps[0].timeout_s: must be less than or equal to 86400, got",
        ),
        ({"wait_s": -1}, "steps[0].wait_s: must be greater than or equal to 0, got -1"),
        ({"repeat": {"count": 0}, "do": [WAIT]}, "steps[0].repeat.count"),
        ({"repeat": {"count": 1.5}, "do": [WAIT]}, "steps[0].repeat.count: must be an integer, got 1.5"),
        ({"repeat": {}, "do": []}, "steps[0].do: must have at least 1 item"),
        ({"repeat": {}}, "steps[0].do: is missing"),
        ({"if": PART, "then": [WAIT], "elsee": []}, "did you mean 'else'"),
        ({"if": PART, "then": [{"wait_s": "long"}]}, "steps[0].then[0].wait_s: must be a number, got 'long'"),
        ({"call": ""}, "steps[0].call"),
        (
            {"pallet": {**GRID, "counts": []}, "do": [WAIT]},
            "steps[0].pallet.counts: must have at least 1 item",
        ),
        ({"on_error": {"retry": -1}, "do": [WAIT]}, "steps[0].on_error.retry"),
        ({"on_error": {"then": "stop"}, "do": [WAIT]}, "steps[0].on_error: unknown key 'then'"),
    ],
)
def test_a_step_that_one_refuses_the_other_refuses_too(
    tmp_path: Path, validator: Any, step: object, words: str
) -> None:
    content = {"steps": [step]}
    assert not validator.is_valid(content)
    with pytest.raises(InputError) as caught:
        read_sequence(written(tmp_path, content))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        (
            [{"wait_for": {"input": "part"}}],
            "steps[0].wait_for: give one of is, above, below, got none",
        ),
        (
            [{"wait_for": {**PART, "above": 1}}],
            "steps[0].wait_for: give one of is, above, below, got is, above",
        ),
        (
            [{"press": {**PUSH, "max_force": 5}}],
            "steps[0].press: max_force is 5 N; it must be above force, 10 N",
        ),
        (
            [{"insert": {**PUSH, "depth": 0.1, "direction": {"x": 0, "y": 0, "z": 0}}}],
            "steps[0].insert: direction: is zero",
        ),
        (
            [{"follow": {**PUSH, "motion": POSE}}],
            "steps[0].follow: motion.planner: ptp does not follow a TCP path; valid planners: lin, circ",
        ),
        (
            [{"follow": {**PUSH, "motion": {**ALONG, "start_when": PART}}}],
            "steps[0].follow: motion.start_when: a path with force cannot have actions or conditions",
        ),
        (
            [{**JOINTS, "radius": 0.1}, {"press": PUSH}],
            "steps[0].radius: the next step is not a waypoint, but the arm stops there",
        ),
        ([{**JOINTS, "radius": 0.1}, WAIT], "steps[0].radius: the next step is not a waypoint, but the arm"),
        (
            [{"repeat": {}, "do": [{**JOINTS, "radius": 0.1}]}],
            "steps[0].do[0].radius: the last step has a radius",
        ),
        (
            [WAIT, {"pallet": {**GRID, "counts": [2, 0]}, "do": [WAIT]}],
            "steps[1].pallet: counts[1] is 0, allowed",
        ),
        (
            [{"pallet": {**GRID, "counts": [1000, 1000]}, "do": [WAIT]}],
            "steps[0].pallet: counts: 1000 x 1000 are 1000000 places, allowed: 1 to 10000",
        ),
        ([{"pallet": {**GRID, "counts": [2]}, "do": [WAIT]}], "counts has 1 directions and offsets has 2"),
        (
            [{"pallet": {**GRID, "frame": "tool"}, "do": [WAIT]}],
            "frame: 'tool' is the name of an existing frame",
        ),
        (
            [{"pallet": {**GRID, "origin": {**POSE, "frame_id": "tool"}}, "do": [WAIT]}],
            "origin.frame_id: 'tool' moves with the arm; a pallet needs a fixed frame",
        ),
        (
            [WAIT, {**JOINTS, "radius": 0.1, "until": {"input": "part", "is": True}}, JOINTS],
            "steps[1].until: only the last motion of a sequence may have it; remove the radius",
        ),
        (
            [{"repeat": {}, "do": [{**JOINTS, "radius": 0.1}, {**JOINTS, "start_when": PART}]}],
            "steps[0].do[1].start_when: only the first motion of a sequence may have it",
        ),
        (
            [{**JOINTS, "radius": 0.1, "pause_while": PART}, {**JOINTS, "pause_while": PART}],
            "steps[1].pause_while: only one motion of a sequence may have it",
        ),
        ([nested(20)], "steps are nested more than 20 deep; flatten them"),
        ([nested(200)], "steps are nested too deeply, allowed: 20 levels of lists"),
    ],
)
def test_what_a_schema_cannot_say_is_refused_with_its_place(
    tmp_path: Path, steps: list[Any], words: str
) -> None:
    with pytest.raises(InputError) as caught:
        read_sequence(written(tmp_path, {"steps": steps}))
    assert words in str(caught.value)


def test_ten_thousand_steps_in_each_other_are_refused(tmp_path: Path) -> None:
    text = '{"repeat": {}, "do": [' * 10_000 + '{"wait_s": 1}' + "]}" * 10_000
    with pytest.raises(InputError, match="not valid JSON: nested too deeply"):
        read_sequence(written(tmp_path, f'{{"steps": [{text}]}}'))


def test_a_sequence_has_waypoints_or_steps(validator: Any) -> None:
    both = {"waypoints": [JOINTS], "steps": [WAIT]}
    assert not validator.is_valid(both)
    with pytest.raises(InputError, match="both are given; a sequence has either waypoints or steps"):
        sequence_of(both)


def test_one_step_may_stand_without_brackets_as_matlab_writes_it() -> None:
    content = {"steps": {"repeat": {"count": 2}, "do": {"if": PART, "then": WAIT}}}
    (step,) = sequence_of(content).items
    assert sequence_of({"steps": [step.model_dump(by_alias=True, exclude_unset=True)]}).items == [step]


def test_a_file_with_many_errors_names_the_first_and_counts_the_rest(tmp_path: Path) -> None:
    content = {"waypoints": [{"joints": []} | {"speed": 9}] * 40}
    with pytest.raises(InputError, match=r"and \d+ more$") as caught:
        read_sequence(written(tmp_path, content))
    assert len(str(caught.value)) < 2000
