"""STOP, the keys that stop, emergency stops, and tokens."""

from __future__ import annotations

import json
from typing import Any

import httpx
import pytest
from cobot_run import WAIT_S, until
from streaming_client import StreamClient

from panel.page import (
    Panel,
    forget,
    set_to,
    slowly,
)


@pytest.mark.parametrize("way", ["button", "space", "escape", "space on a button"])
def test_stop_is_everywhere(panel: Panel, way: str) -> None:
    slowly(panel)
    if way == "button":
        panel.page.click("#stop")
    elif way == "escape":
        panel.page.key("Escape", "Escape")
    else:
        if way == "space on a button":
            panel.page.run("document.querySelector('[data-position]').focus()")
        panel.page.key(" ", "Space", " ")
    until(panel.rests)
    assert panel.run.joints()[0] < 0.5
    assert panel.page.run("document.querySelector('#execute').disabled"), "Space has pressed no other button"


def test_after_a_stop_the_page_says_what_has_stopped_by_whom_and_what_to_press_next(panel: Panel) -> None:
    """Oracle: GET /jobs has who asked for the motion that was stopped, and the share of its path."""
    slowly(panel)
    rows = (
        "[...document.querySelectorAll('#log li[data-type=stop]')].filter((each) => each.told.time > pressed)"
    )
    panel.page.run("cobotPanel.log.stop = null, window.pressed = new Date().toISOString()")
    panel.page.click("#stop")
    until(panel.rests)
    panel.until("!document.querySelector('#halt').hidden")
    panel.until("document.querySelector('#halt-what').innerText.startsWith('The motion has ended')")
    assert panel.text("#halt-who").startswith("Stopped by you at ")
    assert "press Execute" in panel.text("#halt-next")
    panel.until("document.querySelector('#job').innerText.startsWith('Stopped')")
    newest = httpx.get(f"{panel.run.url}/jobs?limit=1", timeout=WAIT_S).json()["jobs"][0]
    assert panel.text("#job-error") == (
        f"The arm came to rest after {round(100 * newest['progress'])} % of the path."
    )
    panel.until(f"{rows}.length === 2")
    shown = panel.page.run(f"{rows}.map((each) => each.hasAttribute('data-detail'))")
    assert sorted(shown) == [False, True], "one press is one line, although it is sent in two ways"
    said = panel.page.run("document.querySelector('#log').textContent")
    assert "/stop" not in said, "no words of REST"
    assert "WebSocket" not in said
    panel.page.click("#halt-close")
    assert panel.page.run("document.querySelector('#halt').hidden")
    panel.page.run("cobotPanel.halt.clear()")
    httpx.post(f"{panel.run.url}/stop", timeout=WAIT_S).raise_for_status()
    panel.until("document.querySelector('#halt-what').innerText.startsWith('Nothing was running')")
    slowly(panel)
    panel.until("document.querySelector('#halt').hidden")
    httpx.post(f"{panel.run.url}/stop", timeout=WAIT_S).raise_for_status()
    panel.until("document.querySelector('#halt-who').innerText.includes('by an unnamed client')")
    panel.page.run("cobotPanel.halt.clear()")
    heard = {"type": "stop", "time": "2026-01-01T00:00:00Z", "data": {"by": "cobot", "cause": "gripper"}}
    panel.page.run(f"cobotPanel.halt.hear({json.dumps(heard)})")
    assert panel.text("#halt-who").endswith(" by cobot. The gripper has lost its object.")
    panel.page.run("cobotPanel.halt.clear()")


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (
            {"code": "motion_timeout"},
            "The arm did not arrive in time. The arm came to rest after 40 % of the path.",
        ),
        ({"code": "execution", "detail": "joint2 left its tolerance"}, "J2 left its tolerance"),
    ],
)
def test_a_motion_that_ends_on_its_way_without_a_stop_says_why(
    panel: Panel, error: dict[str, str], text: str
) -> None:
    """Oracle: docs/conventions.md: such errors have a share of the path, and no cause."""
    asked = json.dumps({**error, "details": {"share": 0.4}})
    assert panel.page.run(f"import('/panel/reasons.js').then((all) => all.reasonOf({asked}))") == text


