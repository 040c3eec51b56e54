"""The panel of a robot in a simulated cell: it commands the gripper and draws the parts.

Oracle: GET /robot/gripper and GET /cell.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest
from chromium import CHROMIUM, Page, browsing
from cobot_run import ROOT, WAIT_S, Run, answering, until

CELL = ROOT / "examples" / "pick_and_place" / "cell.yaml"


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_gripper_is_commanded_and_the_parts_are_drawn(tmp_path: Path) -> None:
    backend = f"mujoco, cell: {CELL}, gripper: {{type: simulated}}"
    with (
        answering(Run(tmp_path, backend=backend, clock="realtime")) as run,
        browsing(tmp_path, "--enable-unsafe-swiftshader") as tools,
    ):

        def width() -> float | None:
            found: dict[str, Any] = httpx.get(f"{run.url}/robot/gripper", timeout=WAIT_S).json()
            return None if found["state"] is None else found["state"]["width"]

        def parts() -> list[str]:
            found: dict[str, Any] = httpx.get(f"{run.url}/cell", timeout=WAIT_S).json()
            return [each["name"] for each in found["parts"]]

        page = Page(tools)
        page.visit(f"{run.url}/")
        until(lambda: page.run("!document.querySelector('#gripper').hidden"))
        until(lambda: page.run("cobotPanel.view?.parts.size") == len(parts()))
        page.click("#gripper-grasp")
        until(lambda: (now := width()) is not None and now < 0.01)
        until(lambda: page.run("document.querySelector('#gripper-why').innerText") != "")
        page.click("#gripper-open")
        until(lambda: (now := width()) is not None and now > 0.07)
        page.set_to("#gripper-width", "40")
        until(lambda: (now := width()) is not None and abs(now - 0.04) < 0.003)
        page.click("#gripper-stop")
        page.click("#gripper-home")
        until(lambda: page.run("document.querySelector('#gripper-why').innerText") == "")
