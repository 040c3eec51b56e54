"""The handles at the TCP are dragged with the mouse; the motion is planned, shown, and run on request."""

from __future__ import annotations

from typing import Any

import httpx
import numpy as np
from cobot_run import WAIT_S, until

from panel.page import HOME, SIZE, Panel, forget, is_at, set_to, size, tcp_at

RING_RAD = 0.8
"""Where a ring is away from the arrows."""
PLAN = "document.querySelector('#plan').innerText"


def on_screen(panel: Panel, axis: int, *, turns: bool, along: float) -> tuple[float, float]:
    """Where a handle is: of an arrow the share of its length, of a ring the angle, rad."""
    point = (
        "place.set(0, 0, 0).setComponent(axis, along)"
        if not turns
        else "place.set(0, 0, 0).setComponent((axis + 1) % 3, 0.7 * Math.cos(along))"
        ".setComponent((axis + 2) % 3, 0.7 * Math.sin(along))"
    )
    found = panel.page.run(
        "((axis, along) => { const { view } = cobotPanel; const { root } = view.handles;"
        "view.handles.fit(view.camera);"
        f"const place = root.position.clone(); {point}; root.localToWorld(place).project(view.camera);"
        "const box = view.renderer.domElement.getBoundingClientRect();"
        "return [box.left + 0.5 * box.width * (1 + place.x), box.top + 0.5 * box.height * (1 - place.y)] })"
        f"({axis}, {along})"
    )
    return float(found[0]), float(found[1])


def press(panel: Panel, place: tuple[float, float]) -> None:
    panel.page.mouse("mousePressed", place)
    panel.until("cobotPanel.drag.pointer !== null")


def move(panel: Panel, place: tuple[float, float]) -> None:
    x, y = place
    panel.page.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1)


def between(begin: tuple[float, float], end: tuple[float, float], share: float) -> tuple[float, float]:
    x, y = (float(one + share * (other - one)) for one, other in zip(begin, end, strict=True))
    return x, y


def target(panel: Panel) -> dict[str, Any]:
    return dict(panel.page.run("cobotPanel.drag.target"))


def shown_tcp(panel: Panel) -> list[float]:
    """X, Y, Z as the fields have them, m."""
    values = panel.page.run(
        "[...document.querySelectorAll('#tcp input')].slice(0, 3).map((each) => each.value)"
    )
    return [float(value) / 1000 for value in values]


def ready(panel: Panel) -> None:
    panel.page.mouse("mouseReleased", (0.0, 0.0))
    panel.page.run("cobotPanel.motions.discard()")
    panel.page.click("#view-iso")
    panel.until("cobotPanel.view.handles.root.visible && cobotPanel.drag.target === null")


def test_a_dragged_arrow_is_planned_on_release_and_run_by_enter(panel: Panel) -> None:
    """Oracle: the pose of REST, and where the service has the TCP of the plan."""
    ready(panel)
    set_to(panel, "#motion-speed", "100")
    x, y, z = tcp_at(panel, HOME)
    begin, beyond = (on_screen(panel, 1, turns=False, along=along) for along in (1.0, 1.8))
    press(panel, begin)
    for share in (0.3, 0.6, 1.0):
        move(panel, between(begin, beyond, share))
    dragged = target(panel)
    moved = np.subtract(dragged["position"], (x, y, z))
    assert moved[1] > 0.02
    np.testing.assert_allclose(moved[[0, 2]], 0.0, atol=1e-6, err_msg="along the arrow only")
    np.testing.assert_allclose(shown_tcp(panel), dragged["position"], atol=1e-4)
    assert is_at(panel, HOME), "a drag moves nothing"
    panel.page.mouse("mouseReleased", (0.0, 0.0))
    panel.until("cobotPanel.view.ghost && cobotPanel.motions.plan")
    assert panel.text("#plan").startswith("To the dragged place.")
    goal = panel.page.run("cobotPanel.motions.plan.path.at(-1).position")
    np.testing.assert_allclose(goal, dragged["position"], atol=1e-4)
    np.testing.assert_allclose(shown_tcp(panel), dragged["position"], atol=1e-4)
    assert is_at(panel, HOME), "a plan moves nothing"
    panel.until("document.activeElement.id === 'execute'")
    panel.page.key("Enter", "Enter", "\r")
    panel.until(f"{PLAN} === 'The arm has arrived.'")
    pose = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    np.testing.assert_allclose([pose[axis] for axis in "xyz"], dragged["position"], atol=2e-3)
    panel.until("cobotPanel.drag.target === null && !document.querySelector('[data-aimed]')")


