"""`cobot run` whose output nobody takes: it serves, stops the arm and ends all the same.

The attackers: a pipe that nobody reads, a stopped supervisor, a disk without room, a client that floods.
"""

from __future__ import annotations

import json
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from cobot_run import WAIT_S, Run, answering, until

SOON_S = 60.0
"""For an answer that takes milliseconds, on a busy computer: what is stuck is so until the test ends."""
TEXT = "x" * 2500
ENOUGH = 60
"""So many of these texts are more than a pipe holds."""


class StuckRun(Run):
    """Its output is a pipe that is read only when the test says so."""

    def __init__(self, folder: Path, more: str = "") -> None:
        self._more = more
        super().__init__(folder, clock="realtime")

    def start(self) -> subprocess.Popen[str]:
        with self.config.open("a", encoding="utf-8") as file:
            file.write(self._more)
        self.process = subprocess.Popen(
            self.command(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1
        )
        assert self.process.stdout is not None
        while "Ctrl-C stops" not in (line := self.process.stdout.readline()):
            assert line, "it ended"
            self.lines.append(line.rstrip())
        return self.process

    @property
    def url(self) -> str:
        (found,) = [line for line in self.lines if "http://" in line]
        return str(json.loads(found)["message"]).split()[-1].removesuffix("/")


@pytest.fixture
def stuck(tmp_path: Path) -> Iterator[StuckRun]:
    run = StuckRun(tmp_path, "logging: {format: json, level: info}\n")
    try:
        run.until(run.healthy)
        yield run
    finally:
        for process in [psutil.Process(run.process.pid)] if run.process.poll() is None else []:
            process.resume()
        run.end()
        assert run.process.stdout is not None
        run.process.stdout.close()


def flood(run: Run, address: str) -> None:
    """A client that has more to say than a pipe holds, in lines that look like others' as far as it can."""
    transport = httpx.HTTPTransport(local_address=address)
    with httpx.Client(transport=transport, base_url=run.url, timeout=SOON_S) as client:
        for n in range(ENOUGH):
            body = {"msg": f'{n}\n{{"level": "forged"}}\x1b[2J{TEXT}'}
            client.post(f"/{run.name}/Trace/textmsg", json=body).raise_for_status()


def quick(run: Run) -> None:
    """It answers, and it stops."""
    begun_s = time.monotonic()
    stop = httpx.post(f"{run.url}/stop", timeout=SOON_S)
    assert stop.json()["success"], stop.text
    assert httpx.get(f"{run.url}/health", timeout=SOON_S).status_code == 200
    assert time.monotonic() - begun_s < SOON_S


def move(run: Run, answers: list[Any]) -> threading.Thread:
    """Begin a motion that takes long."""

    def post() -> None:
        body = {"joints": [1.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 0.01}
        try:
            answers.append(httpx.post(f"{run.url}/robot/move/joints", json=body, timeout=WAIT_S).json())
        except httpx.TransportError as exc:
            answers.append(exc)

    mover = threading.Thread(target=post)
    mover.start()
    run.until(lambda: (run.health() or {"robot": {}})["robot"].get("mode") == "TRAJECTORY" or answers)  # type: ignore[attr-defined]
    return mover


def test_neither_a_full_pipe_nor_a_stopped_supervisor_stops_the_stop(stuck: StuckRun) -> None:
    """And with both, the arm comes to rest first when it is told to end."""
    flood(stuck, "127.0.0.2")
    quick(stuck)
    stuck.process.send_signal(signal.SIGSTOP)
    flood(stuck, "127.0.0.3")
    quick(stuck)
    stuck.process.send_signal(signal.SIGCONT)
    lost = stuck.until(lambda: stuck.health()["service"]["lost_lines"])  # type: ignore[index]
    assert lost["file"] == 0

    answers: list[Any] = []
    mover = move(stuck, answers)
    family = psutil.Process(stuck.process.pid).children(recursive=True)
    begun_s = time.monotonic()
    stuck.process.send_signal(signal.SIGTERM)
    assert stuck.process.wait(WAIT_S) == 0
    assert time.monotonic() - begun_s < SOON_S
    mover.join(WAIT_S)
    assert "the arm stopped" in answers[0]["message"], answers
    until(lambda: not any(each.is_running() and each.status() != psutil.STATUS_ZOMBIE for each in family))

    # The file has what the terminal never got: an object in each line, and none that a client has made.
    text = (stuck.config.parent / "logs" / f"{stuck.name}.log").read_text(encoding="utf-8")
    lines = [json.loads(line) for line in text.splitlines()]
    assert {line["level"] for line in lines} <= {"INFO", "WARNING", "ERROR"}
    said = [line for line in lines if line["logger"] == "cobot.trace"]
    assert 60 <= len(said) < 2 * ENOUGH, "more of one kind from one client are suppressed"
    assert any("were suppressed" in line["message"] for line in said)
    assert all("request" in line or "suppressed" in line["message"] for line in said)
    assert lines[-1]["message"] == "stopped"
    audit = (stuck.config.parent / "logs" / f"{stuck.name}.audit.jsonl").read_text(encoding="ascii")
    kept = [json.loads(line) for line in audit.splitlines()]
    texts = [entry for entry in kept if entry["what"].endswith("Trace/textmsg")]
    assert sum(entry.get("repeated", 1) for entry in texts) == 2 * ENOUGH
    assert {line["request"] for line in said if "request" in line} & {entry["request"] for entry in texts}
    assert len([entry for entry in kept if entry["what"] == "POST /stop"]) == 2


class FullDisk(Run):
    """Its log file is a disk without room."""

    def start(self) -> subprocess.Popen[str]:
        logs = self.config.parent / "logs"
        logs.mkdir()
        (logs / f"{self.name}.log").symlink_to("/dev/full")
        return super().start()

    def healthy(self) -> bool:
        """As healthy as it gets: `degraded`."""
        return self.health() is not None


@pytest.mark.thorough
def test_a_disk_without_room_costs_lines_and_nothing_else(tmp_path: Path) -> None:
    with answering(FullDisk(tmp_path)) as run:
        health = run.health()
        assert health is not None
        assert health["problems"] == ["the log file cannot be written: No space left on device"]
        quick(run)
        named = {"name": "home", "speed": 1.0}
        assert httpx.post(f"{run.url}/robot/move/named", json=named, timeout=WAIT_S).json()["success"]
    assert run.process.returncode == 0
    assert "stopped" in run.lines
