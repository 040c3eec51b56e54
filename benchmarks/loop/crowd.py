"""Three robots next to two busy loops on one computer: which cycles are late, and whether cobot's cycles are
the cause.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from cobot_run import Pair, answering, unique_name

from benchmarks.loop.cycle import bare_cycles_us
from benchmarks.loop.idle import busy
from benchmarks.loop.modes import LONG_US
from benchmarks.service import histograms
from benchmarks.table import Row, row
from cobot.ipc.layout import Phase
from cobot.ipc.shm import MemoryRole, RobotMemory

COLUMNS = ("cycles that computed 1 ms or more, of a million", "longest, ms")


def crowd(duration_s: float) -> Iterator[Row]:
    """Measure at rest for this time, then measure a bare loop next to the same two busy loops for a sixth of
    this time.
    """
    third = unique_name()
    with (
        tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder,
        answering(Three(Path(folder), third)) as run,
    ):
        memories = [RobotMemory.attach(name, MemoryRole.READER) for name in (run.left, run.right, third)]
        with busy(2):
            before = [histograms(memory) for memory in memories]
            overruns = [int(memory.state.read()["overruns"]) for memory in memories]
            time.sleep(duration_s)
            counts = sum(histograms(memory) - old for memory, old in zip(memories, before, strict=True))
            missed = [
                int(memory.state.read()["overruns"]) - old
                for memory, old in zip(memories, overruns, strict=True)
            ]
            longest = max(float(memory.statistics.read()["max_us"][Phase.TOTAL]) for memory in memories)
    with busy(2):
        floor = np.array(bare_cycles_us(duration_s / 6.0))
    total = np.asarray(counts)[Phase.TOTAL]
    yield row(
        f"three robots at rest beside two busy loops, {duration_s:g} s; periods missed {missed}",
        "",
        (1e6 * float(total[LONG_US:].sum()) / float(total.sum()), longest / 1e3),
        "bare loop: Ruckig, mj_step, copy",
        (max(1e6 * float((floor >= LONG_US).mean()), 1e-9), float(floor.max()) / 1e3),
        columns=COLUMNS,
        aim="not above the bare loop's",
    )


class Three(Pair):
    """A `cobot run` of three robots in real time."""

    def __init__(self, folder: Path, third: str) -> None:
        super().__init__(folder, f"}}, {{name: {third}")

    def healthy(self) -> bool:
        robots = (self.health() or {"robots": {}})["robots"]
        assert isinstance(robots, dict)
        return len(robots) == 3 and all(each["status"] == "ok" for each in robots.values())
