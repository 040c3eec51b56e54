"""What the panel shows of an arm that stands still, of a real one, and of one that says nothing."""

from __future__ import annotations

import json
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, until
from panel_arm import fault_file

from panel.page import (
    SIZE,
    Panel,
    forget,
    opened_card,
    set_to,
    size,
    slowly,
)


def test_a_person_is_asked_once_for_a_name_and_others_see_it(panel: Panel) -> None:
    control = f"{panel.run.url}/robot/control"
    try:
        panel.page.run("sessionStorage.setItem('askName', '1')")
        panel.page.run("localStorage.removeItem('cobot.name')")
        panel.load()
        panel.until("document.querySelector('#name-form').checkVisibility()")
        assert panel.page.run("document.documentElement.scrollHeight <= innerHeight")
        panel.page.click("#no-name")
        assert not panel.page.run("document.querySelector('#name-form').checkVisibility()")
        panel.load()
        assert not panel.page.run("document.querySelector('#name-form').checkVisibility()"), "asked once"
        panel.page.run("localStorage.removeItem('cobot.name')")
        panel.load()
        panel.page.write("#person", "<b>Jürgen</b> 李")
        panel.page.click("#use-name")
        panel.until("cobotPanel.stream.ready")
        panel.page.click("#take")
        panel.until("document.querySelector('#control').innerText === 'You'")
        assert httpx.get(control, timeout=WAIT_S).json()["holder"] == '"<b>Jürgen</b> 李"'
        panel.page.run("cobotPanel.api.control = ''")  # as another page sees it
        panel.page.run("cobotPanel.status.look()")
        panel.until("""document.querySelector('#control').innerText === '<b>Jürgen</b> 李'""")
        panel.page.run("cobotPanel.stream.send({ type: 'release' })")
        until(lambda: not httpx.get(control, timeout=WAIT_S).json()["held"])
    finally:
        panel.page.run("sessionStorage.removeItem('askName')")
        panel.page.run("localStorage.removeItem('cobot.name')")
        panel.load()


def test_a_new_user_is_guided_once_and_whenever_they_ask(panel: Panel) -> None:
    """Each mark is at what the text speaks of, and the text lies over no control."""
    marked = "document.querySelector('[data-marked]')"
    over = f"""(() => {{
        const place = (each) => each.getBoundingClientRect();
        const [card, at] = [place(document.querySelector('#guide')), place({marked})];
        const beside = card.right < at.left || at.right < card.left;
        return !beside && card.bottom >= at.top && at.bottom >= card.top && {marked}.id !== 'picture';
    }})()"""
    try:
        panel.page.run("sessionStorage.setItem('askName', '1')")
        panel.page.run("localStorage.clear()")
        panel.load()
        panel.page.click("#no-name")
        for number, target in enumerate(("picture", "stop", "joints", "positions", "tab-program"), 1):
            panel.until(f"{marked}?.id === '{target}'")
            assert panel.text("#guide-title").startswith(f"{number} / 5")
            assert not panel.page.run(over)
            panel.page.click("#guide-next")
        panel.until("document.querySelector('#guide').hidden")
        panel.load()
        panel.until("cobotPanel.stream.ready")
        assert panel.page.run(
            "document.querySelector('#guide').hidden && !document.querySelector('[data-marked]')"
        )
        panel.page.click("#guide-again")
        panel.until("document.querySelector('#page-move').checkVisibility()")
        assert "SIMULATION" in panel.text("#guide-text")
        panel.page.click("#guide-skip")
        panel.until("document.querySelector('#guide').hidden")
    finally:
        panel.page.run("sessionStorage.removeItem('askName')")
        panel.load()


