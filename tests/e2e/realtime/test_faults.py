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
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from arm_activities import TASKS, child, doing, left_alone, name, require_recovery, robot_health
from cobot_run import WAIT_S, Run, answering
from faults import BLOCKS, Record, spoil, watched
from thorough import few

from cobot import Mode, Robot
from cobot.config import load_settings
from cobot.errors import MotionStopped, UnavailableError
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.robot import description as robots
from cobot.types import JointLimits

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


@pytest.fixture
def record(service: Run, limits: JointLimits) -> Iterator[Record]:
    with watched(name(service), limits, 0.001) as made:
        yield made


@pytest.mark.parametrize("task", few(TASKS))
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
            assert left_alone(robot_health(service)["reason"])
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


@pytest.mark.parametrize("pause_s", few([0.2, 2.0]))
@pytest.mark.parametrize(("which", "task"), [("app", "motion"), ("app", "stream"), ("client", "stream")])
def test_a_process_that_is_paused_does_not_harm_the_arm(
    service: Run, record: Record, which: str, task: str, pause_s: float
) -> None:
    with doing(service, task) as done:
        victim = child(service, which, done)
        victim.suspend()
        time.sleep(pause_s)
        victim.resume()
        if which == "app" and task == "motion" and pause_s > 1.0:
            service.until(lambda: "the service has been silent for" in " ".join(record.reasons))
        elif which == "client" and pause_s > 1.0:
            interventions = service.health()["interventions"]  # type: ignore[index]
            assert interventions["command_timeout"] >= 1  # type: ignore[index]
    require_recovery(service, record, task)


@pytest.mark.parametrize("task", few(TASKS))
def test_a_writer_gone_wild_does_not_harm_the_arm(service: Run, record: Record, task: str) -> None:
    random = np.random.default_rng(list(TASKS).index(task))
    memory = RobotMemory.attach(name(service), MemoryRole.READER)
    with doing(service, task):
        for block in BLOCKS:
            for _ in range(5):
                spoil(memory, block, random)
                time.sleep(0.01)
    memory.close()
    require_recovery(service, record, task)


def test_a_service_that_dies_with_its_blocks_spoilt_comes_back(service: Run, record: Record) -> None:
    memory = RobotMemory.attach(name(service), MemoryRole.READER)
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
    memory = RobotMemory.attach(name(service), MemoryRole.READER)
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
                except UnavailableError:  # the computer keeps rtloop waiting: then its state is an old one
                    time.sleep(0.01)
    require_recovery(service, record, *TASKS)


@pytest.mark.thorough
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
