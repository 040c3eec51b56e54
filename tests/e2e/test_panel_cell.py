"""The panel of a robot in a simulated cell: it commands the gripper and draws the parts.

Oracle: GET /robot/gripper and GET /cell.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh
import yaml
from cell_run import EXAMPLE, IN_TRAY, RunOfCell
from chromium import CHROMIUM, Page, browsing
from cobot_run import ROOT, WAIT_S, Run, answering, until
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.thorough

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
    shutil.copy(EXAMPLE / "pick_and_place.json", folder)
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
        page.run("cobotPanel.parts.choose('bar')")
        height = "(e => e.scrollHeight - e.clientHeight)(document.querySelector('#side'))"
        until(
            lambda: page.run(height) <= 1, lambda: f"{page.run(height)} px of the page Move are out of sight"
        )
        lowest = "document.querySelector('#gripper').getBoundingClientRect().bottom"
        for width_px, height_px in ((1280, 800), (1024, 768)):
            page.ask(
                "Emulation.setDeviceMetricsOverride",
                width=width_px, height=height_px, deviceScaleFactor=1, mobile=False,
            )  # fmt: skip
            until(lambda: page.run(lowest) < height_px, lambda: f"{page.run(lowest)} of {height_px} px")  # noqa: B023
        page.click("#tab-setup")
        page.run("cobotPanel.guide.show(4)")
        assert page.run("document.querySelector('#guide-text').innerText").endswith(
            "Das Beispiel „Pick and place“ können Sie auf der Seite Ablauf starten."
        )
        page.run("cobotPanel.guide.show(5)")
        page.click("#gripper-home")
        until(lambda: page.run("document.querySelector('#gripper-why').innerText") == "")
        assert page.run("document.querySelector('#clearance').innerText").endswith("ohne lose Teile")
        page.set_to("#language", "en")
        said = "document.querySelector('#run-why').innerText"
        for number, (step, words) in enumerate(WHY.items()):
            httpx.put(
                f"{run.url}/programs/why{number}",
                json={"label": "Why", "text": f'{{"steps": [{{"wait_s": 0}}, {step}]}}'},
                timeout=WAIT_S,
            ).raise_for_status()
            page.click("#tab-run")
            listed = f"#run-list [data-run=why{number}]"
            until(lambda: page.run(f"!!document.querySelector('{listed}')"))  # noqa: B023
            page.click(listed)
            page.click("#points-run")
            failed = f"Failed. Step 2: {words}"
            until(lambda: page.run(said).startswith(failed), lambda: str(page.run(said)))  # noqa: B023
            assert page.run(said).endswith("Fix the cause, then start it again.")
            assert ".json" not in page.run(said) + page.run("document.querySelector('#log').innerText")


WHY = {
    '{"gripper": {"command": "grasp"}}': "The gripper holds nothing: no part was there.",
    '{"gripper": {"command": "move", "width": 0.3}}': "width: 300 mm is beyond the limit of 80 mm.",
    '{"wait_for": {"input": "gate", "is": true}, "timeout_s": 0.1}': "The input gate did not get its value",
}
"""Steps that fail, and what the page says of each."""
HELD_IS_COVERED = """(arm => arm.bodies.some(
  ({ name, part }, index) => part === "scene" && name === "cube" && !arm.groups[index].visible
))(cobotPanel.view.arm)"""
"""Whether the held cube is drawn only as the part of the cell, which is where the cube really is."""
SCREEN = """(() => {
  const { parts, camera, place } = cobotPanel.view;
  const [, mesh] = [...parts].find(([key]) => key.startsWith("can "));
  const { x, y } = mesh.position.clone().project(camera);
  const { left, top, width, height } = place.getBoundingClientRect();
  return [left + (x + 1) / 2 * width, top + (1 - y) / 2 * height];
})()"""
"""Where the can is drawn."""


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_part_is_chosen_in_the_picture_and_the_arm_goes_above_it_and_to_it_after_execute(
    tmp_path: Path,
) -> None:
    """Oracle: the place of the can in GET /cell, its length in the cell file, and the pose of the service."""
    with (
        answering(RunOfCell(tmp_path)) as run,
        browsing(tmp_path, "--enable-unsafe-swiftshader") as tools,
    ):
        page = Page(tools)
        page.visit(f"{run.url}/")
        until(
            lambda: page.run("window.cobotPanel?.view?.parts.size === 3 && cobotPanel.parts.all.length === 5")
        )
        page.ask(
            "Emulation.setDeviceMetricsOverride", width=1280, height=800, deviceScaleFactor=1, mobile=False
        )
        page.run("document.querySelector('#name-form').hidden = true; cobotPanel.guide.show(5)")
        if page.run("document.querySelector('#view-drag').ariaPressed") == "true":
            page.click("#view-drag")
        at = tuple(page.run(SCREEN))
        page.mouse("mousePressed", at)
        page.mouse("mouseReleased", at)
        until(lambda: page.run("cobotPanel.parts.chosen") == "can")
        assert not page.run("document.querySelector('#cell-list').hidden")
        row = "#cell-list li:nth-child(3)"
        can = next(each for each in run.ask("GET", "/cell")["parts"] if each["name"] == "can")
        shown = [f"{1000 * each:.0f}" for each in can["position"]]
        assert page.run(f"document.querySelector('{row} span').innerText").split() == shown
        length = yaml.safe_load(CELL.read_text(encoding="utf-8"))["parts"]["can"]["size_m"][1]
        page.set_to("#motion-speed", "50")

        def pose() -> list[float]:
            return list(run.ask("GET", "/robot/pose")["position"].values())

        before = pose()
        for nth, above in ((2, 0.5 * length + 0.1), (3, 0.0)):
            page.click(f"{row} button:nth-of-type({nth})")
            until(lambda: page.run("!document.querySelector('#execute').disabled"))
            goal = np.add(can["position"], [0.0, 0.0, above])
            values = (
                "[...document.querySelectorAll('#tcp input')].slice(0, 3).map((each) => Number(each.value))"
            )
            np.testing.assert_allclose(page.run(values), 1000.0 * goal, atol=0.06)
            np.testing.assert_allclose(pose(), before, atol=1e-4, err_msg="a plan moves nothing")
            page.click("#execute")
            until(lambda: page.run("document.querySelector('#plan').innerText") == "The arm has arrived.")
            before = pose()
            np.testing.assert_allclose(before, goal, atol=2e-3)
            turned = Rotation.from_quat(
                list(run.ask("GET", "/robot/pose")["orientation"]["quaternion"].values())
            )
            np.testing.assert_allclose(turned.apply([0.0, 0.0, 1.0]), [0.0, 0.0, -1.0], atol=5e-3)


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_panel_alone_has_the_cube_picked_counted_and_placed(tmp_path: Path) -> None:
    """An imported file on Program, and the example on Run: docs/how-to/pick-and-place.md."""
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
        until(lambda: page.run(HELD_IS_COVERED), lambda: "the held cube is drawn twice")
        page.picture(tmp_path / "carried.png")
        until(lambda: "the cube is in the tray" in page.run("document.querySelector('#lua-log').innerText"))
        assert run.cube() == IN_TRAY
        assert run.count() == 1
        # The example is opened as a copy, and runs as it is.
        (example,) = run.ask("GET", "/programs")
        until(lambda: page.run("!document.querySelector('#stored-open').disabled"))
        shown = page.run("document.querySelector('#stored').selectedOptions[0].textContent")
        assert shown == "Pick and place (Example)"
        page.reveal("#stored-delete")
        assert page.run("document.querySelector('#stored-delete').disabled")
        page.click("#stored-open")
        until(lambda: page.run("document.querySelector('#program-name').value") == "Pick and place")
        names = "[...document.querySelectorAll('#run-list b')].map((each) => each.textContent)"
        assert page.run(names) == ["Pick and place"], "the unchanged copy is not listed too"
        page.click("#program-save")
        until(lambda: len(run.ask("GET", "/programs")) == 2)
        mine, kept = sorted(run.ask("GET", "/programs"), key=lambda each: bool(each["example"]))
        assert kept == example
        assert (mine["label"], mine["version"], mine["example"]) == ("Pick and place", 1, False)
        page.click("#tab-move")
        page.run("document.querySelector('#places-parts').click()")
        page.click("#cell-reset")
        until(lambda: run.cube() != IN_TRAY)
        assert page.run("document.querySelector('#cell-why').innerText") == ""
        page.click("#tab-run")
        page.click(f"[data-run='{example['id']}']")
        assert "Example" in page.run(f"document.querySelector(`[data-run='{example['id']}']`).innerText")
        page.run(
            "(api => { let left = 1; api.get = (path, ...rest) => path.startsWith('/jobs/') && left-- > 0"
            " ? Promise.reject(Object.assign(new Error('signal timed out'), { status: 0 }))"
            " : Object.getPrototypeOf(api).get.call(api, path, ...rest); })(cobotPanel.api)"
        )  # the first question after the job has no answer, as on a busy computer
        page.click("#points-run")
        until(lambda: run.count() == 1)
        until(lambda: page.run("document.querySelector('#run-why').innerText") == "The program has ended.")
        assert run.cube() == IN_TRAY
