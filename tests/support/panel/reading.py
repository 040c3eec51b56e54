"""Names, contrasts, sizes: whether everybody can use it."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import httpx
import pytest
from cobot_run import WAIT_S

from panel.page import (
    HOME,
    PICTURES,
    SIZE,
    Panel,
    drop,
    planned,
    rows_of,
    set_to,
    size,
)

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
        pytest.skip("axe-playwright-python is not installed: see requirements/peers.lock")
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
        panel.page.run("document.querySelectorAll('details.card').forEach((each) => (each.open = true))")
        panel.until("document.querySelector('#io-Output button')")
        look("with all cards open and full")
        panel.page.run(
            "for (const each of ['banner', 'stop-why', 'contact', 'token-form', 'queue-card']) "
            "document.querySelector(`#${each}`).hidden = false"
        )
        panel.page.run(
            "cobotPanel.banner.show({mode: 'FAULT', reason: 'a drive fails', reason_code: 'reading'})"
        )
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
    """WCAG 2.1: 4.1.2 (names), 1.4.3 (a contrast of 4.5), 2.5.5 (targets)."""
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    panel.page.ask("Emulation.setEmulatedMedia", features=features)
    panel.page.run("document.querySelector('#banner').hidden = false")
    panel.page.run(
        "document.querySelectorAll('details.card, details.menu').forEach((each) => (each.open = true))"
    )
    panel.until("document.querySelector('#io-Output button')")
    try:
        assert panel.page.run(NAMELESS) == []
        assert panel.page.run(CONTRAST) == []
        small = "filter((each) => each.checkVisibility() && each.offsetHeight < 32)"
        assert panel.page.run(f"[...document.querySelectorAll('button')].{small}.length") == 0
    finally:
        panel.page.run("document.querySelector('#banner').hidden = true")
        panel.page.run(
            "document.querySelectorAll('details.card, details.menu').forEach((each) => (each.open = false))"
        )
        panel.page.ask("Emulation.setEmulatedMedia", features=[])
        size(panel, *SIZE)


CUT = """
[...document.querySelectorAll(".card button, .card select, .card input, header button")]
.filter((each) => each.checkVisibility()).filter((each) => {
    const [own, card] = [each, each.closest(".card, header")].map((one) => one.getBoundingClientRect());
    return own.left < card.left || own.right > Math.min(card.right, innerWidth);
}).map((each) => each.outerHTML)
"""
COVERED = """
(([view, dock]) => view.height < 150
    || (view.bottom > dock.top + 1 && view.right > dock.left && view.top < dock.top))
(["#view canvas", "#dock"].map((each) => document.querySelector(each).getBoundingClientRect()))
"""
PAGES = ("move", "program", "run", "diagnose", "setup")
PARTS = ("scene", "robot", "service", "people", "tool")
"""Of the page Setup; the last is the one that it opens with."""
SCROLLS = "(e => e.scrollHeight > e.clientHeight + 1)(document.querySelector('#side'))"


@pytest.mark.parametrize(("width", "height"), [SIZE, (1024, 768), (768, 1024), (390, 844)])
def test_nothing_is_cut_off_or_covered_in_the_longest_words(panel: Panel, width: int, height: int) -> None:
    """On a screen, on a tablet both ways and on a phone; with waypoints, whose rows are the widest."""
    set_to(panel, "#language", "de")
    panel.page.click("#teach")
    size(panel, width, height, mobile=width < SIZE[0])
    try:
        panel.page.run("document.querySelectorAll('details.card').forEach((each) => (each.open = true))")
        for name in (*PAGES, *PARTS):
            panel.page.click(f"#tab-{name}")
            if name == "diagnose":
                panel.until("document.querySelector('#io-Output button')")
            if width > 960 or name not in ("setup", *PARTS):
                panel.until(f"!({COVERED})")
            assert panel.page.run(CUT) == [], name
            assert panel.page.run("document.documentElement.scrollWidth <= innerWidth"), name
            assert panel.page.run("(e => e.scrollWidth <= e.clientWidth)(document.querySelector('#side'))"), (
                name
            )
    finally:
        size(panel, *SIZE)
        panel.page.run("localStorage.clear()")
        panel.load()


HEIGHT = "document.querySelector('#dock').offsetHeight"


@pytest.mark.parametrize(("width", "height"), [SIZE, (1024, 768), (390, 844)])
def test_a_long_text_moves_no_button_of_the_dock(panel: Panel, width: int, height: int) -> None:
    """A plan's text and a failure's reason of one word, and of ten lines."""
    size(panel, width, height, mobile=width < SIZE[0])
    write = "document.querySelector('{}').textContent = 'word '.repeat({})"
    try:
        for name in PAGES:
            panel.page.click(f"#tab-{name}")
            for place in ("#plan", "#job-error"):
                panel.page.run(write.format(place, 1))
                before = panel.page.run(HEIGHT)
                panel.page.run(write.format(place, 300))
                assert panel.page.run(HEIGHT) == before, (name, place)
                panel.page.run(write.format(place, 0))
    finally:
        size(panel, *SIZE)
        panel.page.click("#tab-move")
        panel.page.run("cobotPanel.motions.discard(), cobotPanel.job.write()")


def test_no_page_scrolls_on_a_screen(panel: Panel) -> None:
    """At 1280 x 800, as each page opens."""
    for name in (*PAGES, *PARTS):
        panel.page.click(f"#tab-{name}")
        assert (
            panel.page.run("document.querySelectorAll('#side > [role=tabpanel]:not([hidden])').length") == 1
        )
        parts = panel.page.run("document.querySelectorAll('.part:not([hidden])').length")
        assert parts == 1, "of the page Setup"
        assert not panel.page.run(SCROLLS), name
        if PICTURES:
            panel.page.run("cobotPanel.halt.clear()")
            panel.page.picture(Path(PICTURES) / f"panel-{name}.png")
    panel.page.run("document.querySelector('#tab-setup').focus()")
    panel.page.key("Home", "Home")
    assert panel.page.run("document.body.dataset.page") == "move"
    panel.page.key("ArrowRight", "ArrowRight")
    panel.load()
    assert panel.page.run("document.body.dataset.page") == "program", "the browser keeps it"
    panel.page.click("#tab-move")


def test_a_long_joint_name_is_cut_and_covers_no_button(panel: Panel) -> None:
    label = "document.querySelector('#joints .row span')"
    name = panel.page.run(f"{label}.textContent")
    panel.page.run(f"{label}.textContent = 'a_joint_with_a_very_long_name'")
    cut = f"{label}.scrollWidth > {label}.clientWidth"
    beside = (
        f"{label}.getBoundingClientRect().right <= {label}.nextElementSibling.getBoundingClientRect().left"
    )
    assert panel.page.run(f"{cut} && {beside}")
    panel.page.run(f"{label}.textContent = {name!r}")
