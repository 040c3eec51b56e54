"""Programs that the service stores, on virtual time.

Oracle: what was saved, byte by byte; the files in the folder; the simulated arm's joints after a run.
"""

from __future__ import annotations

import json
import os
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import pytest
from virtual_service import VirtualService

from app.services.programs import stored
from cobot.errors import ChangedError, NotFoundError

TEXT = '{"waypoints": [{"named": "work"}], "of the future": {"kept": 1}}\n'
LABEL = "Über Kiste 1"


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    yield service
    for each in service.get("/programs").json():
        service.ask("DELETE", f"/programs/{each['id']}").raise_for_status()
    shutil.rmtree(service.app.state.services.stored._folder, ignore_errors=True)


def save(run: VirtualService, program: str, base: int | None = None, **more: Any) -> httpx.Response:
    headers = {"X-Client-Name": quote(more.pop("by", "Jürgen"))}
    if base is not None:
        headers["If-Match"] = f'"{base}"'
    body = {"label": LABEL, "text": TEXT} | more
    return run.ask("PUT", f"/programs/{program}", json=body, headers=headers)


def files(run: VirtualService) -> dict[str, Path]:
    folder = Path(run.app.state.services.stored._folder)
    return {str(each.relative_to(folder)): each for each in folder.rglob("*") if each.is_file()}


def test_a_program_is_kept_as_it_is_with_its_author_and_private_to_the_user(run: VirtualService) -> None:
    made = save(run, "kiste", label="取料点 <b>1</b>", note="first").raise_for_status()
    assert made.headers["etag"] == '"1"'
    read = run.get("/programs/kiste")
    assert read.headers["etag"] == '"1"'
    found = read.json()
    assert (found["text"], found["label"], found["note"]) == (TEXT, "取料点 <b>1</b>", "first")
    assert (found["author"], found["version"], found["kind"]) == ('"Jürgen"', 1, "sequence")
    (file,) = files(run).values()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert {stat.S_IMODE(each.stat().st_mode) for each in (file.parent, file.parents[1])} == {0o700}
    assert [each["id"] for each in run.get("/programs").json()] == ["kiste"]


def test_each_save_is_a_version_and_an_old_one_can_be_saved_again(run: VirtualService) -> None:
    save(run, "a")
    save(run, "a", 1, label="B").raise_for_status()
    old = run.get("/programs/a?version=1").json()
    save(run, "a", 2, label=old["label"], text=old["text"]).raise_for_status()
    versions = run.get("/programs/a/versions").json()
    assert [(each["version"], each["label"]) for each in versions] == [(3, LABEL), (2, "B"), (1, LABEL)]


def test_the_second_of_two_saves_is_refused_with_names_and_the_way_out(run: VirtualService) -> None:
    save(run, "a")
    save(run, "a", 1, by="Anna", label="Anna's").raise_for_status()
    late = save(run, "a", 1, label="mine")
    assert (late.status_code, late.json()["code"]) == (412, "changed")
    for part in ("Anna", "version 2", "version 1", "load that version, or save yours under another name"):
        assert part in late.json()["detail"]
    blind = save(run, "a", label="mine")
    assert blind.status_code == 412
    assert run.get("/programs/a").json()["label"] == "Anna's"
    with pytest.raises(ChangedError, match="Anna"):
        run.client(run.url).save_program("a", "mine", TEXT, base=1)


def test_the_same_save_again_after_a_lost_answer_makes_no_version(run: VirtualService) -> None:
    assert [save(run, "a").json()["version"] for _ in range(2)] == [1, 1]
    assert [save(run, "a", 1, note="x").json()["version"] for _ in range(2)] == [2, 2]


def test_a_deleted_program_is_not_written_over(run: VirtualService) -> None:
    save(run, "a")
    save(run, "a", 1, label="B")
    assert run.ask("DELETE", "/programs/a", headers={"If-Match": '"1"'}).status_code == 412
    assert run.ask("DELETE", "/programs/a", headers={"If-Match": '"2"'}).json() == []
    assert "has been deleted" in save(run, "a", 2, label="C").json()["detail"]
    assert set(files(run)) == {stored.DELETED}
    assert run.get("/programs/a").status_code == 404


def test_a_program_made_again_never_has_a_version_of_the_deleted_one(run: VirtualService) -> None:
    """An old If-Match would write over the work of another person."""
    save(run, "a")
    save(run, "a", 1, label="B")
    run.ask("DELETE", "/programs/a").raise_for_status()
    again = [save(run, "a", by="Anna", label="new") for _ in range(2)]
    assert [(each.status_code, each.json()["version"]) for each in again] == [(200, 3), (200, 3)]
    for base in (1, 2):
        late = save(run, "a", base, label="mine")
        assert (late.status_code, "Anna" in late.json()["detail"]) == (412, True)
        assert run.ask("DELETE", "/programs/a", headers={"If-Match": f'"{base}"'}).status_code == 412
    assert save(run, "a", 3, label="next").json()["version"] == 4
    assert run.get("/programs/a?version=2").status_code == 404


