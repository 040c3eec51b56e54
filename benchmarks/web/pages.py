"""The time that people wait: for Swagger's pages in a browser, and for a long CSV file until it moves the
arm.
"""

from __future__ import annotations

import io
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from chromium import CHROMIUM, Page, browsing

from benchmarks.service import service
from benchmarks.table import Row, percentiles, row
from cobot.client import Client
from cobot.types import Array

GROUP = ".opblock-tag-section"
PAGES = {"/docs": GROUP, "/docs/robots": GROUP, "/docs/vendor": GROUP, "/redoc": "h1"}
"""What a page shows once it can be used."""
WATCH = """new MutationObserver(() => {{
  if (!window.shown_ms && document.querySelector("{selector}")) window.shown_ms = performance.now();
}}).observe(document, {{childList: true, subtree: true}})"""
SHOWN = """new Promise(end => {
  const look = () => window.shown_ms ? end([
    performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? window.shown_ms, window.shown_ms
  ]) : setTimeout(look, 5);
  look();
})"""
ROWS, STEP_S, DECIMALS = 50_000, 0.002, 6
SWAY_RAD = np.array([0.5, 0.3, 0.4, 0.3, 0.5, 0.3, 0.6])


def documentation(repetitions: int) -> Iterator[Row]:
    """The time from the request of a page to its first paint and to its first group, each in a new browser.
    Yields nothing without Chromium.
    """
    if CHROMIUM is None:
        return
    with service() as run:
        found = {
            path: [shown(run.url + path, what) for _ in range(repetitions)] for path, what in PAGES.items()
        }
        floor = [shown(f"{run.url}/health", "pre")[1] for _ in range(repetitions)]
    for path, times_ms in found.items():
        for index, what in enumerate(("first paint", "its first group is there")):
            yield row(
                f"{path} in headless Chromium, until {what}",
                "ms",
                percentiles([each[index] for each in times_ms]),
                "a page of JSON",
                percentiles(floor),
                ratio_of="p50",
                aim="1000 ms",
            )


def shown(url: str, selector: str, *options: str) -> tuple[float, float]:
    """Times in a new browser from the request, ms: to the first paint, and to the first match of the
    selector.
    """
    with (
        tempfile.TemporaryDirectory(prefix="cobot-chromium-") as folder,
        browsing(Path(folder), *options) as tools,
    ):
        page = Page(tools)
        page.ask("Page.enable")
        page.ask("Page.addScriptToEvaluateOnNewDocument", source=WATCH.format(selector=selector))
        page.ask("Page.navigate", url=url)
        paint_ms, shown_ms = page.run(SHOWN)
        return float(paint_ms), float(shown_ms)


def csv_upload(repetitions: int) -> Iterator[Row]:
    """The time from POST /trajectory/send_csv with 50,000 rows at 2 ms until the motion has begun."""
    ours, floor = [], []
    with service() as run, Client(run.url) as robot, tempfile.TemporaryDirectory() as folder:
        home = next(each["joints"] for each in robot.positions() if each["name"] == "home")
        file = Path(folder) / "long.csv"
        file.write_bytes(_csv(np.array(home)))
        robot.move_named("home", speed=1.0)
        for _ in range(repetitions):
            begun_s = time.monotonic()
            sent = robot.send_csv(file)
            ours.append(time.monotonic() - begun_s)
            assert sent["note"], "the jerk of the rounding is beyond the limits"
            robot.stop()
            robot.move_named("home", speed=1.0)
            begun_s = time.monotonic()
            np.loadtxt(io.BytesIO(file.read_bytes()), delimiter=",", skiprows=1)
            floor.append(time.monotonic() - begun_s)
    yield row(
        f"a CSV file of {ROWS:,} rows at 2 ms with six decimals, until the arm moves",
        "s",
        percentiles(ours),
        "numpy.loadtxt of it",
        percentiles(floor),
        ratio_of="p50",
        aim="3 s",
    )


def _csv(home: Array) -> bytes:
    """A CSV file with an oscillation around home, from rest to rest."""
    times_s = np.arange(ROWS) * STEP_S
    edge = np.clip(np.minimum(times_s, times_s[-1] - times_s) / 2.0, 0.0, 1.0)
    grown = edge**4 * (35.0 - 84.0 * edge + 70.0 * edge**2 - 20.0 * edge**3)
    joints = home + SWAY_RAD * grown[:, None] * np.sin(1.5 * times_s)[:, None]
    text = io.StringIO()
    header = ",".join([*(f"joint{n}" for n in range(1, len(home) + 1)), "t"])
    np.savetxt(text, np.column_stack([joints, times_s]), f"%.{DECIMALS}f", ",", header=header, comments="")
    return text.getvalue().encode()
