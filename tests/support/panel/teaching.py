"""Waypoints: by hand, by jogging, from files; run, step by step, as a sequence."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import jsonschema_rs
import numpy as np
import pytest
from cobot_run import WAIT_S, until
from folders import ROOT

from cobot.runner.schema import sequence_of
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
    assert panel.text("#freedrive-why").startswith("Pull a link")
    panel.page.click("#teach")
    panel.until("document.querySelectorAll('#steps [data-step]').length === 1")
    taught = panel.page.run("cobotPanel.programPage.program.content.steps[0].joints")
    np.testing.assert_allclose(taught, HOME, atol=5e-3)
    panel.page.click("#step-remove")
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


def test_a_link_is_pulled_with_the_mouse_and_the_simulation_begins_again(panel: Panel) -> None:
    """Oracle: the TCP by REST. The bounds of the force: tests/app/services/streaming/test_pulling.py."""
    panel.page.click("#freedrive")
    panel.until("document.querySelector('#freedrive').ariaPressed === 'true'")
    panel.page.click("[data-view=iso]")
    place = (
        "(() => { const { view } = cobotPanel; const at = view.arm.tcp.getWorldPosition("
        "view.camera.position.clone()); at.z += 0.06; at.project(view.camera);"
        "const box = view.renderer.domElement.getBoundingClientRect();"
        "return [box.left + 0.5 * box.width * (1 + at.x), box.top + 0.5 * box.height * (1 - at.y)] })()"
    )
    x, y = panel.page.run(place)
    panel.page.mouse("mousePressed", (x, y))
    panel.until("/^link[67]$/.test(cobotPanel.pull.held?.link)")
    before = panel.run.joints()
    panel.page.ask(
        "Input.dispatchMouseEvent", type="mouseMoved", x=x + 150, y=y - 40, button="left", buttons=1
    )
    until(lambda: np.abs(np.subtract(panel.run.joints(), before)).max() > 0.1, lambda: panel.text("body"))
    panel.until("cobotPanel.view.pointing.pulled")
    panel.page.mouse("mouseReleased", (x + 150, y - 40))
    panel.until("!cobotPanel.pull.held && !cobotPanel.view.pointing.pulled")
    panel.page.click("#freedrive")
    until(lambda: freedriven(panel)["session"] is None)
    panel.stays()
    panel.page.click("#simulation-reset")
    panel.until("document.querySelector('#simulation-why').innerText === 'The simulation has begun again.'")
    until(lambda: np.abs(np.subtract(panel.run.joints(), HOME)).max() < 5e-3)
    panel.stays()


STEPS = "cobotPanel.programPage.program.content"
"""The program in the page."""


def row(number: str, part: str = ".step-name") -> str:
    return f'[data-step="{number}"] > .step {part}'


def test_waypoints_are_taught_shown_run_and_saved_as_a_sequence(panel: Panel, tmp_path: Path) -> None:
    """Oracle: the published schema of sequences, in another implementation of JSON Schema."""
    places = [[0.2, *HOME[1:]], [0.2, 0.2, *HOME[2:]], [0.0, 0.2, *HOME[2:]]]
    for place in places:
        body = {"joints": place, "speed": 1.0}
        assert httpx.post(f"{panel.run.url}/robot/move/joints", json=body, timeout=WAIT_S).json()["success"]
        until(panel.rests)
        near = f"cobotPanel.state?.commanded_position.every((v, i) => Math.abs(v - {place}[i]) < 1e-4)"
        panel.until(near)
        panel.page.click("#teach")
    panel.until("document.querySelectorAll('#steps [data-step]').length === 3")
    panel.page.click(row("1"))
    set_to(panel, "[data-field=step_radius]", "20")
    panel.page.click(row("2"))
    set_to(panel, "[data-field=step_way]", "lin")
    focused = "document.activeElement === document.querySelector('[data-step=\"{}\"] .step-name')"
    panel.page.run(f"document.querySelector({row('2')!r}).focus()")
    panel.page.key("ArrowDown", "ArrowDown", modifiers=1)
    panel.until(focused.format(3))
    panel.page.key("ArrowDown", "ArrowDown", modifiers=1)
    panel.until(focused.format(3))  # it is the last one
    panel.page.key("ArrowUp", "ArrowUp")
    panel.until(focused.format(2))
    panel.page.click(row("2"))
    set_to(panel, "[data-field=step_way]", "auto")
    set_to(panel, "[data-field=step_speed]", "100")
    panel.page.click("#preview")
    panel.until("!document.querySelector('#execute').disabled")
    panel.page.click("#execute")
    panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
    position = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    sequence = json.loads(panel.page.save("#program-export", tmp_path).read_text())
    last = sequence["steps"][2]
    assert last.get("planner") == "lin", f"the second one was moved to the end: {sequence}"
    assert (sequence["steps"][1]["planner"], sequence["steps"][1]["speed"]) == ("auto", 1.0)
    np.testing.assert_allclose([position[k] for k in "xyz"], [last[k] for k in "xyz"], atol=5e-3)
    require_valid(sequence)
    assert [each.get("radius") for each in sequence["steps"]] == [0.02, None, None]

    for number in ("3", "2", "1"):
        panel.page.click(row(number))
        panel.page.click("#step-remove")
    panel.until("document.querySelectorAll('#steps [data-step]').length === 0")
    drop(panel, "#steps", "a.json", json.dumps(sequence))
    panel.until("document.querySelectorAll('#steps [data-step]').length === 3")
    assert panel.page.run(STEPS) == sequence
    drop(panel, "#steps", "b.json", '{"points": []}')
    panel.until("document.querySelector('#program-why').innerText.startsWith('b.json is not a sequence')")
    assert panel.page.run(STEPS) == sequence
    panel.page.click("#program-new")
    panel.page.click("#program-undo")
    panel.until("document.querySelectorAll('#steps [data-step]').length === 3")
    panel.page.run("localStorage.clear()")
    panel.load()


def require_valid(sequence: dict[str, Any]) -> None:
    """By the published schema, and by the runner."""
    schema = ROOT / "sequences" / "sequence.schema.json"
    jsonschema_rs.validator_for(json.loads(schema.read_text())).validate(sequence)
    sequence_of(sequence)


def newest_job(panel: Panel) -> dict[str, Any]:
    """Of those that belong to no other."""
    jobs = httpx.get(f"{panel.run.url}/jobs?n=10", timeout=WAIT_S).json()["jobs"]
    return dict(next(each for each in jobs if each["parent"] is None))


def test_a_program_is_run_step_by_step_paused_and_ended(panel: Panel) -> None:
    places = [[0.2, *HOME[1:]], [0.2, 0.2, *HOME[2:]], [0.0, 0.2, *HOME[2:]]]
    steps: list[dict[str, Any]] = [{"joints": each, "speed": 1.0} for each in places]
    steps[2]["planner"] = "ompl"
    drop(
        panel,
        "#steps",
        "a.json",
        json.dumps({"steps": [*steps[:2], {"repeat": {"count": 1}, "do": steps[2:]}]}),
    )
    panel.until("document.querySelectorAll('#steps [data-step]').length === 4")
    assert panel.page.run("document.querySelector('#step').disabled")
    panel.page.click("#points-step")
    until(lambda: newest_job(panel)["state"] == "paused")
    assert is_at(panel, HOME)
    for place in places[:2]:
        panel.until("!document.querySelector('#step').disabled")
        panel.until("document.querySelector('#pause').innerText === 'Resume'")
        panel.page.click("#step")
        until(lambda place=place: is_at(panel, place) and newest_job(panel)["state"] == "paused")
    panel.until("document.querySelector('#steps [data-next]')?.dataset.step === '3'")
    panel.until("document.querySelector('#pause').innerText === 'Resume'")
    panel.page.click("#pause")
    panel.until("document.querySelector('#run-why').innerText === 'The program has ended.'")
    assert is_at(panel, places[2])
    assert panel.page.run("document.querySelectorAll('#steps [data-next]').length") == 0

    slow = {"steps": [each | {"speed": 0.02} for each in steps[:2]]}
    drop(panel, "#steps", "slow.json", json.dumps(slow))
    panel.until("document.querySelectorAll('#steps [data-step]').length === 2")
    set_to(panel, "#points-rounds", "3")
    panel.page.click("#points-run")
    until(lambda: newest_job(panel)["state"] == "running" and panel.mode() == "TRAJECTORY")
    panel.until("!document.querySelector('#end').disabled")
    start = "document.querySelector('#points-run')"
    panel.until(f"{start}.disabled && {start}.title.startsWith('This program runs.')")
    said = "document.querySelector('#run-why').innerText"
    panel.until(f"{said} === 'The program runs.'")
    assert not panel.page.run("document.querySelector('#plan').checkVisibility()"), "nothing is planned here"
    panel.page.click("#pause")
    panel.until(f"{said}.startsWith('The program waits.')")
    set_to(panel, "#language", "de")
    assert panel.page.run(said).startswith("Das Programm wartet."), "without another event"
    set_to(panel, "#language", "en")
    panel.page.click("#pause")
    panel.until(f"{said} === 'The program runs.'")
    panel.page.click("#end")
    panel.until("document.querySelector('#run-why').innerText.includes('Ended by an unnamed client')")
    assert not panel.page.run(f"{start}.disabled")
    assert newest_job(panel)["state"] == "cancelled"
    panel.stays()
    set_to(panel, "#points-rounds", "1")
    panel.page.run("localStorage.clear()")
    panel.load()


def test_a_file_is_previewed_until_a_step_that_decides_and_run_as_it_is(panel: Panel) -> None:
    """Oracle: of velocities differences of the positions; of what is run, where the arm gets to."""
    end = [0.1, 0.2, *HOME[2:]]
    known = {
        "home": {"named": "home", "speed": 1.0},
        "steps": [
            {"named": "work", "speed": 0.5, "radius": 0.02, "label": "above the bench"},
            {"joints": end, "speed": 1.0},
        ],
    }
    later = {"if": {"input": "none", "is": True}, "then": [{"named": "home"}], "mystery": {"deep": [1]}}
    drop(panel, "#steps", "cell.json", json.dumps(known | {"steps": [*known["steps"], later]}))
    panel.page.click("#preview")
    panel.until("document.querySelector('#program-why').innerText.includes('before step 3')")
    panel.until("document.querySelectorAll('#planned-plots svg').length === 14")
    assert panel.page.run(f"{STEPS}.steps[2].mystery") == {"deep": [1]}, (
        "a step of a newer version stays as it is"
    )
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
    panel.page.click(row("3"))
    panel.page.click("#step-remove")
    panel.page.click("#points-run")
    panel.until("document.querySelector('#run-why').innerText === 'The program has ended.'")
    assert is_at(panel, end)
    panel.until("document.querySelector('#planned').hidden")

    wrong = {"waypoints": [{"joints": [9.0, *HOME[1:]], "speed": 1.0, "label": "too far"}]}
    drop(panel, "#steps", "wrong.json", json.dumps(wrong))
    panel.page.click("#preview")
    panel.until("document.querySelector('#plan').innerText.includes('J1')")
    forget(panel, "422")
    panel.page.run("localStorage.clear()")
    panel.load()


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
