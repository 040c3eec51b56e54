"""The cost of rtloop while its arm is at rest: its share of a core, and its memory."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Iterator

import psutil

from benchmarks.loop.cycle import stopped
from benchmarks.service import reader, service
from benchmarks.table import Row, row

COLUMNS = ("share of a core", "memory, MB")
"""The memory is the proportional set size: forked processes share pages, which count once in their total."""
BUSY = "while True: pass"


def idle(slice_s: float) -> Iterator[Row]:
    """Measure the mode HOLD, in slices that alternate with those of a bare loop: alone, and next to two busy
    loops.
    """
    with service() as run:
        memory = reader(run)
        process = run.child("rtloop")
        assert process is not None
        time.sleep(2.0)
        for name, loops in (("quiet", 0), ("beside two busy loops", 2)):
            with busy(loops):
                overruns = int(memory.state.read()["overruns"])
                ours = _share(process, slice_s)
                missed = int(memory.state.read()["overruns"]) - overruns
                with stopped(run):
                    bare, bare_mb = _bare(slice_s)
            memory_mb = process.memory_full_info().pss / 1e6
            yield row(
                f"an idle rtloop, {name}; {missed} of {round(1000 * slice_s)} periods missed",
                "",
                (ours, memory_mb),
                "bare loop: Ruckig, mj_step, copy",
                (bare, bare_mb),
                columns=COLUMNS,
                aim="1.5 times the share, 120 MB",
            )


def _share(process: psutil.Process, duration_s: float) -> float:
    """The share of a core that is used, user and system time together."""
    begun, begun_s = process.cpu_times(), time.monotonic()
    time.sleep(duration_s)
    now, now_s = process.cpu_times(), time.monotonic()
    return (now.user + now.system - begun.user - begun.system) / (now_s - begun_s)


def _bare(duration_s: float) -> tuple[float, float]:
    command = [sys.executable, "-m", "benchmarks.loop.bare_cycle", str(duration_s + 3.0)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as child:
        process = psutil.Process(child.pid)
        time.sleep(1.5)
        share = _share(process, duration_s)
        return share, process.memory_full_info().pss / 1e6


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    loops = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