def test_a_dragged_ring_turns_the_target_about_its_axis(panel: Panel) -> None:
    ready(panel)
    set_to(panel, "#jog-frame", "tool")
    try:
        before = panel.page.run("cobotPanel.view.handles.root.quaternion.toArray()")
        press(panel, on_screen(panel, 2, turns=True, along=RING_RAD))
        move(panel, on_screen(panel, 2, turns=True, along=RING_RAD + 0.2))
        move(panel, on_screen(panel, 2, turns=True, along=RING_RAD + 0.4))
        after = target(panel)
        np.testing.assert_allclose(after["position"], tcp_at(panel, HOME), atol=1e-6)
        x, y, z, w = before
        i, j, k, r = after["quaternion"]
        turned = 2 * np.arccos(min(1.0, abs(np.dot((x, y, z, w), (i, j, k, r)))))
        assert 0.1 < turned < 1.0
        panel.page.key("Escape", "Escape")
        panel.until("cobotPanel.drag.target === null")
        assert "STOP" in panel.text("#plan")
        panel.page.mouse("mouseReleased", (0.0, 0.0))
        assert panel.page.run("cobotPanel.motions.plan === null")
    finally:
        set_to(panel, "#jog-frame", "base")
        panel.until("document.querySelector('#stop').dataset.confirmed === undefined")


def test_a_connection_that_is_lost_in_a_drag_drops_it(panel: Panel) -> None:
    ready(panel)
    x = tcp_at(panel, HOME)[0]
    plans = len(httpx.get(f"{panel.run.url}/robot/plans", timeout=WAIT_S).json())
    press(panel, on_screen(panel, 0, turns=False, along=1.0))
    move(panel, on_screen(panel, 0, turns=False, along=1.3))
    assert target(panel)["position"][0] > x + 0.01
    panel.page.run("cobotPanel.stream.socket.close()")
    panel.until(f"{PLAN}.startsWith('The connection was lost while you dragged.')")
    panel.page.mouse("mouseReleased", (0.0, 0.0))
    assert panel.page.run("cobotPanel.drag.target === null && cobotPanel.motions.plan === null")
    assert is_at(panel, HOME)
    assert len(httpx.get(f"{panel.run.url}/robot/plans", timeout=WAIT_S).json()) == plans
    panel.until("cobotPanel.stream.ready && cobotPanel.state")
    panel.page.block("*/plan/pose")
    press(panel, on_screen(panel, 0, turns=False, along=1.0))
    move(panel, on_screen(panel, 0, turns=False, along=1.2))
    panel.page.mouse("mouseReleased", (0.0, 0.0))
    panel.until(f"{PLAN}.includes('/plan/pose')")
    panel.page.block()
    assert panel.page.run("cobotPanel.drag.target === null && cobotPanel.motions.plan === null")
    assert is_at(panel, HOME)
    forget(panel, "ERR_")


def test_a_dragged_place_out_of_reach_is_explained_and_a_click_changes_nothing(
    panel: Panel,
) -> None:
    ready(panel)
    press(panel, on_screen(panel, 0, turns=False, along=1.0))
    panel.page.mouse("mouseReleased", on_screen(panel, 0, turns=False, along=1.0))
    assert panel.page.run("cobotPanel.drag.target === null && cobotPanel.motions.plan === null")
    begin = on_screen(panel, 0, turns=False, along=1.0)
    press(panel, begin)
    end = between(begin, on_screen(panel, 0, turns=False, along=1.4), 8.0)
    move(panel, end)
    panel.page.mouse("mouseReleased", end)
    panel.until("cobotPanel.drag.target === null")
    panel.until(f"{PLAN} !== '' && !{PLAN}.startsWith('Planning')")
    assert panel.page.run("cobotPanel.motions.plan === null")
    assert is_at(panel, HOME)
    forget(panel, "422")


def test_the_handles_are_dragged_by_touch_and_can_be_hidden(panel: Panel) -> None:
    size(panel, 390, 844, mobile=True)
    try:
        ready(panel)
        panel.page.run(
            "document.querySelector('#view').scrollIntoView({block: 'center', behavior: 'instant'})"
        )
        first = on_screen(panel, 0, turns=False, along=0.9)
        last = on_screen(panel, 0, turns=False, along=1.3)
        for kind, place in (("touchStart", first), ("touchMove", last), ("touchMove", last)):
            points = [{"x": place[0], "y": place[1]}]
            panel.page.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        assert target(panel)["position"][0] > tcp_at(panel, HOME)[0] + 0.01
        panel.page.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        panel.until("cobotPanel.motions.plan")
        panel.page.click("#discard")
        panel.until("cobotPanel.drag.target === null")
        panel.page.click("#view-drag")
        assert panel.page.run("!cobotPanel.view.handles.root.visible")
        panel.page.click("#view-drag")
        until(lambda: panel.page.run("cobotPanel.view.handles.root.visible"))
    finally:
        size(panel, *SIZE)