def reason(code: str, values: list[float | None], unit: str = "", of: str = "") -> dict[str, Any]:
    return {"reason_code": code, "reason_of": of, "reason_values": values, "reason_unit": unit}


REASONS: list[tuple[dict[str, Any], str]] = [
    (reason("gripper_nothing", [0.042, None], "m"), "The gripper holds nothing: no part was there."),
    (
        reason("gripper_size", [0.042, 0.05], "m"),
        "The gripper holds something that is 42 mm wide, expected 50 mm.",
    ),
    (
        reason("gripper_blocked", [0.03, 0.0], "m"),
        "The fingers stopped at 30 mm instead of 0.0 mm: something is in their way.",
    ),
    (reason("gripper_slow", [None, 30.0], "s"), "The gripper has not finished within 30 s."),
    (
        reason("gripper_device", [None, None], of="robotiq"),
        "The gripper has a problem: no answer from the gripper",
    ),
    ({"code": "stopped", "cause": "gripper", "by": ""}, "The gripper has lost its object."),
    ({"code": "stopped", "cause": "move_before", "by": ""}, "The motion before it in the queue failed."),
    (reason("no_points", [None, 0.2], "s"), "No new point arrived within 0.2 s."),
    (
        reason("input_not_met", [None, 5.0], "s", "part"),
        "The input part did not get its value within 5.0 s. Check the sensor.",
    ),
    ({"code": "condition_not_met"}, "The motion ended, but its condition was not met."),
    (
        reason("joint_limit", [-2.09, -2.1], "rad", "joint4"),
        "J4 is at -120°, its limit is -120°. Move it the other way.",
    ),
]
"""Details of a step's error, and what the page says of it."""


@pytest.mark.parametrize(("details", "text"), REASONS)
def test_a_program_that_fails_says_at_which_step_and_why(
    panel: Panel, details: dict[str, Any], text: str
) -> None:
    """Oracle: the tables of codes in docs/conventions.md; what they mean to a person is in the texts."""
    error = {
        "code": "execution",
        "detail": "a.json: iteration 1/1, step 4 of 12: no answer from the gripper",
        "details": {
            "code": "execution", "step": "4", "message": "no answer from the gripper", **details,
        },
    }  # fmt: skip
    found = panel.page.run(f"import('/panel/reasons.js').then((all) => all.reasonOf({json.dumps(error)}))")
    assert found.startswith(f"Step 4: {text}")
    assert ".json" not in found


def test_a_sentence_of_the_service_is_introduced_in_the_language_of_the_panel(panel: Panel) -> None:
    """Also one without words of its own: what it is about is said in each language, the facts follow."""
    said = json.dumps({"code": "not_found", "detail": "there is no object 'box'"})
    moving = json.dumps({"code": "conflict", "detail": "the arm is moving", "details": {"cause": "moving"}})
    reasons = f"import('/panel/reasons.js').then((all) => [all.reasonOf({said}), all.reasonOf({moving})])"
    found = {}
    for language in ("de", "zh", "en"):
        set_to(panel, "#language", language)
        found[language] = panel.page.run(reasons)
    assert found["en"][0] == "there is no object 'box'"
    assert found["de"][0] == "Das gibt es nicht: there is no object 'box'"
    assert found["zh"][0] == "未找到：there is no object 'box'"
    assert "the arm is moving" not in " ".join(each[1] for each in found.values())


def test_a_limit_of_a_step_is_named_with_its_values(panel: Panel) -> None:
    check = {
        "check": "limit", "quantity": "position", "value": 3.0, "limit": 2.9, "by": 0.1, "unit": "rad",
        "share": None, "of": ["joint1"],
    }  # fmt: skip
    error = {
        "code": "execution", "detail": "a.json: step 2 of 3: ...",
        "details": {"code": "limit", "step": "2", "message": "..."},
        "explain": {"checks": [check], "works": []},
    }  # fmt: skip
    found = panel.page.run(f"import('/panel/reasons.js').then((all) => all.reasonOf({json.dumps(error)}))")
    assert found == "Step 2: J1: 172° is beyond the limit of 166°."


