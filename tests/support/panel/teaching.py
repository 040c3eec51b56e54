"""Waypoints: by hand, by jogging, from files; run, step by step, as a sequence."""

from __future__ import annotations

import json
from typing import Any

import httpx
import jsonschema_rs
import numpy as np
import pytest
from cobot_run import WAIT_S, until
from folders import ROOT

from panel.page import (
    HOME,
    Panel,
    drop,
    forget,
    is_at,
    set_to,
)


def freedriven(panel: Panel) -> dict[str, Any]:
    return dict(httpx.get(f"{panel.run.url}/robot/freedrive", timeout=WAIT_S).json())


def test_the_arm_is_guided_by_hand_while_the_page_is_there(panel: Panel) -> None:
    """That a push moves it: tests/app/services/streaming/test_freedrive.py. Here nobody pushes."""
    pressed = "document.querySelector('#freedrive').ariaPressed === 'true'"

    def switched_on() -> int:
        panel.page.click("#freedrive")
        panel.until(pressed)
        found = freedriven(panel)["session"]
        assert found
        return int(found)

    session = switched_on()
    assert panel.text("#freedrive-why").startswith("Push the arm")
    panel.page.click("#teach")
    panel.until("document.querySelectorAll('#points li').length === 1")
    taught = panel.page.run("cobotPanel.waypoints.list[0].joints")
    np.testing.assert_allclose(taught, HOME, atol=5e-3)
    panel.page.click("#points li:nth-child(1) button:nth-of-type(3)")
    until(lambda: freedriven(panel)["left_s"] > 1.0)
    assert freedriven(panel)["session"] == session, "renewed"
    panel.page.click("#freedrive")
    panel.until(f"!({pressed})")
    until(lambda: freedriven(panel)["ended"] == "freedrive was switched off")
    panel.stays()

    switched_on()
    panel.page.click("#stop")
    panel.until(f"!({pressed}) && document.querySelector('#freedrive-why').innerText.includes('stop')")

    switched_on()
    panel.page.run("clearTimeout(cobotPanel.freedrive.timer)")
    until(lambda: freedriven(panel)["session"] is None)
    assert freedriven(panel)["ended"] == "freedrive was not renewed for 2 s"

    panel.load()
    switched_on()
    panel.load()
    until(lambda: freedriven(panel)["session"] is None)
    assert freedriven(panel)["ended"] in ("freedrive was switched off", "freedrive was not renewed for 2 s")
    panel.stays()


