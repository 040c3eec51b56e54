"""`limit` and `after` of every list. Oracle: the whole list, cut by Python."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from pydantic import ValidationError
from virtual_service import VirtualService

from app.api.paging import deprecated_value
from app.api.schemas.jobs import JobsQuery
from app.api.schemas.robot import MAX_LINE, LogQuery
from cobot.errors import InputError

JOINTS = [0.0, 0.3, 0.0, -1.3, 0.0, 1.3, 0.0]


@pytest.fixture(scope="module")
def filled(service: VirtualService) -> VirtualService:
    """With several entries in each list."""
    for number in range(4):
        name = f"place_{number}"
        assert service.post("/robot/positions", {"name": name, "joints": JOINTS}).status_code == 200
        assert service.post("/robot/plan/named", {"name": name}).status_code == 200
        assert service.post("/robot/move/named", {"name": name, "speed": 1.0}).json()["success"]
        program = {"label": name, "text": '{"waypoints": [{"named": "home"}]}'}
        assert service.ask("PUT", f"/programs/{name}", json=program).status_code == 200
        changed = program | {"text": '{"waypoints": [{"named": "work"}]}'}
        saved = service.ask("PUT", "/programs/place_0", json=changed, headers={"If-Match": f'"{number + 1}"'})
        assert saved.status_code == 200, saved.text
        assert service.post("/trajectory/send", {"points": []}).status_code == 422
        bad = {"points": [{"positions": JOINTS, "time_from_start": 0.0}]}
        assert service.post("/trajectory/send", bad).status_code == 422
    return service


LISTS: dict[str, tuple[Callable[[Any], list[Any]], Callable[[Any], str]]] = {
    "/robot/positions": (lambda found: found, lambda each: each["name"]),
    "/robot/plans": (lambda found: found, lambda each: each["plan_id"]),
    "/programs": (lambda found: found, lambda each: each["id"]),
    "/programs/place_0/versions": (lambda found: found, lambda each: str(each["version"])),
    "/robots": (lambda found: found, lambda each: each["name"]),
    "/jobs": (lambda found: found["jobs"], lambda each: each["id"]),
    "/recordings": (lambda found: found["recordings"], lambda each: each["name"]),
    "/audit": (lambda found: found["entries"], lambda each: each["id"]),
    "/trajectory/logs": (lambda found: found["lines"], lambda each: each),
}
"""Where the entries are in the response, and what each is called in `after`."""


def asked(service: VirtualService, path: str, **query: Any) -> list[Any]:
    answer = service.ask("GET", path, params=query)
    assert answer.status_code == 200, answer.text
    return LISTS[path][0](answer.json())


@pytest.mark.parametrize("path", [path for path in LISTS if path not in ("/robots", "/recordings", "/audit")])
def test_pages_that_follow_each_other_are_the_list(filled: VirtualService, path: str) -> None:
    whole, key = asked(filled, path), LISTS[path][1]
    assert len(whole) >= 4
    found, after = asked(filled, path, limit=3, after=key(whole[0])), key(whole[0])
    assert found == whole[1:4]
    pages = [whole[0]]
    while page := asked(filled, path, limit=2, after=after):
        assert len(page) <= 2
        pages += page
        after = key(page[-1])
    assert pages == whole
    first = (
        whole[-2:] if path.endswith("logs") else whole[:2]
    )  # of a log the newest lines come without `after`
    assert asked(filled, path, limit=2) == first


def test_pages_of_the_audit_go_back_in_time(filled: VirtualService) -> None:
    whole = asked(filled, "/audit", limit=1000)
    assert len(whole) > 8
    assert len({each["id"] for each in whole}) == len(whole)
    assert asked(filled, "/audit", limit=3, after=whole[2]["id"]) == whole[3:6]
    assert asked(filled, "/audit", limit=1000, after=whole[-1]["id"]) == []


@pytest.mark.parametrize("path", LISTS)
def test_an_entry_that_is_not_there_is_named_and_a_bad_limit_is_rejected(
    filled: VirtualService, path: str
) -> None:
    answer = filled.ask("GET", path, params={"after": "nothing"})
    assert (answer.status_code, answer.json()["code"]) == (422, "input")
    assert answer.json()["detail"].startswith("after: ")
    for limit in ("0", "x", "1001000"):
        assert filled.ask("GET", path, params={"limit": limit}).status_code == 422


def test_the_python_client_asks_for_the_same_pages(filled: VirtualService) -> None:
    client = filled.client(filled.url)
    lists: dict[str, Callable[..., list[Any]]] = {
        "/robot/positions": client.positions,
        "/programs": client.programs,
        "/programs/place_0/versions": partial(client.program_versions, "place_0"),
        "/jobs": client.jobs,
        "/trajectory/logs": client.trajectory_logs,
    }
    for path, call in lists.items():
        key = LISTS[path][1]
        after = key(asked(filled, path)[0])
        assert call(limit=2, after=after) == asked(filled, path, limit=2, after=after) != [], path
    assert client.studies(limit=1) == []
    assert client.recordings(limit=1)["recordings"] == asked(filled, "/recordings", limit=1)
    with pytest.raises(InputError, match="after: "):
        client.studies(after="nothing")


def test_a_long_line_of_a_log_is_found_by_its_beginning() -> None:
    """Its whole text would be longer than the header of a request may be."""
    lines = ["first", "é" * 3000, "third", "é" * 3000, "last"]
    assert LogQuery(after="é" * MAX_LINE, limit=50).lines_of(lambda _: lines) == ["last"], (
        "the newest of equal ones"
    )
    assert LogQuery(after="first", limit=2).lines_of(lambda _: lines) == lines[1:3]
    with pytest.raises(ValidationError, match="at most 1000"):
        LogQuery(after="é" * (MAX_LINE + 1))
    with pytest.raises(InputError, match="no such line"):
        LogQuery(after="é", limit=50).lines_of(lambda _: lines)


def test_the_service_reads_a_deprecated_parameter_without_a_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert LogQuery(n=2).lines_of(lambda count: ["line"] * count) == ["line"] * 2
        assert deprecated_value(JobsQuery(n=2), "n") == 2


def test_a_robot_list_ends_behind_its_last_one(filled: VirtualService) -> None:
    (robot,) = asked(filled, "/robots", limit=1)
    assert asked(filled, "/robots", after=robot["name"]) == []


def test_every_list_has_both_and_the_old_names_are_deprecated(filled: VirtualService) -> None:
    paths = filled.get("/openapi.json").json()["paths"]
    for path in [*LISTS, "/sequences/logs", "/studies"]:
        parameters = paths[path.replace("place_0", "{program}")]["get"]["parameters"]
        named = {each["name"]: each for each in parameters}
        assert {"limit", "after"} <= set(named), path
        assert all(each["name"] != "n" or each.get("deprecated") for each in parameters), path


def test_a_job_has_its_request_as_an_object(filled: VirtualService) -> None:
    """Oracle: the body that was sent."""
    filled.post("/robot/move/named", {"name": "home", "speed": 1.0})
    filled.post("/trajectory/send", {"points": [{"positions": JOINTS, "time_from_start": 0.0}]})
    trajectory, motion = asked(filled, "/jobs", limit=2)
    assert motion["requested"] == {"path": "/robot/move/named", "body": {"name": "home", "speed": 1.0}}
    assert motion["request"].startswith("/robot/move/named {")
    assert trajectory["requested"] == {"path": "/trajectory/send", "body": None}
    deprecated = filled.get("/openapi.json").json()["components"]["schemas"]["JobAnswer"]["properties"]
    assert deprecated["request"]["deprecated"] is True


def test_the_body_of_a_very_long_request_is_left_out(filled: VirtualService) -> None:
    motions = [{"joints": [each + 0.0123456789 for each in JOINTS], "speed": 1.0}] * 50
    filled.post("/robot/move/sequence", {"motions": motions})
    (job,) = asked(filled, "/jobs", limit=1)
    assert job["requested"] == {"path": "/robot/move/sequence", "body": None}


def test_the_kinds_of_recorded_events_are_an_enum(filled: VirtualService) -> None:
    """Oracle: the kinds that `cobot.recording.events` makes, by its source."""
    from inspect import getsource
    from re import findall

    from cobot.recording import events

    source = getsource(events)
    made = set(findall(r'yield "(\w+)"|Event\(cycle, moment_ns, "(\w+)"', source))
    kinds = {kind for pair in made for kind in pair if kind} | {mode.name.lower() for mode in events.LATCHED}
    schema = filled.get("/openapi.json").json()["components"]["schemas"]["RecordedEvent"]["properties"][
        "kind"
    ]
    assert set(schema["enum"]) == kinds == events.EVENT_KINDS
