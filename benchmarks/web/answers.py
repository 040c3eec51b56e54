"""The web service next to a bare one: answers per second, and the time until a stop takes effect."""

from __future__ import annotations

import contextlib
import gc
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import psutil

from benchmarks.service import background, reader, service
from benchmarks.table import Row, percentiles, row
from cobot.client import Client
from cobot.errors import CobotError
from cobot.ipc.shm import RobotMemory
from cobot.launch.process import Niceness, set_niceness

CLIENTS = 16
TOKENS = 10
POLLERS = 20
POLL_RATE_HZ = 20
JOINT_STATES = "/robot/joint_states"


def requests_per_second(slices: int, slice_s: float) -> Iterator[Row]:
    """GET /robot/joint_states, in slices that alternate with a bare FastAPI route with a payload of the same
    size.

    Without tokens, and with one of so many.
    """
    for tokens in (0, TOKENS):
        ours, theirs = Answers(), Answers()
        with service(tokens=tokens) as run, background("benchmarks.web.bare") as bare:
            bare_url, app, floor = address(bare), run.child("app"), psutil.Process(bare.pid)
            assert app is not None
            shown = [run.asking["headers"]["Authorization"].removeprefix("Bearer ")] if tokens else []
            ours.rest(app, slice_s)
            theirs.rest(floor, slice_s)
            for _ in range(slices):
                ours.collect(app, run.url, slice_s, *shown)
                theirs.collect(floor, bare_url, slice_s)
        asked = (
            f"GET {JOINT_STATES}, {CLIENTS} connections{f', with one of {tokens} tokens' if tokens else ''}"
        )
        yield row(
            asked,
            "answers/s",
            _low_tail(ours.rates),
            "bare FastAPI route",
            _low_tail(theirs.rates),
            aim="0.7 or more",
        )
        yield row(
            f"{asked}: time of an answer",
            "ms",
            percentiles(ours.took_ms),
            "bare FastAPI route",
            percentiles(theirs.took_ms),
            ratio_of="p99",
        )
        yield row(
            f"{asked}: computing time of the service for an answer",
            "µs",
            percentiles(ours.cpu_us),
            "bare FastAPI route",
            percentiles(theirs.cpu_us),
            aim="1.43 times or less",
        )


def stop(repetitions: int) -> Iterator[Row]:
    """The time from POST /stop to the first cycle that decelerates, while 20 clients poll and a planner
    plans.
    """
    delays: list[float] = []
    answers: list[float] = []
    with service() as run, background("benchmarks.web.bare") as bare, background("benchmarks.web.planner"):
        seconds = str(repetitions * 10)
        arguments = (run.url + JOINT_STATES, str(POLLERS), str(POLL_RATE_HZ), seconds)
        with (
            background("benchmarks.web.load", *arguments),
            Client(run.url, motion_timeout_s=30.0) as mover,
            Client(run.url) as stopper,
            Client(address(bare)) as floor,
        ):
            memory = reader(run)
            gc.disable()
            set_niceness(Niceness.PROMPT)  # this client stands for another computer, without planners
            names = ("work", "home")
            for repetition in range(repetitions):
                with motion(mover, names[repetition % 2]):
                    until_cruising(memory)
                    begun_ns = time.monotonic_ns()
                    stopper.stop()
                    delays.append((int(memory.state.read()["deceleration_monotonic_ns"]) - begun_ns) / 1e6)
                begun_ns = time.monotonic_ns()
                floor.stop()
                answers.append((time.monotonic_ns() - begun_ns) / 1e6)
            set_niceness(Niceness.ORDINARY)
    yield row(
        f"POST /stop to the first decelerating cycle, {POLLERS} clients polling, a planner running",
        "ms",
        percentiles(delays),
        "answer of a bare FastAPI route, under the same load",
        percentiles(answers),
        ratio_of="p99",
        aim="10 ms at p99",
    )


@contextlib.contextmanager
def motion(client: Client, name: str, speed: float = 0.2) -> Iterator[None]:
    """Context manager: a motion in the background. It has ended when the context is closed."""

    def move() -> None:
        with contextlib.suppress(CobotError):
            client.move_named(name, speed=speed)

    thread = threading.Thread(target=move)
    thread.start()
    try:
        yield
    finally:
        thread.join()


def until_cruising(memory: RobotMemory) -> None:
    """Wait until half a second after the start of a motion."""
    deadline_s = time.monotonic() + 20.0
    while time.monotonic() < deadline_s:
        state = memory.state.read()
        if int(state["motion_result"]) == 1 and float(state["path_time_s"]) > 0.5:
            return
        time.sleep(0.003)
    raise TimeoutError("no motion")


class Answers:
    """The answers of a server at full load: answers per second, the time of each answer, and the server's CPU
    time, which other programs on the computer hardly change.
    """

    def __init__(self) -> None:
        self.rates: list[float] = []
        self.took_ms: list[float] = []
        self.cpu_us: list[float] = []
        self._idle = 0.0

    def rest(self, server: psutil.Process, duration_s: float) -> None:
        """Measure the CPU time of the server without requests, which is not part of an answer."""
        before_s = _computed_s(server)
        time.sleep(duration_s)
        self._idle = (_computed_s(server) - before_s) / duration_s

    def collect(self, server: psutil.Process, url: str, duration_s: float, *token: str) -> None:
        asked = (url + JOINT_STATES, str(CLIENTS), "0", str(duration_s), *token)
        command = [sys.executable, "-m", "benchmarks.web.load", *asked]
        before_s = _computed_s(server)
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
        computed_s = _computed_s(server) - before_s - self._idle * duration_s
        self.cpu_us.append(1e6 * computed_s / int(said[0]))
        self.rates.append(float(said[0]) / duration_s)
        self.took_ms += map(float, said[1:])


def _computed_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)


def _low_tail(rates: list[float]) -> tuple[float, float, float]:
    """The low percentiles, which are the bad ones for a rate."""
    p50, p1, p01 = percentiles([-rate for rate in rates])
    return -p50, -p1, -p01


def address(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()