def test_waypoints_are_taught_shown_run_and_saved_as_a_sequence(panel: Panel) -> None:
    """Oracle: the published schema of sequences, in another implementation of JSON Schema."""
    places = [[0.2, *HOME[1:]], [0.2, 0.2, *HOME[2:]], [0.0, 0.2, *HOME[2:]]]
    for place in places:
        body = {"joints": place, "speed": 1.0}
        assert httpx.post(f"{panel.run.url}/robot/move/joints", json=body, timeout=WAIT_S).json()["success"]
        until(panel.rests)
        near = f"cobotPanel.state.commanded_position.every((v, i) => Math.abs(v - {place}[i]) < 1e-4)"
        panel.until(near)
        panel.page.click("#teach")
    panel.until("document.querySelectorAll('#points li').length === 3")
    set_to(panel, "#points li:nth-child(1) input[type=number]", "20")
    set_to(panel, "#points li:nth-child(2) select", "lin")
    focused = (
        "document.activeElement === document.querySelector('#points li:nth-child({}) button:nth-of-type({})')"
    )
    panel.page.run("document.querySelector('#points li:nth-child(2) button:nth-of-type(2)').focus()")
    panel.page.key("Enter", "Enter", "\r")
    panel.until(focused.format(3, 1))  # it is the last one now, and can go back alone
    panel.page.key("Enter", "Enter", "\r")
    panel.until(focused.format(2, 1))
    panel.page.click("#points li:nth-child(3) button:nth-of-type(1)")
    set_to(panel, "#points li:nth-child(2) select", "auto")
    panel.page.click("#points-show")
    panel.until("!document.querySelector('#execute').disabled")
    panel.page.click("#execute")
    panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
    position = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    sequence = panel.page.run("cobotPanel.waypoints.sequence()")
    last = sequence["waypoints"][2]
    assert last.get("planner") == "lin", f"the second one was moved to the end: {sequence}"
    assert sequence["waypoints"][1]["planner"] == "auto"
    np.testing.assert_allclose([position[k] for k in "xyz"], [last[k] for k in "xyz"], atol=5e-3)
    schema = ROOT / "sequences" / "sequence.schema.json"
    jsonschema_rs.validator_for(json.loads(schema.read_text())).validate(sequence)
    assert [each["radius"] for each in sequence["waypoints"]] == [0.02, 0.0, 0.0]

    for _ in range(3):
        panel.page.click("#points li:nth-child(1) button:nth-of-type(3)")
    panel.until("document.querySelectorAll('#points li').length === 0")
    drop(panel, "#points", "a.json", json.dumps(sequence))
    panel.until("document.querySelectorAll('#points li').length === 3")
    assert panel.page.run("cobotPanel.waypoints.sequence()") == sequence
    drop(panel, "#points", "a.json", '{"points": []}')
    panel.until("document.querySelector('#points-why').innerText.startsWith('a.json is not a sequence')")
    assert panel.page.run("document.querySelectorAll('#points li').length") == 3
    drop(panel, "#points", "steps.json", '{"steps": [{"wait_s": 0}, {"wait_s": 0}]}')
    panel.until("document.querySelector('#points li').innerText.startsWith('steps.json: 2 steps')")
    assert panel.page.run("document.querySelector('#points-show').disabled")
    panel.page.click("#points-run")
    panel.until("document.querySelector('#points-why').innerText === 'The program has ended.'")
    panel.page.click("#points li button")
    panel.until("document.querySelectorAll('#points li').length === 3")
    panel.page.run("localStorage.clear()")


def newest_job(panel: Panel) -> dict[str, Any]:
    """Of those that belong to no other."""
    jobs = httpx.get(f"{panel.run.url}/jobs?n=10", timeout=WAIT_S).json()["jobs"]
    return dict(next(each for each in jobs if each["parent"] is None))


def test_waypoints_are_run_step_by_step_paused_and_ended(panel: Panel) -> None:
    places = [[0.2, *HOME[1:]], [0.2, 0.2, *HOME[2:]], [0.0, 0.2, *HOME[2:]]]
    sequence = {"waypoints": [{"joints": each, "speed": 1.0, "radius": 0.0} for each in places]}
    sequence["waypoints"][2]["planner"] = "ompl"
    drop(panel, "#points", "a.json", json.dumps(sequence))
    panel.until("document.querySelectorAll('#points li').length === 3")
    panel.until("!document.querySelector('#execute').disabled && cobotPanel.view.ghost")
    assert panel.page.run("document.querySelector('#motion-speed').value") == "100"
    assert panel.page.run("document.querySelector('#step').disabled")
    panel.page.click("#points-step")
    until(lambda: newest_job(panel)["state"] == "paused")
    assert is_at(panel, HOME)
    for place in places[:2]:
        panel.until("!document.querySelector('#step').disabled")
        panel.until("document.querySelector('#pause').innerText === 'Resume'")
        panel.page.click("#step")
        until(lambda place=place: is_at(panel, place) and newest_job(panel)["state"] == "paused")
    panel.until("document.querySelectorAll('#points li[data-next]').length === 1")
    panel.until("document.querySelector('#pause').innerText === 'Resume'")
    panel.page.click("#pause")
    panel.until("document.querySelector('#points-why').innerText === 'The program has ended.'")
    assert is_at(panel, places[2])
    assert panel.page.run("document.querySelectorAll('#points li[data-next]').length") == 0

    set_to(panel, "#motion-speed", "5")
    set_to(panel, "#points-rounds", "3")
    panel.page.click("#points-run")
    until(lambda: newest_job(panel)["state"] == "running" and panel.mode() == "TRAJECTORY")
    panel.until("!document.querySelector('#end').disabled")
    panel.page.click("#end")
    panel.until("document.querySelector('#points-why').innerText.includes('was cancelled by')")
    assert newest_job(panel)["state"] == "cancelled"
    panel.stays()
    set_to(panel, "#points-rounds", "1")
    panel.page.run("localStorage.clear()")


