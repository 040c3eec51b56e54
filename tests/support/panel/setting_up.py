"""The page Setup: the tool, its TCP, and the limits."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh
from cobot_run import WAIT_S, until

from app.api.schemas.tool import EXAMPLE_POINTS
from panel.page import Panel, forget, set_to

TIP_M = [0.0, 0.0, 0.15]
"""Where the tip is that touches one point in all of `EXAMPLE_POINTS`."""


@pytest.fixture
def http(panel: Panel) -> Iterator[httpx.Client]:
    """REST; afterwards the flange is bare and nothing is around the arm."""
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as made:
        yield made
        made.post("/scene", json={"clear": True}).raise_for_status()
        made.post("/robot/tool", json={"clear": True}).raise_for_status()


def value(panel: Panel, selector: str) -> Any:
    return panel.page.run(f"document.querySelector({json.dumps(selector)}).value")


def shows(panel: Panel, selector: str, text: str) -> None:
    panel.until(f"document.querySelector({json.dumps(selector)}).textContent.includes({json.dumps(text)})")


def go(panel: Panel, http: httpx.Client, joints: list[float]) -> None:
    """The arm goes there, and the page has it there at rest."""
    assert http.post("/robot/move/joints", json={"joints": joints, "speed": 1.0}).json()["success"]
    panel.until(
        f"cobotPanel.state?.position.every((each, joint) => Math.abs(each - {joints}[joint]) < 1e-3)"
        " && cobotPanel.state?.velocity.every((each) => Math.abs(each) < 0.01)"
    )


def test_without_tokens_the_page_says_how_to_create_the_first_one(panel: Panel) -> None:
    panel.page.click("#tab-setup")
    panel.page.click("#tab-people")
    panel.until("document.querySelector('#people-add').disabled")
    assert "token of an administrator" in panel.page.run("document.querySelector('#people-add').title")
    shown = panel.page.run("document.querySelector('#people-first').innerText")
    assert "web.authentication: required" in shown
    assert "cobot token create NAME --role admin" in shown
    panel.page.click("#tab-tool")


def test_setup_shows_the_tool_and_the_limits(panel: Panel, http: httpx.Client) -> None:
    """Oracle: what REST was told."""
    panel.page.click("#tab-setup")
    panel.page.click("#tab-tool")
    http.post("/robot/tool", json={"name": "pen", "mass": 0.25, "tcp": {"z": 0.1}}).raise_for_status()
    panel.until("document.querySelector('#tool-name').value === 'pen'")
    assert value(panel, "#tool-mass") == "0.25"
    assert [value(panel, f"#tool-tcp-{axis}") for axis in (1, 2, 3)] == ["0", "0", "100"]
    panel.page.click("#tab-robot")
    rows = panel.page.run("[...document.querySelectorAll('#limits tr')].map((each) => each.innerText)")
    assert len(rows) == 8
    assert "85 °/s" in rows[1]


def test_the_tool_is_changed_and_what_others_changed_stays(panel: Panel, http: httpx.Client) -> None:
    """Oracle: GET /robot/tool."""
    turned = {"z": 0.1, "a": 0.5}
    http.post("/robot/tool", json={"name": "his", "mass": 0.25, "tcp": turned}).raise_for_status()
    panel.until("document.querySelector('#tool-name').value === 'his'")
    before = http.get("/robot/tool").json()
    for field, text in (("#tool-tcp-1", "12.5"), ("#tool-centre-3", "40")):
        panel.page.write(field, text)
    http.post("/robot/tool", json={"name": "<b>hers</b>"}).raise_for_status()
    shows(panel, "#tool-why", "Another client has changed the tool")
    panel.page.click("#tool-save")
    shows(panel, "#tool-why", "is saved")
    found = http.get("/robot/tool").json()
    assert (found["name"], found["mass"], found["centre"]) == ("<b>hers</b>", 0.25, [0.0, 0.0, 0.04])
    np.testing.assert_allclose(found["position"], [0.0125, 0.0, 0.1], atol=1e-12)
    assert found["quaternion"] == before["quaternion"], "a field nobody has touched keeps all its digits"
    assert value(panel, "#tool-name") == "<b>hers</b>"

    panel.page.write("#tool-name", "mine")
    panel.page.write("#tool-mass", "99")
    panel.page.click("#tool-save")
    shows(panel, "#tool-why", "99 kg")
    assert http.get("/robot/tool").json() == found, "what is refused changes nothing"
    panel.page.click("#tool-undo")
    panel.until("document.querySelector('#tool-mass').value === '0.25'")
    panel.page.write("#tool-tcp-6", "90")
    panel.page.write("#tool-centre-1", "")
    panel.page.click("#tool-save")
    shows(panel, "#tool-why", "Fill in each number")
    panel.page.write("#tool-centre-1", "1")
    panel.page.write("#tool-centre-2", "2")
    for index in (2, 3, 4, 5):
        panel.page.write(f"#tool-tcp-{index}", "10")
    panel.page.click("#tool-save")
    shows(panel, "#tool-why", "is saved")
    np.testing.assert_allclose(http.get("/robot/tool").json()["centre"], [0.001, 0.002, 0.04], atol=1e-12)


def test_the_tcp_is_found_with_four_points(panel: Panel, http: httpx.Client) -> None:
    """Oracle: the tip of which the four postures of the simulated arm were made, see `TIP_M`."""
    panel.page.click("#tab-tool")
    panel.page.click("#tip-take")
    shows(panel, "#tip-why", "3 more to go")
    for _ in range(3):
        panel.page.click("#tip-take")
    shows(panel, "#tip-why", "nearly the same orientation")
    assert panel.page.run("document.querySelector('#tip-set').disabled")
    panel.page.click("#tip-clear")
    for joints in EXAMPLE_POINTS[:3]:
        go(panel, http, joints)
        panel.page.click("#tip-take")
    go(panel, http, [0.3, *EXAMPLE_POINTS[3][1:]])
    panel.page.click("#tip-take")
    shows(panel, "#tip-why", "That is much")
    panel.page.click("#tip-points li:last-child button")
    shows(panel, "#tip-why", "1 more to go")
    go(panel, http, EXAMPLE_POINTS[3])
    panel.page.click("#tip-take")
    shows(panel, "#tip-why", "mm from the flange, error 0.")
    panel.page.click("#tip-set")
    shows(panel, "#tip-why", "The TCP is set")
    tool = http.get("/robot/tool").json()
    np.testing.assert_allclose(tool["position"], TIP_M, atol=1e-3)
    assert tool["quaternion"] == [0.0, 0.0, 0.0, 1.0]
    until(lambda: panel.page.run("document.querySelectorAll('#tip-points li').length") == 0)


def test_no_pose_is_taken_over_while_the_arm_moves(panel: Panel, http: httpx.Client) -> None:
    body = {"points": [{"positions": EXAMPLE_POINTS[0], "time_from_start": 20.0}]}
    panel.page.click("#tab-tool")
    http.post("/trajectory/send", json=body).raise_for_status()
    panel.until("Math.abs(cobotPanel.state?.velocity[4]) > 0.021")
    panel.page.click("#tip-take")
    shows(panel, "#tip-why", "The arm moves")
    http.post("/stop").raise_for_status()
    until(panel.rests)


def turned_back(panel: Panel, field: str) -> None:
    """A value is changed, and back to 0: without a change the field would count as not used."""
    for text in ("5", "0"):
        panel.page.write(field, text)


def chosen(panel: Panel, name: str) -> None:
    """An object or a frame, from its list."""
    selector = f".chips [data-name={json.dumps(name)}]"
    panel.until(f"document.querySelector({json.dumps(selector)})")
    panel.page.click(selector)


def objects(http: httpx.Client) -> dict[str, Any]:
    return {each["name"]: each for each in http.get("/scene").json()["objects"]}


def test_frames_are_added_placed_at_the_tcp_and_deleted(panel: Panel, http: httpx.Client) -> None:
    """Oracle: GET /scene, and the TCP of GET /robot/pose with a tool."""
    panel.page.click("#tab-scene")
    panel.page.write("#frame-name", "<b>x</b>")
    panel.page.click("#frame-save")
    shows(panel, "#frame-why", "letters from a to z")
    panel.page.write("#frame-name", "pallet")
    for axis, text in ((1, "100"), (2, "-700"), (3, "200"), (4, "90")):
        panel.page.write(f"#frame-place-{axis}", text)
    for axis in (5, 6):
        turned_back(panel, f"#frame-place-{axis}")
    panel.page.click("#frame-save")
    shows(panel, "#frame-why", "is saved")
    (frame,) = http.get("/scene").json()["frames"]
    np.testing.assert_allclose(frame["position"], [0.1, -0.7, 0.2], atol=1e-9)
    np.testing.assert_allclose(frame["quaternion"], [0, 0, 0.5**0.5, 0.5**0.5], atol=1e-9)

    chosen(panel, "pallet")
    before = panel.page.run("cobotPanel.geometry.tcp.position[2]")
    http.post("/robot/tool", json={"tcp": {"x": 0.02, "z": 0.15, "b": 0.5}}).raise_for_status()
    panel.until(f"Math.abs(cobotPanel.geometry.tcp.position[2] - {before}) > 0.1")
    panel.page.click("#frame-here")
    panel.page.click("#frame-save")
    shows(panel, "#frame-why", "is saved")
    tcp = http.get("/robot/pose").json()["position"]
    until(
        lambda: np.allclose(http.get("/scene").json()["frames"][0]["position"], list(tcp.values()), atol=1e-4)
    )
    panel.page.click("#frame-delete")
    until(lambda: not http.get("/scene").json()["frames"])
    panel.page.click("#frame-new")
    assert value(panel, "#frame-name") == ""


def test_an_object_is_added_in_a_frame_moved_sized_and_deleted(panel: Panel, http: httpx.Client) -> None:
    """Oracle: GET /scene, and the bodies that the page draws."""
    pallet = {"x": 0.1, "y": -0.7, "z": 0.2, "a": np.pi / 2}
    http.post("/scene", json={"frames": {"pallet": pallet}}).raise_for_status()
    panel.page.click("#tab-scene")
    panel.page.click("#object-new")
    panel.page.write("#object-name", "crate")
    panel.until("document.querySelectorAll('#object-frame option').length === 2")
    set_to(panel, "#object-frame", "pallet")
    for axis in (1, 2, 3):
        panel.page.write(f"#object-size-{axis}", str(10 * axis))
        turned_back(panel, f"#object-place-{axis}")
    panel.page.click("#object-save")
    shows(panel, "#object-why", "is saved")
    np.testing.assert_allclose(objects(http)["crate"]["size"], [0.01, 0.02, 0.03])
    np.testing.assert_allclose(objects(http)["crate"]["position"], [0.1, -0.7, 0.2], atol=1e-9)
    panel.until("cobotPanel.geometry.bodies.some((each) => each.name.includes('crate'))")

    panel.until("document.querySelector('#object-place-2').value === '-700'")
    panel.page.write("#object-place-2", "-650")
    http.post("/scene", json={"frames": {"other": {"x": 0.0, "y": 0.0, "z": 0.0}}}).raise_for_status()
    panel.until("document.querySelectorAll('#frames-all button').length === 2")
    assert value(panel, "#object-place-2") == "-650", "what is typed stays"
    for axis in (4, 5, 6):
        turned_back(panel, f"#object-place-{axis}")
    panel.page.run(
        "(api => { api.post = async (...all) => { await new Promise((go) => (window.letGo = go));"
        " return Object.getPrototypeOf(api).post.apply(api, all); }; })(cobotPanel.api)"
    )
    panel.page.click("#object-save")
    panel.until("window.letGo")
    panel.page.write("#object-size-1", "-1")
    panel.page.click("#object-save")
    panel.page.run("delete cobotPanel.api.post, letGo()")
    until(lambda: abs(objects(http)["crate"]["position"][1] + 0.65) < 1e-9)
    shows(panel, "#object-why", "greater than 0")  # and the answer to the first press does not replace it
    panel.page.write("#object-size-1", "50")
    panel.page.click("#object-save")
    until(lambda: abs(objects(http)["crate"]["size"][0] - 0.05) < 1e-9)

    chosen(panel, "crate")
    panel.page.click("#object-delete")
    until(lambda: not objects(http))


def test_a_mesh_is_imported_and_moved(panel: Panel, http: httpx.Client, tmp_path: Path) -> None:
    """Oracle: the size of a box that trimesh writes, in mm."""
    box = trimesh.creation.box((100.0, 200.0, 50.0))
    file = tmp_path / "fixture.stl"
    file.write_bytes(box.export(file_type="stl"))
    panel.page.click("#tab-scene")
    panel.page.click("#object-new")
    panel.page.write("#object-name", "fixture")
    set_to(panel, "#object-shape", "mesh")
    panel.page.click("#object-save")
    shows(panel, "#object-why", "Choose an STL or OBJ file")
    panel.page.choose("#object-choose", file)
    shows(panel, "#object-file-name", "fixture.stl")
    set_to(panel, "#object-unit", "1")
    panel.page.write("#object-place-2", "-900")
    panel.page.click("#object-save")
    shows(panel, "#object-why", "The arm touches now")
    panel.until("document.querySelector('#scene-all button')")  # its row moves what is below
    panel.page.click("#object-delete")
    shows(panel, "#object-why", "is deleted")
    panel.page.write("#object-name", "fixture")
    set_to(panel, "#object-shape", "mesh")
    panel.page.choose("#object-choose", file)
    set_to(panel, "#object-unit", "0.001")
    panel.page.click("#object-here")
    panel.page.write("#object-place-2", "-900")
    panel.page.click("#object-save")
    shows(panel, "#object-why", "is saved")
    (made,) = http.get("/scene").json()["objects"]
    np.testing.assert_allclose(made["size"], [0.1, 0.2, 0.05], atol=1e-6)
    panel.until("document.querySelector('#scene-all button')?.textContent.startsWith('fixture')")
    panel.page.write("#object-place-3", "400")
    panel.page.click("#object-save")
    until(lambda: abs(http.get("/scene").json()["objects"][0]["position"][2] - 0.4) < 1e-9)
    panel.page.write("#object-name", "renamed")
    panel.page.click("#object-save")
    shows(panel, "#object-why", "not renamed")
    broken = tmp_path / "broken.stl"
    broken.write_bytes(b"solid nothing\n" * 1000)
    panel.page.click("#object-new")
    panel.page.write("#object-name", "broken")
    set_to(panel, "#object-shape", "mesh")
    panel.page.choose("#object-choose", broken)
    panel.page.click("#object-save")
    shows(panel, "#object-why", "is not an STL or OBJ mesh")
    huge = tmp_path / "huge.stl"
    with huge.open("wb") as sparse:
        sparse.truncate(500_000_000)
    panel.page.choose("#object-choose", huge)
    shows(panel, "#object-why", "500 MB")
    forget(panel, "413", "422")


def test_a_backup_is_downloaded_and_staged_and_a_bundle_made(
    panel: Panel, http: httpx.Client, tmp_path: Path
) -> None:
    """Oracle: zipfile, and GET /robot/tool."""
    http.post("/robot/tool", json={"name": "pen"}).raise_for_status()
    archive = panel.page.save("#backup-make", tmp_path)
    shows(panel, "#backup-why", "is downloaded")
    with zipfile.ZipFile(archive) as files:
        tool = json.loads(files.read(f"robots/{panel.run.name}/tool.json"))
    assert tool["name"] == "pen"
    panel.page.choose("#backup-choose", archive)
    shows(panel, "#backup-why", "is valid. The next start of cobot restores it")
    broken = tmp_path / "broken.zip"
    broken.write_bytes(archive.read_bytes()[:-20])
    panel.page.choose("#backup-choose", broken)
    shows(panel, "#backup-why", "is not a ZIP archive")
    forget(panel, "422")
    next(panel.run.config.parent.rglob("*.restore.zip")).unlink()
    bundle = panel.page.save("#support-make", tmp_path)
    shows(panel, "#support-why", "is downloaded")
    with zipfile.ZipFile(bundle) as files:
        assert {"health.json", "jobs.json", "settings.yaml"} <= set(files.namelist())


def test_planned_motions_run_in_slow_motion_and_the_head_of_the_page_shows_it(
    panel: Panel, http: httpx.Client
) -> None:
    """Oracle: GET /robot/simulation/time_factor."""
    path = "/robot/simulation/time_factor"
    badge = "document.querySelector('#simulation').textContent.trim()"
    pressed = "document.querySelector('#time-factor :checked')?.value"
    panel.page.click("#tab-setup")
    panel.page.click("#tab-robot")
    panel.until(f"{badge} === 'Simulation' && {pressed} === '1'")
    panel.page.click("#time-factor label:nth-child(1)")
    panel.until(f"{badge} === 'Simulation × 0.25'")
    assert http.get(path).json() == {"factor": 0.25}
    http.post(path, json={"factor": 3.0}).raise_for_status()  # for which there is no button
    panel.until(f"{badge} === 'Simulation × 3' && {pressed} === undefined")
    token = http.post("/robot/control", json={"timeout_s": 60}).json()["token"]
    panel.page.click("#time-factor label:nth-child(5)")
    shows(panel, "#simulation-why", "control")
    panel.until(f"{pressed} === undefined")
    forget(panel, "409")
    http.delete("/robot/control", headers={"X-Control-Token": token}).raise_for_status()
    panel.page.click("#time-factor label:nth-child(3)")
    panel.until(f"{badge} === 'Simulation' && {pressed} === '1'")
    assert http.get(path).json() == {"factor": 1.0}
    panel.page.click("#tab-tool")
