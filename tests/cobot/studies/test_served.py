"""What the process of a study accepts from the service. Oracles: the models of the studies; the files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from cobot.config import load_settings
from cobot.errors import CobotError, ConflictError
from cobot.studies.served import KINDS, ServedRequest, finite, settle
from cobot.studies.study_file import KINDS as ALL_KINDS

SPACE = {"box": {"low": [0.3, -0.4, 0.2], "high": [0.7, 0.4, 0.6]}, "spacing_m": 0.2}
REACH: dict[str, Any] = {"question": "What does it reach?", "kind": "reach", "space": SPACE}
CYCLE: dict[str, Any] = {"question": "How short?", "kind": "cycle", "space": {}}
COMPARE = {"question": "?", "kind": "compare", "study": {"kind": "reach", "space": SPACE}}
TEXT = json.dumps({"waypoints": [{"named": "home"}, {"named": "mine", "speed": 1.0}]})
MINE = {"mine": {"name": "mine", "group": "taught", "joints": [0.5, 0, 0, -1.57, 0, 1.57, 0]}}


def request(folder: Path, document: dict[str, Any], **more: Any) -> ServedRequest:
    fields: dict[str, Any] = {
        "parent": os.getppid(),
        "document": document,
        "stored": (TEXT, "kiste.json"),
        "base": str(folder),
        "copies": {"positions": json.dumps(MINE), "tool_file": json.dumps({"version": 7, "mass": 1.0})},
        "settings": None,
        "robot": load_settings().robot.name,
        "map": "map.json",
        "workers": 1,
        "niceness": 0,
        "may_create": True,
        "max_tasks": 1000,
        "max_bytes": 10**9,
        "max_s": 60.0,
    }
    return ServedRequest.model_validate(fields | more, strict=False)


def test_the_same_study_has_the_same_folder_whatever_the_version_of_the_tool(tmp_path: Path) -> None:
    first, folder = settle(request(tmp_path, REACH))
    assert first.tasks == 45
    copies = {"positions": json.dumps(MINE), "tool_file": json.dumps({"version": 9, "mass": 1.0})}
    assert settle(request(tmp_path, REACH, copies=copies, may_create=False))[1] == folder
    heavier = copies | {"tool_file": json.dumps({"version": 7, "mass": 2.0})}
    with pytest.raises(ConflictError, match="too many studies; delete one"):
        settle(request(tmp_path, REACH, copies=heavier, may_create=False))
    assert [path.name for path in tmp_path.iterdir()] == [folder.name]


def test_a_stored_program_may_go_to_taught_positions(tmp_path: Path) -> None:
    moves = {"waypoints[1]": {"stop": True}}
    study, _ = settle(request(tmp_path, CYCLE | {"program": {"stored": "kiste", "moves": moves}}))
    assert [move["to"] for move in study.document["program"]] == ["home", "mine"]
    assert study.kernel()(0, 1)["duration_s"][0] > 0.0


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (REACH | {"metrik": "share"}, r"^study: unknown key 'metrik'"),
        (REACH | {"method": "fre"}, r"^study: method: "),
        (REACH | {"kind": "python", "function": "os:system"}, "kind: must be one of reach, "),
        (REACH | {"function": "os:system"}, "function: a study in the service cannot call functions"),
        (
            REACH | {"robot": {"settings": "/etc/passwd"}},
            "robot: unknown key 'settings'; a study in the service",
        ),
        (REACH | {"robot": {"scene": "/etc/passwd"}}, "uses its own robot, scene and positions"),
        (REACH | {"space": {"mesh": {"file": "/etc/passwd"}, "spacing_m": 1}}, "space.mesh: a study"),
        (CYCLE | {"program": {"file": "/etc/passwd"}}, "program: a study in the service cannot read"),
        (CYCLE | {"program": {"stored": "kiste", "file": "/etc/passwd"}}, "program: "),
        (CYCLE | {"program": {"stored": "a", "moves": {"waypoints[8]": {}}}}, "unknown motion"),
        (COMPARE | {"study": {"kind": "python"}, "variants": {}}, "study.kind: must be one of"),
        (COMPARE | {"study": 3}, "study: is missing"),
        (
            COMPARE | {"variants": {"a": {}, "b": {"robot": {"tool_file": "/etc/passwd"}}}},
            "variants.b.robot: unknown key 'tool_file'; a study",
        ),
        (
            COMPARE | {"variants": {"a": {}, "b": {"kind": "python", "function": "os:system"}}},
            "variants.b.kind: must be one of",
        ),
        (
            COMPARE | {"variants": {"a": {}, "b": {"program": {"file": "/etc/passwd"}}}},
            "variants.b.program: a study in the service cannot read files",
        ),
    ],
)
def test_what_a_request_may_not_have_is_named_and_leaves_nothing(
    document: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(CobotError, match=message) as caught:
        settle(request(tmp_path, document))
    assert str(tmp_path) not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def paths_of(model: type[BaseModel], place: str) -> Iterator[str]:
    """The places of all files that a model reads."""
    for name, field in model.model_fields.items():
        words = str(field.annotation) + str(field.metadata)
        if "Path" in words:
            yield f"{place}.{name}"
        for part in _models(field.annotation):
            yield from paths_of(part, f"{place}.{name}")


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in getattr(annotation, "__args__", ()):
        yield from _models(part)


def test_each_file_that_a_study_can_read_is_one_that_a_request_cannot_name() -> None:
    """A new field with a file must be added to `require_no_files` and to the cases above."""
    from importlib import import_module

    assert set(KINDS) == ALL_KINDS.keys() - {"python"}
    found = set()
    for kind in KINDS:
        module, name = ALL_KINDS[kind].split(":")
        found |= set(paths_of(getattr(import_module(f"cobot.studies.{module}"), name), ""))
    robot = {f".robot.{name}" for name in ("settings", "scene", "tool_file", "positions")}
    assert found == robot | {".space.mesh.file", ".targets.mesh.file"}


def test_numbers_that_json_does_not_have_become_null() -> None:
    assert finite({"a": [1.5, math.inf, (math.nan, 2)]}) == {"a": [1.5, None, [None, 2]]}