def test_a_sequence_that_the_list_cannot_edit_is_shown_with_its_curves_and_run_as_it_is(panel: Panel) -> None:
    """Oracle: of velocities differences of the positions; of what is run, where the arm gets to."""
    end = [0.1, 0.2, *HOME[2:]]
    sequence = {
        "home": {"named": "home", "speed": 1.0},
        "waypoints": [
            {"named": "work", "speed": 0.5, "radius": 0.02, "label": "above the bench"},
            {"joints": end, "speed": 1.0},
        ],
    }
    drop(panel, "#points", "cell.json", json.dumps(sequence))
    panel.until("document.querySelector('[data-file=\"cell.json\"]')")
    assert "cell.json: 2 waypoints" in panel.text("#points")
    panel.until("document.querySelectorAll('#planned-plots svg').length === 14")
    assert panel.rests()
    assert is_at(panel, HOME), "nothing has moved"
    path = panel.page.run("cobotPanel.planned.plan.path")
    times, places, rates = (
        np.array([each[name] for each in path]) for name in ("time_s", "joints", "velocities")
    )
    np.testing.assert_allclose(rates, np.gradient(places, times, axis=0), atol=0.05)
    np.testing.assert_allclose(places[-1], end, atol=1e-6)
    assert panel.page.run("document.querySelectorAll('#planned-plots .beyond').length") == 0
    assert "%" in panel.text("#planned-plots b")
    panel.page.click("#points-run")
    panel.until("document.querySelector('#points-why').innerText === 'The program has ended.'")
    assert is_at(panel, end)
    panel.until("document.querySelector('#planned').hidden")
    panel.page.click("#points button")
    panel.until("!document.querySelector('[data-file]')")

    wrong = {"waypoints": [{"joints": [9.0, *HOME[1:]], "speed": 1.0, "label": "too far"}]}
    drop(panel, "#points", "wrong.json", json.dumps(wrong))
    panel.until("document.querySelector('#plan').innerText.includes('joint1')")
    panel.page.click("#points button")
    forget(panel, "422")


def test_a_long_sequence_is_planned_in_parts_that_end_where_the_arm_stops(panel: Panel) -> None:
    """120 waypoints, one in three with a radius; and two plans as one."""
    radii = "Array.from({length: 120}, (_, n) => ({joints: [n], radius: n % 3 ? 0.01 : 0}))"
    parts = panel.page.run(f"import('/panel/sequence.js').then((all) => all.partsOf({{waypoints: {radii}}}))")
    counts = [len(each["motions"]) for each in parts]
    assert counts == [49, 48, 23]
    assert [each["motions"][0]["joints"][0] for each in parts] == [0, 49, 97]
    assert all(len(each["radii"]) == len(each["motions"]) - 1 for each in parts)
    assert parts[0]["radii"][:4] == [0, 0.01, 0.01, 0]
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        there = {"joints": [0.2, *HOME[1:]], "speed": 1.0, "samples": 5}
        back = {"joints": HOME, "speed": 0.5, "start": there["joints"], "samples": 5}
        plans = [http.post("/robot/plan/joints", json=body).json() for body in (there, back)]
    plans = [each | {"ids": [each["plan_id"]]} for each in plans]
    one_after_the_other = f"all.followed({json.dumps(plans[0])}, {json.dumps(plans[1])})"
    both = panel.page.run(f"import('/panel/sequence.js').then((all) => {one_after_the_other})")
    assert both["ids"] == [each["plan_id"] for each in plans]
    assert both["duration_s"] == pytest.approx(sum(each["duration_s"] for each in plans))
    assert [each["time_s"] for each in both["path"]] == sorted(each["time_s"] for each in both["path"])
    nearest = min(each["closest_self"]["distance_m"] for each in plans)
    assert both["closest_self"]["distance_m"] == nearest
