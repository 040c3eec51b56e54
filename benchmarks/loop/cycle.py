"""The 1 kHz cycle: its computing time, and how late it begins."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from cobot_run import Run

from benchmarks.service import from_histogram, histograms, reader, service
from benchmarks.table import Row, percentiles, row
from cobot.client import Client
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Phase

WARM_UP_S = 1.5
CYCLICTEST = ("cyclictest", "--quiet", "--mlockall", "--interval=1000", "--threads=1")


def compute(slices: int, slice_s: float) -> Iterator[Row]:
    """Compute time per cycle while the arm moves, in slices that alternate with a bare loop's."""
    phases = (Phase.READ, Phase.UPDATE, Phase.WRITE, Phase.TOTAL)
    counts = np.zeros((len(Phase), HISTOGRAM_BUCKETS), np.int64)
    floor: list[float] = []
    with service() as run, Moving(run):
        memory = reader(run)
        for _ in range(slices):
            time.sleep(WARM_UP_S)
            before = histograms(memory)
            time.sleep(slice_s)
            counts += histograms(memory) - before
            with stopped(run):
                floor += bare_cycles_us(slice_s)
    for phase in phases:
        aim = "50 / 120 / 200" if phase is Phase.TOTAL else ""
        name = f"rtloop compute time a cycle, {phase.name.lower()}"
        bare = "bare loop: Ruckig, mj_step, copy"
        yield row(name, "µs", from_histogram(counts[phase]), bare, percentiles(floor), aim=aim)


def wake_up(slices: int, slice_s: float) -> Iterator[Row]:
    """Delays of cycles, in slices that alternate with those of cyclictest at the same priority."""
    if shutil.which(CYCLICTEST[0]) is None:
        print("wake-up: cyclictest is not installed (Debian: rt-tests)")
        return
    ours = np.zeros(HISTOGRAM_BUCKETS, np.int64)
    floor = np.zeros(HISTOGRAM_BUCKETS, np.int64)
    with service() as run, Moving(run):
        memory = reader(run)
        real_time = bool(memory.statistics.read()["sched_fifo"])
        policy = ("--policy=fifo", f"--priority={load_settings(None).rt.priority}")
        for _ in range(slices):
            time.sleep(WARM_UP_S)
            before = histograms(memory)[Phase.WAKEUP]
            time.sleep(slice_s)
            ours += histograms(memory)[Phase.WAKEUP] - before
            with stopped(run):
                floor += _cyclictest(slice_s, policy if real_time else ("--policy=other",))
    against = f"cyclictest, {'SCHED_FIFO' if real_time else 'no real-time permission'}"
    yield row(
        "wake-up latency of a cycle",
        "µs",
        from_histogram(ours),
        against,
        from_histogram(floor),
        ratio_of="p99",
        aim="1.5 times at p99",
    )


def _cyclictest(duration_s: float, policy: tuple[str, ...]) -> np.ndarray:
    output = subprocess.run(
        [*CYCLICTEST, *policy, f"--duration={round(duration_s)}", f"--histogram={HISTOGRAM_BUCKETS}"],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    counts = np.zeros(HISTOGRAM_BUCKETS, np.int64)
    for line in output.splitlines():
        if line and line[0].isdigit():
            bucket, count = line.split()[:2]
            counts[int(bucket)] += int(count)
        elif line.startswith("# Histogram Overflows:"):
            counts[-1] += int(line.split()[-1])
    return counts


def bare_cycles_us(duration_s: float) -> list[float]:
    command = [sys.executable, "-m", "benchmarks.loop.bare_cycle", str(duration_s)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return [int(line) / 1000 for line in output.split()]


@contextlib.contextmanager
def stopped(run: Run) -> Iterator[None]:
    """Context manager during which rtloop is suspended, so that its floor can be measured."""
    child = run.child("rtloop")
    assert child is not None
    child.suspend()
    try:
        yield
    finally:
        child.resume()


class Moving:
    """Keeps the arm moving between two positions, even if single motions fail.

    Args:
        how: more fields of each motion.
    """

    def __init__(self, run: Run, **how: Any) -> None:
        self._url, self._how = run.url, how
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._move, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def _move(self) -> None:
        with Client(self._url, motion_timeout_s=30.0) as robot:
            while not self._end.is_set():
                for name in ("work", "home"):
                    try:
                        robot.move_named(name, speed=0.3, **self._how)
                    except CobotError:
                        time.sleep(0.1)  # stopped while rtloop was: the next one follows
