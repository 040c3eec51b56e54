"""The tree of steps: each kind of step, its fields, its place, and what is undone."""

from __future__ import annotations

import json
from typing import Any

import httpx
import numpy as np
from cobot_run import WAIT_S

from panel.page import HOME, Panel, drop, set_to
from panel.teaching import STEPS, require_valid, row

KINDS = ("named", "gripper", "set", "wait_for", "wait_s", "repeat", "if", "pallet", "call", "on_error")
NUMBERS = "[...document.querySelectorAll('#steps [data-step]')].map((each) => each.dataset.step)"


def content(panel: Panel) -> dict[str, Any]:
    return dict(panel.page.run(STEPS))


def field(name: str, nth: int = 1) -> str:
    """A field of the step that is chosen; the nth of this name."""
    panel_fields = f"#step-fields [data-field={name}]"
    return panel_fields if nth == 1 else f":nth-child({nth} of {panel_fields})"


def fresh(panel: Panel) -> None:
    panel.page.run("localStorage.clear()")
    panel.load()
    panel.page.click("#tab-program")


def open_steps(panel: Panel, steps: list[dict[str, Any]]) -> None:
    drop(panel, "#steps", "a.json", json.dumps({"steps": steps}))
    panel.until(f"{NUMBERS}.length >= {len(steps)}")


def test_each_kind_of_step_is_added_and_its_fields_change_it(panel: Panel) -> None:
    """Oracle: the published schema, and the runner's own; the values by hand."""
    fresh(panel)
    panel.page.click('[data-add="home"]')
    for kind in KINDS:
        panel.page.click(f'[data-add="{kind}"]')
        panel.until(f"{STEPS}.steps.at(-1).{kind} !== undefined")
    np.testing.assert_allclose(content(panel)["home"]["joints"], HOME, atol=1e-3)

    panel.page.click(row("1"))
    set_to(panel, field("step_position"), "work")
    set_to(panel, "#step-label", "Über <b>Kiste</b> 取料点")
    set_to(panel, field("step_comment"), "slowly")
    assert "<b>Kiste</b>" in panel.text(row("1"))
    assert panel.page.run("document.querySelectorAll('#steps .step-name b b').length") == 0, "markup is text"
    panel.page.click(row("2"))
    set_to(panel, field("step_command"), "move")
    set_to(panel, field("gripper_width"), "40")
    set_to(panel, field("gripper_force"), "20")
    panel.page.click(row("3"))
    set_to(panel, field("step_output"), "lamp")
    set_to(panel, field("step_value"), "number")
    set_to(panel, field("step_number"), "0.5")
    panel.page.click(row("4"))
    set_to(panel, field("step_input"), "pressure")
    set_to(panel, field("step_test"), "above")
    set_to(panel, "#step-fields input[data-field=step_value]", "2.5")
    set_to(panel, field("step_timeout"), "5")
    panel.page.click(row("5"))
    set_to(panel, field("step_duration"), "0.2")
    panel.page.click(row("6"))
    set_to(panel, field("step_count"), "3")
    panel.page.click(row("7"))
    set_to(panel, field("step_input"), "part_there")
    set_to(panel, field("step_test"), "off")
    panel.page.click(row("8"))
    set_to(panel, field("step_frame"), "layer")
    set_to(panel, field("step_places"), "4")
    set_to(panel, field("step_axis"), "400")
    panel.page.click(row("9"))
    set_to(panel, field("step_file"), "fetch.json")
    panel.page.click(row("10"))
    set_to(panel, field("step_retry"), "2")
    panel.page.click(field("step_go_on"))
    for number in ("6", "7", "7.else", "8", "10", "10.run"):
        panel.page.click(f'[data-into="{number}"]')
        panel.page.click('[data-add="wait_s"]')

    found = content(panel)
    steps = found["steps"]
    assert steps[0]["named"] == "work"
    assert (steps[0]["label"], steps[0]["comment"]) == ("Über <b>Kiste</b> 取料点", "slowly")
    assert steps[1] == {"gripper": {"command": "move", "width": 0.04, "force": 20}}
    assert steps[2] == {"set": {"output": "lamp", "value": 0.5}}
    assert steps[3] == {"wait_for": {"input": "pressure", "above": 2.5}, "timeout_s": 5}
    assert steps[4] == {"wait_s": 0.2}
    assert steps[5] == {"repeat": {"count": 3}, "do": [{"wait_s": 1}]}
    assert steps[6] == {
        "if": {"input": "part_there", "is": False},
        "then": [{"wait_s": 1}],
        "else": [{"wait_s": 1}],
    }
    assert (steps[7]["pallet"]["frame"], steps[7]["pallet"]["counts"]) == ("layer", [4, 2])
    assert steps[7]["pallet"]["origin"]["x"] == 0.4
    assert steps[8] == {"call": "fetch.json"}
    assert steps[9] == {
        "on_error": {"retry": 2, "go_on": True, "run": [{"wait_s": 1}]},
        "do": [{"wait_s": 1}],
    }
    require_valid(found)

    open_steps(
        panel, [{"press": {"force": 10, "duration_s": 1}}, {"joints": HOME, "radius": 0.01}, {"joints": HOME}]
    )
    panel.page.click(row("1"))
    set_to(panel, field("step_fields"), '{"press": {"force": 12}}')
    panel.page.click(row("2"))
    set_to(panel, field("step_axis"), "10")
    found = content(panel)["steps"]
    assert found[0] == {"press": {"force": 12}}
    assert abs(found[1]["joints"][0] - np.radians(10)) < 1e-6
    panel.page.click(row("1"))
    panel.page.write(field("step_fields"), '{"call": "x"}')
    assert content(panel)["steps"][0] == {"press": {"force": 12}}, "another kind is rejected"
    fresh(panel)


