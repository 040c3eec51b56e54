"""The configuration that runs. Oracle: the settings as they are loaded from the user's own file."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import trimesh
import yaml
from independent_models import LIMITS, SRDF

from cobot.cell import load_cell
from cobot.config import load_settings
from cobot.errors import SharedMemoryError
from cobot.launch.running_config import ProcessState, RunningConfig
from cobot.robot.limits import load_joint_limits
from cobot.robot.srdf import load_named_positions

FILES = {"web": {"endpoints", "joint_limits"}, "robot": {"srdf"}}


@pytest.fixture
def running(tmp_path: Path) -> RunningConfig:
    return RunningConfig(tmp_path / "running")


def settings_file(folder: Path, text: str) -> Path:
    (folder / "limits.yaml").write_bytes(LIMITS.read_bytes())
    (folder / "arm.srdf").write_bytes(SRDF.read_bytes())
    file = folder / "mine.yaml"
    file.write_text(text, encoding="utf-8")
    return file


ONE = (
    "robot: {name: a, srdf: arm.srdf}\nrt: {settle_position_rad: 0.00001}\nweb: {joint_limits: limits.yaml}\n"
)
TWO = (
    "planning: {workers: 1}\nrobots: [{name: a, srdf: arm.srdf, joint_limits: limits.yaml}, "
    "{name: b, rt: {period_s: 0.002}, planning: {collision_margin_m: 0.01}, backend: 'my.arm:Arm'}]\n"
)


@pytest.mark.parametrize("text", [ONE, TWO, "{}"])
def test_the_copy_says_what_the_files_say(tmp_path: Path, running: RunningConfig, text: str) -> None:
    settings = load_settings(settings_file(tmp_path, text))
    running.create(settings)
    copy = load_settings(running.file)
    assert list(copy.each) == list(settings.each)
    for name, each in settings.each.items():
        mine, others = (item.model_dump(exclude=FILES | {"robots": True}) for item in (copy.of(name), each))
        assert mine == others
        limits, wanted = (load_joint_limits(item.web.joint_limits) for item in (copy.of(name), each))
        assert repr(limits) == repr(wanted)
        place = copy.of(name).robot
        assert load_named_positions(place.srdf, limits.names, place.group) == load_named_positions(
            each.robot.srdf, limits.names, place.group
        )
        assert place.srdf.parent == running.folder


def test_a_cell_is_copied_with_its_meshes(tmp_path: Path, running: RunningConfig) -> None:
    (tmp_path / "meshes").mkdir()
    mesh = tmp_path / "meshes" / "block.stl"
    mesh.write_bytes(trimesh.creation.box([0.05] * 3).export(file_type="stl"))
    block = {"shape": "mesh", "file": "meshes/block.stl", "mass_kg": 0.1, "position_m": [0.5, 0.0, 0.1]}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump({"parts": {"block": block}}), encoding="utf-8")
    file = settings_file(tmp_path, "robot: {cell: cell.yaml}")
    settings = load_settings(file)
    assert settings.robot.cell is not None
    before = load_cell(settings.robot.cell)
    running.create(settings)
    mesh.write_bytes(b"edited")
    first = load_settings(running.file).robot.cell
    assert first is not None
    assert load_cell(first) == before
    assert running.folder in first.parents
    mesh.write_bytes(trimesh.creation.box([0.06] * 3).export(file_type="stl"))
    for _ in range(2):
        running.prepare(load_settings(file))
        running.commit()
    second = load_settings(running.file).robot.cell
    assert second is not None
    assert load_cell(second).parts["block"].mesh.size == pytest.approx((0.06,) * 3)
    assert not first.exists(), "editions that are not used any more are removed"


def test_nothing_counts_before_it_is_committed(tmp_path: Path, running: RunningConfig) -> None:
    file = settings_file(tmp_path, ONE)
    running.create(load_settings(file))
    before = running.file.read_bytes()
    (tmp_path / "limits.yaml").write_text("spoilt", encoding="utf-8")
    new = running.prepare(load_settings(file))
    assert running.file.read_bytes() == before
    assert load_joint_limits(load_settings(running.file).web.joint_limits).dof == 7
    assert new != running.file
    running.commit()
    assert load_settings(running.file).web.joint_limits.read_text() == "spoilt"


def test_what_nobody_goes_by_any_more_is_removed(tmp_path: Path, running: RunningConfig) -> None:
    settings = load_settings(settings_file(tmp_path, ONE))
    running.create(settings)
    for _ in range(5):
        running.prepare(settings)
    assert len(list(running.folder.glob("[0-9]*"))) == 6  # the current one, and the one that is prepared
    running.commit()
    running.prepare(settings)
    assert len(list(running.folder.glob("[0-9]*"))) == 6


def test_what_a_killed_run_has_left_is_replaced(tmp_path: Path, running: RunningConfig) -> None:
    running.folder.mkdir()
    (running.folder / "settings.yaml").write_text("old")
    (running.folder / "old").write_text("old")
    running.create(load_settings(settings_file(tmp_path, ONE)))
    assert not (running.folder / "old").exists()
    assert running.folder.stat().st_mode & 0o777 == 0o700


def test_a_folder_that_somebody_else_has_put_there_is_refused(tmp_path: Path, running: RunningConfig) -> None:
    """As a link to a folder of theirs, which nothing removes."""
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    running.folder.symlink_to(theirs)
    with pytest.raises(SharedMemoryError, match=r"cannot be created: File exists; .* another robot\.name"):
        running.create(load_settings(settings_file(tmp_path, ONE)))
    assert list(theirs.iterdir()) == []


def test_processes_are_told_and_read(tmp_path: Path, running: RunningConfig) -> None:
    assert running.processes() == {}
    running.folder.mkdir()
    told = {"rtloop": ProcessState(os.getpid(), 3), "service": ProcessState(2, 0)}
    running.publish(told)
    assert running.processes() == told
    (running.folder / "processes.json").write_text("[", encoding="utf-8")
    assert running.processes() == {}
