"""A backup and its restore. Oracle: the files on disk, byte by byte, and what each reader makes of them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cobot.config import Settings, load_settings
from cobot.errors import InputError, UnavailableError
from cobot.launch.backup import backup as module
from cobot.launch.backup.archive import pack, unpack
from cobot.launch.backup.backup import activate, joints_of, make_backup, read_backup, stage, staged_file
from cobot.launch.backup.support import REMOVED, make_bundle
from cobot.launch.backups import restore_staged
from cobot.launch.cli import main
from cobot.robot.geometry.cells import packed
from cobot.robot.scene import Scene, SceneFile, SceneObject
from cobot.robot.tool import BARE, ToolFile

PROGRAM = {"id": "kiste", "version": 2, "author": "A", "time": "T", "saved": {"label": "Über", "text": "{}"}}


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """Settings of a robot with a tool, a scene, taught positions and a program."""
    file = tmp_path / "mine.yaml"
    file.write_text("robot: {name: arm}\nlogs: logs\nkept: kept\n", encoding="utf-8")
    settings = load_settings(file)
    fill(settings, 1.0)
    return file


def fill(settings: Settings, mass: float) -> None:
    ToolFile(settings.tool_file).write(replace(BARE, version=3, mass=mass))
    box = SceneObject("sphere", (0.1,), (0.9, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0))
    SceneFile(settings.scene_file).write(Scene(version=5, objects={"ball": box}))
    taught = {"there": {"name": "there", "group": "taught", "joints": [0.0] * 7, "description": ""}}
    settings.positions_file.write_text(json.dumps(taught), encoding="utf-8")
    program = settings.programs_folder / "kiste" / "2.json"
    program.parent.mkdir(parents=True, exist_ok=True)
    program.write_text(json.dumps(PROGRAM), encoding="utf-8")


def files(config: Path) -> dict[str, bytes]:
    folder = config.parent
    ours = [path for path in (folder / "kept").rglob("*") if path.suffix in (".json", ".yaml")]
    return {str(path.relative_to(folder)): path.read_bytes() for path in [config, *ours]}


def test_a_restore_brings_everything_back(config: Path) -> None:
    settings, before = load_settings(config), files(config)
    content = make_backup(settings, config)
    fill(settings, 2.0)
    (settings.programs_folder / "newer").mkdir()
    (settings.programs_folder / "newer" / "1.json").write_text("{}", encoding="utf-8")
    config.write_text("robot: {name: arm, max_payload_kg: 3.0}\nlogs: logs\nkept: kept\n", encoding="utf-8")
    stage(settings, content)
    found = restore_staged(settings, config)
    assert found.robot.max_payload_kg == load_settings(None).robot.max_payload_kg
    assert files(config) == before
    assert not staged_file(settings).exists()
    last = config.parent / "kept" / "arm.before-restore.last.zip"
    assert unpack(last.read_bytes())[1]["settings.yaml"].startswith(b"robot: {name: arm, max_payload")


def test_what_the_backup_has_not_is_removed(config: Path) -> None:
    settings = load_settings(config)
    content = pack({}, {"format": 1, "cobot": "0.1.0", "robots": joints_of(settings)})
    stage(settings, content)
    activate(settings, config)
    assert set(files(config)) == {"mine.yaml"}
    assert ToolFile(settings.tool_file).read() == BARE


def test_a_restore_that_is_killed_is_done_again(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings, before = load_settings(config), files(config)
    content = make_backup(settings, config)
    fill(settings, 2.0)
    worse = files(config)
    stage(settings, content)
    keep = module.keep
    for writes in range(1, 5):
        left = [writes]

        def until_killed(path: Path, text: bytes, what: str, left: list[int] = left) -> None:
            left[0] -= 1
            if left[0] < 0:
                raise UnavailableError("killed")
            keep(path, text, what)

        with monkeypatch.context() as patch:
            patch.setattr(module, "keep", until_killed)
            with pytest.raises(UnavailableError):
                activate(settings, config)
        assert staged_file(settings).exists()
    restore_staged(settings, config)
    assert files(config) == before
    last = config.parent / "kept" / "arm.before-restore.last.zip"
    assert unpack(last.read_bytes())[1]["robots/arm/tool.json"] == worse["kept/arm.tool.json"]


def cloud_without_its_boxes() -> bytes:
    """A scene whose point cloud has a box elsewhere. The service would not start with it."""
    pose, box = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [5.0, 0.0, 0.0, 0.1, 0.1, 0.1]
    cloud = {"shape": "point_cloud", "size": [0.1] * 3, "pose": pose, "boxes": [box], "voxel": 0.1}
    return json.dumps({"objects": {"seen": cloud | {"cells": packed(np.zeros((1, 3)), 0.1)}}}).encode()


def broken(settings: Settings, **changes: Any) -> bytes:
    files = {"robots/arm/tool.json": ToolFile(settings.tool_file).path.read_bytes()} | changes.pop(
        "files", {}
    )
    about = {"format": 1, "cobot": "0.1.0", "robots": joints_of(settings)} | changes
    return pack(files, about)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"format": 2}, "has the format 2, but this cobot reads the format 1"),
        ({"cobot": "99.0.1"}, "made by cobot 99.0.1, but this is .*; update cobot first"),
        ({"robots": {"other": []}}, "belongs to other robots"),
        ({"robots": {"arm": ["joint1"]}}, "belongs to other robots"),
        ({"robots": None}, "belongs to other robots"),
        ({"files": {"robots/arm/../../x.json": b"{}"}}, "is not a file of a backup"),
        ({"files": {"../x": b""}}, "is not a file of a backup"),
        ({"files": {"/etc/passwd": b""}}, "is not a file of a backup"),
        ({"files": {"robots/arm/keys.sqlite": b""}}, "is not a file of a backup"),
        ({"files": {"robots/else/tool.json": b"{}"}}, "is not a file of a backup"),
        ({"files": {"robots/arm/programs/a/0.json": b"{}"}}, "is not a file of a backup"),
        ({"files": {"robots/arm/programs/../1.json": b"{}"}}, "is not a file of a backup"),
        ({"files": {"robots/arm/programs/a/1.json": b"{}"}}, "a different program or version"),
        ({"files": {"robots/arm/tool.json": b"{"}}, "is not JSON"),
        ({"files": {"robots/arm/tool.json": b"[" * 100_000}}, "is not JSON"),
        ({"files": {"robots/arm/tool.json": b"[]"}}, "is not a JSON object"),
        ({"files": {"robots/arm/tool.json": b'{"mass": "heavy"}'}}, "is not valid: mass"),
        ({"files": {"robots/arm/scene.json": b'{"objects": 1}'}}, "is not valid: objects"),
        ({"files": {"robots/arm/scene.json": cloud_without_its_boxes()}}, "seen.boxes: do not contain all"),
        ({"files": {"robots/arm/positions.json": b'{"a": 1}'}}, "is not valid"),
        ({"files": {"settings.yaml": b"robot: {name: [}"}}, "settings.yaml of the backup"),
        ({"files": {"settings.yaml": b"robot: {nome: arm}\n"}}, "settings.yaml of the backup"),
        (
            {"files": {"settings.yaml": b"robot: {name: other}\n"}},
            "contains the robots other, but this cobot has arm",
        ),
    ],
)
def test_a_backup_that_does_not_fit_changes_nothing(config: Path, changes: dict[str, Any], said: str) -> None:
    settings, before = load_settings(config), files(config)
    content = broken(settings, **changes)
    if b"settings.yaml" not in content:
        with pytest.raises(InputError, match=said):
            read_backup(content, settings)
    stage(settings, content)
    with pytest.raises(InputError, match=said):
        activate(settings, config)
    assert files(config) == before
    assert restore_staged(settings, config) is settings, "the start goes on"
    assert (config.parent / "kept" / "arm.restore.rejected").exists()


@contextmanager
def running(config: Path) -> Iterator[None]:
    """Another process keeps the files of these settings, as `cobot run` does."""
    code = (
        "import sys; from pathlib import Path; from cobot.config import load_settings\n"
        "from cobot.launch.supervisor.kept_lock import locking_kept_files\n"
        "with locking_kept_files(load_settings(Path(sys.argv[1]))): print('held', flush=True); input()"
    )
    command = [sys.executable, "-c", code, str(config)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield
        process.communicate("\n")


def test_the_commands_make_a_backup_and_restore_it(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings, before = load_settings(config), files(config)
    archive = tmp_path / "cell.zip"
    command = [str(archive), "--config", str(config)]
    assert main(["backup", *command]) == 0
    assert archive.stat().st_mode & 0o777 == 0o600
    assert main(["backup", *command]) == 1
    assert "already exists" in capsys.readouterr().err
    fill(settings, 2.0)
    assert main(["restore", *command]) == 0
    assert "restored, as of" in capsys.readouterr().out
    assert files(config) == before
    with running(config):
        assert main(["restore", *command]) == 0
        assert "cobot is running, so the next start will restore the backup" in capsys.readouterr().out
        assert staged_file(settings).read_bytes() == archive.read_bytes()
    assert main(["restore", str(tmp_path / "none.zip"), "--config", str(config)]) == 1
    assert "none.zip: cannot be read" in capsys.readouterr().err


def test_a_bundle_has_no_secrets_and_is_bounded(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = load_settings(config)
    settings.log_file.parent.mkdir(parents=True, exist_ok=True)
    lines = b"Authorization: Bearer cobot_very_secret_token\n" + b"x" * 999_999 + b"\nthe last line\n"
    settings.log_file.write_bytes(lines)
    live = {"health.json": b'{"password": "hunter22"}', "events.jsonl": b"e" * 4_000_000}
    content = make_bundle(settings, live)
    _, found = unpack(content)
    assert b"very_secret" not in b"".join(found.values())
    assert b"hunter22" not in b"".join(found.values())
    assert REMOVED.encode() in found["health.json"]
    assert found["arm/log.txt"].endswith(b"the last line\n")
    assert len(found["arm/log.txt"]) <= 1_000_000
    assert found["events.jsonl"] == b"4000000 bytes, left out"
    assert f"tokens: {REMOVED}".encode() in found["settings.yaml"]
    assert b"cobot" in found["packages.txt"]
