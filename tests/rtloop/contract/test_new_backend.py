"""What `cobot backend new` makes is built, installed, found by its entry point, and keeps the contract.

Oracles: pip and pytest, which know nothing of cobot.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
import wheels

from rtloop.contract import listing
from rtloop.contract.__main__ import main
from rtloop.contract.new_backend import write_backend
from rtloop.contract.suite import CHECKS

LIMIT_S = 250


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The folder of a new backend, and one with its wheel installed."""
    place = tmp_path_factory.mktemp("backend")
    folder = write_backend("sky_crane", place)
    wheel = wheels.build(folder, place)
    target = place / "installed"
    options = ["--no-deps", "--no-index", "--no-compile", "--target", str(target)]
    subprocess.run([*wheels.PIP, "install", *options, str(wheel)], check=True, timeout=LIMIT_S)
    return folder, target


def run(made: tuple[Path, Path], *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python beside what is installed, and this checkout."""
    folder, target = made
    search = os.pathsep.join([str(target), str(wheels.ROOT)])
    environment = {**wheels.ALONE, "PYTHONPATH": search, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )


@pytest.mark.thorough
def test_its_wheel_is_found_by_its_entry_point_and_keeps_the_contract(made: tuple[Path, Path]) -> None:
    done = run(made, "-m", "cobot", "backend", "list", "--json")
    (found,) = [each for each in json.loads(done.stdout) if each["name"] == "sky_crane"]
    assert found["origin"] == "cobot-backend-sky-crane 0.1.0"
    assert found["place"] == "cobot_backend_sky_crane:SkyCraneArm"
    assert not found["problem"]
    done = run(made, "-m", "cobot", "backend", "test", "sky_crane")
    assert done.returncode == 0, done.stdout + done.stderr
    passed = len(CHECKS) - 3
    assert done.stdout.splitlines()[-1] == f"sky_crane, every 1 ms: {passed} passed, 0 FAILED, 3 not tested"


def test_one_for_a_device_that_takes_whole_motions_keeps_it_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", "slow_crane", "--trajectory", "--dir", str(tmp_path)]) == 0
    folder = tmp_path / "cobot-backend-slow-crane"
    assert '"cobot_backend_slow_crane:SlowCraneArm"' in (folder / "pyproject.toml").read_text()
    monkeypatch.syspath_prepend(folder)
    place = "cobot_backend_slow_crane:SlowCraneArm"
    assert main(["test", place, "--only", "options", "calls", "motion", "stop", "disconnect in motion"]) == 0
    assert "5 passed, 0 FAILED" in capsys.readouterr().out


def test_its_own_tests_are_the_contract(made: tuple[Path, Path]) -> None:
    done = run(made, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "error")
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(CHECKS) - 3} passed, 3 skipped" in done.stdout


@pytest.mark.parametrize(("name", "kind"), [("my_arm", "MyArm"), ("arm", "ArmArm"), ("armada", "ArmadaArm")])
def test_a_name_that_ends_with_arm_says_it_once(tmp_path: Path, name: str, kind: str) -> None:
    folder = write_backend(name, tmp_path)
    assert f'{kind}"' in (folder / "pyproject.toml").read_text(encoding="utf-8")
    assert f"class {kind}:" in (folder / f"cobot_backend_{name}.py").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("Sky Crane", "is not a valid name for a backend"),
        ("../crane", "is not a valid name for a backend"),
        ("", "is not a valid name for a backend"),
        ("a" * 41, "up to 40 lowercase letters"),
        ("crane__two", "single underscores"),
        ("class", "is reserved by Python"),
        ("math", "is reserved by Python"),
        ("mujoco", "is taken by rtloop.backends.mujoco:MujocoBackend"),
    ],
)
def test_a_name_that_cannot_be_one_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, problem: str
) -> None:
    assert main(["new", name, "--dir", str(tmp_path)]) == 1
    assert problem in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_nothing_is_written_over_and_no_folder_is_made_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", "crane", "--dir", str(tmp_path)]) == 0
    assert "cobot backend test crane" in capsys.readouterr().out
    assert main(["new", "crane", "--dir", str(tmp_path)]) == 1
    assert "already exists" in capsys.readouterr().err
    assert main(["new", "crane", "--dir", str(tmp_path / "none")]) == 1
    assert "there is no folder" in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == ["cobot-backend-crane"]


def test_the_list_says_what_cannot_be_used_and_why(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = EntryPoint("broken", "no_such_module:Arm", "cobot.backends")
    boasts = EntryPoint("boasts", "own_arm:Boasts", "cobot.backends")
    monkeypatch.setattr("cobot.entry_points.entry_points", lambda group: [broken, boasts])
    listed = {each.name: each for each in listing.listed()}
    assert listed["broken"].problem.startswith("cannot load 'broken': ModuleNotFoundError")
    assert listed["boasts"].problem.startswith("Boasts.capabilities is 'yes'; it must be a Capabilities")
    assert listed["fri"].contract == "simulated device"
    assert listed["mujoco"].contract == "itself"
    monkeypatch.setattr(listing.importlib.util, "find_spec", lambda name: None)
    listed = {each.name: each for each in listing.listed()}
    assert listed["franka"].problem == "needs pylibfranka, which is not installed"
    assert main(["list"]) == 0
    said = capsys.readouterr().out
    assert "every 1, 2, 4, 5, 10 ms" in said
    assert "cannot be used here: needs pylibfranka" in said
