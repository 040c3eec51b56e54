"""The panel with an arm whose description contains 20 MB of meshes: the time until it is shown, and its frame
rate.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from chromium import CHROMIUM, Page, browsing
from cobot_run import RunOfFolder, answering
from urdf_arms import ARMS, urdf

from benchmarks.service import service
from benchmarks.table import Row, percentiles, row
from benchmarks.web.panel import SOFTWARE, drawing
from cobot.client import Client

ABOUT, ALONG = 240, 121
"""Points about and along each housing: 57,600 triangles, 2.9 MB as STL. The arm has seven links."""
WATCH = """
const look = setInterval(() => {
  const view = window.cobotPanel?.view;
  if (!view?.arm || !view.looks.size) return;
  clearInterval(look);
  const drawn = () => (window.drawn_ms = performance.now());
  requestAnimationFrame(() => requestAnimationFrame(drawn)); // the picture after the change is drawn by then
}, 5);
"""
DRAWN = """new Promise((end) => {
  const look = () => (window.drawn_ms ? end(drawn_ms) : setTimeout(look, 5));
  look();
})"""


def looks(repetitions: int, duration_s: float) -> Iterator[Row]:
    """Nothing where there is no Chromium.

    Args:
        repetitions: pages that are opened.
        duration_s: of drawing, and of the shares of a core.
    """
    if CHROMIUM is None:
        return
    with tempfile.TemporaryDirectory(prefix="cobot-looks-") as name:
        source, made = Path(name) / "source", Path(name) / "made"
        size_mb = _describe(source) / 1e6
        begun_s = time.monotonic()
        command = [
            sys.executable,
            "-m",
            "cobot",
            "new-robot",
            str(source / "arm.urdf"),
            "--output",
            str(made),
        ]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        converted_s = time.monotonic() - begun_s
        with answering(RunOfFolder(made, "realtime")) as run, service() as shipped:
            yield row(
                f"the panel with {size_mb:.0f} MB of meshes, until the arm is drawn with them "
                f"(converted once, in {converted_s:.0f} s)",
                "ms",
                percentiles([_drawn(run.url) for _ in range(repetitions)]),
                "the shipped arm",
                percentiles([_drawn(shipped.url) for _ in range(repetitions)]),
                ratio_of="p50",
                aim="1500 ms",
            )
        with answering(RunOfFolder(made, "realtime")) as run:
            with Client(run.url) as robot:
                first, *others = robot.joint_states()["position"]
                robot.teach_position("work", [first + 1.5, *others])
            yield drawing(run, duration_s, f"one panel open with {size_mb:.0f} MB of meshes")


def _describe(folder: Path) -> int:
    """Write an arm with seven links and a mesh for each link. Returns the size of the meshes in bytes."""
    folder.mkdir()
    text = urdf(ARMS["srs"])
    total = 0
    for index in range(7):
        mesh = _housing(index)
        (folder / f"link{index}.stl").write_bytes(mesh)
        total += len(mesh)
        look = f'<visual><geometry><mesh filename="link{index}.stl"/></geometry></visual>'
        text = re.sub(rf'(<link name="link{index}">)', rf"\1{look}", text)
    (folder / "arm.urdf").write_text(text, encoding="utf-8")
    return total


def _housing(index: int) -> bytes:
    """A turned housing with ribs, as binary STL."""
    about, along = np.meshgrid(np.arange(ABOUT), np.arange(ALONG), indexing="ij")
    angle, height = 2.0 * np.pi * about / ABOUT, 0.25 * along / (ALONG - 1)
    radius = 0.05 + 0.004 * np.sin(40.0 * np.pi * height / 0.25) + 0.002 * np.sin((5 + index) * angle)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], -1)
    one, other = points[:, :-1], np.roll(points, -1, 0)[:, :-1]
    above, other_above = points[:, 1:], np.roll(points, -1, 0)[:, 1:]
    corners = np.concatenate(
        [np.stack(each, -2).reshape(-1, 3, 3) for each in ((one, other, above), (other, other_above, above))]
    )
    facets = np.zeros(len(corners), np.dtype([("numbers", "<f4", (4, 3)), ("colour", "<u2")]))
    facets["numbers"][:, 1:] = corners
    return bytes(80) + np.uint32(len(facets)).tobytes() + facets.tobytes()


def _drawn(url: str) -> float:
    """The time from the request of the panel in a new browser to the first picture of the arm with its
    meshes, ms.
    """
    with (
        tempfile.TemporaryDirectory(prefix="cobot-chromium-") as folder,
        browsing(Path(folder), SOFTWARE) as tools,
    ):
        page = Page(tools)
        page.ask("Page.enable")
        page.ask("Page.addScriptToEvaluateOnNewDocument", source=WATCH)
        page.ask("Page.navigate", url=f"{url}/")
        return float(page.run(DRAWN))
