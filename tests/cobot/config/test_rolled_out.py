"""Settings that a fleet has rolled out. Oracle: docs/fleet.md, "Roll out"."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot.config import load_settings, load_with_rolled_out
from cobot.config.rolled_out import ROLLED_OUT_FILE, read_rolled_out
from cobot.errors import ConfigError
from cobot.fleet.cell_settings import configuration_of
from cobot.launch.cli import main

OWN = "kept: kept\nplanning: {workers: 2, kept_plans: 7}\nfleet: {cell: one, connect: [tcp/127.0.0.1:7447]}\n"


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """The settings file of a cell to which planning.workers and joint limits were rolled out."""
    file = tmp_path / "cobot-setting.yaml"
    file.write_text(OWN)
    link = load_settings(file).rolled_out
    folder = link.parent / "0123"
    folder.mkdir(parents=True)
    (folder / ROLLED_OUT_FILE).write_text("planning: {workers: 3}\nweb: {joint_limits: mine.yaml}\n")
    shipped = load_settings().web.joint_limits.read_text()
    (folder / "mine.yaml").write_text(shipped)
    link.symlink_to(folder.name)
    return file


def test_they_apply_over_the_users_file(own: Path) -> None:
    found = load_with_rolled_out(own)
    assert (found.planning.workers, found.planning.kept_plans) == (3, 7)
    assert found.web.joint_limits == own.parent / "kept" / "iiwa.rolled-out" / "0123" / "mine.yaml"
    assert load_settings(own).planning.workers == 2


def test_a_cell_that_has_left_the_fleet_uses_its_own_file(own: Path) -> None:
    own.write_text(OWN.replace("[tcp/127.0.0.1:7447]", "[]"))
    assert load_with_rolled_out(own).planning.workers == 2


def test_what_does_not_fit_any_more_says_what_to_remove(own: Path) -> None:
    link = load_settings(own).rolled_out
    (link / ROLLED_OUT_FILE).write_text("planning: {workers: 99}\n")
    with pytest.raises(ConfigError) as caught:
        load_with_rolled_out(own)
    assert "planning.workers" in str(caught.value)
    assert f"to continue without it, remove {link}" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("logs: /tmp", "unknown key 'logs'"),
        ("fleet: {accept: {settings: observer}}", "unknown key 'fleet'"),
        ("web: {authentication: none}", "web: unknown key 'authentication'"),
        ("robot: {backend: fri}", "robot: unknown key 'backend'"),
        ("planning: 3", "planning: must be a mapping, got 3"),
        ("web: {joint_limits: ../other.yaml}", "must be a file next to settings.yaml"),
        ("robot: {srdf: /etc/shadow}", "must be a file next to settings.yaml"),
        ("robot: {cell: [1]}", "must be a file next to settings.yaml"),
        ("[", "settings.yaml"),
    ],
)
def test_what_cannot_be_rolled_out_is_an_error(tmp_path: Path, content: str, words: str) -> None:
    file = tmp_path / ROLLED_OUT_FILE
    file.write_text(content)
    with pytest.raises(ConfigError) as caught:
        read_rolled_out(file)
    assert words in str(caught.value)


def test_the_hash_of_a_configuration_is_of_contents_and_not_of_places(own: Path) -> None:
    here = configuration_of(load_with_rolled_out(own))
    elsewhere = "kept: other\nrobot: {name: two}\nweb: {tokens: other.json}"
    own.write_text(OWN.replace("kept: kept", elsewhere))
    plain = configuration_of(load_settings(own))
    assert plain != here, "it has 2 workers"
    own.write_text(own.read_text().replace("workers: 2", "workers: 3"))
    assert configuration_of(load_settings(own)) == here, "the limits are a copy of the shipped ones"


def test_a_folder_that_is_missing_is_an_error_and_not_the_users_own_limits(own: Path) -> None:
    link = load_settings(own).rolled_out
    (link.parent / "0123" / ROLLED_OUT_FILE).unlink()
    with pytest.raises(ConfigError, match="to continue without it, remove"):
        load_with_rolled_out(own)
    link.unlink()
    assert load_with_rolled_out(own).planning.workers == 2


def test_they_do_not_apply_to_a_file_that_has_several_robots_by_now(own: Path) -> None:
    own.write_text(f"{OWN}robots: [{{name: iiwa}}, {{name: other}}]\n")
    with pytest.raises(ConfigError, match=r"has several robots, .* to continue without it, remove"):
        load_with_rolled_out(own)


@pytest.mark.parametrize("command", ["run", "check"])
def test_a_start_that_fails_with_them_says_what_to_remove(
    own: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """As after a change of the user to another model, whose joints have other names."""
    link = load_settings(own).rolled_out
    limits = link / "mine.yaml"
    limits.write_text(limits.read_text().replace("joint1:", "shoulder:"))
    assert main([command, "--config", str(own)]) == 1
    said = capsys.readouterr()
    assert "shoulder" in said.out + said.err
    assert f"to continue without it, remove {link}" in said.err
    link.unlink()
    assert main(["check", "--config", str(own)]) == 0
    assert "remove" not in capsys.readouterr().err
