"""Joints and TCP are moved by holding a button, and step by step."""

from __future__ import annotations

import json

import httpx
import numpy as np
from cobot_run import WAIT_S, until

from panel.page import (
    HOME,
    MOVED_RAD,
    SIZE,
    Panel,
    away,
    button,
    commanded,
    is_at,
    newest,
    set_to,
    size,
    tcp_at,
)

HOME_X_M = 0.4


def test_a_joint_moves_while_its_button_is_held(panel: Panel) -> None:
    """The state is called jogging until the arm is at rest, even if the own stream has ended before."""
    plus = button("joint", 0, 1)
    panel.hold(plus, away(panel, 0, 1, 0.0))
    assert panel.mode() in ("JOINT_IMPEDANCE", "STOPPING", "HOLD")
    ended = panel.page.run(
        "((status) => { const own = status.ownStream; status.show({mode: 'JOINT_IMPEDANCE'});"
        "status.ownStream = () => null; status.show({mode: 'JOINT_IMPEDANCE'});"
        "status.ownStream = own; return document.querySelector('#mode').textContent; })(cobotPanel.status)"
    )
    assert ended == "Jogging"
    panel.let_go(plus)
    where = panel.stays()
    assert where[0] > MOVED_RAD
    np.testing.assert_allclose(where[1:], HOME[1:], atol=5e-3)


def test_a_page_that_loses_the_focus_lets_go(panel: Panel) -> None:
    minus = button("joint", 0, -1)
    panel.hold(minus, away(panel, 0, -1, 0.0))
    panel.page.run("dispatchEvent(new Event('blur'))")
    panel.stays()
    assert not panel.page.run("!!cobotPanel.jog.held")
    panel.let_go(minus)


def test_without_a_connection_nothing_is_held_and_the_page_says_why(panel: Panel) -> None:
    """The connection is lost before the press, and while the button is held."""
    plus = button("joint", 0, 1)
    interrupted = "connection was interrupted"
    panel.page.run("cobotPanel.stream.socket.close()")
    panel.page.click(plus)
    assert not panel.page.run("!!cobotPanel.jog.held")
    assert interrupted in panel.text("#jog-why")
    panel.until("cobotPanel.stream.ready && document.querySelector('#connection').innerText === 'connected'")
    panel.stays()
    assert is_at(panel, HOME)
    panel.hold(plus, away(panel, 0, 1, 0.0))
    panel.page.run("cobotPanel.stream.socket.close()")
    panel.until("!cobotPanel.jog.held")
    panel.let_go(plus)
    assert interrupted in panel.text("#jog-why")
    panel.until("cobotPanel.stream.ready && document.querySelector('#connection').innerText === 'connected'")
    panel.stays()
    panel.page.click("#jog-how label:nth-child(1)")  # already chosen: no change
    assert interrupted in panel.text("#jog-why"), "a new connection is no reason to forget it"


def test_the_reason_of_a_refused_press_stays_after_the_release(panel: Panel) -> None:
    """The service repeats its refusal while the button is held, without the error."""
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as other:
        taken = other.post("/robot/control", json={})
        taken.raise_for_status()
        try:
            place = panel.page.place(button("joint", 0, 1))
            panel.page.run(COUNT_ANSWERS)
            panel.page.mouse("mousePressed", place)
            panel.until("cobotPanel.jog.answers > 1")
            why = panel.text("#jog-why")
            assert "127.0.0.1" in why, why
            panel.page.mouse("mouseReleased", place)
            assert panel.text("#jog-why") == why
        finally:
            panel.page.run("delete cobotPanel.jog.hear")
            headers = {"X-Control-Token": taken.json()["token"]}
            other.request("DELETE", "/robot/control", headers=headers).raise_for_status()


def test_what_blocks_the_arm_is_said_until_the_next_press(panel: Panel) -> None:
    """Oracle: the joints by REST, and the scene with a box 50 mm below the TCP."""
    x, y, z = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"].values()
    box = {"shape": "box", "size": [0.1, 0.1, 0.1], "x": x, "y": y, "z": z - 0.1}
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        http.post("/scene", json={"objects": {"box": box}}).raise_for_status()
        try:
            set_to(panel, "#motion-speed", "50")
            place = panel.page.place(button("tcp", 2, -1))
            panel.page.mouse("mousePressed", place)
            shown = "document.querySelector('#jog-why').innerText"
            panel.until(f"{shown}.startsWith('No further this way: Only ') && {shown}.includes('box')")
            panel.page.mouse("mouseReleased", place)
            panel.until("!cobotPanel.jog.held")
            assert panel.text("#jog-why").startswith("No further this way: ")
            place = panel.page.place(button("tcp", 2, 1))
            panel.page.mouse("mousePressed", place)
            panel.until(f"{shown} === 'The arm moves.'")
            panel.page.mouse("mouseReleased", place)
            panel.until(f"{shown}.startsWith('Hold ')")
        finally:
            until(panel.rests)
            http.post("/scene", json={"clear": True}).raise_for_status()
            panel.run.go_home()