UNDER_NOTICES = """(() => {
    const notices = document.querySelector("#notices");
    const content = document.querySelector("#content")?.getBoundingClientRect();
    const covered = (control) => {
        const { left, width, top, bottom } = control.getBoundingClientRect();
        const clip = content?.height && control.closest("#content") ? content : { top: 0, bottom: 1e4 };
        const [first, last] = [Math.max(top, clip.top) + 1, Math.min(bottom, clip.bottom) - 1];
        const places = first < last ? [first, 0.5 * (first + last), last] : [];
        return places.some((y) => notices.contains(document.elementFromPoint(left + 0.5 * width, y)));
    };
    return [...document.querySelectorAll("button, input, select, summary, a[href]")]
        .filter((each) => each.checkVisibility() && !notices.contains(each) && covered(each))
        .map((each) => each.id || each.outerHTML);
})()"""
"""The controls that a notice covers, in the part of the page that is scrolled to."""


@pytest.mark.parametrize(("width", "height"), [SIZE, (1024, 768), (800, 600), (390, 844)])
def test_notices_cover_no_control_and_each_other_neither(panel: Panel, width: int, height: int) -> None:
    size(panel, width, height)
    try:
        panel.page.click("#guide-again")
        httpx.post(f"{panel.run.url}/stop", timeout=WAIT_S).raise_for_status()
        panel.until("!document.querySelector('#halt').hidden")
        for number in range(1, 6):
            assert panel.text("#guide-title").startswith(f"{number} / 5")
            assert panel.page.run(UNDER_NOTICES) == []
            panel.page.click("#guide-next")
        assert panel.page.run("document.querySelector('#guide').hidden")
        panel.page.click("#halt-close")
        assert panel.page.run("document.querySelector('#halt').hidden")
        assert panel.page.run("document.documentElement.scrollHeight <= innerHeight")
    finally:
        size(panel, *SIZE)
        panel.load()


def test_it_shows_the_arm_where_it_is_and_asks_nobody_else(panel: Panel) -> None:
    pose = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    until(
        lambda: np.allclose(
            panel.page.run("cobotPanel.view.arm.tcpPosition()"), [pose[k] for k in "xyz"], atol=2e-3
        )
    )
    panel.until("document.querySelector('#mode').dataset.mode === 'HOLD'")
    panel.until("document.querySelector('#control').innerText === 'Free'")
    panel.until("document.querySelector('#cycle').innerText.includes('µs')")
    assert panel.page.run("document.querySelector('#joints .row:nth-child(4) input').value") == "-90.0 °"
    assert panel.page.run("document.querySelector('#tcp .row:nth-child(1) input').value").startswith("40")
    sources = panel.page.run("performance.getEntriesByType('resource').map((entry) => entry.name)")
    assert len(sources) > 10
    assert all(source.startswith(panel.run.url) for source in sources), sources
    painted = panel.page.run("performance.getEntriesByName('first-contentful-paint')[0]?.startTime")
    print(f"first paint after {painted:.0f} ms")


def test_a_simulation_says_nothing_of_itself(panel: Panel) -> None:
    panel.until("cobotPanel.device.told")
    assert panel.page.run("document.querySelector('#device-part').hidden")
    assert panel.page.run("document.querySelector('#contact').hidden")


def test_a_real_robot_is_acknowledged_and_says_how_it_is_and_why_it_has_failed(real: Panel) -> None:
    """Oracle: what that arm says, and REST."""
    acknowledge(real)
    says_how_it_is(real)
    sets_its_outputs(real)
    fails_in_words(real)


def sets_its_outputs(panel: Panel) -> None:
    """By name; what the device reports is shown."""
    opened_card(panel, "io")
    panel.until("document.querySelectorAll('#device-io label').length === 6")
    assert panel.text("#device-io label:nth-of-type(4) b") == "on"
    unknown = [{"name": "N", "kind": "boolean", "direction": "input", "value": None}]
    shown = "document.querySelector('#device-io b').textContent"
    told = f"(cobotPanel.deviceIo.points = {json.dumps(unknown)}, cobotPanel.deviceIo.write(), {shown})"
    assert panel.page.run(told) == "?"  # neither on nor off
    panel.until("document.querySelectorAll('#device-io label').length === 6")
    close, speed = ("#device-io label:nth-of-type(1) button", "#device-io label:nth-of-type(3) input")
    panel.page.click(close)
    panel.until(f"document.querySelector('{close}').ariaPressed === 'true'")
    set_to(panel, speed, "12")
    until(lambda: [each["value"] for each in device(panel)["io"]] == [True, 2.5, 12, True, False, False])
    set_to(panel, speed, "-1")
    panel.until("document.querySelector('#device-io-why').innerText.includes('from 0 to')")
    forget(panel, "422")
    marks_an_output(panel)


