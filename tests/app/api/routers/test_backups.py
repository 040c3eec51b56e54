"""Backup, restore and support bundle over REST. Oracle: zipfile, and the files of the service."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from virtual_service import VirtualService

from cobot.launch.backup.backup import staged_file


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    yield service
    staged_file(service.app.state.reloading.settings).unlink(missing_ok=True)
    service.post("/robot/tool", {"clear": True}).raise_for_status()


def opened(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name) for name in archive.namelist()}


def test_a_backup_is_made_and_staged_and_nothing_changes_before_a_start(run: VirtualService) -> None:
    run.post("/robot/tool", {"name": "pen", "mass": 0.5}).raise_for_status()
    answer = run.get("/admin/backup")
    assert answer.headers["content-type"] == "application/zip"
    assert "attachment" in answer.headers["content-disposition"]
    files = opened(answer.content)
    assert json.loads(files[f"robots/{run.name}/tool.json"])["name"] == "pen"
    assert not [name for name in files if "token" in name]

    run.post("/robot/tool", {"name": "other"}).raise_for_status()
    staged = run.ask("POST", "/admin/restore", files={"file": ("b.zip", answer.content)})
    assert staged.status_code == 200, staged.text
    assert any("tool" in each for each in staged.json()["contents"])
    assert run.get("/robot/tool").json()["name"] == "other"
    assert staged_file(run.app.state.reloading.settings).read_bytes() == answer.content


def test_what_is_no_backup_is_rejected(run: VirtualService) -> None:
    for content, said in ((b"", "not a ZIP archive"), (b"PK" * 1000, "not a ZIP archive")):
        answer = run.ask("POST", "/admin/restore", files={"file": ("b.zip", content)})
        assert (answer.status_code, said in answer.json()["detail"]) == (422, True), answer.text
    assert not staged_file(run.app.state.reloading.settings).exists()


def test_the_bundle_has_what_helps(run: VirtualService, tmp_path: Path) -> None:
    run.client(run.url).fetch_support(tmp_path / "s.zip")
    files = opened((tmp_path / "s.zip").read_bytes())
    assert json.loads(files["health.json"])["versions"]["cobot"]
    assert "jobs" in json.loads(files["jobs.json"])
    assert all(json.loads(line) for line in files["events.jsonl"].decode().splitlines())
    assert b"cobot_" in files["metrics.txt"]
    assert {"settings.yaml", "computer.json", "packages.txt", f"{run.name}/log.txt"} <= set(files)
    client = run.client(run.url)
    client.fetch_backup(tmp_path / "b.zip")
    assert client.restore(tmp_path / "b.zip")["created"]


def test_the_bundle_comes_although_there_are_many_jobs(run: VirtualService) -> None:
    """More than GET /jobs answers without a turn among the costly answers, one of which the bundle is."""
    for number in range(60):
        joints = [0.01 * (number % 2), *run.joints()[1:]]
        answer = run.post("/robot/move/joints", {"joints": joints, "speed": 1.0})
        assert answer.json()["success"], answer.text
    answer = run.get("/admin/support")
    assert answer.status_code == 200, answer.text
    assert len(json.loads(opened(answer.content)["jobs.json"])["jobs"]) >= 60
