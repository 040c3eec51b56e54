"""Requests as clients of all kinds write them.

Oracle: the answer to the same request as the documents have it.
"""

from __future__ import annotations

import gzip
import inspect
import json
from typing import Any, get_args

import pytest
from pydantic import RootModel, Tag
from virtual_service import VirtualService

from app.api.route import CobotRoute
from cobot.loose_lists import RequestModel

MOVE = "/robot/move/joints"
BODY = json.dumps({"joints": [0, 0.1, 0, -1.5, 0, 1.5, 0]}).encode()
JSON = {"content-type": "application/json"}


@pytest.fixture(scope="module")
def run(service: VirtualService) -> VirtualService:
    return service


def refused(run: VirtualService, content: bytes, headers: dict[str, str] = JSON) -> tuple[int, str]:
    answer = run.ask("POST", MOVE, content=content, headers=headers)
    return answer.status_code, answer.json()["detail"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"'{joints: [0]}'", "the single quotes around it are the shell's"),
        (b"{'joints': [0]}", "JSON uses double quotes"),
        (b'{"joints": [0, 1,]}', "remove the comma before it"),
        (b'{"joints": [0],}', "remove the comma before it"),
        (b'{"joints": [0] /* home */}', "JSON does not allow comments"),
        (b'{"joints": [0, None]}', "JSON writes true, false and null"),
        (json.dumps(BODY.decode()).encode(), "this is JSON inside a JSON string"),
        (b"[0, 0]", "the body must be an object, got [0, 0]"),
        (b'{"joints": {"joint1": 0}}', "joints: must be a list, got {"),
        (
            b'{"joints": [null, true]}',
            "joints[0]: must be a number, got null; joints[1]: must be a number, got true",
        ),
        ('{"name": "H\xf6he"}'.encode("latin-1"), "byte 0xf6 at position 11; send it encoded as UTF-8"),
        (gzip.compress(BODY, mtime=0), "compressed with gzip: send it uncompressed"),
    ],
)
def test_a_body_that_is_no_json_object_is_rejected_with_what_to_write(
    run: VirtualService, content: bytes, words: str
) -> None:
    status, detail = refused(run, content)
    assert status == 422
    assert words in detail


def test_a_compressed_body_is_rejected_with_the_header_that_says_so(run: VirtualService) -> None:
    for coding in ("gzip", "br", "Deflate"):
        answer = run.ask(
            "POST", MOVE, content=gzip.compress(BODY, mtime=0), headers={**JSON, "content-encoding": coding}
        )
        assert (answer.status_code, answer.json()["code"]) == (415, "media_type")
        assert answer.json()["detail"].startswith(f"the header Content-Encoding is '{coding.lower()}'")
        assert answer.headers["accept-encoding"] == "identity"
    for coding in ("identity", ""):
        answer = run.ask("POST", MOVE, content=b"{}", headers={**JSON, "content-encoding": coding})
        assert answer.json()["detail"] == "joints: is missing"


def test_a_stop_takes_no_body_and_so_no_encoding_keeps_it_out(run: VirtualService) -> None:
    assert run.ask("POST", "/stop", content=b"x", headers={"content-encoding": "gzip"}).status_code == 200


def test_a_content_type_that_is_missing_or_another_is_named_with_the_right_one(run: VirtualService) -> None:
    assert refused(run, BODY, {})[1].startswith("Content-Type must be application/json, got none: send")
    answer = run.ask("POST", "/trajectory/send_csv", content=b"t", headers={"content-type": "text/csv"})
    assert "multipart/form-data, got text/csv: send the file as a field of a form" in answer.json()["detail"]


@pytest.mark.parametrize("path", ["//robot/joint_states", "/Robot/Joint_States", "/robot/joint_state"])
def test_an_unknown_path_names_the_one_that_may_have_been_meant(run: VirtualService, path: str) -> None:
    answer = run.ask("GET", f"http://robot.test{path}")
    assert answer.status_code == 404
    assert "did you mean /robot/joint_states?" in answer.json()["detail"]


def test_every_json_body_of_the_rest_api_is_read_so(run: VirtualService) -> None:
    routes = [each for each in run.app.routes if isinstance(each, CobotRoute)]
    bodies = [field.field_info.annotation for each in routes for field in each.dependant.body_params]
    models = {
        each for each in bodies if inspect.isclass(each) and each.__module__ != "starlette.datastructures"
    }
    models = {each for each in models if hasattr(each, "model_fields")}
    assert len(models) >= 20
    bases = {part for each in models for part in parts_of(each)}
    assert [each.__name__ for each in bases if not issubclass(each, RequestModel)] == []


def parts_of(model: Any) -> list[Any]:
    """The model itself, or those of which a body that may be one of several has to be one."""
    if not issubclass(model, RootModel):
        return [model]
    found, parts = [model.model_fields["root"].annotation], []
    while found:
        each = found.pop()
        if inspect.isclass(each):
            parts.append(each)
        else:
            found += [part for part in get_args(each) if not isinstance(part, Tag)]
    return parts


def test_requests_as_matlab_writes_them_are_planned(run: VirtualService) -> None:
    there = {"x": 0.45, "y": 0.0, "z": 0.5, "b": 3.14159}
    beside = {**there, "y": 0.1}
    for path, body in {
        "path": {"poses": there},
        "pose": {**there, "planner": "polyline", "through": beside, "via": [], "start": []},
        "sequence": {"motions": [{"name": "work"}, {"name": "home"}], "radii": 0.05},
        "joints": {"joints": [0, 0.1, 0, -1.5, 0, 1.5, 0], "constraints": []},
    }.items():
        answer = run.ask("POST", f"/robot/plan/{path}", json={**body, "samples": 2, "explain": False})
        assert answer.status_code == 200, answer.text
