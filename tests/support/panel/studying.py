"""Studies of the service: a map around the arm, a placement that is taken over, and a cancel."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, until

from panel.page import Panel, set_to

REACH: dict[str, Any] = {
    "question": "Was erreicht <b>er</b>?",
    "kind": "reach",
    "space": {"box": {"low": [0.3, -0.4, 0.2], "high": [0.9, 0.4, 1.0]}, "spacing_m": 0.2},
}
PLACEMENT: dict[str, Any] = {
    "question": "Where is its place?",
    "kind": "placement",
    "targets": {"box": {"low": [0.6, 0.0, 0.2], "high": [0.6, 0.2, 0.4]}, "spacing_m": 0.2},
    "space": {
        "base_x_m": {"values": [0.0, 0.1]},
        "tcp_z_m": {"values": [0.05]},
        "tcp_pitch_rad": {"values": [0.3]},
    },
}


@pytest.fixture
def studied(panel: Panel) -> Iterator[httpx.Client]:
    """The service over REST; the tool is as before and all studies are deleted in the end."""
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as client:
        panel.page.click("#tab-setup")
        panel.page.click("#tab-studies")
        yield client
        client.post("/robot/tool", json={"clear": True}).raise_for_status()
        for each in client.get("/studies").json()["studies"]:
            until(lambda each=each: state_of(client, each) != "running")
            client.delete(f"/studies/{each['id']}").raise_for_status()


def started(http: httpx.Client, document: dict[str, Any]) -> dict[str, Any]:
    return dict(http.post("/studies", json=document).raise_for_status().json())


def state_of(http: httpx.Client, study: dict[str, Any]) -> str:
    return str(http.get(f"/studies/{study['id']}").json()["state"])


def finished(http: httpx.Client, document: dict[str, Any]) -> dict[str, Any]:
    study = started(http, document)
    until(lambda: state_of(http, study) == "finished")
    return dict(http.get(f"/studies/{study['id']}").json())


def choose_study(panel: Panel, study: dict[str, Any]) -> None:
    panel.until(f"cobotPanel.setup.studies.list.some(({{ id }}) => id === '{study['id']}')")
    if panel.page.run("document.querySelector('#study').value") != study["id"]:
        set_to(panel, "#study", study["id"])


def points(panel: Panel, name: str, size: int) -> np.ndarray:
    found = panel.page.run(f"[...cobotPanel.view.map.geometry.attributes.{name}.array]")
    return np.reshape(np.array(found, dtype=float), (-1, size))


def as_srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def test_a_map_of_the_reach_is_drawn_around_the_arm(panel: Panel, studied: httpx.Client) -> None:
    """Oracle: the map, read over REST; the colours of its scale."""
    study = finished(studied, REACH)
    choose_study(panel, study)
    panel.until("document.querySelector('#study-state').innerText.startsWith('Done, ')")
    assert panel.page.run("document.querySelector('#study b') === null"), "markup is text"
    assert panel.page.run("document.querySelector('#placement-card').hidden")
    panel.page.click("#study-map")
    panel.until("cobotPanel.view.map")
    shown = studied.get(f"/studies/{study['id']}/map").json()
    np.testing.assert_allclose(
        points(panel, "position", 3), np.column_stack([shown[axis] for axis in "xyz"]), atol=1e-6
    )
    reached = np.array([value is not None for value in shown["values"]["share"]])
    assert reached.any()
    assert not reached.all()
    colours = points(panel, "color", 4)
    assert ((colours[:, 3] > 0.5) == reached).all(), "places that are not reached are faint"
    np.testing.assert_allclose(as_srgb(colours[reached, :3])[0] * 255, shown["scale"][-1], atol=0.1)
    assert panel.text("#study-high") == "1.00"
    set_to(panel, "#study-metric", "manipulability")
    high = shown["ranges"]["manipulability"][1]
    panel.until(f"Number(document.querySelector('#study-high').innerText) === {float(f'{high:.3g}')}")
    assert len(np.unique(points(panel, "color", 4), axis=0)) > 3
    panel.page.click("#study-map")
    panel.until("cobotPanel.view.map === null")


def test_the_best_placement_is_taken_over(panel: Panel, studied: httpx.Client) -> None:
    """Oracle: the placement and the tool, read over REST."""
    choose_study(panel, finished(studied, REACH))
    study = finished(studied, PLACEMENT)
    choose_study(panel, study)
    base = f"x {1000 * study['placement']['base'][0]:.1f}"
    panel.until(f"document.querySelector('#study-base').innerText.includes({json.dumps(base)})")
    assert panel.page.run("document.querySelector('#map-card').hidden")
    panel.page.click("#study-tool")
    panel.until("document.querySelector('#study-why').innerText.startsWith('The TCP is set')")
    tool = studied.get("/robot/tool").json()
    x, y, z, w, *vector = study["placement"]["tcp"]
    np.testing.assert_allclose(tool["position"], [x, y, z], atol=1e-9)
    np.testing.assert_allclose(tool["quaternion"], [*vector, w], atol=1e-9)
    assert abs(w) < 0.999, "it is turned"


def test_a_running_study_is_cancelled_with_a_partial_answer(panel: Panel, studied: httpx.Client) -> None:
    """Oracle: its state, read over REST."""
    space = {"box": REACH["space"]["box"], "spacing_m": 0.02}
    study = started(studied, REACH | {"space": space, "question": "How much?"})
    choose_study(panel, study)
    panel.until("!document.querySelector('#study-cancel').disabled")
    panel.until("document.querySelector('#study-state').innerText.includes(' tasks done')")
    panel.page.click("#study-cancel")
    until(lambda: state_of(studied, study) == "partial")
    panel.until("document.querySelector('#study-state').innerText.includes('start the same study again')")
    panel.until("document.querySelector('#study-cancel').disabled")
