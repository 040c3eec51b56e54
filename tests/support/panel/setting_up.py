"""The page Setup: the tool, its TCP, and the limits."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, until

from app.api.tool_schemas import EXAMPLE_POINTS
from panel.page import Panel

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
        f"cobotPanel.state.position.every((each, joint) => Math.abs(each - {joints}[joint]) < 1e-3)"
        " && cobotPanel.state.velocity.every((each) => Math.abs(each) < 0.01)"
    )


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
    panel.until("Math.abs(cobotPanel.state.velocity[4]) > 0.021")
    panel.page.click("#tip-take")
    shows(panel, "#tip-why", "The arm moves")
    http.post("/stop").raise_for_status()
    until(panel.rests)
