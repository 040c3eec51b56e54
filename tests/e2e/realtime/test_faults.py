"""Processes that are killed or paused, and memory that is spoilt, under a `cobot run` in real time.

Nothing is restarted by hand: each fault finds the arm that the one before has left. Oracles: `faults.Record`,
which reads the state block as anybody can and takes numpy's differences of consecutive cycles; the operating
system's exit statuses and process table.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import pytest
from faults import BLOCKS, Record, spoil, watched
from running import WAIT_S, Run, answering

from cobot import Mode, Robot
from cobot.config import load_settings
from cobot.errors import MotionStopped
from cobot.ipc.shm import RobotMemory, Role
from cobot.robot import description as robots
from cobot.types import JointLimits, LoopMode
from rtloop.modes import STREAMING

BACKENDS = Path(__file__).parents[2] / "backends"
HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
GOALS = [[0.8, 0.3, -0.3, -1.2, 0.3, 1.2, 0.5], HOME]
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
WILD_CLOCK = """
import random, time
random.seed(1)
now, now_ns = time.time, time.time_ns
time.time = lambda: now() + random.uniform(-1e8, 1e8)
time.time_ns = lambda: now_ns() + random.randrange(-10**17, 10**17)
"""


class PreparedRun(Run):
    """Not started yet."""

    def start(self) -> None: ...


@pytest.fixture(scope="module")
def limits() -> JointLimits:
    return robots.load_robot(load_settings()).limits


@pytest.fixture(scope="module")
def hasty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """One that notices pauses as it does as shipped."""
    with answering(Run(tmp_path_factory.mktemp("hasty"), clock="realtime", patient=False)) as started:
        yield started


@pytest.fixture
def record(service: Run, limits: JointLimits) -> Iterator[Record]:
    with watched(name(service), limits, 0.001) as made:
        yield made


def name(run: Run) -> str:
    return run.memory.name.removeprefix("cobot-")


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
        self._client = threading.Thread(target=self._move)
        self._client.start()
        run.until(lambda: robot_health(run).get("mode") == "TRAJECTORY")
        time.sleep(0.3)

    def _move(self) -> None:
        body = {"joints": self._goal, "speed": 0.15}
        try:
            self.answer = httpx.post(f"{self._run.url}/robot/move/joints", json=body, timeout=WAIT_S)
        except httpx.TransportError as exc:
            self.answer = exc

    def end(self) -> None:
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
    assert record.violations() == []
    assert len(record.cycles) > 500


def reset(run: Run) -> bool:
    return httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S).status_code == 200


def child(run: Run, which: str, task: Any) -> psutil.Process:
    if which == "client":
        return psutil.Process(task.process.pid)
    found = run.child(which)
    assert found is not None
    return found


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("which", ["app", "rtloop"])
def test_a_process_that_is_killed_comes_back_and_the_arm_is_unharmed(
    service: Run, record: Record, which: str, task: str
) -> None:
    with doing(service, task) as done:
        victim = child(service, which, done)
        victim.kill()
        service.until(lambda: service.restarted(which, victim.pid) and service.healthy())
        if which == "rtloop":
            assert robot_health(service)["reason"] == "rtloop was restarted"
        elif task == "motion":
            assert "the service has been silent for" in robot_health(service)["reason"]
        else:
            assert robot_health(service)["mode"] == "JOINT_IMPEDANCE", "it needs no service"
        if which == "rtloop" and task == "stream":
            _, error = done.process.communicate(timeout=WAIT_S)
            assert "MotionStopped" in error or "UnavailableError" in error
    require_recovery(service, record, task)


def test_a_client_that_is_killed_leaves_an_arm_at_rest(service: Run, record: Record) -> None:
    with doing(service, "stream") as stream:
        stream.process.kill()
        service.until(lambda: robot_health(service)["mode"] == "HOLD")
        assert robot_health(service)["reason"] == "the streaming client has died"
    require_recovery(service, record, *TASKS)


@pytest.mark.parametrize("pause_s", [0.2, 2.0])
@pytest.mark.parametrize(
    ("which", "task"),
    [("app", "motion"), ("app", "stream"), ("rtloop", "motion"), ("rtloop", "stream"), ("client", "stream")],
)
def test_a_process_that_is_paused_does_not_harm_the_arm(
    hasty: Run, limits: JointLimits, which: str, task: str, pause_s: float
) -> None:
    with watched(name(hasty), limits, 0.001) as record:
        pause(hasty, record, which, task, pause_s)


def pause(service: Run, record: Record, which: str, task: str, pause_s: float) -> None:
    with doing(service, task) as done:
        victim = child(service, which, done)
        victim.suspend()
        time.sleep(pause_s)
        victim.resume()
        if which == "rtloop":
            service.until(lambda: "the computer is too slow or too busy" in " ".join(record.reasons))
        elif which == "app" and task == "motion" and pause_s > 1.0:
            service.until(lambda: "the service has been silent for" in " ".join(record.reasons))
        elif which == "client" and pause_s > 1.0:
            interventions = service.health()["interventions"]  # type: ignore[index]
            assert interventions["command_timeout"] >= 1  # type: ignore[index]
    require_recovery(service, record, task)


@pytest.mark.parametrize("task", TASKS)
def test_a_writer_gone_wild_does_not_harm_the_arm(service: Run, record: Record, task: str) -> None:
    random = np.random.default_rng(list(TASKS).index(task))
    memory = RobotMemory.attach(name(service), Role.READER)
    with doing(service, task):
        for block in BLOCKS:
            for _ in range(5):
                spoil(memory, block, random)
                time.sleep(0.01)
    memory.close()
    require_recovery(service, record, task)


def test_a_service_that_dies_with_its_blocks_spoilt_comes_back(service: Run, record: Record) -> None:
    memory = RobotMemory.attach(name(service), Role.READER)
    with doing(service, "motion"):
        old = child(service, "app", None)
        old.suspend()
        for block in ("requests", "head", "commands", "heartbeat"):
            spoil(memory, block, np.random.default_rng(6))
        old.kill()
        service.until(lambda: service.restarted("app", old.pid) and service.healthy())
    memory.close()
    require_recovery(service, record, *TASKS)


def test_an_rtloop_that_dies_with_its_state_spoilt_comes_back_with_an_estop(
    service: Run, record: Record
) -> None:
    memory = RobotMemory.attach(name(service), Role.READER)
    with doing(service, "motion"):
        old = child(service, "rtloop", None)
        old.suspend()
        spoil(memory, "state", np.random.default_rng(7))
        old.kill()
        service.until(lambda: service.restarted("rtloop", old.pid) and service.health())
        service.until(lambda: "was damaged" in str(robot_health(service).get("reason")))
        assert robot_health(service)["mode"] == "ESTOP"
    memory.close()
    record.forget(0)  # nobody knows where the arm was
    require_recovery(service, record, *TASKS)


def test_setpoints_as_fast_as_a_computer_can_send_them_change_nothing(service: Run, record: Record) -> None:
    with Robot(name(service), verbose=False) as robot:
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        with robot.start_joint_impedance_control(1000) as control:
            here = np.array(control.get_state().q)
            begin = time.monotonic()
            for _ in range(20_000):
                passed = time.monotonic() - begin
                try:
                    control.set_target_joints((here + 0.05 * (1.0 - np.cos(3.0 * passed))).tolist())
                except MotionStopped as exc:
                    pytest.fail(str(exc))
    require_recovery(service, record, *TASKS)


def test_a_wild_clock_on_the_wall_changes_nothing(
    tmp_path: Path, limits: JointLimits, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(WILD_CLOCK, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with (
        answering(Run(tmp_path, clock="realtime")) as run,
        watched(name(run), limits, 0.001) as record,
    ):
        require_recovery(run, record, *TASKS)
    assert not {reason for reason in record.reasons if "silent" in reason or "late" in reason}


def test_a_start_without_room_for_the_memory_says_so_and_leaves_nothing(tmp_path: Path) -> None:
    """A limit on the size of files stands for a full /dev/shm: both fail where the memory is allocated."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, 2**20))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    run = PreparedRun(tmp_path)
    done = subprocess.run(
        run.command(), capture_output=True, text=True, timeout=WAIT_S, check=False, preexec_fn=limit
    )
    assert done.returncode == 1
    assert "cannot allocate" in done.stderr
    assert not run.memory.exists()
    assert os.fspath(run.memory) in done.stderr
