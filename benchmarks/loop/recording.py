"""The cost of recording: for a cycle of rtloop, and for the process that writes."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import psutil
from cobot_run import Run, unique_name
from mcap.reader import make_reader
from rig import Rig

from benchmarks.loop.idle import busy
from benchmarks.service import background, service
from benchmarks.table import Row, percentiles, row
from cobot.client import Client
from cobot.config import load_settings
from cobot.errors import UnavailableError
from cobot.ipc.recording_memory import RecordingMemory
from cobot.robot.description import load_robot


def recording(cycles: int, slice_s: float) -> Iterator[Row]:
    """A cycle with and without recording, in turn; the recorder at rest and while it writes everything; and
    the share of the cycles that its files contain after it has written next to two busy loops.
    """
    yield _cycle(cycles)
    with service() as run:
        rtloop, recorder = process(run, "rtloop"), process(run, "cobot.recorder")
        rest = shares([recorder, rtloop], slice_s)
        httpx.post(f"{run.url}/recordings", json={"action": "start"}, timeout=30.0).raise_for_status()
        busy = shares([recorder, rtloop], slice_s)
        httpx.post(f"{run.url}/recordings", json={"action": "stop"}, timeout=120.0).raise_for_status()
        state = httpx.get(f"{run.url}/recordings", timeout=30.0).json()["recorder"]
        loaded = _under_load(run, 2 * slice_s)
    yield loaded
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


def _under_load(run: Run, duration_s: float) -> Row:
    """Record while the arm moves next to two busy loops and 32 clients that send requests as fast as
    possible. Returns the number of cycles that rtloop has counted, and the number of messages of each topic,
    as the library mcap reads the file.
    """
    load = ("benchmarks.web.load", f"{run.url}/robot/joint_states", "32", "0", str(duration_s + 60.0))
    with (
        tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder,
        Client(run.url, timeout_s=150.0, motion_timeout_s=150.0) as robot,
    ):
        with busy(2), background(*load):
            robot.record("start")
            end_s, motions = time.monotonic() + duration_s, 0
            while time.monotonic() < end_s:
                with contextlib.suppress(UnavailableError):  # so much load that the service stood still
                    robot.move_named(("work", "home")[motions % 2], speed=1.0)
                motions += 1
            names = robot.record("stop")
        counts: Counter[str] = Counter()
        numbers: list[int] = []
        for name in names:
            robot.fetch_recording(name, Path(folder) / name)
            with (Path(folder) / name).open("rb") as file:
                for _, channel, message in make_reader(file).iter_messages():
                    counts[channel.topic] += 1
                    if channel.topic == "/cycle":
                        numbers.append(message.sequence)
    cycles = max(numbers) - min(numbers) + 1
    topics = ("/cycle", "/joint_states", "/commanded", "/wrench")
    beside = f"beside two busy loops and 32 clients, {motions} motions in {duration_s:.0f} s"
    return row(
        f"a recording {beside}: messages lost",
        "",
        [cycles - counts[topic] for topic in topics],
        "cycles of rtloop",
        [cycles] * len(topics),
        columns=topics,
        ratio_of="/cycle",
        aim="0",
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
    """Shares of a core."""
    before = [sum(process.cpu_times()[:2]) for process in processes]
    time.sleep(duration_s)
    after = [sum(process.cpu_times()[:2]) for process in processes]
    return [(end - begin) / duration_s for begin, end in zip(before, after, strict=True)]
