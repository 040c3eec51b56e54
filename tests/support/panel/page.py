"""The page of the panel in a headless Chromium, the service behind it, and what a person does with it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from chromium import CHROMIUM, LeftPageError, Page, browsing
from cobot_run import WAIT_S, Run, answering, until

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]


MOVED_RAD = 0.02


SIZE = (1280, 800)


PICTURES = os.environ.get("COBOT_PICTURES")


# Chromium would draw the arm 60 times a second, by the processor: as it is looked at by nobody, it is drawn
# less often, and coarsely.
COARSE = () if PICTURES else ("--webgl-antialiasing-mode=none",)
SCALE = 1 if PICTURES else 0.5
DRAW_SELDOM = (
    ""
    if PICTURES
    else """
{
    const soon = requestAnimationFrame;
    window.requestAnimationFrame = (draw) => setTimeout(() => soon(draw), 100);
}
"""
)


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


UNNAMED = """
try {
    const asked = sessionStorage.getItem("askName") || localStorage.getItem("cobot.name") !== null;
    if (!asked) localStorage.setItem("cobot.name", "");
    if (!sessionStorage.getItem("askName")) localStorage.setItem("cobot.guide", "seen");
} catch { /* a page without a storage */ }
"""
"""The page does not ask for the person's name and does not show the guide."""


CONTROLS = """
(() => {
    const controls = "button, input, select, textarea, summary";
    const named = (control) => {
        const own = control.matches("summary") ? control.parentElement : control;
        if (own.id || own.dataset.field) return own.id || own.dataset.field;
        if (own.dataset.add) return `add ${own.dataset.add}`;
        const row = own.closest("li, .row");
        const place = row ? [...row.querySelectorAll(controls)].indexOf(own) + 1 : "";
        return `${own.closest("[id]").id} ${own.localName} ${place}`.trim();
    };
    window.lookForControls = () => {
        for (const each of document.querySelectorAll(controls)) toldSeen(named(each));
    };
    for (const kind of ["click", "change"]) {
        addEventListener(kind, (event) => {
            const control = event.target.closest?.(controls);
            if (!control || !event.isTrusted) return;
            toldOperated(named(control));
            lookForControls();
        }, true);
    }
})();
"""
"""Of each control of the page its id, or where it is made: told when it is there, and when a hand, a key or a
finger has pressed or changed it. What a script does is no use of it.
"""


CELL = {"cell-reset"} | {f"gripper-{name}" for name in ("open", "grasp", "stop", "home", "width", "force")}
"""Used in tests/e2e/test_panel_cell.py; the robot of these tests has neither a gripper nor loose parts."""
PEOPLE = {f"people-{each}" for each in ("name", "role", "days", "add", "new", "copy", "done")}
"""Used in tests/e2e/test_access.py; the service of these tests needs no token."""
ELSEWHERE = {"robots button"} | CELL | PEOPLE
"""The button is used in tests/e2e/realtime/test_several_robots.py."""


SEEN: set[str] = set()


OPERATED: set[str] = set()


class Panel:
    """The page, and the service behind it."""

    def __init__(self, page: Page, run: Run) -> None:
        self.page, self.run = page, run
        size(self, *SIZE)
        page.ask("Page.enable")
        page.ask("Page.addScriptToEvaluateOnNewDocument", source=DRAW_SELDOM + UNNAMED + WATCH + CONTROLS)
        page.bind("toldOperated", OPERATED.add)
        page.bind("toldSeen", SEEN.add)
        self.load()

    def load(self) -> None:
        """Until the arm is drawn and states come."""
        self.page.visit(f"{self.run.url}/")
        self.until(
            "window.cobotPanel?.view?.arm && cobotPanel.view.joints"
            " && document.querySelector('[data-position]')"
        )
        if PICTURES:  # in place of a name that is unique on this computer
            self.page.run("document.querySelector('#robot-name').textContent = 'iiwa'")

    def until(self, script: str) -> Any:
        def holds() -> bool:
            try:
                return bool(self.page.run(f"!!({script})"))
            except LeftPageError:
                return False

        return until(
            holds,
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
            if not self.page.run("!!cobotPanel.jog.held") or "Release the button" in self.text("#jog-why"):
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
    how = {"width": width, "height": height, "deviceScaleFactor": SCALE, "mobile": mobile}
    panel.page.ask("Emulation.setDeviceMetricsOverride", **how)


@pytest.fixture(scope="module")
def opened(service: Run, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Panel]:
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    folder = tmp_path_factory.mktemp("browser")
    with browsing(folder, "--enable-unsafe-swiftshader", "--lang=en", *COARSE) as tools:
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


def newest(panel: Panel, value: str) -> Any:
    """Wait for a state, and read a value from it. On a busy computer no state may arrive for a while."""
    found = []

    def read() -> bool:
        found[:] = [panel.page.run(f"cobotPanel.state?.{value}")]
        return found[0] is not None

    until(read)
    return found[0]


def commanded(panel: Panel) -> list[float]:
    return list(newest(panel, "commanded_position"))


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


def planned(panel: Panel, name: str) -> None:
    panel.page.click(f'[data-position="{name}"]')
    panel.until("!document.querySelector('#execute').disabled")


def slowly(panel: Panel) -> None:
    """The arm goes to "work", for a minute or so."""
    body = {"points": [{"positions": [0.6, *HOME[1:]], "time_from_start": 60.0}]}
    httpx.post(f"{panel.run.url}/trajectory/send", json=body, timeout=WAIT_S).raise_for_status()
    until(lambda: panel.mode() == "TRAJECTORY")


def set_to(panel: Panel, selector: str, value: str) -> None:
    """By the keyboard, as a person does."""
    panel.page.set_to(selector, value)


def opened_card(panel: Panel, card: str) -> None:
    if not panel.page.run(f"document.querySelector('#{card}').open"):
        panel.page.click(f"#{card} > summary")


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


def is_at(panel: Panel, joints: list[float]) -> bool:
    return bool(np.abs(np.subtract(panel.run.joints(), joints)).max() < 5e-3)