@pytest.mark.parametrize("menu", ["override-part", "control-part", "program-menu", "add"])
def test_escape_closes_a_menu_and_stops_all_the_same(panel: Panel, menu: str) -> None:
    slowly(panel)
    panel.page.reveal(f"#{menu} > summary")
    panel.page.click(f"#{menu} > summary")
    panel.until(f"document.querySelector('#{menu}').open")
    panel.page.key("Escape", "Escape")
    panel.until(f"!document.querySelector('#{menu}').open")
    until(panel.rests)
    assert panel.run.joints()[0] < 0.5
    panel.page.click(f"#{menu} > summary")
    panel.until(f"document.querySelector('#{menu}').open")
    panel.page.click("#mode")
    panel.until(f"!document.querySelector('#{menu}').open")
    panel.page.click("#tab-move")


def test_a_space_in_a_text_field_is_a_space(panel: Panel) -> None:
    pressed = panel.page.run("document.querySelector('#stop').dataset.pressed ?? '0'")
    panel.page.run("document.querySelector('#token-form').hidden = false")
    panel.page.click("#token")
    panel.page.key(" ", "Space", " ")
    assert panel.page.run("document.querySelector('#token').value") == " "
    assert panel.page.run("document.querySelector('#stop').dataset.pressed ?? '0'") == pressed
    panel.page.run("document.querySelector('#token').value = ''")
    panel.page.run("document.querySelector('#token-form').hidden = true")


def test_a_wrong_token_is_told(panel: Panel) -> None:
    try:
        panel.page.run("document.querySelector('#token-form').hidden = false")
        panel.page.write("#token", "wrong")
        panel.page.click("#use-token")
        panel.until("document.querySelector('#token-why')?.innerText.includes('token')")
    finally:
        panel.page.run("sessionStorage.clear()")
        panel.load()


def test_after_an_estop_a_banner_says_why_and_the_way_out(panel: Panel) -> None:
    with StreamClient(panel.run.url) as client:
        client.session(inner_control_hz=50)
        client.send("estop")
        panel.until("!document.querySelector('#banner').hidden")
    assert "Emergency stop" in panel.text("#banner")
    reason = panel.run.health()["robot"]["reason"]  # type: ignore[index]
    assert panel.page.run("document.querySelector('#banner-cause').title") == reason
    assert panel.text("#banner-reason") == ""
    assert panel.text("#banner-cause") == "A person or a program requested an emergency stop."
    assert "Reset" in panel.text("#banner-way")
    for disabled in ("#execute", "[data-jog]"):
        panel.until(f"document.querySelector('{disabled}').title === 'Press Reset first.'")
        assert panel.page.run(f"document.querySelector('{disabled}').disabled")
    assert panel.text("#jog-why") == "Press Reset first."
    panel.page.click("#reset")
    panel.until("document.querySelector('#banner').hidden")
    panel.until("!document.querySelector('[data-jog]').disabled")
    assert "Hold" in panel.text("#jog-why"), "what is no longer true is not shown"
    until(panel.rests)


def test_a_stop_that_one_way_does_not_take_goes_the_other_and_one_that_fails_is_told(panel: Panel) -> None:
    slowly(panel)
    why = "document.querySelector('#stop-why')"
    try:
        panel.page.block("*/stop")
        panel.page.click("#stop")
        until(panel.rests)
        panel.until(f"{why}.hidden")
        panel.page.run("cobotPanel.stream.send = () => false")
        panel.page.click("#stop")
        panel.until(f"!{why}.hidden")
        assert panel.page.run(f"{why}.innerText.split('\\n').join(' ')") == (
            "STOP is not confirmed. Use the robot's own emergency stop. The service cannot be reached."
        )
        set_to(panel, "#language", "de")
        assert panel.page.run(f"{why}.innerText").endswith("Der Dienst ist nicht erreichbar.")
        set_to(panel, "#language", "en")
        panel.page.run("cobotPanel.status.connected(true)")
        assert not panel.page.run(f"{why}.hidden"), "nothing else writes over it"
        panel.page.run("cobotPanel.halt.clear()")
        httpx.post(f"{panel.run.url}/stop", timeout=WAIT_S).raise_for_status()
        panel.until("!document.querySelector('#halt').hidden")
        assert "by an unnamed client" in panel.text("#halt-who"), "not the press that nobody has heard"
    finally:
        panel.page.block()
        panel.page.run("delete cobotPanel.stream.send")
    panel.page.click("#stop")
    panel.until(f"{why}.hidden")
    forget(panel, "Failed to load")
