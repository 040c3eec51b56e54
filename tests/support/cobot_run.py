"""`cobot run` under test: a robot of its own, a free port, folders of its own."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import httpx
import psutil
import yaml
from folders import ROOT, SUPPORT
from warm_start import Warm, started

WAIT_S = 120.0
POLL_S = (0.01, 0.05)
"""Between two looks at a condition, at first and at last: what is looked at costs the processor too."""
TRIES = 5
LATE = "too slow or too busy", "has been silent", "stood still"
"""What the service says of a computer that could not keep up."""
LATE_TRIES = 10
PATIENT = "pause_to_stop_s: 1.0, overruns_to_stop: 1000, service_timeout_s: 1.0"
"""rtloop stops the arm when its computer pauses, is too slow, or the service falls silent. Where a test is
about something else, a busy computer shall not make that happen. These are as patient as the settings permit,
but for a service that was killed, which is to be missed before there is another."""
PATIENT_PLANNING = "timeout_s: 60.0"
"""Planners that search look at the clock on the wall: a busy computer shall not have them give up."""
BRIEF_RECORDING = "recording: {before_s: 1.0, after_s: 0.2}\n"
"""Each fault leaves a recording, of 35 s as shipped: in tests that have many of them that takes a while."""
# For a process that runs a module of tests/: the packages come before the folders of tests that mirror them.
HELPER_ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(SUPPORT)])}
_numbers = itertools.count()
R = TypeVar("R", bound="Run")


def unique_name() -> str:
    """A robot name that no other test run on this machine uses; it is one in ROS too."""
    return f"test_{os.getpid()}_{next(_numbers)}"


def until(condition: Callable[[], Any], what: Callable[[], str] = str) -> Any:
    """What the condition gave when it first held; `what` explains when it never does."""
    deadline_s, pause_s = time.monotonic() + WAIT_S, POLL_S[0]
    while time.monotonic() < deadline_s:
        value = condition()
        if value:
            return value
        time.sleep(pause_s)
        pause_s = min(1.1 * pause_s, POLL_S[1])
    raise AssertionError(f"did not happen within {WAIT_S} s {what()}")


def again(do: Callable[[], tuple[bool, str]]) -> None:
    """Until it succeeds. What is said of a failure is that the computer was late."""
    for _ in range(LATE_TRIES):
        done, said = do()
        if done:
            return
        assert any(words in said for words in LATE), said
    raise AssertionError(f"{LATE_TRIES} times: {said}")


def require_quick(measure: Callable[[], float], limit_s: float) -> None:
    """That it takes no longer: in one of some tries, as the computer may be busy with other things."""
    took_s = []
    for _ in range(TRIES):
        took_s.append(measure())
        if took_s[-1] < limit_s:
            return
    raise AssertionError(f"took {took_s} s, {limit_s} s are allowed")


class Run:
    """One `cobot run` with a robot name, a port and folders of its own."""

    environment: dict[str, str] | None = None

    def __init__(
        self,
        folder: Path,
        clock: str = "fast",
        ros_domain: int | None = None,
        *,
        ros_elsewhere: bool = False,
        ros_access: str = "move",
        patient: bool = True,
        web: str = "",
        planning: str = PATIENT_PLANNING,
        more: str = "",
        asking: dict[str, Any] | None = None,
        backend: str = "",
        capacity: int = 20_000,
    ) -> None:
        """With a ROS domain it is on ROS 2 too, which takes the start a second.

        ros_elsewhere: also for other computers, which may move the arm.
        patient: see `PATIENT`; else all is as shipped.
        web: more about the web service, as YAML that begins with a comma.
        planning: about the planners, as YAML.
        more: sections of the settings that are not written otherwise, as YAML.
        asking: what its own requests need: headers, verify.
        backend: of the robot: a class in a module of tests/.
        capacity: of the segments of a motion: to give and take back the memory of 200,000 takes 0.1 s.
        """
        self.asking = asking or {}
        self.environment = HELPER_ENVIRONMENT if backend else None
        self.name = robot = unique_name()
        self.memory = Path("/dev/shm") / f"cobot-{robot}"
        self.config = folder / f"{robot}.yaml"
        self.config.write_text(
            f"robot: {{name: {robot}{f', backend: {backend}' if backend else ''}}}\nlogs: logs\n"
            f"sequences: {{recordings: recordings, programs: programs}}\n{BRIEF_RECORDING}"
            f"rt: {{trajectory_capacity: {capacity}, clock: {clock}{', ' + PATIENT if patient else ''}}}\n"
            f"web: {{port: 0{web}}}\nplanning: {{workers: 1, {planning}}}\n"
            f"ros: {{enabled: {str(ros_domain is not None).lower()}, domain_id: {ros_domain or 0}, "
            f"localhost_only: {str(not ros_elsewhere).lower()}, access: {ros_access}}}\n{more}",
            encoding="utf-8",
        )
        self.lines: list[str] = []
        self.start()

    def command(self) -> list[str]:
        return [sys.executable, "-m", "cobot", "run", "--config", str(self.config)]

    def start(self) -> subprocess.Popen[str] | Warm:
        self.lines.clear()
        command = self.command()
        warm = None if self.environment else started(command)
        self.process = warm or subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=self.environment
        )
        threading.Thread(target=self._collect, args=(self.process,), daemon=True).start()
        return self.process

    def _collect(self, process: subprocess.Popen[str] | Warm) -> None:
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
            r"https?://[^/]+", self.until(lambda: re.search(r"address +http", self.output)).string
        )
        assert found
        return found.group()

    def until(self, condition: Callable[[], Any]) -> Any:
        """The same, with what `cobot run` has printed in the explanation."""
        return until(condition, lambda: f"; output so far:\n{self.output}")

    def health(self) -> dict[str, object] | None:
        try:
            response = httpx.get(f"{self.url}/health", timeout=5.0, **self.asking)
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
        response = httpx.get(f"{self.url}/robot/joint_states", timeout=5.0, **self.asking)
        response.raise_for_status()
        return response.json()["position"]

    def go_home(self) -> None:
        """Also from a motion; it ends what else moves the arm. A service that was kept from running for a
        second moves nothing that waited meanwhile: 503. A stop of the test's that is late stops this one too.
        """

        def answered() -> httpx.Response | None:
            answer = httpx.post(f"{self.url}/robot/move/named", json=named, timeout=WAIT_S, **self.asking)
            late = answer.status_code == 503 or answer.json().get("code") == "stopped"
            return None if late else answer

        httpx.post(f"{self.url}/stop", timeout=WAIT_S, **self.asking).raise_for_status()
        named = {"name": "home", "speed": 1.0}
        home = self.until(answered)
        assert home.json().get("success"), home.text

    def end(self) -> None:
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait(WAIT_S)


class Pair(Run):
    """A `cobot run` of two robots in real time, the first of which is the default one."""

    def __init__(self, folder: Path, second: str = "") -> None:
        """second: more about the second robot, as YAML that begins with a comma."""
        self.left, self.right = unique_name(), unique_name()
        self.programs = folder / "programs"
        self.programs.mkdir()
        self.config = folder / f"{self.left}.yaml"
        self.config.write_text(
            f"logs: logs\nsequences: {{recordings: recordings, programs: programs}}\n{BRIEF_RECORDING}"
            "web: {port: 0}\n"
            f"rt: {{trajectory_capacity: 20000, {PATIENT}}}\nplanning: {{workers: 1, {PATIENT_PLANNING}}}\n"
            f"robots: [{{name: {self.left}}}, {{name: {self.right}{second}}}]\nros: {{enabled: false}}\n",
            encoding="utf-8",
        )
        self.lines: list[str] = []
        self.asking = {}
        self.start()

    def healthy(self) -> bool:
        robots = (self.health() or {"robots": {}})["robots"]
        assert isinstance(robots, dict)
        return len(robots) == 2 and all(each["status"] == "ok" for each in robots.values())


class RunOfFolder(Run):
    """`cobot run --config FOLDER` of a folder that new-robot has made."""

    def __init__(self, made: Path, clock: str = "fast") -> None:
        self.made = made
        super().__init__(made.parent, clock)

    def command(self) -> list[str]:
        return [*super().command()[:-1], str(self.made)]

    def start(self) -> subprocess.Popen[str] | Warm:
        file = self.made / "cobot-setting.yaml"
        settings = yaml.safe_load(file.read_text())
        for section, values in yaml.safe_load(self.config.read_text()).items():
            settings[section] = settings.get(section, {}) | values if isinstance(values, dict) else values
        file.write_text(yaml.safe_dump(settings))
        return super().start()


@contextmanager
def answering(run: R) -> Iterator[R]:
    """The run once it is healthy; it ends with the block."""
    try:
        run.until(run.healthy)
        yield run
    finally:
        run.end()
