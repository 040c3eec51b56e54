"""A stop comes in whatever floods the service, with few descriptors; nothing dies, nothing grows for ever.

How soon it takes effect is measured by `python -m benchmarks floods`.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator

import httpx
import psutil
import pytest
from cobot_run import WAIT_S, Run, answering
from floods import STOPS, flooding
from thorough import few

from cobot.errors import BusyError
from cobot.launch.process import Niceness, set_niceness

KINDS = (
    "slow body",
    "200 WebSockets",
    "slow header",
    "endless chunks",
    "half-open connections",
    "valid requests",
    "giant frames",
    "unread WebSockets",
    "agents",
    "Foxglove clients",
    "unread events",
    "endless headers",
    STOPS,
)
"""Of all floods, those that differ; the others are tried at bare listeners and measured."""
LASTS_S = 1.5
TRIES = 5
GROWTH_BYTES = 200e6
"""An endless header or trailer would reach it within the time that a flood lasts."""
KEPT_BYTES = 80e6
"""More than what is imported and cached at the first use, and less than any flood takes while it lasts."""


class Narrow(Run):
    """With 256 descriptors for each of its processes, and little patience for slow clients.

    Attributes:
        begun_bytes: what its service took before the first flood.
    """

    begun_bytes = 0

    def command(self) -> list[str]:
        content = self.config.read_text(encoding="utf-8")
        limits = "limits: {header_timeout_s: 1.0, body_timeout_s: 1.0}"
        self.config.write_text(
            content.replace("web: {port: 0}", f"web: {{port: 0, {limits}}}"), encoding="utf-8"
        )
        return ["sh", "-c", 'ulimit -n 256; exec "$@"', "sh", *super().command()]


@pytest.fixture(scope="module")
def narrow(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Narrow]:
    with answering(Narrow(tmp_path_factory.mktemp("narrow"))) as started:
        service = started.child("app")
        assert service is not None
        started.begun_bytes = service.memory_info().rss
        yield started


def family(run: Run) -> dict[int, float]:
    """Each process of the run, and when it began."""
    processes = psutil.Process(run.process.pid).children(recursive=True)
    return {process.pid: process.create_time() for process in processes}


def move_slowly(run: Run) -> None:
    points = [{"positions": [0.5, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 2000.0}]
    sent = httpx.post(f"{run.url}/trajectory/send", json={"points": points}, timeout=WAIT_S)
    assert sent.json()["status"] == "sent", sent.text


def ask(run: Run, method: str, path: str) -> httpx.Response:
    """As a client on another computer, whose processor is its own: one that was let in but spoke too
    late, and had to make room, comes again.
    """
    set_niceness(Niceness.PROMPT)
    try:
        for _ in range(TRIES):
            try:
                answer = httpx.request(method, f"{run.url}{path}", timeout=WAIT_S)
                if answer.status_code != 503 or answer.json()["code"] != BusyError.code:
                    return answer
            except (httpx.RemoteProtocolError, httpx.ReadError):
                continue
    finally:
        set_niceness(Niceness.ORDINARY)
    raise AssertionError(f"{method} {path}: closed {TRIES} times")


def stops(run: Run) -> None:
    answer = ask(run, "POST", "/stop")
    assert answer.status_code == 200, answer.text
    assert answer.json()["at_rest"], answer.text
    assert answer.json()["stopped"], answer.text


@pytest.mark.parametrize("kind", few(KINDS, 2))
def test_the_arm_stops_and_nothing_dies_under_a_flood(narrow: Narrow, kind: str) -> None:
    before = family(narrow)
    service = narrow.child("app")
    assert service is not None
    memory_before = service.memory_info().rss
    narrow.go_home()
    move_slowly(narrow)
    with flooding(narrow.url, kind):
        deadline_s = time.monotonic() + LASTS_S
        answer = ask(narrow, "GET", "/health")
        assert answer.status_code == 200, answer.text
        if kind == STOPS:  # one of which has stopped it
            assert ask(narrow, "POST", "/stop").json()["at_rest"]
        else:
            stops(narrow)
        while time.monotonic() < deadline_s:
            assert service.memory_info().rss - memory_before < GROWTH_BYTES
            time.sleep(0.05)
    narrow.until(narrow.healthy)
    assert family(narrow) == before
    assert "Traceback" not in narrow.output, narrow.output


def test_what_the_floods_took_comes_back(narrow: Narrow) -> None:
    """All of them, one after the other. Beside it: `python -m benchmarks memory`."""
    service = narrow.child("app")
    assert service is not None
    narrow.until(lambda: service.memory_info().rss - narrow.begun_bytes < KEPT_BYTES)


def cobot_stop(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "cobot", "stop", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)


def test_cobot_stop_ends_a_motion_and_the_program_behind_it(narrow: Narrow) -> None:
    """It would go on with its next motion: the service sees to it that there is none."""
    narrow.go_home()
    program = "while true do\n  pcall(movej, {0.5, 0, 0, -1.57, 0, 1.57, 0}, 0.01)\nend\n"
    files, data = {"config": ("again.lua", program)}, {"n_iterations": 1}
    started = httpx.post(f"{narrow.url}/sequences/start", files=files, data=data, timeout=WAIT_S)
    assert started.status_code == 200, started.text
    narrow.until(lambda: narrow.health()["robot"]["mode"] == "TRAJECTORY")  # type: ignore[index]
    stopped = cobot_stop("--config", str(narrow.config))
    assert (stopped.returncode, "at rest" in stopped.stdout) == (0, True), stopped.stdout + stopped.stderr

    def ended() -> bool:
        status = httpx.get(f"{narrow.url}/sequences/status", timeout=WAIT_S).json()
        return status["status"] != "running" and narrow.healthy()

    narrow.until(ended)


def test_cobot_stop_needs_no_service(narrow: Narrow) -> None:
    service = narrow.child("app")
    assert service is not None
    service.suspend()
    try:
        stopped = cobot_stop("--robot", narrow.name, "--estop")
    finally:
        service.resume()
    assert (stopped.returncode, "latched" in stopped.stdout) == (0, True), stopped.stdout + stopped.stderr
    narrow.until(lambda: narrow.health()["robot"]["mode"] == "ESTOP")  # type: ignore[index]
    httpx.post(f"{narrow.url}/robot/reset", timeout=WAIT_S).raise_for_status()
    narrow.until(narrow.healthy)
