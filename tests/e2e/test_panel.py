"""The operator panel in a headless Chromium, as a person uses it; the arm's reaction is asked of REST.

With COBOT_PICTURES=FOLDER it writes the documents' pictures of the panel there, one of them moving.
"""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import httpx
import jsonschema_rs
import numpy as np
import pytest
from chromium import CHROMIUM, Page, browsing
from panel_arm import fault_file
from PIL import Image
from running import WAIT_S, Run, answering, until
from scipy.interpolate import BPoly, CubicSpline
from streaming_client import StreamClient
from websockets.sync.client import connect

from cobot.clock import SYSTEM

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
HOME_X_M = 0.4
MOVED_RAD = 0.02
SIZE = (1280, 800)
WATCH = """
window.problems = [];
addEventListener("error", (event) => problems.push(event.message));
addEventListener("unhandledrejection", (event) => problems.push(String(event.reason)));
document.addEventListener("securitypolicyviolation", (event) => problems.push(`policy: ${event.blockedURI}`));
for (const kind of ["error", "warn"]) {
    const before = console[kind];
    console[kind] = (...all) => { problems.push(`${kind}: ${all.join(" ")}`); before(...all); };
}
"""


class Panel:
    """The page, and the service behind it."""

    def __init__(self, page: Page, run: Run) -> None:
        self.page, self.run = page, run
        size(self, *SIZE)
        page.ask("Page.enable")
        page.ask("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        self.load()

    def load(self) -> None:
        """Until the arm is drawn and states come."""
        self.page.visit(f"{self.run.url}/")
        self.until(
            "window.cobotPanel?.view?.arm && cobotPanel.view.joints"
            " && document.querySelector('[data-position]')"
        )

    def until(self, script: str) -> Any:
        return until(
            lambda: self.page.run(f"!!({script})"),
            lambda: f"{script}: {self.problems()}, {self.text('body')}",
        )

    def text(self, selector: str) -> str:
        return str(self.page.run(f"document.querySelector({json.dumps(selector)}).innerText"))

    def problems(self) -> list[str]:
        return list(self.page.run("problems"))

    def mode(self) -> str:
        return str(self.run.health()["robot"]["mode"])  # type: ignore[index]

    def rests(self) -> bool:
        health = self.run.health()
        return health is not None and health["session"] is None and health["robot"]["mode"] == "HOLD"  # type: ignore[index]

    def hold(self, selector: str, moved: Callable[[], bool]) -> None:
        """Hold a button until the arm has moved; again if a busy computer has made the panel fall silent."""
        place = self.page.place(selector)
        self.page.mouse("mousePressed", place)

        def held_and_moved() -> bool:
            if not self.page.run("!!cobotPanel.jog.held") or "let go" in self.text("#jog-why"):
                self.page.mouse("mouseReleased", place)
                until(self.rests)
                self.page.mouse("mousePressed", place)
            return moved()

        until(held_and_moved, lambda: f"{self.text('#jog-why')}, {self.problems()}")

    def let_go(self, selector: str) -> None:
        self.page.mouse("mouseReleased", self.page.place(selector))

    def stays(self) -> list[float]:
        """Where the arm is, once nobody moves it any more."""
        until(self.rests)
        before = self.run.joints()
        for _ in range(10):
            np.testing.assert_allclose(self.run.joints(), before, atol=5e-3)
        return before


def size(panel: Panel, width: int, height: int, *, mobile: bool = False) -> None:
    """What the page has to show itself in."""
    how = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
    panel.page.ask("Emulation.setDeviceMetricsOverride", **how)


PICTURES = os.environ.get("COBOT_PICTURES")


@pytest.fixture(scope="module")
def opened(service: Run, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    folder = tmp_path_factory.mktemp("browser")
    with browsing(folder, "--enable-unsafe-swiftshader", "--lang=en") as tools:
        yield Panel(Page(tools), service)


@pytest.fixture
def real(opened: Panel, tmp_path: Path) -> Iterator[Panel]:
    """The same page with an arm that seems to be a real one, and can fail."""
    with answering(Run(tmp_path, clock="realtime", backend="panel_arm:PanelArm")) as started:
        panel = Panel(opened.page, started)
        yield panel
        assert panel.problems() == []
    opened.load()


def forget(panel: Panel, *codes: str) -> None:
    """Chromium says of each refusal that a resource has not been loaded; nothing else was a problem."""
    while panel.problems():
        assert any(code in panel.problems()[0] for code in codes)
        panel.page.run("problems.shift()")


@pytest.fixture
def panel(opened: Panel) -> Iterator[Panel]:
    """With the arm at home; the page had no problem in any test."""
    opened.run.go_home()
    until(opened.rests)
    yield opened
    assert opened.problems() == []


def button(kind: str, index: int, sign: int) -> str:
    return f'[data-jog="{kind}"][data-index="{index}"][data-sign="{sign}"]'


def away(panel: Panel, index: int, sign: int, from_rad: float) -> Callable[[], bool]:
    return lambda: sign * (panel.run.joints()[index] - from_rad) > MOVED_RAD


def test_it_shows_the_arm_where_it_is_and_asks_nobody_else(panel: Panel) -> None:
    pose = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    until(
        lambda: np.allclose(
            panel.page.run("cobotPanel.view.arm.tcpPosition()"), [pose[k] for k in "xyz"], atol=2e-3
        )
    )
    panel.until("document.querySelector('#mode').dataset.mode === 'HOLD'")
    panel.until("document.querySelector('#control').innerText === 'nobody'")
    panel.until("document.querySelector('#cycle').innerText.includes('µs')")
    assert panel.text("#joints .row:nth-child(4) b") == "-90.0 °"
    assert panel.text("#tcp .row:nth-child(1) b").startswith("40")
    sources = panel.page.run("performance.getEntriesByType('resource').map((entry) => entry.name)")
    assert len(sources) > 10
    assert all(source.startswith(panel.run.url) for source in sources), sources
    painted = panel.page.run("performance.getEntriesByName('first-contentful-paint')[0]?.startTime")
    print(f"first paint after {painted:.0f} ms")


def test_a_simulation_says_nothing_of_itself(panel: Panel) -> None:
    panel.until("cobotPanel.device.told")
    assert panel.page.run("document.querySelector('#device').closest('div').hidden")
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
    panel.until("document.querySelectorAll('#device-io label').length === 4")
    assert panel.text("#device-io label:nth-of-type(4) b") == "on"
    close, speed = ("#device-io label:nth-of-type(1) button", "#device-io label:nth-of-type(3) input")
    panel.page.click(close)
    panel.until(f"document.querySelector('{close}').ariaPressed === 'true'")
    set_to(panel, speed, "12")
    until(lambda: [each["value"] for each in device(panel)["io"]] == [True, 2.5, 12, True])
    set_to(panel, speed, "-1")
    panel.until("document.querySelector('#device-io-why').innerText.includes('from 0 to')")
    forget(panel, "422")


def device(panel: Panel) -> dict[str, Any]:
    """As REST has it."""
    return dict(httpx.get(f"{panel.run.url}/robots", timeout=WAIT_S).json()[0]["device"])


def acknowledge(panel: Panel) -> None:
    """Only who has seen to the payload may; what was found is there to be read."""
    panel.until("!document.querySelector('#contact').hidden")
    assert "joint4 -90.0 degrees" in panel.text("#contact-found")
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


def fails_in_words(panel: Panel) -> None:
    """In each language, and why a reset is refused."""
    file = fault_file(panel.run.name)
    file.write_text("drive 3 is too hot", encoding="utf-8")
    try:
        panel.until("document.querySelector('#banner-title').innerText === 'Fault'")
        assert panel.text("#banner-reason") == "reading from the robot failed: drive 3 is too hot"
        causes = {"de": "Der Roboter sagt nicht", "zh": "无法读取", "en": "The robot does not tell"}
        for language, cause in causes.items():
            set_to(panel, "#language", language)
            assert panel.text("#banner-cause").startswith(cause)
        panel.page.click("#reset")
        panel.until("document.querySelector('#banner-way').innerText.includes('drive 3 is too hot')")
        panel.until("document.querySelector('#log [data-problem][data-type=fault]')")
    finally:
        file.unlink()

    def reset() -> bool:
        panel.page.click("#reset")
        return bool(panel.page.run("document.querySelector('#banner').hidden"))

    until(reset)
    until(panel.rests)
    forget(panel, "409", "503")


def test_a_joint_moves_while_its_button_is_held(panel: Panel) -> None:
    plus = button("joint", 0, 1)
    panel.hold(plus, away(panel, 0, 1, 0.0))
    assert panel.mode() in ("JOINT_IMPEDANCE", "STOPPING", "HOLD")
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


def test_without_a_connection_nothing_is_held(panel: Panel) -> None:
    panel.page.run("cobotPanel.stream.socket.close()")
    panel.page.click(button("joint", 0, 1))
    assert not panel.page.run("!!cobotPanel.jog.held")
    panel.until("cobotPanel.stream.ready && document.querySelector('#connection').innerText === 'connected'")
    panel.stays()
    assert is_at(panel, HOME)


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
        if not panel.page.run("!!cobotPanel.jog.held") or "let go" in panel.text("#jog-why"):
            panel.page.ask("Input.dispatchKeyEvent", type="keyUp", **down)
            until(panel.rests)
            panel.page.ask("Input.dispatchKeyEvent", type="rawKeyDown", **down)
        return away(panel, 5, -1, HOME[5])()

    until(pressed_and_moved)
    panel.page.ask("Input.dispatchKeyEvent", type="keyUp", **down)
    panel.stays()


def commanded(panel: Panel) -> list[float]:
    return list(panel.page.run("cobotPanel.state.commanded_position"))


def step(panel: Panel, selector: str) -> None:
    """One press, to the end of its motion, as the panel's own state has it too."""
    before = commanded(panel)
    panel.page.click(selector)
    panel.until(
        f"!cobotPanel.jog.pending && cobotPanel.state.commanded_position.some((v, i) => v !== {before}[i])"
    )
    until(panel.rests)
    time_s = panel.page.run("cobotPanel.state.robot_time_s")
    panel.until(f"cobotPanel.state.robot_time_s > {time_s} + 0.1")


def test_steps_move_by_just_that_and_do_not_add_up_what_is_measured_beside_it(panel: Panel) -> None:
    """Oracle: the sum of the steps; for the TCP the end of what the service plans to these joints."""
    set_to(panel, "#jog-how", "middle")
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
        set_to(panel, "#jog-how", "hold")
        set_to(panel, "#jog-frame", "base")


def tcp_at(panel: Panel, joints: list[float]) -> list[float]:
    """Where the service has the TCP; the page has it at the same place."""
    body = {"start": HOME, "joints": joints, "speed": 1.0, "samples": 2}
    answer = httpx.post(f"{panel.run.url}/robot/plan/joints", json=body, timeout=WAIT_S).json()
    last = answer["path"][-1]
    page = panel.page.run(
        f"import('/panel/kinematics.js').then((all) => all.tcpOf(cobotPanel.geometry, {last['joints']}))"
    )
    np.testing.assert_allclose(page["position"], last["position"], atol=1e-9)
    np.testing.assert_allclose(abs(np.dot(page["quaternion"], last["quaternion"])), 1.0, atol=1e-9)
    return list(last["position"])


def test_a_held_button_moves_as_fast_as_the_slider_says(panel: Panel) -> None:
    """Oracle: half of the joint's limit at 100 %."""
    limit = panel.page.run("cobotPanel.readouts.ranges[0].max_velocity")
    set_to(panel, "#jog-speed", "10")
    plus = button("joint", 0, 1)
    try:
        near = f"Math.abs(cobotPanel.state.commanded_velocity[0] - {0.1 * 0.5 * limit}) < 1e-3"
        panel.hold(plus, lambda: bool(panel.page.run(near)))
    finally:
        panel.let_go(plus)
        set_to(panel, "#jog-speed", "50")
    panel.stays()


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
    assert "choose steps" in panel.text("#jog-why")
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


def planned(panel: Panel, name: str) -> None:
    panel.page.click(f'[data-position="{name}"]')
    panel.until("!document.querySelector('#execute').disabled")


def test_a_motion_is_shown_before_it_is_run(panel: Panel) -> None:
    panel.page.run("document.querySelector('#motion-speed').value = 100")
    planned(panel, "work")
    assert "Takes" in panel.text("#plan")
    assert "mm" in panel.text("#plan")
    frames = panel.page.run("cobotPanel.view.frames")
    panel.until(f"cobotPanel.view.ghost && cobotPanel.view.frames > {frames} + 5")
    np.testing.assert_allclose(panel.run.joints(), HOME, atol=5e-3)
    panel.page.click("#discard")
    panel.until("!cobotPanel.view.ghost && document.querySelector('#execute').disabled")
    planned(panel, "work")
    panel.page.click("#rehearse")
    panel.until("document.querySelector('#plan').innerText.startsWith('Dry run: arrives after ')")
    np.testing.assert_allclose(panel.run.joints(), HOME, atol=5e-3)
    if PICTURES:
        panel.page.picture(Path(PICTURES) / "panel.png")
    panel.page.click("#execute")
    panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
    goals = {each["name"]: each["joints"] for each in httpx.get(f"{panel.run.url}/robot/positions").json()}
    np.testing.assert_allclose(panel.run.joints(), goals["work"], atol=5e-3)


@pytest.mark.skipif(not PICTURES, reason="no pictures are asked for")
def test_the_moving_picture_of_the_documents(panel: Panel) -> None:
    """A motion is planned, its ghost goes the way, the arm follows: slowly, so that a busy computer has many
    pictures of it, which are then shown faster.
    """
    shots: list[Image.Image] = []

    def shoot(least: int, goes_on: Callable[[], bool] = lambda: False) -> None:
        begun = len(shots)
        while len(shots) < begun + least or goes_on():
            shots.append(Image.open(io.BytesIO(panel.page.shot())).convert("RGB").resize((800, 500)))
            SYSTEM.sleep(0.3)

    panel.page.run("document.querySelector('#motion-speed').value = 5")
    panel.until("document.querySelector('#control').innerText === 'nobody'")
    shoot(3)
    planned(panel, "work")
    shoot(12)
    panel.page.click("#execute")
    shoot(1, lambda: panel.text("#plan") != "The arm has arrived.")
    shoot(1)
    assert PICTURES
    file = Path(PICTURES) / "panel.gif"
    together = Image.new("RGB", (800, 500 * len(shots)))
    for index, shot in enumerate(shots):
        together.paste(shot, (0, 500 * index))
    colours = together.quantize(128, Image.Quantize.MAXCOVERAGE, kmeans=1)  # one for all, or they flicker
    few = [shot.quantize(palette=colours, dither=Image.Dither.NONE) for shot in shots]
    lasts_ms = [120] * (len(few) - 1) + [1500]
    few[0].save(file, save_all=True, append_images=few[1:], duration=lasts_ms, loop=0, optimize=False)
    assert file.stat().st_size < 1_500_000


def slowly(panel: Panel) -> None:
    """The arm goes to "work", for a minute or so."""
    body = {"points": [{"positions": [0.6, *HOME[1:]], "time_from_start": 60.0}]}
    httpx.post(f"{panel.run.url}/trajectory/send", json=body, timeout=WAIT_S).raise_for_status()
    until(lambda: panel.mode() == "TRAJECTORY")


SET = "(e, v) => (e.value = v, e.dispatchEvent(new Event('input')), e.dispatchEvent(new Event('change')))"


def set_to(panel: Panel, selector: str, value: str) -> None:
    """What a control has after a person has chosen a value."""
    panel.page.run(f"({SET})(document.querySelector({json.dumps(selector)}), {json.dumps(value)})")


def speed(panel: Panel) -> float:
    return float(httpx.get(f"{panel.run.url}/robot/speed_override", timeout=WAIT_S).json()["fraction"])


def test_motions_are_slowed_paused_and_followed(panel: Panel) -> None:
    """The arm and the jobs as REST tells of them."""
    try:
        panel.page.run("document.querySelector('#override-set').focus()")
        panel.page.key("PageDown", "PageDown")
        until(lambda: speed(panel) == 0.9)
        set_to(panel, "#override-set", "50")
        until(lambda: speed(panel) == 0.5)
        assert panel.text("#override-shown") == "50 %"
        slowly(panel)
        panel.until("document.querySelector('#progress').value > 0.001")
        panel.until("/^[0-9]+ s left[.]$/.test(document.querySelector('#job-left').innerText)")
        assert panel.text("#job").startswith("Runs, for anonymous")
        panel.page.run("document.querySelector('#pause').focus()")
        panel.page.key("Enter", "Enter", "\r")
        panel.until("document.querySelector('#pause').innerText === 'Resume'")
        newest = httpx.get(f"{panel.run.url}/jobs?n=1", timeout=WAIT_S).json()["jobs"][0]
        assert newest["state"] == "paused"
        panel.page.click("#pause")
        panel.until("document.querySelector('#pause').innerText === 'Pause'")
        before = panel.run.joints()[0]
        until(lambda: panel.run.joints()[0] > before + 1e-3)
        panel.until("cobotPanel.view.way")
        ends = "cobotPanel.view.way.geometry.attributes.position.array.slice(-3)"
        end = [0.6, *HOME[1:]]
        np.testing.assert_allclose(panel.page.run(f"[...{ends}]"), tcp_at(panel, end), atol=1e-5)
        panel.page.click("#stop")
        panel.until("!cobotPanel.view.way")
        panel.until("document.querySelector('#job').innerText.startsWith('Was stopped')")
        assert panel.page.run("document.querySelector('#pause').disabled")
        httpx.post(f"{panel.run.url}/robot/speed_override", json={"fraction": 0.0}, timeout=WAIT_S)
        panel.page.run("cobotPanel.job.look()")
        panel.until("document.querySelector('#override-shown').innerText === '0 %'")
    finally:
        set_to(panel, "#override-set", "100")
        until(lambda: speed(panel) == 1.0)


def test_plans_of_others_are_approved_and_taken_back(panel: Panel) -> None:
    planned(panel, "work")
    panel.page.click("#discard")
    body = {"joints": [0.3, *HOME[1:]], "speed": 0.5}
    answer = httpx.post(f"{panel.run.url}/robot/plan/joints", json=body, timeout=WAIT_S).json()
    row = f'[data-plan="{answer["plan_id"]}"]'
    panel.until(f"document.querySelector('{row}')")
    assert f"{answer['duration_s']:.1f} s" in panel.text(row)
    own = panel.page.run("cobotPanel.motions.made.at(-1)")
    assert not panel.page.run(f"!!document.querySelector('[data-plan=\"{own}\"]')")

    def approved_by() -> str | None:
        plans = httpx.get(f"{panel.run.url}/robot/plans", timeout=WAIT_S).json()
        return {each["plan_id"]: each["approved_by"] for each in plans}[answer["plan_id"]]

    panel.page.click(f"{row} button")
    panel.until(f"document.querySelector('{row} button').innerText === 'Take back'")
    assert approved_by() == "anonymous"
    panel.page.click(f"{row} button")
    panel.until(f"document.querySelector('{row} button').innerText === 'Approve'")
    assert approved_by() is None


def test_a_plan_of_somebody_else_is_shown_before_it_is_approved(panel: Panel) -> None:
    body = {"joints": [0.4, *HOME[1:]], "speed": 0.5}
    answer = httpx.post(f"{panel.run.url}/robot/plan/joints", json=body, timeout=WAIT_S).json()
    row = f'[data-plan="{answer["plan_id"]}"]'
    panel.until(f"document.querySelector('{row}')")
    panel.page.click(f"{row} button:nth-of-type(2)")
    panel.until("cobotPanel.view.ghost && document.querySelector('#plan').innerText.includes('Takes')")
    assert panel.page.run("cobotPanel.view.plan.plan_id") == answer["plan_id"]
    assert panel.page.run("document.querySelector('#execute').disabled"), "it is not the panel's to run"
    panel.page.click("#discard")
    panel.until("!cobotPanel.view.ghost")


def test_the_speed_that_somebody_else_sets_is_heard_of(panel: Panel) -> None:
    try:
        for fraction in (0.4, 1.0):
            body = {"fraction": fraction}
            httpx.post(f"{panel.run.url}/robot/speed_override", json=body, timeout=WAIT_S).raise_for_status()
            panel.until(f"document.querySelector('#override-shown').innerText === '{100 * fraction:.0f} %'")
    finally:
        httpx.post(f"{panel.run.url}/robot/speed_override", json={"fraction": 1.0}, timeout=WAIT_S)


QUEUED = 12
"""More than the newest ten: what goes on is older than those that wait for it."""


def test_what_waits_in_the_queue_is_listed_and_taken_out(panel: Panel) -> None:
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        try:
            http.post("/robot/speed_override", json={"fraction": 0.0}).raise_for_status()
            jobs = []
            for angle in np.linspace(0.1, 1.2, QUEUED).tolist():
                body = {"joints": [angle, *HOME[1:]], "speed": 1.0}
                jobs.append(
                    http.post("/robot/move/joints?queue=true", json=body).raise_for_status().json()["id"]
                )
            panel.until(f"document.querySelectorAll('#queue li').length === {QUEUED}")
            panel.until("document.querySelector('#job').innerText.startsWith('Waits, for anonymous')")
            listed = panel.page.run(
                "[...document.querySelectorAll('#queue li')].map((each) => each.dataset.job)"
            )
            assert listed == jobs
            panel.page.click(f'[data-job="{jobs[1]}"] button')
            panel.until(f"document.querySelectorAll('#queue li').length === {QUEUED - 1}")
            assert http.get(f"/jobs/{jobs[1]}").json()["state"] == "cancelled"
            panel.page.click("#stop")
            panel.until("document.querySelector('#queue').hidden")
            until(lambda: http.get(f"/jobs/{jobs[2]}").json()["state"] == "cancelled")
        finally:
            http.post("/robot/speed_override", json={"fraction": 1.0}).raise_for_status()


def test_a_place_is_taught_gone_to_and_forgotten(panel: Panel) -> None:
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:
        place = [0.25, *HOME[1:]]
        assert http.post("/robot/move/joints", json={"joints": place, "speed": 1.0}).json()["success"]
        panel.until("Math.abs(cobotPanel.state.commanded_position[0] - 0.25) < 1e-4")
        set_to(panel, "#position-name", "bench")
        panel.page.click("#position-teach")
        panel.until("document.querySelector('[data-position=bench]')")
        taught = {each["name"]: each for each in http.get("/robot/positions").json()}["bench"]
        assert taught["taught"]
        np.testing.assert_allclose(taught["joints"], place, atol=1e-4)
        panel.run.go_home()
        panel.page.run("document.querySelector('#motion-speed').value = 100")
        planned(panel, "bench")
        panel.page.click("#execute")
        panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
        np.testing.assert_allclose(panel.run.joints(), place, atol=5e-3)
        set_to(panel, "#position-name", "home")
        panel.page.click("#position-teach")
        panel.until("document.querySelector('#plan').innerText.includes('SRDF')")
        assert panel.page.run("document.querySelector('#position-forget').disabled")
        set_to(panel, "#position-name", "bench")
        panel.page.click("#position-forget")
        panel.until("!document.querySelector('[data-position=bench]')")
        assert "bench" not in [each["name"] for each in http.get("/robot/positions").json()]
        http.post("/robot/positions", json={"name": "elsewhere", "joints": place}).raise_for_status()
        panel.until("document.querySelector('[data-position=elsewhere]')")
        http.delete("/robot/positions/elsewhere").raise_for_status()
        panel.until("!document.querySelector('[data-position=elsewhere]')")
        forget(panel, "409")


def opened_card(panel: Panel, card: str) -> None:
    panel.page.run(f"document.querySelector('#{card}').open = true")


def test_a_lua_program_is_run_and_its_mistakes_are_marked(panel: Panel) -> None:
    opened_card(panel, "lua")
    try:
        program = "movej({ 0.2, 0, 0, -1.57, 0, 1.57, 0 }, 1.0)\nprint('there')\n"
        set_to(panel, "#lua-text", program)
        assert panel.text("#lua-lines").split() == ["1", "2", "3"]
        panel.page.click("#lua-run")
        panel.until("document.querySelector('#lua-why').innerText === 'Has ended well.'")
        assert "there" in panel.text("#lua-log")
        np.testing.assert_allclose(panel.run.joints(), [0.2, *HOME[1:]], atol=5e-3)
        set_to(panel, "#lua-text", "print('one')\nmovej({ 9, 0, 0, 0, 0, 0, 0 })\n")
        panel.page.click("#lua-run")
        panel.until("document.querySelector('#lua-why').innerText.startsWith('Ended with 2')")
        assert "joint1" in panel.text("#lua-why")
        begin = panel.page.run("document.querySelector('#lua-text').selectionStart")
        assert begin == len("print('one')\n"), "the second line is selected"
    finally:
        panel.page.run("document.querySelector('#lua').open = false; localStorage.removeItem('cobot.lua')")


def test_outputs_are_switched_and_registers_written(panel: Panel) -> None:
    """Oracle: the vendor services of the same robot."""
    name = httpx.get(f"{panel.run.url}/robots", timeout=WAIT_S).json()[0]["name"]

    def called(method: str, **fields: Any) -> Any:
        answer = httpx.post(f"{panel.run.url}/{name}/{method}", json=fields, timeout=WAIT_S).json()
        assert answer["code"] == 0, answer
        return answer["result"]

    opened_card(panel, "io")
    try:
        third = "#io-Output button:nth-of-type(3)"
        panel.until(f"document.querySelector('{third}')")
        panel.page.click(third)
        until(lambda: called("IoControl/getStandardDigitalOutput", index=2))
        panel.until(f"document.querySelector('{third}').getAttribute('aria-pressed') === 'true'")
        panel.page.click(third)
        until(lambda: not called("IoControl/getStandardDigitalOutput", index=2))
        called("IoControl/setStandardDigitalInput", index=1, value=True)
        panel.until("document.querySelector('#io-Input button:nth-of-type(2)').ariaPressed === 'true'")
        called("IoControl/setStandardDigitalInput", index=1, value=False)
        set_to(panel, "#register-bank", "Output")
        set_to(panel, "#register-kind", "Int32")
        set_to(panel, "#register-index", "7")
        set_to(panel, "#register-value", "-12")
        panel.page.click("#register-write")
        until(lambda: called("RegisterControl/getInt32Output", index=7) == -12)
        panel.until("document.querySelector('#register-shown').innerText === '-12'")
        called("RegisterControl/setInt32Output", index=7, value=0)
    finally:
        panel.page.run("document.querySelector('#io').open = false")


def test_recordings_are_made_listed_over_their_time_and_taken_away(panel: Panel, tmp_path: Path) -> None:
    opened_card(panel, "recordings")
    with httpx.Client(base_url=panel.run.url, timeout=WAIT_S) as http:

        def names() -> list[str]:
            return [each["name"] for each in http.get("/recordings").json()["recordings"]]

        before = names()
        try:
            panel.page.click("#rec-dump")
            until(lambda: len(names()) > len(before))
            made = next(name for name in names() if name not in before)
            panel.until(f"document.querySelector('[data-recording=\"{made}\"] button')")
            assert "asked for" in panel.text(f'[data-recording="{made}"]')
            panel.page.click(f'[data-recording="{made}"] button')
            panel.until("!document.querySelector('#rec-shown').hidden && cobotPanel.view.still !== null")
            path = http.get(f"/recordings/{made}/path?samples=400").json()
            assert panel.page.run("cobotPanel.view.still") == pytest.approx(path["duration_s"])
            assert panel.page.run("cobotPanel.recordings.shown.path") == path["path"]
            events = panel.page.run("document.querySelectorAll('#rec-events li').length")
            assert events == len(path["events"][-100:]) > 0
            panel.page.click("#rec-events button")
            first = path["events"][-100:][0]["time_s"]
            panel.until(f"Math.abs(cobotPanel.view.still - {first}) < 1e-6")
            set_to(panel, "#rec-time", "0.5")
            panel.until("cobotPanel.view.still === 0.5")
            mine = f'[data-recording="{made}"] button:nth-of-type(2)'
            assert panel.page.save(mine, tmp_path).read_bytes() == http.get(f"/recordings/{made}").content
            panel.page.click("#rec-close")
            panel.until("!cobotPanel.view.ghost && document.querySelector('#rec-shown').hidden")
            count = panel.page.run("document.querySelectorAll('#rec-line line').length")
            assert count == len(names())
            panel.page.click("#rec-run")
            panel.until("document.querySelector('#rec-run').innerText === 'End the recording'")
            assert http.get("/recordings").json()["recorder"]["recording"]
            panel.page.click("#rec-run")
            panel.until("document.querySelector('#rec-run').innerText === 'Record'")
            assert not http.get("/recordings").json()["recorder"]["recording"]
        finally:
            panel.page.run("document.querySelector('#recordings').open = false")
            for name in set(names()) - set(before):
                http.delete(f"/recordings/{name}").raise_for_status()


def happened(panel: Panel) -> list[dict[str, Any]]:
    """All events that are kept."""
    address = f"ws{panel.run.url.removeprefix('http')}/events?after=0"
    with connect(address) as socket:
        newest = json.loads(socket.recv(WAIT_S))["data"]["newest"]
        events = [json.loads(socket.recv(WAIT_S))]
        while events[-1]["id"] < newest:
            events.append(json.loads(socket.recv(WAIT_S)))
    return events


def test_what_has_happened_is_listed_and_nothing_is_missed(panel: Panel) -> None:
    """The events as another connection hears them; after a break the list goes on where it was."""
    listed = "[...document.querySelectorAll('#log li')].map((e) => [e.dataset.type, e.children[0].dateTime])"

    def all_listed() -> bool:
        newest = happened(panel)[:-101:-1]
        return bool(panel.page.run(listed) == [[each["type"], each["time"]] for each in newest])

    until(all_listed)
    panel.page.run("cobotPanel.events.socket.close()")
    assert httpx.post(f"{panel.run.url}/stop", timeout=WAIT_S).status_code == 200
    until(all_listed)
    assert panel.page.run("document.querySelector('#log [data-type=stop] b').dataset.level") == "warn"
    panel.page.click("#log-problems")
    shown = "[...document.querySelectorAll('#log li')].filter((each) => each.checkVisibility())"
    assert panel.page.run(f"{shown}.length > 0 && {shown}.every((each) => 'problem' in each.dataset)")
    panel.page.click("#log-problems")


def drop(panel: Panel, selector: str, name: str, content: str) -> None:
    """A file, as a hand does."""
    panel.page.run(
        "((text, name, place) => { const held = new DataTransfer(); held.items.add(new File([text], name));"
        "document.querySelector(place).dispatchEvent(new DragEvent('drop',"
        "{dataTransfer: held, bubbles: true, cancelable: true})) })"
        f"({json.dumps(content)}, {json.dumps(name)}, {json.dumps(selector)})"
    )


def rows_of(times: list[float], first: list[float]) -> str:
    """A trajectory that moves joint 1 alone."""
    header = ";".join([*(f"joint{n}" for n in range(1, 8)), "t"])
    rows = [
        ";".join(str(value) for value in [angle, *HOME[1:], time])
        for time, angle in zip(times, first, strict=True)
    ]
    return "\n".join([header, *rows]).replace(".", ",") + "\n"


def test_a_csv_file_is_looked_at_before_it_is_sent(panel: Panel) -> None:
    """Oracle: of velocities SciPy's clamped cubic spline."""
    times, angles = [0.0, 1.5, 3.0, 5.0], [0.0, 0.2, 0.25, 0.1]
    drop(panel, "#csv-why", "wave.csv", rows_of(times, angles))
    panel.until("document.querySelectorAll('#csv-plots svg').length === 14")
    assert "4 points, 5.00 s" in panel.text("#csv-why")
    shown = np.array(panel.page.run("cobotPanel.csv.shown[0].velocities"))
    exact = CubicSpline(times, angles, bc_type="clamped").derivative()
    np.testing.assert_allclose(shown[:, 1], exact(shown[:, 0]), atol=1e-12)
    dense = np.abs(exact(np.linspace(0.0, 5.0, 5001))).max()
    assert np.abs(shown[:, 1]).max() == pytest.approx(dense, rel=1e-4)
    np.testing.assert_allclose(panel.run.joints(), HOME, atol=5e-3)
    panel.page.click("#csv-send")
    panel.until("document.querySelector('#csv-why').innerText.startsWith('Moves for 5.0 s')")
    until(lambda: panel.rests() and abs(panel.run.joints()[0] - 0.1) < 5e-3)

    drop(panel, "#csv-why", "fast.csv", rows_of([0.0, 0.05], [0.1, 4.0]))
    panel.until("document.querySelector('#csv-why').innerText.includes('joint1 reaches')")
    assert "joint1 leaves its range" in panel.text("#csv-why")
    assert panel.page.run("document.querySelectorAll('#csv-plots .beyond').length") == 2
    panel.page.click("#csv-send")
    panel.until("document.querySelector('#csv-why').innerText.includes('angle of joint1 is 4 rad')")

    drop(panel, "#csv-why", "away.csv", rows_of([0.0, 2.0], [0.3, 0.4]))
    panel.until("document.querySelector('#csv-why').innerText.includes('away.csv')")
    panel.page.click("#csv-start")
    panel.page.click("#csv-send")
    until(lambda: panel.rests() and abs(panel.run.joints()[0] - 0.4) < 5e-3)
    panel.page.click("#csv-start")
    assert panel.page.run("document.querySelector('#csv-start').ariaPressed") == "false"

    drop(panel, "#csv-why", "other.csv", "a,b\n1,2\n")
    panel.until("document.querySelector('#csv-why').innerText.startsWith('other.csv is no trajectory')")
    assert panel.page.run("document.querySelector('#csv-send').disabled")


def test_the_last_seconds_of_each_joint_are_drawn(panel: Panel) -> None:
    """The values as REST has them; a curve is where the canvas has colour."""
    panel.page.run("document.querySelector('#live').scrollIntoView()")
    for quantity, field in (("effort", "effort"), ("velocity", "velocity"), ("position", "position")):
        set_to(panel, "#live-what", quantity)
        values = httpx.get(f"{panel.run.url}/robot/joint_states", timeout=WAIT_S).json()[field]
        shown = float(values[3]) * (1.0 if quantity == "effort" else 180.0 / np.pi)
        near = "Math.abs(parseFloat(document.querySelectorAll('#live b')[3].innerText)"
        panel.until(f"{near} - ({shown})) < 0.5")
        named = "document.querySelectorAll('#live canvas')[3].getAttribute('aria-label')"
        assert "joint4" in panel.page.run(named)
    coloured = (
        "[...document.querySelectorAll('#live canvas')].every((each) => each.getContext('2d')"
        ".getImageData(0, 0, each.width, each.height).data.some((value) => value))"
    )
    panel.until(coloured)
    before = panel.run.health()["rtloop"]["overruns"]  # type: ignore[index]
    for quantity, lanes, shown in (("error", 7, " °"), ("wrench", 6, " N"), ("cycle", 2, " µs")):
        set_to(panel, "#live-what", quantity)
        panel.until(f"document.querySelectorAll('#live b').length === {lanes}")
        panel.until(f"document.querySelector('#live b').innerText.endsWith('{shown}')")
        panel.until(coloured)
    newest = "cobotPanel.live.states.at(-1)"
    panel.until(f"{newest}.cycle[0] > 0 && {newest}.cycle[1] >= {before}")
    assert (
        panel.page.run("document.querySelector('#live canvas').ariaLabel")
        == "cycle time of period, the last 20 s"
    )
    error = f"{newest}.error.every((each, joint) => Math.abs(each) < 0.02)"
    panel.until(f"{error} && {newest}.wrench.length === 6")
    set_to(panel, "#live-what", "position")
    span = "cobotPanel.live.states.at(-1).time - cobotPanel.live.states[0].time"
    assert panel.page.run(f"{span} < 20.1 && {span} > 0")
    assert panel.page.run("cobotPanel.live.lanes.length") == 7


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


def test_a_space_in_a_text_field_is_a_space(panel: Panel) -> None:
    pressed = panel.page.run("document.querySelector('#stop').dataset.pressed ?? '0'")
    panel.page.run("document.querySelector('#token-form').hidden = false")
    panel.page.run("document.querySelector('#token').focus()")
    panel.page.key(" ", "Space", " ")
    assert panel.page.run("document.querySelector('#token').value") == " "
    assert panel.page.run("document.querySelector('#stop').dataset.pressed ?? '0'") == pressed
    panel.page.run("document.querySelector('#token').value = ''")
    panel.page.run("document.querySelector('#token-form').hidden = true")


def test_after_an_estop_a_banner_says_why_and_the_way_out(panel: Panel) -> None:
    with StreamClient(panel.run.url) as client:
        client.session(inner_control_hz=50)
        client.send("estop")
        panel.until("!document.querySelector('#banner').hidden")
    assert "Emergency stop" in panel.text("#banner")
    reason = panel.run.health()["robot"]["reason"]  # type: ignore[index]
    assert reason in panel.text("#banner-reason")
    assert panel.text("#banner-cause") == "Somebody, or a program, has asked for an emergency stop."
    assert "Reset" in panel.text("#banner-way")
    panel.page.click("#reset")
    panel.until("document.querySelector('#banner').hidden")
    until(panel.rests)


def test_it_speaks_german_and_chinese(panel: Panel) -> None:
    def choose(language: str) -> None:
        panel.page.run(
            f"(e => (e.value = '{language}', e.dispatchEvent(new Event('change'))))"
            "(document.querySelector('#language'))"
        )

    try:
        for language, joints, mode in (("de", "Gelenke", "hält"), ("zh", "关节", "保持")):
            choose(language)
            assert panel.text("#joints-title") == joints
            assert panel.text("#mode") == mode
            assert panel.page.run("document.documentElement.lang") == language
    finally:
        choose("en")
    assert panel.text("#joints-title") == "Joints"


def test_who_has_taken_the_control_moves_the_arm_alone(panel: Panel) -> None:
    home = {"name": "home", "speed": 1.0}
    panel.page.click("#take")
    panel.until("document.querySelector('#take').innerText === 'Give back'")
    refused = httpx.post(f"{panel.run.url}/robot/move/named", json=home, timeout=WAIT_S)
    assert refused.status_code == 409
    plus = button("joint", 0, 1)
    panel.hold(plus, away(panel, 0, 1, 0.0))
    panel.let_go(plus)
    panel.stays()
    planned(panel, "home")
    panel.page.click("#execute")
    panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
    panel.page.click("#take")
    panel.until("document.querySelector('#take').innerText === 'Take'")
    answer = httpx.post(f"{panel.run.url}/robot/move/named", json=home, timeout=WAIT_S)
    assert answer.json()["success"], answer.text


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
    set_to = "(e, v) => (e.value = v, e.dispatchEvent(new Event('change')))"
    panel.page.run(f"({set_to})(document.querySelector('#points li:nth-child(1) input'), '20')")
    panel.page.run(f"({set_to})(document.querySelector('#points li:nth-child(2) select'), 'lin')")
    panel.page.click("#points li:nth-child(3) button:nth-of-type(1)")
    panel.page.run(f"({set_to})(document.querySelector('#points li:nth-child(2) select'), 'auto')")
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
    schema = Path(__file__).parents[2] / "sequences" / "sequence.schema.json"
    jsonschema_rs.validator_for(json.loads(schema.read_text())).validate(sequence)
    assert [each["radius"] for each in sequence["waypoints"]] == [0.02, 0.0, 0.0]

    for _ in range(3):
        panel.page.click("#points li:nth-child(1) button:nth-of-type(3)")
    panel.until("document.querySelectorAll('#points li').length === 0")
    drop(panel, "#points", "a.json", json.dumps(sequence))
    panel.until("document.querySelectorAll('#points li').length === 3")
    assert panel.page.run("cobotPanel.waypoints.sequence()") == sequence
    drop(panel, "#points", "a.json", '{"points": []}')
    panel.until("document.querySelector('#points-why').innerText.startsWith('a.json is no sequence')")
    assert panel.page.run("document.querySelectorAll('#points li').length") == 3
    panel.page.run("localStorage.clear()")


def newest_job(panel: Panel) -> dict[str, Any]:
    """Of those that belong to no other."""
    jobs = httpx.get(f"{panel.run.url}/jobs?n=10", timeout=WAIT_S).json()["jobs"]
    return dict(next(each for each in jobs if each["parent"] is None))


def is_at(panel: Panel, joints: list[float]) -> bool:
    return bool(np.abs(np.subtract(panel.run.joints(), joints)).max() < 5e-3)


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
    panel.until("document.querySelector('#points-why').innerText === 'Has come to its end.'")
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
    panel.until("document.querySelector('#points-why').innerText === 'Has come to its end.'")
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


def test_a_robot_that_says_nothing_is_told_and_its_values_are_old(panel: Panel) -> None:
    """The real-time process stands still for as long as the test has it; the connection is good."""
    process = panel.run.child("rtloop")
    assert process is not None
    process.suspend()
    try:
        panel.until("document.body.matches('[data-silent]') && !document.querySelector('#banner').hidden")
        assert panel.text("#banner-title") == "Nobody tells how the arm is"
        assert panel.page.run("cobotPanel.stream.ready")
        assert panel.page.run("document.querySelector('#reset').hidden")
        assert panel.page.run("getComputedStyle(document.querySelector('#joints b')).fontStyle") == "italic"
    finally:
        process.resume()
    panel.until("!document.body.matches('[data-silent]')")
    until(panel.rests)
    panel.until("document.querySelector('#banner').hidden")
    forget(panel, "503")


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
        assert "the robot's own emergency stop" in panel.text("#stop-why")
        panel.page.run("cobotPanel.status.connected(true)")
        assert not panel.page.run(f"{why}.hidden"), "nothing else writes over it"
    finally:
        panel.page.block()
        panel.page.run("delete cobotPanel.stream.send")
    panel.page.click("#stop")
    panel.until(f"{why}.hidden")
    forget(panel, "Failed to load")


def test_a_page_whose_service_does_not_answer_yet_stops_and_comes_to_life(panel: Panel) -> None:
    """Nor do its words come, and what this browser keeps is broken."""
    name = panel.page.run("cobotPanel.api.robot.name")
    panel.page.run(
        f"localStorage.setItem('cobot.waypoints.{name}', '[{{}}, 3');"
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
    panel.until("document.querySelector('#mode').innerText === 'holds'")
    assert panel.page.run("cobotPanel.waypoints.list.length + cobotPanel.motions.made.length") == 0
    panel.page.run("localStorage.clear(), sessionStorage.clear()")
    forget(panel, "Failed to load")


def test_files_are_chosen_and_taken_away(panel: Panel, tmp_path: Path) -> None:
    fast = tmp_path / "fast.csv"
    fast.write_text(rows_of([0.0, 0.1], [0.0, 0.3]), encoding="utf-8")
    panel.page.choose("#csv-choose", fast)
    panel.until("document.querySelector('#csv-why').innerText.includes('joint1 reaches')")
    panel.page.click("#csv-retime")
    panel.page.click("#csv-send")
    panel.until("document.querySelector('#csv-why').innerText.startsWith('Moves for')")
    until(lambda: panel.rests() and abs(panel.run.joints()[0] - 0.3) < 5e-3)
    panel.page.click("#csv-retime")
    assert panel.page.run("document.querySelector('#csv-file').value") == ""

    panel.page.click("#teach")
    saved = panel.page.save("#points-save", tmp_path)
    assert json.loads(saved.read_text()) == panel.page.run("cobotPanel.waypoints.sequence()")
    panel.page.click("#points li:nth-child(1) button:nth-of-type(3)")

    opened_card(panel, "lua")
    try:
        program = tmp_path / "hello.lua"
        program.write_text('print("hello")\n', encoding="utf-8")
        panel.page.choose("#lua-choose", program)
        panel.until("document.querySelector('#lua-text').value.includes('hello')")
        assert panel.page.run("document.querySelector('#lua-file').value") == ""
        assert panel.page.save("#lua-save", tmp_path).read_text() == program.read_text()
    finally:
        panel.page.run("document.querySelector('#lua').open = false; localStorage.clear()")


def test_of_a_csv_file_with_accelerations_the_curves_are_those_that_are_run(panel: Panel) -> None:
    """Oracle: SciPy's piecewise polynomials through the same values."""
    times, places, rates, bends = [0.0, 0.8, 2.0], [0.0, 0.3, 0.2], [0.0, 0.1, 0.0], [0.0, -1.5, 0.0]
    columns = json.dumps([times, places, rates, bends])
    curve = f"import('/panel/points.js').then((all) => all.velocityCurve(...{columns}))"
    shown = np.array(panel.page.run(curve))
    exact = BPoly.from_derivatives(times, np.transpose([places, rates, bends])).derivative()
    np.testing.assert_allclose(shown[:, 1], exact(shown[:, 0]), atol=1e-9)
    dense = exact(np.linspace(0.0, 2.0, 20001))
    np.testing.assert_allclose([shown[:, 1].min(), shown[:, 1].max()], [dense.min(), dense.max()], atol=1e-4)
    header = [f"{kind}{joint}" for kind in ("joint", "velocity", "acceleration") for joint in (1, 2)]
    rows = [
        [place, 0, rate, 0, bend, 0, time]
        for time, place, rate, bend in zip(times, places, rates, bends, strict=True)
    ]
    text = "\n".join(",".join(map(str, row)) for row in [[*header, "t"], *rows])
    read = panel.page.run(f"import('/panel/points.js').then((all) => all.read({json.dumps(text)}, 2))")
    assert read["accelerations"] == [bends, [0, 0, 0]]


def test_what_is_a_problem_is_told_by_what_has_happened(panel: Panel) -> None:
    levels = {
        "bad": [
            {"type": "job", "data": {"state": "failed"}},
            {"type": "job", "data": {"state": "interrupted"}},
            {"type": "motion", "data": {"what": "failed"}},
            {"type": "mode", "data": {"mode": "FAULT"}},
            {"type": "sequence", "data": {"what": "ended", "returncode": 2}},
            {"type": "log", "data": {"level": "error"}},
            {"type": "lost", "data": {}},
        ],
        "warn": [
            {"type": "log", "data": {"level": "warning"}},
            {"type": "lease", "data": {"what": "taken over"}},
            {"type": "planning", "data": {"what": "replaced"}},
        ],
        "": [
            {"type": "job", "data": {"state": "finished"}},
            {"type": "motion", "data": {"what": "begun"}},
            {"type": "sequence", "data": {"what": "ended", "returncode": 0}},
            {"type": "lease", "data": {"what": "taken"}},
        ],
    }
    for level, events in levels.items():
        found = f"import('/panel/log.js').then((all) => {json.dumps(events)}.map(all.levelOf))"
        assert panel.page.run(found) == [level] * len(events)


NAMELESS = """
[...document.querySelectorAll("button, input, textarea, select, progress, a, [role=meter]")]
.filter((each) => {
    const named = each.getAttribute("aria-label") || each.innerText?.trim() || each.labels?.length;
    return !named;
}).map((each) => each.outerHTML)
"""
CONTRAST = """
(() => {
    const numbers = (colour) => colour.match(/[\\d.]+/g).map(Number);
    const luminance = (colour) => {
        const [r, g, b] = numbers(colour).slice(0, 3).map((value) => {
            const share = value / 255;
            return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
        });
        return 0.2126 * r + 0.7152 * g + 0.0722 * b;
    };
    const behind = (each) => {
        for (let node = each; node; node = node.parentElement) {
            const colour = getComputedStyle(node).backgroundColor;
            if ((numbers(colour)[3] ?? 1) > 0) return colour;
        }
        return "rgb(255, 255, 255)";
    };
    const poor = [];
    for (const each of document.querySelectorAll("body *")) {
        const own = [...each.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
        if (!own || !each.checkVisibility() || each.disabled || each.tagName === "OPTION") continue;
        const both = [getComputedStyle(each).color, behind(each)].map(luminance);
        const [one, other] = both.sort((a, b) => b - a);
        const ratio = (one + 0.05) / (other + 0.05);
        if (ratio < 4.5) poor.push(`${each.tagName} ${each.textContent.trim()}: ${ratio.toFixed(2)}`);
    }
    return poor;
})()
"""


VIOLATIONS = """
axe.run(document, {resultTypes: ["violations"], ...$MORE}).then((found) => found.violations.map((each) => {
    const where = each.nodes.map((node) => `${node.html} ${node.failureSummary}`);
    return `${each.id} (${each.impact}): ${each.help}: ${where.join("; ")}`;
}))
"""


@pytest.fixture(scope="module")
def axe() -> str:
    """The script of axe-core. What brings it along would import a browser's driver, so it is not imported."""
    spec = find_spec("axe_playwright_python")
    if spec is None or not spec.submodule_search_locations:
        pytest.skip("axe-playwright-python is not installed: see requirements-peers.lock")
    return (Path(spec.submodule_search_locations[0]) / "axe.min.js").read_text(encoding="utf-8")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_in_any_view(panel: Panel, axe: str, scheme: str) -> None:
    """Oracle: all rules of axe-core, WCAG's and its own; in the dark those of colours."""
    panel.page.run(axe)
    rules = "{}" if scheme == "light" else "{runOnly: ['color-contrast']}"

    found: dict[str, list[str]] = {}

    def look(view: str) -> None:
        if violations := panel.page.run(VIOLATIONS.replace("$MORE", rules)):
            found[view] = violations

    features = [{"name": "prefers-color-scheme", "value": scheme}]
    panel.page.ask("Emulation.setEmulatedMedia", features=features)
    try:
        look("as it opens")
        planned(panel, "work")
        panel.page.run("cobotPanel.view.preview(null)")  # else the ghost is drawn all the time
        panel.page.click("#teach")
        drop(panel, "#csv-why", "fast.csv", rows_of([0.0, 0.05], [0.1, 4.0]))
        panel.until("document.querySelectorAll('#csv-plots .beyond').length")
        body = {"joints": [0.4, *HOME[1:]], "speed": 0.5}
        plan = httpx.post(f"{panel.run.url}/robot/plan/joints", json=body, timeout=WAIT_S).json()["plan_id"]
        panel.until(f"document.querySelector('[data-plan=\"{plan}\"]')")
        panel.page.run("document.querySelectorAll('details').forEach((each) => (each.open = true))")
        panel.until("document.querySelector('#io-Output button')")
        look("with all cards open and full")
        panel.page.run(
            "for (const each of ['banner', 'stop-why', 'contact', 'token-form', 'queue']) "
            "document.querySelector(`#${each}`).hidden = false"
        )
        panel.page.run("cobotPanel.banner.show({mode: 'FAULT', reason: 'a drive fails'})")
        panel.page.run("new cobotPanel.tabs.constructor([{name: 'one'}, {name: 'two'}], () => {})")
        panel.page.run("document.body.toggleAttribute('data-silent', true)")
        look("with all that can be said at once, and two robots")
        size(panel, 768, 1024, mobile=True)
        look("on a tablet")
        assert not found, json.dumps(found, indent=1)
    finally:
        size(panel, *SIZE)
        panel.page.ask("Emulation.setEmulatedMedia", features=[])
        panel.page.run("localStorage.clear()")
        panel.load()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_has_a_name_and_can_be_read(panel: Panel, scheme: str) -> None:
    """WCAG 2.1: 4.1.2 (names), 1.4.3 (a contrast of 4.5), 2.5.5 (targets); on a tablet nothing is cut off."""
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    panel.page.ask("Emulation.setEmulatedMedia", features=features)
    panel.page.run("document.querySelector('#banner').hidden = false")
    panel.page.run("document.querySelectorAll('details').forEach((each) => (each.open = true))")
    panel.until("document.querySelector('#io-Output button')")
    try:
        assert panel.page.run(NAMELESS) == []
        assert panel.page.run(CONTRAST) == []
        small = "filter((each) => each.checkVisibility() && each.offsetHeight < 32)"
        assert panel.page.run(f"[...document.querySelectorAll('button')].{small}.length") == 0
        size(panel, 768, 1024, mobile=True)
        assert panel.page.run("document.documentElement.scrollWidth <= innerWidth")
    finally:
        panel.page.run("document.querySelector('#banner').hidden = true")
        panel.page.run("document.querySelectorAll('details').forEach((each) => (each.open = false))")
        panel.page.ask("Emulation.setEmulatedMedia", features=[])
        size(panel, *SIZE)
