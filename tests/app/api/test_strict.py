"""Strict statuses, asked for by `Prefer: status=strict` or `?strict=true`.

Oracles: the examples and rules of RFC 7240; the status that the same error has where it is an error of HTTP
(`cobot.errors` and its table); the answer without the preference.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from virtual_service import URL, VirtualService

from app.api.errors import status_of
from app.api.schemas.robot import MoveAnswer, ResetAnswer, StopAnswer
from app.api.strict import preference, reports_success
from cobot.errors import BY_CODE, CobotError, CollisionError, UnreachableError

STRICT = {"Prefer": "status=strict"}
FAR = {"x": 3.0, "y": 0.0, "z": 0.5, "a": 0.0, "b": 3.14, "c": 0.0}
HOME = {"name": "home", "speed": 1.0}


def without_times(answer: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in answer.items() if not name.endswith(("_s", "explain"))}


@pytest.mark.parametrize("how", [{"headers": STRICT}, {"params": {"strict": "true"}}])
def test_the_same_body_comes_with_the_status_of_its_error(
    service: VirtualService, how: dict[str, Any]
) -> None:
    plain = service.post("/robot/move/pose", FAR)
    strict = service.post("/robot/move/pose", FAR, **how)
    assert (plain.status_code, plain.json()["success"]) == (200, False)
    assert strict.status_code == status_of(BY_CODE[strict.json()["code"]]()) == 422
    assert without_times(strict.json()) == without_times(plain.json())
    assert strict.headers["preference-applied"] == "status=strict"
    assert "preference-applied" not in plain.headers


def test_a_motion_that_arrives_is_200_either_way(service: VirtualService) -> None:
    answer = service.post("/robot/move/named", HOME, headers=STRICT)
    assert (answer.status_code, answer.json()["success"]) == (200, True)
    assert service.post("/robot/move/named?wait=false&strict=true", HOME).status_code == 202
    service.post("/stop").raise_for_status()


def test_a_motion_that_is_stopped_is_a_409(service: VirtualService) -> None:
    service.go_home()
    away = {"joints": [1.5, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 0.05}
    moving = service.begin(service.asking("POST", "/robot/move/joints?strict=true", json=away))
    service.until(lambda: service.joints()[0] > 0.05)
    assert service.post("/stop", headers=STRICT).status_code == 200
    answer = service.end(moving)
    assert (answer.status_code, answer.json()["code"], answer.json()["success"]) == (409, "stopped", False)


@pytest.mark.parametrize("value", ["yes", "", "maybe"])
def test_another_value_is_refused_before_anything_moves(service: VirtualService, value: str) -> None:
    answer = service.post("/robot/move/named", HOME, params={"strict": value})
    assert answer.status_code == 422
    assert answer.json()["detail"] == f"strict is '{value}', allowed: true and false"


def test_the_query_counts_before_the_header_and_a_stop_heeds_neither_in_error(
    service: VirtualService,
) -> None:
    assert service.post("/robot/move/pose?strict=false", FAR, headers=STRICT).status_code == 200
    assert service.post("/stop", headers={"Prefer": "status=lenient"}).status_code == 200


@pytest.mark.parametrize(
    ("headers", "found"),
    [
        (["status=strict"], "strict"),
        (['respond-async, wait=10, STATUS="strict"'], "strict"),
        (["wait=10", "status = strict; a=b"], "strict"),
        (['foo; some-parameter="status=strict"'], None),  # a parameter is no preference
        (['a="x,status=strict"'], None),  # nor is a quoted comma the end of one
        (["status=lenient, status=strict"], "lenient"),  # RFC 7240, 2: the first is considered
        (["status"], ""),
        (['status=""'], ""),
        (["mystatus=strict"], None),
        ([], None),
    ],
)
def test_the_header_is_read_as_rfc_7240_says(headers: list[str], found: str | None) -> None:
    assert preference(headers, "status") == found


@given(st.text(max_size=300))
def test_no_header_takes_long_or_fails(text: str) -> None:
    preference([text, text * 20], "status")


def test_no_header_that_is_meant_to_take_long_does() -> None:
    for text in ('"' * 16000, 'a="' + "\\" * 16000, "a;" * 8000, 'a;"' * 5000, "a" * 16000, "a= " * 5000):
        preference([text], "status")


def test_it_is_documented_where_an_answer_reports_success(service: VirtualService) -> None:
    paths = service.get("/openapi.json").json()["paths"]
    documented = {
        path
        for path, operations in paths.items()
        for each in operations.values()
        if any(parameter["name"] == "Prefer" for parameter in each.get("parameters", ()))
    }
    plain = {path for path in documented if not path.startswith("/robots/")}
    assert {path for path in plain if "gripper" not in path and "force" not in path} == {
        *(f"/robot/move/{what}" for what in ("named", "joints", "pose", "arc", "sequence")),
        "/robot/execute",
        "/robot/plans/{plan}/execute",
        "/stop",
    }
    move = paths["/robot/move/pose"]["post"]["responses"]
    assert {"409", "422", "500", "502", "503", "504"} < set(move)
    answers = move["422"]["content"]["application/json"]["schema"]["anyOf"]
    assert {each["$ref"].rpartition("/")[2] for each in answers} == {"RefusedAnswer", "MoveAnswer"}
    assert reports_success(MoveAnswer)
    assert reports_success(StopAnswer)
    assert not reports_success(ResetAnswer)


def test_the_client_uses_it_and_raises_what_it_raised_before(service: VirtualService) -> None:
    with service.client(URL) as robot:
        seen: list[str] = []
        robot._http.event_hooks["response"] = [
            lambda response: seen.append(f"{response.status_code} {response.headers['preference-applied']}")
        ]
        with pytest.raises(UnreachableError) as caught:
            robot.move_pose(**FAR)
        assert seen == ["422 status=strict"]
        assert caught.value.explain is not None
        assert robot.move_named("home", speed=1.0)["success"]


def test_every_code_has_a_status() -> None:
    assert {status_of(kind()) for kind in BY_CODE.values()} <= set(range(400, 600))
    assert status_of(BY_CODE[CollisionError.code]()) == 422
    assert status_of(BY_CODE[CobotError.code]()) == 500
