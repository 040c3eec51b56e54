"""Requests that are sent again with the same `Idempotency-Key`.

Oracles: the list of jobs, which has one more or not; the sentences of the IETF's draft.
"""

from __future__ import annotations

import asyncio
import sqlite3
from typing import Any

import pytest
from virtual_service import VirtualService

from app.api.middleware.idempotency import MAX_KEY
from app.routes import ENDPOINTS

KEY = "Idempotency-Key"
NEAR = {"joints": [0.1, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 1.0}
FAR = {"joints": [1.5, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 0.2}
CSV = "joint1,joint2,joint3,joint4,joint5,joint6,joint7,t\n0,0,0,-1.57,0,1.57,0,0\n0.1,0,0,-1.57,0,1.57,0,2\n"


def jobs(service: VirtualService) -> list[str]:
    return [each["id"] for each in service.get("/jobs?n=1000").json()["jobs"]]


def keyed(service: VirtualService, key: str, body: Any, path: str = "/robot/move/joints") -> Any:
    return service.post(path, body, headers={KEY: key})


def test_a_retry_gets_the_first_answer_and_moves_nothing(service: VirtualService) -> None:
    service.go_home()
    first = keyed(service, "a", NEAR)
    known = jobs(service)
    again = keyed(service, '"a"', NEAR, "/v1/robot/move/joints")
    assert (again.status_code, again.content) == (first.status_code, first.content)
    assert again.headers["idempotent-replayed"] == "true"
    assert "idempotent-replayed" not in first.headers
    assert jobs(service) == known
    assert all(each.startswith("job_") for each in known)


def test_a_retry_gets_the_same_job(service: VirtualService) -> None:
    first = keyed(service, "b", NEAR, "/robot/move/joints?wait=false")
    again = keyed(service, "b", NEAR, "/robot/move/joints?wait=false")
    assert first.status_code == again.status_code == 202
    assert again.json()["id"] == first.json()["id"]
    assert again.headers["location"] == first.headers["location"]
    service.post("/stop")


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/robot/move/joints", FAR),
        ("/robot/move/joints?wait=false", NEAR),
        ("/robot/move/named", {"name": "home"}),
    ],
)
def test_another_request_with_the_key_is_a_422_with_words(
    service: VirtualService, path: str, body: Any
) -> None:
    keyed(service, "c", NEAR)
    answer = keyed(service, "c", body, path)
    assert answer.status_code == 422
    assert answer.json()["detail"] == (
        'Idempotency-Key "c" was used for another request in the last 24 hours: send the same path, query '
        "and body, or use a new key"
    ).replace('"c"', "'c'")


def test_a_request_that_was_refused_leaves_its_key_free(service: VirtualService) -> None:
    assert keyed(service, "d", {"joints": [99.0] * 7}).status_code == 422
    assert keyed(service, "d", NEAR).json()["success"]


def test_requests_at_once_are_one_job(service: VirtualService) -> None:
    service.go_home()
    known = len(jobs(service))

    async def at_once() -> list[Any]:
        asking = (
            service.asking("POST", "/robot/move/joints", json=NEAR, headers={KEY: "e"}) for _ in range(20)
        )
        return list(await asyncio.gather(*asking))

    answers = service.run(at_once())
    assert {each.status_code for each in answers} == {200}
    assert len({each.content for each in answers}) == 1
    assert len(jobs(service)) == known + 1


def test_a_retry_while_the_first_goes_on_waits_for_its_end(service: VirtualService) -> None:
    service.go_home()
    first = service.begin(service.asking("POST", "/robot/move/joints", json=FAR, headers={KEY: "f"}))
    service.until(lambda: service.joints()[0] > 0.05)
    again = service.begin(service.asking("POST", "/robot/move/joints", json=FAR, headers={KEY: "f"}))
    service.sleep(0.1)
    service.post("/stop")
    assert service.end(first).json()["code"] == "stopped"
    assert service.end(again).content == service.end(first).content


def test_the_status_of_a_retry_may_be_strict(service: VirtualService) -> None:
    out = {"x": 3.0, "y": 0.0, "z": 0.5, "a": 0.0, "b": 3.14, "c": 0.0}
    assert keyed(service, "g", out, "/robot/move/pose").status_code == 200
    assert keyed(service, "g", out, "/robot/move/pose?strict=true").status_code == 422


def test_a_form_may_have_another_boundary(service: VirtualService) -> None:
    service.go_home()
    known = len(jobs(service))
    sent = []
    for boundary in ("one", "two"):
        content = {
            "content": f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="a.csv"\r\n'
            f"Content-Type: text/csv\r\n\r\n{CSV}\r\n--{boundary}--\r\n".encode(),
            "headers": {KEY: "h", "Content-Type": f"multipart/form-data; boundary={boundary}"},
        }
        sent.append(service.ask("POST", "/trajectory/send_csv", **content))
    assert sent[0].status_code == 200, sent[0].text
    assert sent[1].content == sent[0].content
    assert len(jobs(service)) == known + 1
    service.post("/stop")


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("", "Idempotency-Key is '', allowed: 1 to 255 printable ASCII characters"),
        ('""', "Idempotency-Key is '', allowed:"),
        ("a b", "Idempotency-Key is 'a b', allowed:"),
        ("k" * (MAX_KEY + 1), "Idempotency-Key has 256 characters, allowed: 1 to 255"),
        ("k" * 1_000_000, "Idempotency-Key has 1000000 characters, allowed: 1 to 255"),
    ],
)
def test_a_key_that_is_none_is_refused(service: VirtualService, key: str, words: str) -> None:
    known = jobs(service)
    answer = keyed(service, key, NEAR)
    assert answer.status_code == 422
    assert answer.json()["detail"].startswith(words)
    twice = service.post("/robot/move/joints", NEAR, headers=[(KEY, "x"), (KEY, "y")])
    assert twice.json()["detail"] == "Idempotency-Key occurs 2 times, allowed: one"
    assert jobs(service) == known


def test_a_stop_heeds_no_key(service: VirtualService) -> None:
    for _ in range(2):
        answer = service.post("/stop", headers={KEY: "stop"})
        assert answer.status_code == 200
        assert "idempotent-replayed" not in answer.headers


def test_a_request_whose_service_was_killed_is_not_carried_out_again(service: VirtualService) -> None:
    """Its row without an answer is what tests/app/services/test_keys.py has of a killed process."""
    first = keyed(service, "i", NEAR, "/robot/move/joints?wait=false").json()["id"]
    service.post("/stop")
    file = service.app.state.keys._path
    with sqlite3.connect(file) as database:
        changed = database.execute("UPDATE keys SET status = NULL WHERE job = ?", (first,)).rowcount
    database.close()
    assert changed == 1
    known = jobs(service)
    answer = keyed(service, "i", NEAR, "/robot/move/joints?wait=false")
    assert (answer.status_code, answer.json()["code"]) == (409, "conflict")
    assert f"see GET /jobs/{first}" in answer.json()["detail"]
    assert jobs(service) == known


def test_all_that_begins_a_job_heeds_a_key_and_the_schema_has_the_header(service: VirtualService) -> None:
    paths = service.get("/openapi.json").json()["paths"]
    documented = {
        f"POST {path}"
        for path, operations in paths.items()
        if any(each["name"] == KEY for each in operations.get("post", {}).get("parameters", ()))
    }
    plain = {name for name in documented if "/robots/" not in name}
    assert plain == {name for name, each in ENDPOINTS.items() if each.keyed}
    accepted = {
        f"POST {path}" for path, each in paths.items() if "202" in each.get("post", {}).get("responses", ())
    }
    assert documented == accepted
