"""The panel of a robot in a simulated cell: it commands the gripper and draws the parts.

Oracle: GET /robot/gripper and GET /cell.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest
import trimesh
import yaml
from cell_run import EXAMPLE, IN_TRAY, RunOfCell
from chromium import CHROMIUM, Page, browsing
from cobot_run import ROOT, WAIT_S, Run, answering, until

BETWEEN = """(() => {
  const { arm } = cobotPanel.view;
  const [one, other] = ["hand.finger1", "hand.finger2"].map(
    (name) => arm.groups[arm.bodies.findIndex((body) => body.name === name)].position);
  return one.distanceTo(other);
})()"""
"""Distance of the middles of the drawn fingers, which are 12 mm thick."""
CELL = ROOT / "examples" / "pick_and_place" / "cell.yaml"


def with_mesh(folder: Path) -> Path:
    """The example's cell with a cube more, which is a mesh."""
    content = yaml.safe_load(CELL.read_text(encoding="utf-8"))
    (folder / "block.stl").write_bytes(trimesh.creation.box([30.0] * 3).export(file_type="stl"))
    content["parts"]["block"] = {
        "shape": "mesh", "file": "block.stl", "scale": 0.001, "mass_kg": 0.05,
        "position_m": [0.42, -0.42, 0.216],
    }  # fmt: skip
    (folder / "cell.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    return folder / "cell.yaml"


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_gripper_is_commanded_and_the_parts_are_drawn(tmp_path: Path) -> None:
    backend = f"mujoco, cell: {with_mesh(tmp_path)}, gripper: {{type: simulated}}"
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
        corners = "[...cobotPanel.view.parts.values()].map((each) => each.geometry.attributes.position.count)"
        assert 3 * 12 in page.run(corners), "the mesh has its own triangles"
        page.click("#gripper-grasp")
        until(lambda: (now := width()) is not None and now < 0.01)
        until(lambda: page.run("document.querySelector('#gripper-why').innerText") != "")
        page.click("#gripper-open")
        until(lambda: (now := width()) is not None and now > 0.07)
        page.set_to("#gripper-width", "40")
        until(lambda: (now := width()) is not None and abs(now - 0.04) < 0.003)
        until(lambda: abs(page.run(BETWEEN) - 0.052) < 0.003)
        page.click("#gripper-stop")
        page.ask(
            "Emulation.setDeviceMetricsOverride", width=1280, height=800, deviceScaleFactor=1, mobile=False
        )
        page.set_to("#language", "de")
        page.run("document.querySelector('#name-form').hidden = true")
        height = "(e => e.scrollHeight - e.clientHeight)(document.querySelector('#side'))"
        until(
            lambda: page.run(height) <= 1, lambda: f"{page.run(height)} px of the page Move are out of sight"
        )
        page.click("#gripper-home")
        until(lambda: page.run("document.querySelector('#gripper-why').innerText") == "")


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_panel_alone_has_the_cube_picked_counted_and_placed(tmp_path: Path) -> None:
    """As docs/how-to/pick-and-place.md has it: a file is imported and started on the page Program."""
    with (
        answering(RunOfCell(tmp_path)) as run,
        browsing(tmp_path, "--enable-unsafe-swiftshader") as tools,
    ):
        run.until(lambda: run.ask("GET", "/robot/gripper")["connected"])
        page = Page(tools)
        page.visit(f"{run.url}/")
        until(lambda: page.run("!document.querySelector('#gripper').hidden"))
        page.choose("#program-import", EXAMPLE / "pick_and_place.lua")
        until(lambda: "gripper.grasp" in page.run("document.querySelector('#program-text').value"))
        page.click("#lua-run")
        until(lambda: run.cube()[2] > 0.3)
        page.picture(tmp_path / "carried.png")
        until(lambda: "the cube is in the tray" in page.run("document.querySelector('#lua-log').innerText"))
        assert run.cube() == IN_TRAY
        assert run.count() == 1
