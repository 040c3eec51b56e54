"""The operator panel in a headless Chromium, as a person uses it; the arm's reaction is asked of REST.

With COBOT_PICTURES=FOLDER it writes the documents' picture of the panel there.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import jsonschema_rs
import numpy as np
import pytest
from chromium import CHROMIUM, Page, browsing
from running import WAIT_S, Run, until
from scipy.interpolate import CubicSpline
from streaming_client import StreamClient
from websockets.sync.client import connect

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
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
        width, height = SIZE
        page.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
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


@pytest.fixture(scope="module")
def opened(service: Run, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    folder = tmp_path_factory.mktemp("browser")
    with browsing(folder, "--enable-unsafe-swiftshader", "--lang=en") as tools:
        yield Panel(Page(tools), service)


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


def test_a_step_moves_by_just_that(panel: Panel) -> None:
    panel.page.run("document.querySelector('#jog-how').value = 'middle'")
    try:
        panel.page.click(button("joint", 0, 1))
        until(lambda: abs(panel.run.joints()[0] - np.radians(2.0)) < 1e-3)
        until(panel.rests)
        panel.until("!cobotPanel.jog.pending")
        before = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]["x"]
        panel.page.click(button("tcp", 0, -1))
        panel.until("!cobotPanel.jog.pending")
        until(panel.rests)
        after = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]["x"]
        assert after - before == pytest.approx(-0.01, abs=2e-3)
    finally:
        panel.page.run("document.querySelector('#jog-how').value = 'hold'")


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
    folder = os.environ.get("COBOT_PICTURES")
    if folder:
        panel.page.picture(Path(folder) / "panel.png")
    panel.page.click("#execute")
    panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
    goals = {each["name"]: each["joints"] for each in httpx.get(f"{panel.run.url}/robot/positions").json()}
    np.testing.assert_allclose(panel.run.joints(), goals["work"], atol=5e-3)


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
        panel.page.click("#stop")
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
    panel.page.click("#points-show")
    panel.until("!document.querySelector('#execute').disabled")
    panel.page.click("#execute")
    panel.until("document.querySelector('#plan').innerText === 'The arm has arrived.'")
    position = httpx.get(f"{panel.run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    sequence = panel.page.run("cobotPanel.waypoints.sequence()")
    last = sequence["waypoints"][2]
    assert last.get("planner") == "lin", f"the second one was moved to the end: {sequence}"
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
    drop(panel, "#points", "a.json", '{"waypoints": [{"named": "work"}]}')
    panel.until("document.querySelector('#points-why').innerText.includes('POST /sequences/start')")
    assert panel.page.run("document.querySelectorAll('#points li').length") == 3
    panel.page.run("localStorage.clear()")


NAMELESS = """
[...document.querySelectorAll("button, input, select, progress, a, [role=meter]")].filter((each) => {
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


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_has_a_name_and_can_be_read(panel: Panel, scheme: str) -> None:
    """WCAG 2.1: 4.1.2 (names), 1.4.3 (a contrast of 4.5), 2.5.5 (targets); on a tablet nothing is cut off."""
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    panel.page.ask("Emulation.setEmulatedMedia", features=features)
    panel.page.run("document.querySelector('#banner').hidden = false")
    try:
        assert panel.page.run(NAMELESS) == []
        assert panel.page.run(CONTRAST) == []
        small = "filter((each) => each.checkVisibility() && each.offsetHeight < 32)"
        assert panel.page.run(f"[...document.querySelectorAll('button')].{small}.length") == 0
        panel.page.ask(
            "Emulation.setDeviceMetricsOverride", width=768, height=1024, deviceScaleFactor=1, mobile=True
        )
        assert panel.page.run("document.documentElement.scrollWidth <= innerWidth")
    finally:
        panel.page.run("document.querySelector('#banner').hidden = true")
        panel.page.ask("Emulation.setEmulatedMedia", features=[])
        width, height = SIZE
        panel.page.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
