"""`cobot run --cell examples/pick_and_place`: its programs as a user runs them, and a service that dies.

Oracle: GET /cell, the bodies that MuJoCo steps in the real-time process.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest
from cell_run import EXAMPLE, IN_TRAY, RunOfCell
from cobot_run import WAIT_S, answering
from thorough import few


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunOfCell]:
    with answering(RunOfCell(tmp_path_factory.mktemp("cell"))) as made:
        yield made


@pytest.fixture
def run(shared: RunOfCell) -> RunOfCell:
    shared.until(shared.healthy)
    shared.until(lambda: shared.ask("GET", "/robot/gripper")["connected"])
    shared.ask("POST", "/cell/reset")
    shared.until(lambda: shared.count() == 0)
    return shared


@pytest.mark.parametrize(
    "command",
    few(
        [
            ["-m", "cobot", "run", str(EXAMPLE / "pick_and_place.json")],
            ["-m", "cobot", "lua", str(EXAMPLE / "pick_and_place.lua")],
            [str(EXAMPLE / "pick_and_place.py")],
        ]
    ),
    ids=["sequence", "Lua", "Python"],
)
def test_the_cube_is_counted_and_placed_in_the_tray(run: RunOfCell, command: list[str]) -> None:
    ended = subprocess.run(
        [sys.executable, *command],
        env={**os.environ, "COBOT_URL": run.url},
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert run.cube() == IN_TRAY
    assert run.count() == 1


@pytest.mark.thorough
def test_a_service_that_is_killed_leaves_the_part_in_the_hand(run: RunOfCell) -> None:
    with (EXAMPLE / "pick_and_place.json").open("rb") as file:
        run.ask("POST", "/sequences/start", files={"config": file})
    run.until(lambda: run.cube()[2] > 0.3)
    service = run.child("app")
    assert service is not None
    service.kill()
    run.until(lambda: run.restarted("app", service.pid) and run.healthy())
    run.until(lambda: run.ask("GET", "/robot/gripper")["connected"])
    x, y, z = run.cube()
    assert z > 0.3
    tcp = run.ask("GET", "/robot/pose")["position"]
    assert [x, y, z] == pytest.approx([tcp[axis] for axis in "xyz"], abs=5e-3)
    assert run.ask("GET", "/robot/gripper")["state"]["object"] == "held_inside"
    # and it goes on from there
    pose = {"x": 0.55, "y": 0.3, "z": 0.36, "b": 3.14159265, "speed": 0.3}
    assert run.ask("POST", "/robot/move/pose", json=pose)["success"]
    assert run.cube() == pytest.approx([0.55, 0.3, 0.36], abs=5e-3)