def marks_an_output(panel: Panel) -> None:
    """It is switched on the page Move too, also after the page was loaded again."""
    star = "#device-io label:nth-of-type({}) .star".format
    panel.page.click(star(1))
    panel.until(f"document.querySelector('{star(1)}').ariaPressed === 'true'")
    panel.load()
    panel.page.click("#tab-move")
    panel.until("document.querySelector('#outputs button')")
    panel.page.click("#outputs button")
    until(lambda: device(panel)["io"][0]["value"] is False)
    assert panel.text("#outputs label span") == "Gripper.Close"
    stale = "JSON.stringify(['gone', 'too', 'Gripper.Close'])"
    panel.page.run(f"localStorage.setItem(`cobot.outputs.${{cobotPanel.api.robot.name}}`, {stale})")
    opened_card(panel, "io")
    for number in (2, 3, 5):  # outputs that the robot no longer has take no place
        panel.until(f"document.querySelector('{star(number)}')?.disabled === false")
        panel.page.click(star(number))
    panel.until(f"document.querySelector('{star(6)}').disabled")
    assert "four outputs" in panel.page.run(f"document.querySelector('{star(6)}').title")
    set_to(panel, "#outputs input", "2")
    until(lambda: device(panel)["io"][1]["value"] == 2)
    opened_card(panel, "io")
    for number in (1, 2, 3, 5):
        panel.page.click(star(number))
    assert not panel.page.run("document.querySelector('#outputs').children.length")


def device(panel: Panel) -> dict[str, Any]:
    """As REST has it."""
    return dict(httpx.get(f"{panel.run.url}/robots", timeout=WAIT_S).json()[0]["device"])


def acknowledge(panel: Panel) -> None:
    """Only who has seen to the payload may; what was found is there to be read."""
    panel.until("!document.querySelector('#contact').hidden")
    assert "J4 -90.0 degrees" in panel.text("#contact-found")
    panel.page.click("#acknowledge")
    panel.until("document.querySelector('#contact-why').innerText.startsWith('payload_checked')")
    panel.page.click("#contact-payload")
    panel.page.click("#acknowledge")
    panel.until("document.querySelector('#contact').hidden")
    assert (device(panel)["unacknowledged"], device(panel)["speed_share"]) == ("", 1.0)
    forget(panel, "422")


def says_how_it_is(panel: Panel) -> None:
    assert panel.text("#device") == "T1, COMMANDING_ACTIVE, GOOD, drives on"
    opened_card(panel, "device-card")
    told, rows = device(panel), "[...document.querySelectorAll('#device-all dd')]"
    shown = dict(panel.page.run(f"{rows}.map((each) => [each.dataset.about, each.innerText])"))
    assert shown["device_backend"] == f"{told['backend']}: a real robot"
    assert shown["device_brakes"] == told["status"]["brakes"] == "released"
    assert shown["device_lost"] == str(told["status"]["packets_lost"]) == "7"
    assert shown["device_able"].count(",") == len(told["able"]) - 1
    assert "control of its brakes" in shown["device_able"]
    assert shown["device_stops"] == "1, 2"
    stopped = json.dumps(told | {"status": told["status"] | {"safety_stop": "safety stop 1: at rest"}})
    header = "document.querySelector('#device')"
    seen = panel.page.run(
        f"(cobotPanel.device.tell({stopped}), [{header}.textContent, {header}.dataset.level])"
    )
    assert seen == ["T1, safety stop 1: at rest", "bad"]


