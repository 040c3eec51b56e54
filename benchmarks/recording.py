"""What recording costs: a cycle of rtloop, and the process that writes."""

from __future__ import annotations

import time
from collections.abc import Iterator

import httpx
import numpy as np
import psutil
from rig import Rig
from running import Run, unique_name

from benchmarks.service import service
from benchmarks.table import Row, percentiles, row
from cobot.config import load_settings
from cobot.ipc.recording_memory import RecordingMemory
from cobot.robot.description import load_robot


def recording(cycles: int, slice_s: float) -> Iterator[Row]:
    """A cycle with and without a record, in turn; and the recorder at rest and while it writes everything."""
    yield _cycle(cycles)
    with service() as run:
        rtloop, recorder = process(run, "rtloop"), process(run, "recorder")
        rest = shares([recorder, rtloop], slice_s)
        httpx.post(f"{run.url}/recordings", json={"action": "start"}, timeout=30.0).raise_for_status()
        busy = shares([recorder, rtloop], slice_s)
        httpx.post(f"{run.url}/recordings", json={"action": "stop"}, timeout=120.0).raise_for_status()
        state = httpx.get(f"{run.url}/recordings", timeout=30.0).json()["recorder"]
    yield row(
        f"recorder: {state['lost']} cycles lost in {2 * slice_s:.0f} s",
        "",
        [rest[0], busy[0]],
        "rtloop",
        [rest[1], busy[1]],
        columns=("share of a core, history alone", "continuous recording"),
        ratio_of="continuous recording",
        aim="0 lost",
    )


def _cycle(cycles: int) -> Row:
    settings = load_settings(None)
    robot = load_robot(settings)
    name, limits = unique_name(), robot.limits
    memory = RecordingMemory.create(name, limits.dof, settings.rt.period_s, 5.0, limits.names)
    rigs = [Rig(settings, robot, simulated=True, recording=each) for each in (memory, None)]
    took_us = np.empty((cycles, 2))
    try:
        for cycle in range(cycles):
            time.sleep(settings.rt.period_s)  # caches are as cold as in a process that has slept
            for index in (0, 1) if cycle % 2 else (1, 0):
                begun_ns = time.perf_counter_ns()
                rigs[index].loop.step()
                took_us[cycle, index] = (time.perf_counter_ns() - begun_ns) * 1e-3
    finally:
        for rig in rigs:
            rig.close()
        memory.unlink()
    return row(
        "a cycle at rest that is recorded, called from Python",
        "µs",
        percentiles(took_us[:, 0]),
        "not recorded",
        percentiles(took_us[:, 1]),
        aim="1 µs more (p50)",
    )


def process(run: Run, module: str) -> psutil.Process:
    found = run.child(module)
    assert found is not None
    return found


def shares(processes: list[psutil.Process], duration_s: float) -> list[float]:
    """Of a core."""
    before = [sum(process.cpu_times()[:2]) for process in processes]
    time.sleep(duration_s)
    after = [sum(process.cpu_times()[:2]) for process in processes]
    return [(end - begin) / duration_s for begin, end in zip(before, after, strict=True)]