def test_steps_are_moved_with_buttons_keys_mouse_and_finger(panel: Panel) -> None:
    fresh(panel)
    waits = [{"wait_s": second} for second in (1, 2, 3)]
    open_steps(panel, [*waits, {"repeat": {"count": 2}, "do": [{"wait_s": 4}]}])

    def order() -> str:
        def text(steps: list[dict[str, Any]]) -> str:
            return "".join(str(each.get("wait_s", f"({text(each.get('do', []))})")) for each in steps)

        return text(content(panel)["steps"])

    panel.page.click(row("3"))
    panel.page.click("#step-down")
    assert order() == "12(34)", "into the repeat"
    panel.page.click("#step-down")
    panel.page.click("#step-down")
    assert order() == "12(4)3", "and out of it"
    assert panel.page.run("document.querySelector('#step-down').disabled")
    panel.page.click("#step-up")
    assert order() == "12(43)"
    panel.page.click("#step-copy")
    assert order() == "12(433)"
    panel.page.key("z", "KeyZ", modifiers=2)
    assert order() == "12(43)"
    panel.page.click("#program-redo")
    assert order() == "12(433)"
    panel.page.run(f"document.querySelector('{row('3.3')}').focus()")
    panel.page.key("Delete", "Delete")
    assert order() == "12(43)"
    panel.page.run(f"document.querySelector('{row('2')}').focus()")
    panel.page.key("F2", "F2")
    assert panel.page.run("document.activeElement.id") == "step-label"

    def drag(number: str, to: str, share: float) -> None:
        start = panel.page.place(f'[data-step="{number}"] > .step .grip')
        box = panel.page.run(
            f"document.querySelector('[data-step=\"{to}\"] > .step').getBoundingClientRect().toJSON()"
        )
        end = (start[0], box["top"] + share * box["height"])
        panel.page.mouse("mousePressed", start)
        panel.page.mouse("mouseMoved", end)
        assert panel.page.run("document.querySelectorAll('[data-drop]').length") == 1
        panel.page.mouse("mouseReleased", end)

    drag("1", "3.1", 0.2)
    assert order() == "2(143)"
    drag("2", "1", 0.2)
    assert order() == "(143)2"
    start = panel.page.place('[data-step="1"] > .step .grip')
    inner = panel.page.place('[data-step="1.2"] > .step .grip')
    panel.page.mouse("mousePressed", start)
    panel.page.mouse("mouseMoved", inner)
    assert panel.page.run("document.querySelectorAll('[data-drop]').length") == 0, "not into itself"
    panel.page.mouse("mouseReleased", inner)
    assert order() == "(143)2"
    panel.page.touch('[data-step="2"] > .step .grip')
    x, y = panel.page.place('[data-step="1.1"] > .step .grip')
    panel.page.ask("Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": x, "y": y + 12}])
    panel.page.lift()
    assert order() == "(1243)"
    panel.load()
    assert order() == "(1243)", "the browser has kept it"
    fresh(panel)


