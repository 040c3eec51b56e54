"""The time from POST /stop to the first cycle that decelerates, while a client floods the service.

Next to it: the answer of a bare FastAPI route under the same flood. `memory` measures the memory.
"""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from cobot_run import Run
from floods import FLOODS, HANDSHAKES, STOPS, flooding

from benchmarks.service import reader, service
from benchmarks.table import Row, percentiles, row
from benchmarks.web.answers import address, motion, until_cruising
from benchmarks.web.visitor import visitor
from cobot.client import Client
from cobot.ipc.shm import RobotMemory

FLOOR_BYTES = 2 * 2**30
"""A bare server may take so much memory: without a limit an endless header would take all there is."""
RISES_S = 0.5
"""So long a flood goes on before each stop."""


def floods(repetitions: int) -> Iterator[Row]:
    """Each flood in turn at the same service; the flood of handshakes at a service with TLS."""
    with service() as run:
        process = run.child("app")
        assert process is not None
        memory = reader(run)
        _stops(run, memory, 2)  # what is made at the first use only is no growth
        for kind in (each for each in FLOODS if each not in (STOPS, HANDSHAKES)):
            with flooding(run.url, kind) as flood:
                flood.send_signal(signal.SIGSTOP)
                delays = _stops(run, memory, repetitions, flood)
            yield _row("to the first decelerating cycle", kind, delays, _floor(kind, repetitions))
        yield _row("answered", STOPS, _answers(run.url, STOPS, repetitions), _floor(STOPS, repetitions))
        assert run.child("app") == process, "the service has died"
    with service(tls=True) as run:
        delays = _answers(run.url, HANDSHAKES, repetitions)
        yield _row(
            "over TLS, answered", HANDSHAKES, delays, _floor(HANDSHAKES, repetitions, run.config.parent)
        )


def _row(what: str, kind: str, delays: list[float], floor: list[float]) -> Row:
    return row(
        f"POST /stop {what}, {kind}",
        "ms",
        percentiles(delays),
        "answer of a bare FastAPI route, under the same flood",
        percentiles(floor),
        ratio_of="p99",
        aim="50 ms at p99",
    )


def _stops(
    run: Run, memory: RobotMemory, repetitions: int, flood: subprocess.Popen[str] | None = None
) -> list[float]:
    """Times until a stop takes effect, ms. The flood pauses while a motion is planned, because planning would
    get no CPU time.
    """
    delays = []
    with visitor() as somebody:
        for _ in range(repetitions):
            with Client(run.url, motion_timeout_s=60.0) as mover:  # one that is idle is closed in a crowd
                mover.move_named("home", speed=1.0)
                with motion(mover, "work", speed=0.05):
                    until_cruising(memory)
                    if flood is not None:
                        flood.send_signal(signal.SIGCONT)
                        time.sleep(RISES_S)
                    begun_ns = somebody.stop(run.url)
                    if flood is not None:
                        flood.send_signal(signal.SIGSTOP)
                    delays.append((int(memory.state.read()["deceleration_monotonic_ns"]) - begun_ns) / 1e6)
    return delays


def _floor(kind: str, repetitions: int, certificate: Path | None = None) -> list[float]:
    """Answer times of a separate bare server for each flood, ms. Over TLS, the server uses the certificate in
    this folder.
    """
    command = [sys.executable, "-m", "benchmarks.web.bare", *([str(certificate)] if certificate else [])]
    limited: Callable[[], None] = partial(resource.setrlimit, resource.RLIMIT_AS, (FLOOR_BYTES, FLOOR_BYTES))
    bare = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        preexec_fn=limited,
        start_new_session=True,
    )
    try:
        return _answers(address(bare), kind, min(repetitions, 20))
    finally:
        bare.kill()
        bare.communicate()


def _answers(url: str, kind: str, repetitions: int) -> list[float]:
    """Answer times, ms, each over its own connection."""
    with visitor() as somebody, flooding(url, kind):
        time.sleep(RISES_S)
        return [somebody.answer_ms(url) for _ in range(repetitions)]
