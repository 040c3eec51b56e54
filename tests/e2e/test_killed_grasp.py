"""The service is killed in the middle of a grasp. Oracle: the part in MuJoCo goes along with the hand."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import httpx
import pytest
from cobot_run import ROOT, WAIT_S, Run, answering

pytestmark = pytest.mark.thorough

CUBE = {"x": 0.5, "y": -0.3, "b": math.pi}


def test_a_service_that_is_killed_in_the_middle_of_a_grasp_leaves_the_part_in_the_hand(
    tmp_path: Path,
) -> None:
    cell = ROOT / "examples" / "pick_and_place"
    with answering(Run(tmp_path, backend=f"mujoco, cell: {cell}", clock="realtime")) as run:

        def ask(method: str, path: str, **body: Any) -> dict[str, Any]:
            answer = httpx.request(method, f"{run.url}{path}", json=body or None, timeout=WAIT_S)
            found: dict[str, Any] = answer.raise_for_status().json()
            return found

        def go(z: float, planner: str) -> None:
            answer = ask("POST", "/robot/move/pose", **CUBE, z=z, planner=planner, speed=0.5)
            assert answer["success"], answer

        def width() -> float:
            return float(ask("GET", "/robot/gripper")["state"]["width"])

        go(0.36, "ptp")
        go(0.225, "lin")
        ask("POST", "/robot/gripper/grasp?wait=false", width=0.05, speed=0.01, force=40.0)
        run.until(lambda: width() < 0.075)
        old = run.child("app")
        assert old is not None
        old.kill()
        run.until(lambda: run.restarted("app", old.pid) and run.healthy())
        run.until(lambda: ask("GET", "/robot/gripper")["held"] == "cube")
        run.until(lambda: any(each["name"] == "cube" for each in ask("GET", "/scene")["objects"]))
        go(0.4, "lin")
        (cube,) = (each for each in ask("GET", "/cell")["parts"] if each["name"] == "cube")
        assert cube["position"] == pytest.approx([0.5, -0.3, 0.4], abs=0.005)
        state = ask("GET", "/robot/gripper")["state"]
        assert state["object"] == "held_inside"
        assert state["width"] == pytest.approx(0.05, abs=0.002)
        assert state["force"] == pytest.approx(40.0, rel=0.1)
