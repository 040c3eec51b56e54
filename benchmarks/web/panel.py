"""The operator panel in a browser: the time until it is shown, its frame rate, its cost for the service, the
delay of events, and the memory of the service while the panel is open.
"""

from __future__ import annotations

import contextlib
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
from chromium import CHROMIUM, Page, browsing
from cobot_run import Run

from benchmarks.loop.recording import process, shares
from benchmarks.service import reader, service
from benchmarks.table import Row, percentiles, row
from benchmarks.web.answers import motion, until_cruising
from benchmarks.web.pages import shown
from cobot.client import Client
from cobot.ipc.shm import RobotMemory
from cobot.types import LoopMode

SOFTWARE = "--enable-unsafe-swiftshader"
HEARD = """
window.heard = [];
new EventSource("/events?types=mode").addEventListener("mode", (event) =>
    heard.push([JSON.parse(event.data).data.mode, performance.timeOrigin + performance.now()]));
"""
SLOWLY = 0.05
MEMORY_EVERY_S = 5.0


def panel(repetitions: int, duration_s: float, memory_s: float) -> Iterator[Row]:
    """Nothing where there is no Chromium.

    Args:
        repetitions: pages that are opened, and motions whose events are waited for.
        duration_s: of drawing, and of the shares of a core.
        memory_s: over which the memory is looked at, while a panel is open and the arm moves now and then.
    """
    if CHROMIUM is None:
        return
    with service() as run:
        painted = [shown(f"{run.url}/", "[data-position]", SOFTWARE) for _ in range(repetitions)]
        floor = [shown(f"{run.url}/health", "pre")[1] for _ in range(repetitions)]
        for index, what in enumerate(("first paint", "the arm's positions are there")):
            yield row(
                f"the panel in headless Chromium, until {what}",
                "ms",
                percentiles([each[index] for each in painted]),
                "a page of JSON",
                percentiles(floor),
                ratio_of="p50",
                aim="1500 ms",
            )
        yield drawing(run, duration_s)
        yield from _open(run, repetitions, memory_s)


def drawing(run: Run, duration_s: float, what: str = "one panel open") -> Row:
    """The frame rate of a panel while the arm moves to its position "work", and its cost."""
    processes = [process(run, "app"), process(run, "rtloop")]
    alone = shares(processes, duration_s)
    with panel_of(run) as page, Client(run.url, motion_timeout_s=120.0) as robot:
        with motion(robot, "work", SLOWLY):
            until_cruising(reader(run))
            frames, begun_s = page.run("cobotPanel.view.frames"), time.monotonic()
            beside = shares(processes, duration_s)
            drawn = (page.run("cobotPanel.view.frames") - frames) / (time.monotonic() - begun_s)
            robot.stop()
        return row(
            f"{what} while the arm moves: {drawn:.1f} pictures/s, drawn in software",
            "",
            beside,
            "no panel, the arm at rest",
            alone,
            columns=("share of a core, service", "share of a core, rtloop"),
            aim="20 pictures/s, 0.1 more of the service",
        )


@contextlib.contextmanager
def panel_of(run: Run) -> Iterator[Page]:
    """A browser with the panel, in which the arm is visible."""
    with (
        tempfile.TemporaryDirectory(prefix="cobot-chromium-") as folder,
        browsing(Path(folder), SOFTWARE) as tools,
    ):
        page = Page(tools)
        page.visit(f"{run.url}/")
        while not page.run("!!window.cobotPanel?.view?.looks.size && !!cobotPanel.state"):
            time.sleep(0.1)
        yield page


def _open(run: Run, repetitions: int, memory_s: float) -> Iterator[Row]:
    """Measure with one open panel."""
    with panel_of(run) as page, Client(run.url, motion_timeout_s=120.0) as robot:
        yield row(
            "a mode that changes in rtloop to a page's EventSource",
            "ms",
            percentiles(_latencies(page, run, repetitions)),
            "half of how often the service looks, and all of it",
            (5.0, 10.0, 10.0),
            ratio_of="p99",
        )
        yield _memory(run, process(run, "app"), robot, memory_s)


def _latencies(page: Page, run: Run, repetitions: int) -> list[float]:
    """Times from the publication of each mode to its event in the page, ms."""
    seen: list[tuple[str, float]] = []
    ended = threading.Event()
    memory = reader(run)
    looking = threading.Thread(target=_look, args=(memory, seen, ended), daemon=True)
    page.run(HEARD)
    time.sleep(1.0)
    looking.start()
    with Client(run.url, motion_timeout_s=30.0) as mover, Client(run.url) as stopper:
        for repetition in range(repetitions):
            with motion(mover, ("work", "home")[repetition % 2]):
                until_cruising(memory)
                stopper.stop()
    time.sleep(1.0)
    ended.set()
    heard = page.run("heard")
    assert [mode for mode, _ in seen] == [mode for mode, _ in heard], "none is missed, none comes twice"
    return [later_ms - now_ms for (_, now_ms), (_, later_ms) in zip(seen, heard, strict=True)]


def _look(memory: RobotMemory, seen: list[tuple[str, float]], ended: threading.Event) -> None:
    """Record each mode with its publication time in ms since 1970, as a page's clock counts."""
    mode = int(memory.state.read()["mode"])
    while not ended.wait(2e-4):
        state = memory.state.read()
        if int(state["mode"]) != mode:
            mode = int(state["mode"])
            ago_ns = time.monotonic_ns() - int(state["monotonic_ns"])
            seen.append((LoopMode(mode).name, (time.time_ns() - ago_ns) / 1e6))


def _memory(run: Run, app: psutil.Process, robot: Client, duration_s: float) -> Row:
    """Median of the resident memory in the first and in the last third of the time."""
    seen: list[tuple[float, float]] = []
    rtloop, recorder = process(run, "rtloop"), process(run, "cobot.recorder")
    begun_s, number = time.monotonic(), 0
    while time.monotonic() < begun_s + duration_s:
        robot.move_named(("work", "home")[number % 2], speed=0.5)
        number += 1
        sizes = [each.memory_info().rss / 1e6 for each in (app, rtloop, recorder)]
        seen.append((sizes[0], sum(sizes[1:])))
        time.sleep(MEMORY_EVERY_S)
    third = max(len(seen) // 3, 1)
    first, last = (
        [sorted(column)[third // 2] for column in zip(*part, strict=True)]
        for part in (seen[:third], seen[-third:])
    )
    return row(
        f"resident memory after {duration_s:.0f} s with a panel open and {number} motions, the last third",
        "MB",
        last,
        "the first third",
        first,
        columns=("service", "rtloop and recorder"),
        ratio_of="service",
        aim="flat",
    )