COUNT_ANSWERS = """(jog => {
    jog.answers = 0;
    jog.hear = (frame) => {
        jog.answers += frame.type === "jog";
        Object.getPrototypeOf(jog).hear.call(jog, frame);
    };
})(cobotPanel.jog)"""
"""Count the answers to the frames of a press."""


def test_a_page_that_falls_silent_is_stopped_by_the_service(panel: Panel) -> None:
    plus = button("joint", 6, 1)
    panel.hold(plus, away(panel, 6, 1, 0.0))
    panel.page.run("clearInterval(cobotPanel.jog.timer)")
    panel.stays()
    panel.let_go(plus)


def test_the_tcp_moves_along_the_axis_that_is_held(panel: Panel) -> None:
    def height() -> float:
        return float(httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]["z"])

    before, down = height(), button("tcp", 2, -1)
    panel.hold(down, lambda: height() < before - 0.01)
    panel.let_go(down)
    panel.stays()
    tool = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()
    assert abs(tool["position"]["y"]) < 5e-3


def test_enter_holds_a_button_too(panel: Panel) -> None:
    panel.page.run(f"document.querySelector({json.dumps(button('joint', 5, -1))}).focus()")
    down = {"key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13}

    def pressed_and_moved() -> bool:
        if not panel.page.run("!!cobotPanel.jog.held") or "Release the button" in panel.text("#jog-why"):
            panel.page.ask("Input.dispatchKeyEvent", type="keyUp", **down)
            until(panel.rests)
            panel.page.ask("Input.dispatchKeyEvent", type="rawKeyDown", **down)
        return away(panel, 5, -1, HOME[5])()

    until(pressed_and_moved)
    panel.page.ask("Input.dispatchKeyEvent", type="keyUp", **down)
    panel.stays()


def step(panel: Panel, selector: str) -> None:
    """One press, to the end of its motion, as the panel's own state has it too."""
    before = commanded(panel)
    panel.page.click(selector)
    panel.until(
        f"!cobotPanel.jog.pending && cobotPanel.state?.commanded_position.some((v, i) => v !== {before}[i])"
    )
    until(panel.rests)
    time_s = newest(panel, "robot_time_s")
    panel.until(f"cobotPanel.state?.robot_time_s > {time_s} + 0.1")


def test_steps_move_by_just_that_and_do_not_add_up_what_is_measured_beside_it(panel: Panel) -> None:
    """Oracle: the sum of the steps; for the TCP the end of what the service plans to these joints."""
    panel.page.click("#jog-how label:nth-child(3)")
    try:
        for count in (1, 2):
            step(panel, button("joint", 0, 1))
            np.testing.assert_allclose(commanded(panel)[0], np.radians(2.0 * count), atol=1e-9)
        before = tcp_at(panel, commanded(panel))
        step(panel, button("tcp", 0, -1))
        after = tcp_at(panel, commanded(panel))
        np.testing.assert_allclose(np.subtract(after, before), [-0.01, 0.0, 0.0], atol=1e-6)
        set_to(panel, "#jog-frame", "tool")  # whose z looks down here
        step(panel, button("tcp", 2, 1))
        lower = tcp_at(panel, commanded(panel))
        np.testing.assert_allclose(np.subtract(lower, after), [0.0, 0.0, -0.01], atol=1e-4)
    finally:
        for nth in (2, 4, 1):
            panel.page.click(f"#jog-how label:nth-child({nth})")
        set_to(panel, "#jog-frame", "base")


def test_a_held_button_asks_for_the_speed_that_the_slider_says_and_the_arm_moves(panel: Panel) -> None:
    """The one speed of the panel, and the override that scales it. Oracle: the limit of the joint, and the
    override of the service. That the arm reaches what is asked for is tested where the clock is virtual, in
    tests/app/services/streaming/test_jog.py: a busy computer lets go before that.
    """
    limit = panel.page.run("cobotPanel.readouts.ranges[0].max_velocity")
    set_to(panel, "#motion-speed", "20")
    set_to(panel, "#override-set", "50")
    panel.until("document.querySelector('#motion-speed-shown').innerText === '20 % × 50 %'")
    plus = button("joint", 0, 1)
    panel.page.run(
        "(s => { s.send = (frame) => {"
        " if (frame.joints) s.asked = frame.joints;"
        " return Object.getPrototypeOf(s).send.call(s, frame); }; })(cobotPanel.stream)"
    )
    before = panel.run.joints()[0]
    try:
        panel.hold(plus, away(panel, 0, 1, before))
        asked = panel.page.run("cobotPanel.stream.asked")
    finally:
        panel.let_go(plus)
        panel.page.run("delete cobotPanel.stream.send")
        set_to(panel, "#override-set", "100")
        set_to(panel, "#motion-speed", "10")
    np.testing.assert_allclose(asked, [0.2 * 0.5 * limit, *[0.0] * 6], rtol=1e-12)
    panel.until("document.querySelector('#motion-speed-shown').innerText === '10 %'")
    panel.stays()


def test_at_an_override_of_zero_nothing_is_jogged_and_the_page_says_why(panel: Panel) -> None:
    try:
        set_to(panel, "#override-set", "0")
        override = f"{panel.run.url}/robot/speed_override"
        until(lambda: httpx.get(override, timeout=WAIT_S).json()["fraction"] == 0.0)
        panel.until("!cobotPanel.job.sending && cobotPanel.speed.override === 0")
        panel.page.click(button("joint", 0, 1))
        assert "override in the head is 0 %" in panel.text("#jog-why")
    finally:
        set_to(panel, "#override-set", "100")
    panel.stays()


def test_the_hint_says_what_a_press_does(panel: Panel) -> None:
    for nth, hint in ((2, "0.5° or 1 mm"), (4, "10° or 50 mm"), (1, "Hold − or +")):
        panel.page.click(f"#jog-how label:nth-child({nth})")
        assert hint in panel.text("#jog-why")


def test_on_a_phone_the_speed_is_next_to_the_jog_buttons_and_is_the_same(panel: Panel) -> None:
    size(panel, 390, 844, mobile=True)
    try:
        assert panel.page.run("document.querySelector('#motion-speed').offsetParent === null")
        set_to(panel, "#jog-speed", "25")
        assert panel.page.run("cobotPanel.speed.share") == 0.25
        panel.until("document.querySelector('#jog-speed-shown').innerText === '25 %'")
        set_to(panel, "#jog-speed", "10")
    finally:
        size(panel, *SIZE)
    assert panel.page.run("document.querySelector('#motion-speed').value") == "10"


def test_a_finger_holds_a_button_too_and_no_step_is_taken_by_holding_nothing(panel: Panel) -> None:
    plus = button("joint", 0, 1)
    panel.page.touch(plus)

    def held_and_moved() -> bool:
        if not panel.page.run("!!cobotPanel.jog.held"):
            panel.page.lift()
            until(panel.rests)
            panel.page.touch(plus)
        return away(panel, 0, 1, 0.0)()

    try:
        until(held_and_moved)
    finally:
        panel.page.lift()
    panel.until("!cobotPanel.jog.held")
    where = panel.stays()
    panel.page.run(f"document.querySelector({json.dumps(plus)}).click()")  # as a screen reader does
    assert "choose a step size" in panel.text("#jog-why")
    assert is_at(panel, where)


def test_the_arm_is_jogged_up_to_a_wall_and_not_into_it(panel: Panel) -> None:
    """Oracle: where the TCP is, and where the wall."""
    box = {"shape": "box", "size": [0.02, 2.0, 2.0], "x": 0.6, "y": 0.0, "z": 0.6}
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        http.post("/scene", json={"objects": {"wall": box}}).raise_for_status()
        forwards = button("tcp", 0, 1)
        try:
            panel.until("cobotPanel.geometry.bodies.some((each) => each.name === 'wall')")
            panel.until("cobotPanel.view.geometry === cobotPanel.geometry")
            slowed = "/^At [0-9]+ %: .*wall/.test(document.querySelector('#jog-why').innerText)"
            panel.hold(forwards, lambda: bool(panel.page.run(slowed)))
            panel.let_go(forwards)
            panel.stays()
            assert HOME_X_M < http.get("/robot/pose").json()["position"]["x"] < 0.59
        finally:
            panel.let_go(forwards)
            http.post("/scene", json={"clear": True}).raise_for_status()
