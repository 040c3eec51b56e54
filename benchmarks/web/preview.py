"""The time from the press of a position's button in the panel until its ghost is on the screen, among
shelves.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from chromium import CHROMIUM, Page

from benchmarks.planning.plan_requests import boxes_of
from benchmarks.planning.scenes import problems
from benchmarks.service import service
from benchmarks.table import Row, row
from benchmarks.web.panel import panel_of
from cobot.client import Client
from cobot.config import load_settings
from cobot.robot.description import load_robot

WATCH = """
window.watched = null;
document.addEventListener("click", () => {
    const begun = performance.now(), { view } = cobotPanel;
    let drawn = null, waited = 0;
    const look = () => {
        waited += 1;
        if (view.ghost) drawn ??= view.frames;
        if (drawn !== null && view.frames > drawn) window.watched = [performance.now() - begun, waited];
        else requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
}, { capture: true, once: true });
"""
"""The time in ms from the next click until a picture with the ghost is drawn, and its pictures."""
WAIT_S = 120.0


def preview(presses: int) -> Iterator[Row]:
    """Measure the previews. Yields nothing without Chromium."""
    if CHROMIUM is None:
        return
    robot = load_robot(load_settings(None))
    took_ms: list[float] = []
    planned_ms: list[float] = []
    with (
        service("fast") as run,
        panel_of(run) as page,
        Client(run.url, motion_timeout_s=120.0) as client,
    ):
        for problem in problems(robot, "shelf", presses):
            client.change_scene(clear=True)
            client.move_joints(problem.start.tolist(), speed=1.0, planner="auto")
            client.change_scene(objects=boxes_of(problem.robot))
            name = problem.name.replace(" ", "-")
            client.teach_position(name, problem.goal.tolist())
            button = f'[data-position="{name}"]'
            _until(page, f"!!document.querySelector('{button}') && !cobotPanel.view.ghost")
            page.run(WATCH)
            page.click(button)
            _until(page, "watched !== null")
            took_ms.append(page.run("watched[0]"))
            planned_ms.append(1e3 * page.run("cobotPanel.motions.plan.planning_time_s"))
            page.click("#discard")
    yield row(
        f"the panel's preview among shelves, {len(took_ms)} presses: from the press to the ghost",
        "ms",
        _three(took_ms),
        "planning_time_s of its plan",
        _three(planned_ms),
        columns=("p50", "p95", "max"),
    )


def _until(page: Page, condition: str) -> None:
    end_s = time.monotonic() + WAIT_S
    while not page.run(condition):
        if time.monotonic() > end_s:
            raise TimeoutError(f"{condition} is not true after {WAIT_S:g} s")
        time.sleep(0.02)


def _three(values: list[float]) -> tuple[float, ...]:
    return tuple(map(float, np.percentile(values, (50.0, 95.0, 100.0))))