def test_a_waypoint_is_gone_to_and_taught_again(panel: Panel) -> None:
    fresh(panel)
    panel.page.click("#teach")
    set_to(panel, "#step-label", "Über Kiste 1")
    assert "mm" in panel.text(row("1", "small"))
    place = [0.2, *HOME[1:]]
    body = {"joints": place, "speed": 1.0}
    assert httpx.post(f"{panel.run.url}/robot/move/joints", json=body, timeout=WAIT_S).json()["success"]
    panel.until("Math.abs(cobotPanel.state?.commanded_position[0] - 0.2) < 1e-4")
    panel.page.click(row("1", ".step_go"))
    panel.until("document.querySelector('#plan').innerText.startsWith('To Über Kiste 1.')")
    np.testing.assert_allclose(panel.page.run("cobotPanel.view.plan.path.at(-1).joints"), HOME, atol=1e-4)
    panel.page.click("#discard")
    panel.page.click(row("1", ".step_teach"))
    np.testing.assert_allclose(content(panel)["steps"][0]["joints"], place, atol=1e-4)
    set_to(panel, field("step_way"), "lin")
    pose = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    taught = content(panel)["steps"][0]
    np.testing.assert_allclose([taught[axis] for axis in "xyz"], [pose[axis] for axis in "xyz"], atol=2e-3)
    panel.page.click("#program-undo")
    assert content(panel)["steps"][0]["label"] == "Über Kiste 1"
    assert "joints" in content(panel)["steps"][0]

    inner = {"x": 0, "y": 0, "z": -0.05, "frame_id": "place"}
    pallet = {"origin": {"x": 0.45, "y": -0.1, "z": 0.4}, "counts": [2], "offsets": [{"x": 0.05}]}
    open_steps(panel, [{"pallet": pallet, "do": [inner]}])
    panel.page.click(row("1.1", ".step_go"))
    panel.until("document.querySelector('#program-why').innerText.includes('a place of a pallet')")
    panel.page.click(row("1", ".step_teach"))
    origin = content(panel)["steps"][0]["pallet"]["origin"]
    np.testing.assert_allclose([origin[axis] for axis in "xyz"], [pose[axis] for axis in "xyz"], atol=2e-3)
    fresh(panel)


def test_a_text_is_edited_and_a_mistake_in_it_loses_nothing(panel: Panel) -> None:
    fresh(panel)
    open_steps(panel, [{"wait_s": 1}])
    panel.page.click("label:has(> #view-text)")
    wrong = '{"steps": [{"wait_s": 2},]}'
    set_to(panel, "#program-text", wrong)
    panel.until("document.querySelector('#text-why').innerText.includes('not valid JSON')")
    panel.page.click("label:has(> #view-steps)")
    assert panel.text("#step-fields") == "This program can only be edited as text."
    panel.load()
    panel.page.click("label:has(> #view-text)")
    assert panel.page.run("document.querySelector('#program-text').value") == wrong
    panel.page.click("label:has(> #view-file)")
    panel.page.click("label:has(> #view-text)")
    set_to(panel, "#program-text", wrong.replace(",]", "]"))
    panel.page.click("label:has(> #view-steps)")
    panel.until(f"{NUMBERS}.length === 1")
    assert "2 s" in panel.text(row("1"))
    strange = {"steps": [{"do": "nothing"}, {"repeat": {}, "do": 3}]}
    set_to(panel, "#program-text", json.dumps(strange))
    panel.until("document.querySelector('#preview').disabled")
    fresh(panel)
