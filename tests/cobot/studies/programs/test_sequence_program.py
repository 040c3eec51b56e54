"""Sequence files as programs of studies. Oracles: the validator of sequence files; the same program as a
list; KUKA's angles by SciPy.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from folders import ROOT
from scipy.spatial.transform import Rotation

from cobot.errors import CobotError, ConfigError
from cobot.runner.schema import read_sequence
from cobot.studies import Study, study_of

EXAMPLES = ROOT / "examples"
POSE = {"x": 0.5, "y": 0.1, "z": 0.4, "a": 0.2, "b": 3.0, "c": -0.1}


def study(folder: Path, content: Any, kind: str = "robustness", **more: Any) -> Study:
    (folder / "program.json").write_text(json.dumps(content), encoding="utf-8")
    moves = more.pop("moves", {})
    document = {"question": "Does it work?", "kind": kind, "space": {}}
    return study_of(document | {"program": {"file": "program.json", "moves": moves}} | more, folder)


def program(folder: Path, content: Any, **more: Any) -> list[dict[str, Any]]:
    found = study(folder, content, **more).document["program"]
    assert isinstance(found, list)
    return found


def test_an_iteration_runs_from_home_through_all_waypoints_and_back(tmp_path: Path) -> None:
    moves = program(tmp_path, {"home": {"named": "home", "speed": 0.4}, "waypoints": [{"named": "work"}]})
    assert [move["to"] for move in moves] == ["home", "work", "home"]
    assert [move["label"] for move in moves] == ["home", "waypoints[0]", "home"]
    assert [move["speed"] for move in moves] == [0.4, 0.1, 0.4]


def test_a_pose_with_kukas_angles_is_the_same_pose(tmp_path: Path) -> None:
    (_, move) = program(tmp_path, {"waypoints": [{"named": "home"}, {**POSE, "speed_m_s": 0.2}]})
    turn = Rotation.from_euler("ZYX", [POSE["a"], POSE["b"], POSE["c"]]).as_quat(scalar_first=True)
    assert move["pose"][:3] == [0.5, 0.1, 0.4]
    assert abs(np.dot(move["pose"][3:], turn)) == pytest.approx(1.0)
    assert (move["speed"], move["speed_m_s"]) == (1.0, 0.2)


def test_the_arm_stops_where_the_sequence_does_something_else(tmp_path: Path) -> None:
    steps = [
        {"named": "home"},
        {"wait_s": 1.0},
        {"on_error": {"retry": 1}, "do": [{"named": "work", "label": "above"}, POSE]},
        {"gripper": {"command": "release"}},
        {"named": "home"},
    ]
    content = {"steps": steps}
    moves = program(tmp_path, content, moves={"steps[2].do[1]": {"tolerance_m": 0.003}})
    labels = ["steps[0]", "steps[2].do[0] above", "steps[2].do[1]", "steps[4]"]
    assert [move["label"] for move in moves] == labels
    assert [move.get("stop", False) for move in moves] == [True, False, True, False]
    assert moves[2]["tolerance_m"] == 0.003
    assert len(read_sequence(tmp_path / "program.json").items) == 5


def test_the_results_are_those_of_the_same_program_as_a_list(tmp_path: Path) -> None:
    file = study_of(
        {
            "question": "How short?",
            "kind": "cycle",
            "program": {"file": "motion_sequence_config.json"},
            "space": {"blend_radius_m": {"values": [0.0, 0.05]}},
        },
        EXAMPLES,
    )
    listed = study_of(file.document)  # without the file
    assert listed.document["program"] == file.document["program"]
    first, second = file.kernel()(0, 2), listed.kernel()(0, 2)
    np.testing.assert_array_equal(first["duration_s"], second["duration_s"])
    durations = np.asarray(first["duration_s"], float)
    assert durations[1] < durations[0]


def test_a_failure_names_the_place_in_the_file(tmp_path: Path) -> None:
    far = {"waypoints": [{"named": "home"}, {"x": 3.0, "y": 0, "z": 0, "label": "far away"}]}
    with pytest.raises(CobotError, match=r"program\[1\] \(waypoints\[1\] far away\): "):
        study(tmp_path, far).kernel()


def test_comparisons_read_sequence_files_too(tmp_path: Path) -> None:
    for name, end in (("one", "work"), ("two", "home")):
        content = {"waypoints": [{"named": "home"}, {"named": "work"}, {"named": end}]}
        (tmp_path / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
    variants = {name: {"program": {"file": f"{name}.json"}} for name in ("one", "two")}
    document = {"question": "Which?", "kind": "compare", "study": {"kind": "cycle", "space": {}}}
    found = study_of(document | {"variants": variants}, tmp_path)
    columns = found.kernel()(0, 2)
    durations = np.asarray(columns["duration_s"], float)
    assert durations[1] > durations[0] > 0.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([], r"program.json: is not a JSON object, so it is not a sequence file"),
        ({"waypoints": 3}, "has no list of waypoints or steps"),
        ({"waypoints": [3]}, r"waypoints\[0\]: must be a waypoint, got 3"),
        ({"waypoints": [{"nmed": "home"}]}, r"waypoints\[0\]: .*nmed"),
        ({"waypoints": [{"named": "home", "speed": 7}]}, r"waypoints\[0\]: speed: .*got 7"),
        ({"waypoints": [{**POSE, "frame_id": "tool"}]}, r"waypoints\[0\]: a study does not compute frame_id"),
        ({"waypoints": [{**POSE, "constraints": {}}]}, r"does not compute constraints; list the moves"),
        ({"waypoints": [{**POSE, "planner": "circ", "via": {"x": 0, "y": 0, "z": 0}}]}, "compute via"),
        ({"steps": [{"call": "other.json"}]}, r"steps\[0\]: a study does not compute call; list the moves"),
        ({"steps": [{"repeat": {"count": 2}, "do": [{"named": "home"}]}]}, "does not compute repeat"),
        ({"waypoints": [{**POSE}, {**POSE}]}, r"program\[0\].*needs the key to"),
        ({"waypoints": [{"named": "home"}]}, "program: must have at least 2 items"),
    ],
)
def test_what_a_study_cannot_compute_is_an_error_with_its_place(
    content: Any, message: str, tmp_path: Path
) -> None:
    with pytest.raises(CobotError, match=message):
        study(tmp_path, content).kernel()


@pytest.mark.parametrize(
    ("program", "message"),
    [
        ({"file": "none.json"}, r"program.file: .*none.json: cannot be read: No such file"),
        ({"fil": "program.json"}, r"program: unknown key 'fil' \(did you mean 'file'"),
        ({"file": "program.json", "moves": {"waypoints[7]": {}}}, "program.moves: unknown motion"),
        ({"file": "program.json", "moves": {"waypoints[0]": {"sped": 1}}}, "unknown key 'sped'"),
    ],
)
def test_a_bad_choice_of_a_file_names_the_key(program: Any, message: str, tmp_path: Path) -> None:
    (tmp_path / "program.json").write_text('{"waypoints": [{"named": "home"}, {"named": "work"}]}')
    document = {"question": "?", "kind": "cycle", "space": {}, "program": program}
    with pytest.raises(ConfigError, match=message):
        study_of(document, tmp_path)