RED = """(({ bodies, groups }) => bodies.filter((_, index) =>
    groups[index].children.some((mesh) => mesh.material?.emissive?.getHex())).map(({ name }) => name))
    (cobotPanel.view.arm)"""
"""Names of the bodies that are drawn in red."""


def fails_in_words(panel: Panel) -> None:
    """In each language, and why a reset is refused."""
    file = fault_file(panel.run.name)
    file.write_text("the drive of joint3 is too hot", encoding="utf-8")
    try:
        panel.until("document.querySelector('#banner-title').innerText === 'Fault'")
        assert panel.text("#banner-reason") == "reading from the robot failed: the drive of joint3 is too hot"
        panel.until(f"JSON.stringify({RED}) === JSON.stringify(['link3'])")
        causes = {"de": "Der Roboter meldet", "zh": "无法读取", "en": "The robot does not report"}
        for language, cause in causes.items():
            set_to(panel, "#language", language)
            assert panel.text("#banner-cause").startswith(cause)
        panel.page.click("#reset")
        panel.until("document.querySelector('#banner-way').innerText.includes('J3 is too hot')")
        panel.until("document.querySelector('#log [data-problem][data-type=fault]')")
    finally:
        file.unlink()

    def reset() -> bool:
        panel.page.click("#reset")
        return bool(panel.page.run("document.querySelector('#banner').hidden"))

    until(reset)
    until(panel.rests)
    panel.until(f"{RED}.length === 0")
    forget(panel, "409", "503")


def test_it_speaks_german_and_chinese(panel: Panel) -> None:
    def choose(language: str) -> None:
        set_to(panel, "#language", language)

    try:
        for language, joints, mode in (("de", "Gelenke", "Bereit"), ("zh", "关节", "就绪")):
            choose(language)
            assert panel.text("#joints-title") == joints
            assert panel.text("#mode") == mode
            assert panel.page.run("document.documentElement.lang") == language
    finally:
        choose("en")
    assert panel.text("#joints-title") == "Joints"


def test_a_robot_that_says_nothing_is_told_and_its_values_are_old(panel: Panel) -> None:
    """The real-time process stands still for as long as the test has it; the connection is good."""
    process = panel.run.child("rtloop")
    assert process is not None
    process.suspend()
    try:
        panel.until("document.body.matches('[data-silent]') && !document.querySelector('#banner').hidden")
        assert panel.text("#banner-title") == "No data from the robot"
        assert panel.page.run("cobotPanel.stream.ready")
        assert panel.page.run("document.querySelector('#reset').hidden")
        assert (
            panel.page.run("getComputedStyle(document.querySelector('#joints input')).fontStyle") == "italic"
        )
    finally:
        process.resume()
    panel.until("!document.body.matches('[data-silent]')")
    until(panel.rests)
    panel.until("document.querySelector('#banner').hidden")
    forget(panel, "503")


def test_a_page_whose_service_does_not_answer_yet_stops_and_comes_to_life(panel: Panel) -> None:
    """Nor do its words come, and what this browser keeps is broken."""
    name = panel.page.run("cobotPanel.api.robot.name")
    panel.page.run(
        f"localStorage.setItem('cobot.program.{name}', '[{{}}, 3');"
        "sessionStorage.setItem('cobot.plans', '{')"
    )
    slowly(panel)
    panel.page.block("*/robots", "*/words.json")
    try:
        panel.page.visit(f"{panel.run.url}/")
        panel.until("window.cobotPanel && !document.querySelector('#banner').hidden")
        panel.page.key("Escape", "Escape")
        until(panel.rests)
    finally:
        panel.page.block()
    panel.until("cobotPanel.view?.arm && cobotPanel.view.joints && document.querySelector('#banner').hidden")
    panel.until("document.querySelector('#mode').innerText === 'Ready'")
    assert (
        panel.page.run("cobotPanel.programPage.program.content.steps.length + cobotPanel.motions.made.length")
        == 0
    )
    panel.page.run("localStorage.clear(), sessionStorage.clear()")
    forget(panel, "Failed to load")
