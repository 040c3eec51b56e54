"""Studies over REST, on virtual time. Their process is in tests/app/services/programs/test_studies.py.

Oracle: what the process was asked for; the files in the folder.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from virtual_service import VirtualService

from app.services.programs.study_files import MAP, STATUS, StudyStatus
from cobot.client.rest import Client
from cobot.errors import ConflictError, NotFoundError

ID = "0123456789ab"
REACH = {
    "question": "What does it reach?",
    "kind": "reach",
    "space": {"box": {"low": [0, 0, 0], "high": [1, 1, 1]}, "spacing_m": 1.0},
}


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    yield service
    for each in service.get("/studies").json()["studies"]:
        service.ask("DELETE", f"/studies/{each['id']}").raise_for_status()
    for each in service.get("/programs").json():
        service.ask("DELETE", f"/programs/{each['id']}").raise_for_status()


@pytest.fixture
def client(run: VirtualService) -> Iterator[Client]:
    with run.client(run.url) as made:
        yield made


def status(**more: Any) -> dict[str, Any]:
    fixed = {"id": ID, "document": REACH, "owner": "anna", "started_at": "2026-01-01T00:00:00+00:00"}
    return fixed | {"question": REACH["question"], "kind": "reach", "state": "finished"} | more


def stored(run: VirtualService, **more: Any) -> Path:
    """A study as its process leaves it."""
    folder = Path(run.app.state.services.studies.files.folder) / ID
    folder.mkdir(parents=True)
    (folder / STATUS).write_text(json.dumps(status(**more)))
    return folder


@pytest.fixture
def asked(run: VirtualService, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the service of studies was asked for."""
    found: list[Any] = []

    async def start(
        document: dict[str, Any], program: tuple[str, str] | None, max_s: float, timeout_s: float
    ) -> StudyStatus:
        found.append((document, program, max_s))
        return StudyStatus(**status(state="running"))

    monkeypatch.setattr(run.app.state.services.studies, "start", start)
    return found


def test_a_study_is_asked_for_as_its_file_has_it(run: VirtualService, asked: list[Any]) -> None:
    answer = run.post("/studies", REACH | {"max_s": 60.0, "approach": 8})
    assert answer.status_code == 200, answer.text
    assert (answer.json()["id"], answer.json()["state"]) == (ID, "running")
    assert asked == [(REACH | {"approach": 8}, None, 60.0)]


def test_a_stored_program_is_passed_on_with_its_text(run: VirtualService, asked: list[Any]) -> None:
    text = '{"waypoints": [{"named": "home"}, {"named": "work"}]}'
    run.ask("PUT", "/programs/kiste", json={"label": "Kiste", "text": text}).raise_for_status()
    cycle = {"question": "How short?", "kind": "cycle", "space": {}, "program": {"stored": "kiste"}}
    run.post("/studies", cycle).raise_for_status()
    assert asked[0][1] == (text, "kiste.json")
    missing = run.post("/studies", cycle | {"program": {"stored": "none"}})
    assert (missing.status_code, missing.json()["code"]) == (404, "not_found")
    nameless = run.post("/studies", cycle | {"program": {"file": "/etc/passwd"}})
    assert nameless.status_code == 422
    assert "program.stored: must be the id of a stored program" in nameless.json()["detail"]


@pytest.mark.parametrize(
    ("body", "detail"),
    [
        ({"kind": "reach"}, "question: is missing"),
        (REACH | {"kind": "python"}, "kind: must be"),
        (REACH | {"function": "os:system"}, "unknown key 'function'"),
        (REACH | {"max_s": 1e9}, "max_s: must be less than or equal to 86400"),
    ],
)
def test_a_bad_request_names_the_key(body: dict[str, Any], detail: str, run: VirtualService) -> None:
    answer = run.post("/studies", body)
    assert answer.status_code == 422
    assert detail in answer.json()["detail"]


def test_the_client_reads_and_deletes_studies(run: VirtualService, client: Client, tmp_path: Path) -> None:
    folder = stored(run, answer={"places": 8}, tasks=8, done=8, maps=True)
    assert [each["id"] for each in client.studies()] == [ID]
    assert client.study(ID)["answer"] == {"places": 8}
    with pytest.raises(NotFoundError, match="has no such results yet: 8 of 8 tasks are done"):
        client.study_map(ID)
    (folder / MAP).write_text('{"x": [0.5]}')
    assert client.study_map(ID) == {"x": [0.5]}
    (folder / "results.sqlite").write_bytes(b"SQLite")
    client.fetch_study_table(ID, tmp_path / "table")
    assert (tmp_path / "table").read_bytes() == b"SQLite"
    assert client.delete_study(ID) == []
    assert not folder.exists()
    with pytest.raises(NotFoundError, match="there is no study"):
        client.study(ID)


def test_a_study_of_a_service_that_ended_can_be_continued(run: VirtualService) -> None:
    stored(run, state="running", rate_hz=5.0, left_s=3.0)
    (found,) = run.get("/studies").json()["studies"]
    assert (found["state"], found["reason"]) == ("partial", "the service ended before the study did")
    assert (found["rate_hz"], found["left_s"]) == (0.0, None)


def test_while_another_study_runs_a_start_is_a_conflict(run: VirtualService, client: Client) -> None:
    turn = run.app.state.services.studies._turn
    run.loop.run_until_complete(turn.acquire())
    try:
        with pytest.raises(ConflictError, match="another study is running"):
            client.start_study(REACH)
    finally:
        turn.release()
