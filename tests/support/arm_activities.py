"""What the arm of a running service does while something happens to it: a motion, or a stream."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import numpy as np
import psutil
import pytest
from cobot_run import WAIT_S, Run
from faults import Record

from cobot.types import LoopMode
from rtloop.modes import STREAMING

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
GOALS = [[2.5, 0.3, -0.3, -1.2, 0.3, 1.2, 0.5], HOME]
BUSY = {LoopMode.TRAJECTORY, *STREAMING}

CLIENT = """
import math, sys, time
from cobot import Mode, Robot
robot = Robot(sys.argv[1], verbose=False)
robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
with robot.start_joint_impedance_control(100) as control:
    home = control.get_state().q
    print("streaming", flush=True)
    begin = time.monotonic()
    while True:
        angle = 0.1 * (1.0 - math.cos(2.0 * (time.monotonic() - begin)))
        control.set_target_joints([q + angle for q in home[:1]] + list(home[1:]))
        time.sleep(0.01)
"""


def name(run: Run) -> str:
    return run.memory.name.removeprefix("cobot-")


def left_alone(reason: str) -> bool:
    """Whether it says that a motion has lost its service: to its silence, or to a new one."""
    return "the service has been silent for" in reason or reason == "stop requested"


def robot_health(run: Run) -> dict[str, Any]:
    health = run.health()
    return health["robot"] if health is not None else {}  # type: ignore[return-value]


class Motion:
    """A planned motion, begun by an HTTP client that waits for its end."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self.answer: httpx.Response | Exception | None = None
        here = np.array(run.joints())
        self._goal = max(GOALS, key=lambda goal: np.abs(here - goal).max())
        self._begin()
        run.until(self._seen)
        time.sleep(0.3)

    def _begin(self) -> None:
        self._client = threading.Thread(target=self._move)
        self._client.start()

    def _seen(self) -> bool:
        """Whether the arm moves. What a busy computer has stopped before anybody looked is begun again."""
        if robot_health(self._run).get("mode") == "TRAJECTORY":
            return True
        if not self._client.is_alive():
            self._begin()
        return False

    def _move(self) -> None:
        body = {"joints": self._goal, "speed": 0.15}
        try:
            self.answer = httpx.post(f"{self._run.url}/robot/move/joints", json=body, timeout=WAIT_S)
        except httpx.TransportError as exc:
            self.answer = exc

    def end(self) -> None:
        with contextlib.suppress(httpx.TransportError):  # What has ended the service says more.
            httpx.post(f"{self._run.url}/stop", timeout=WAIT_S)
        self._client.join(WAIT_S)
        assert not self._client.is_alive()


class Streaming:
    """A client that streams joints, a process of its own."""

    def __init__(self, run: Run) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", CLIENT, name(run)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        if self.process.stdout.readline() != "streaming\n":
            pytest.fail(self.process.communicate()[1])
        time.sleep(0.5)

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


TASKS = {"motion": Motion, "stream": Streaming}


@contextmanager
def doing(run: Run, task: str) -> Iterator[Any]:
    made = TASKS[task](run)
    try:
        yield made
    finally:
        made.end()


def require_recovery(run: Run, record: Record, *tasks: str) -> None:
    """The arm can do the task as before; no limit was violated at any time."""
    run.until(lambda: robot_health(run).get("mode") in ("HOLD", "ESTOP", "FAULT"))
    run.until(lambda: reset(run) and run.healthy())
    for task in tasks:
        before = len(record.modes)
        with doing(run, task):
            pass
        assert BUSY & set(record.modes[before:])
        run.until(lambda: robot_health(run).get("mode") == "HOLD")
    violations = record.violations()
    assert violations == [], violations
    assert len(record.cycles) > 500


def reset(run: Run) -> bool:
    return httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S).status_code == 200


def child(run: Run, which: str, task: Any) -> psutil.Process:
    if which == "client":
        return psutil.Process(task.process.pid)
    found = run.child(which)
    assert found is not None
    return found