def test_on_a_full_disk_a_program_can_be_deleted_and_its_versions_stay_known(
    run: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(run, "a")
    save(run, "a", 1, label="B")

    def full(_: int) -> None:
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        assert run.ask("DELETE", "/programs/a").json() == []
    assert {name: file.stat().st_size for name, file in files(run).items()} == {".deleted-a/2.json": 0}
    assert run.get("/programs").json() == []
    assert save(run, "a").json()["version"] == 3
    assert save(run, "a", 2, label="late").status_code == 412


def test_the_versions_of_deleted_programs_take_no_more_room_than_a_thousand(
    run: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stored, "MAX_DELETED", 2)
    for program, versions in (("a", 3), ("b", 1), ("c", 1), ("d", 1)):
        for base in range(versions):
            save(run, program, base or None, note=str(base)).raise_for_status()
        run.ask("DELETE", f"/programs/{program}").raise_for_status()
    assert [save(run, each).json()["version"] for each in ("a", "b", "c", "e")] == [4, 4, 2, 4]
    assert save(run, "a", 3, label="late").status_code == 412


def test_a_damaged_list_of_deleted_programs_is_named_and_nothing_is_written_over(run: VirtualService) -> None:
    save(run, "a")
    run.ask("DELETE", "/programs/a").raise_for_status()
    files(run)[stored.DELETED].write_bytes(b"{")
    answer = save(run, "a")
    assert (answer.status_code, "is damaged" in answer.json()["detail"]) == (503, True)
    assert save(run, "b").status_code == 503
    files(run)[stored.DELETED].unlink()
    save(run, "a").raise_for_status()


@pytest.mark.parametrize(
    ("program", "body", "said"),
    [
        ("..%2Fx", {}, ""),
        ("%2Fetc%2Fpasswd", {}, ""),
        ("A", {}, "is not a valid id"),
        (".hidden", {}, "is not a valid id"),
        ("x" * 65, {}, "is not a valid id"),
        ("a", {"label": ""}, "label"),
        ("a", {"label": " "}, "label"),
        ("a", {"label": "a\u202eb"}, "label"),
        ("a", {"label": "x" * 101}, "label"),
        ("a", {"text": "{"}, "text: is not JSON"),
        ("a", {"text": "[" * 100_000}, "text: is not JSON"),
        ("a", {"text": "[]"}, "text: a sequence file must be an object"),
        ("a", {"kind": "python"}, "kind"),
    ],
)
def test_what_cannot_be_saved_is_refused(
    run: VirtualService, program: str, body: dict[str, Any], said: str
) -> None:
    answer = save(run, program, **body)
    assert answer.status_code in (404, 422), answer.text
    assert said in answer.json()["detail"]
    assert run.get("/programs").json() == []


def test_an_if_match_that_is_no_version_is_refused(run: VirtualService) -> None:
    answer = run.ask("PUT", "/programs/a", json={"label": "a", "text": "{}"}, headers={"If-Match": "*"})
    assert (answer.status_code, "If-Match" in answer.json()["detail"]) == (422, True)


def test_a_full_disk_leaves_the_old_version(run: VirtualService, monkeypatch: pytest.MonkeyPatch) -> None:
    save(run, "a")
    before = {name: file.read_bytes() for name, file in files(run).items()}

    def full(_: int) -> None:
        raise OSError(28, os.strerror(28))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        answer = save(run, "a", 1, label="B")
    assert answer.status_code == 503
    assert {name: file.read_bytes() for name, file in files(run).items()} == before
    assert run.get("/programs/a").json()["version"] == 1
    save(run, "a", 1, label="B").raise_for_status()


def test_number_versions_and_size_are_bounded(run: VirtualService, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stored, "MAX_PROGRAMS", 1)
    monkeypatch.setattr(stored, "MAX_VERSIONS", 3)
    for base in range(5):
        save(run, "a", base or None, note=str(base)).raise_for_status()
    assert [each["version"] for each in run.get("/programs/a/versions").json()] == [5, 4, 3]
    assert "the versions 3 to 5 are kept" in run.get("/programs/a?version=1").json()["detail"]
    refused = save(run, "b")
    assert (refused.status_code, "which is the limit" in refused.json()["detail"]) == (409, True)
    monkeypatch.setattr(stored, "MAX_TOTAL_BYTES", 10)
    assert "allowed: 10" in save(run, "a", 5, note="z").json()["detail"]


def test_a_damaged_file_hides_no_other_program(run: VirtualService) -> None:
    save(run, "a")
    save(run, "b")
    files(run)["a/1.json"].write_text("{")
    assert [each["id"] for each in run.get("/programs").json()] == ["b"]
    assert "is damaged" in run.get("/programs/a").json()["detail"]
    assert [each["id"] for each in run.ask("DELETE", "/programs/a").json()] == ["b"]


def test_saving_and_deleting_are_events(run: VirtualService) -> None:
    with run.listen("/events") as events:
        save(run, "a")
        told = events.event("program")["data"]
        assert (told["what"], told["id"], told["label"], told["by"]) == (
            "saved",
            "a",
            LABEL,
            '"Jürgen" from 127.0.0.1',
        )
        run.ask("DELETE", "/programs/a")
        assert events.event("program")["data"]["what"] == "deleted"


def test_the_client_has_all_of_it(run: VirtualService) -> None:
    client = run.client(run.url)
    assert client.save_program("a", LABEL, json.loads(TEXT))["version"] == 1
    assert client.save_program("a", "B", "x = 1", kind="lua", base=1)["version"] == 2
    assert client.program("a")["text"] == "x = 1"
    assert client.restore_program("a", 1)["version"] == 3
    assert json.loads(client.program("a")["text"]) == json.loads(TEXT)
    assert [each["version"] for each in client.program_versions("a")] == [3, 2, 1]
    assert [each["id"] for each in client.programs()] == ["a"]
    assert client.delete_program("a") == []
    with pytest.raises(NotFoundError, match="there is no 'a'"):
        client.run_program("a")
