"""`cobot run` under test: a robot of its own, a free port, folders of its own."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import psutil

WAIT_S = 60.0
_numbers = itertools.count()


def unique_name() -> str:
    """A robot name that no other test run on this machine uses."""
    return f"test-{os.getpid()}-{next(_numbers)}"


def until(condition: Callable[[], Any], what: Callable[[], str] = str) -> Any:
    """What the condition gave when it first held; `what` explains when it never does."""
    deadline_s = time.monotonic() + WAIT_S
    while time.monotonic() < deadline_s:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"did not happen within {WAIT_S} s {what()}")


class Run:
    """One `cobot run` with a robot name, a port and folders of its own."""

    def __init__(self, folder: Path, clock: str = "fast", ros_domain: int | None = None) -> None:
        """With a ROS domain it is on ROS 2 too, which takes the start a second."""
        self.name = robot = unique_name()
        self.memory = Path("/dev/shm") / f"cobot-{robot}"
        self.config = folder / f"{robot}.yaml"
        self.config.write_text(
            f"robot: {{name: {robot}}}\nlogs: logs\n"
            "sequences: {recordings: recordings, programs: programs}\n"
            f"rt: {{trajectory_capacity: 200000, clock: {clock}}}\n"
            "web: {port: 0}\nplanning: {workers: 1}\n"
            f"ros: {{enabled: {str(ros_domain is not None).lower()}, domain_id: {ros_domain or 0}}}\n",
            encoding="utf-8",
        )
        self.lines: list[str] = []
        self.start()

    def command(self) -> list[str]:
        return [sys.executable, "-m", "cobot", "run", "--config", str(self.config)]

    def start(self) -> subprocess.Popen[str]:
        self.lines.clear()
        self.process = subprocess.Popen(
            self.command(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        threading.Thread(target=self._collect, args=(self.process,), daemon=True).start()
        return self.process

    def _collect(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout as output:
            for line in output:
                self.lines.append(line.rstrip())

    @property
    def output(self) -> str:
        return "\n".join(self.lines)

    @property
    def url(self) -> str:
        found = re.search(
            r"http://[^/]+", self.until(lambda: re.search(r"address +http", self.output)).string
        )
        assert found
        return found.group()

    def until(self, condition: Callable[[], Any]) -> Any:
        """The same, with what `cobot run` has printed in the explanation."""
        return until(condition, lambda: f"; output so far:\n{self.output}")

    def health(self) -> dict[str, object] | None:
        try:
            response = httpx.get(f"{self.url}/health", timeout=5.0)
        except httpx.TransportError:
            return None
        return response.json() if response.status_code == 200 else None

    def healthy(self) -> bool:
        health = self.health()
        return health is not None and health["status"] == "ok"

    def child(self, module: str) -> psutil.Process | None:
        for process in psutil.Process(self.process.pid).children():
            try:
                if process.cmdline()[1:4] == ["-P", "-m", module]:
                    return process
            except (psutil.NoSuchProcess, psutil.ZombieProcess):
                continue
        return None

    def restarted(self, module: str, old_pid: int) -> psutil.Process | None:
        found = self.child(module)
        return found if found is not None and found.pid != old_pid else None

    def joints(self) -> list[float]:
        response = httpx.get(f"{self.url}/robot/joint_states", timeout=5.0)
        response.raise_for_status()
        return response.json()["position"]

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait(WAIT_S)
