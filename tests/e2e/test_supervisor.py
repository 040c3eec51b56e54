"""`cobot run` as a person would run it: one command, signals, crashes, a second start.

The oracles are the operating system's: exit statuses, /dev/shm, the process table (psutil).
"""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import pytest
from cobot_run import WAIT_S, Run, answering
from mcap.reader import make_reader

from cobot.launch.process import Niceness

IDLE = -1


@pytest.fixture(scope="module")
def sturdy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """One for the tests that kill its processes and leave it as it was."""
    with answering(Run(tmp_path_factory.mktemp("sturdy"), web=", hang_to_restart_s: 3.0")) as started:
        yield started


def gone(processes: list[psutil.Process]) -> bool:
    return not any(process.is_running() and process.status() != psutil.STATUS_ZOMBIE for process in processes)


def test_the_start_says_what_matters(shared: Run) -> None:
    shared.until(lambda: "Ctrl-C" in shared.output)
    for word in ("address", "robot", "backend", "clock fast", "SCHED_FIFO", "locked memory", "logs"):
        assert word in shared.output
    assert str(shared.config.parent / "logs") in shared.output


def test_the_recorder_takes_the_time_that_nobody_else_wants_once_it_is_there(shared: Run) -> None:
    recorder = shared.child("cobot.recorder")
    assert recorder is not None
    shared.until(lambda: recorder.nice() == Niceness.BACKGROUND)


def test_sigterm_ends_everything_and_leaves_nothing_behind(run: Run) -> None:
    family = psutil.Process(run.process.pid).children(recursive=True)
    assert len(family) >= 2
    run.process.send_signal(signal.SIGTERM)
    assert run.process.wait(WAIT_S) == 0
    run.until(lambda: gone(family))
    assert not run.memory.exists()
    assert "stopping: the arm first" in run.output


def test_sigterm_during_a_motion_brings_the_arm_to_rest_first(run: Run) -> None:
    body = {"joints": [1.0, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 0.01}
    answers: list[object] = []

    def move() -> None:
        try:
            answers.append(httpx.post(f"{run.url}/robot/move/joints", json=body, timeout=WAIT_S).status_code)
        except httpx.TransportError as exc:
            answers.append(exc)

    mover = threading.Thread(target=move)
    mover.start()
    run.until(lambda: (run.health() or {"robot": {}})["robot"].get("mode") == "TRAJECTORY" or answers)
    run.process.send_signal(signal.SIGTERM)
    assert run.process.wait(WAIT_S) == 0
    mover.join(WAIT_S)
    assert answers
    assert not run.memory.exists()


def test_a_second_start_is_refused_with_the_pid_of_the_first(shared: Run) -> None:
    second = subprocess.run(shared.command(), capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert second.returncode == 1
    assert f"pid {shared.process.pid} runs as its supervisor" in second.stderr
    assert shared.healthy()


def test_a_killed_rtloop_is_restarted_where_the_arm_was(sturdy: Run) -> None:
    run = sturdy
    goal = [0.3, 0.2, 0.1, -1.4, 0.1, 1.3, 0.2]
    answer = httpx.post(f"{run.url}/robot/move/joints", json={"joints": goal, "speed": 1.0}, timeout=WAIT_S)
    assert answer.json()["success"], answer.text
    before = run.joints()
    old = run.child("rtloop")
    assert old is not None
    old.kill()
    run.until(lambda: run.restarted("rtloop", old.pid) and run.healthy())
    assert run.joints() == pytest.approx(before, abs=1e-3)
    assert "rtloop" in run.output
    assert "SIGKILL" in run.output
    back = httpx.post(f"{run.url}/robot/move/named", json={"name": "home", "speed": 1.0}, timeout=WAIT_S)
    assert back.json()["success"], back.text


def test_reads_answer_503_with_the_reason_while_rtloop_does_not_run(sturdy: Run) -> None:
    run = sturdy
    rtloop = run.child("rtloop")
    assert rtloop is not None
    rtloop.suspend()
    try:
        run.until(lambda: httpx.get(f"{run.url}/robot/joint_states", timeout=10.0).status_code == 503)
        detail = httpx.get(f"{run.url}/robot/joint_states", timeout=10.0).json()["detail"]
        assert f"pid {rtloop.pid}" in detail
        stop = httpx.post(f"{run.url}/stop", timeout=WAIT_S)
        assert stop.status_code == 200
        assert stop.json()["success"] is False
    finally:
        rtloop.resume()
    run.until(run.healthy)


def test_a_motion_that_is_lost_sight_of_ends_when_rtloop_goes_on(sturdy: Run) -> None:
    run = sturdy
    body = {"points": [{"positions": [0.5, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 2000.0}]}
    assert httpx.post(f"{run.url}/trajectory/send", json=body, timeout=WAIT_S).json()["status"] == "sent"
    rtloop = run.child("rtloop")
    assert rtloop is not None
    rtloop.suspend()

    def lost() -> bool:
        lines = httpx.get(f"{run.url}/trajectory/logs", timeout=WAIT_S).json()["lines"]
        return any("its state is unknown" in line for line in lines)

    run.until(lost)
    rtloop.resume()
    run.until(run.healthy)

    def stopped() -> bool:
        robot = (run.health() or {"robot": {}})["robot"]
        assert isinstance(robot, dict)
        return robot.get("motion_result") == "STOPPED" and robot.get("mode") == "HOLD"

    run.until(stopped)


def test_a_killed_service_is_restarted_and_the_arm_has_stopped(sturdy: Run) -> None:
    run = sturdy
    body = {"points": [{"positions": [0.5, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 2000.0}]}
    assert httpx.post(f"{run.url}/trajectory/send", json=body, timeout=WAIT_S).json()["status"] == "sent"
    old = run.child("app")
    assert old is not None
    workers = old.children(recursive=True)
    old.kill()
    run.until(lambda: run.restarted("app", old.pid) and run.healthy())
    run.until(lambda: gone(workers))
    health = run.health()
    assert health is not None
    robot = health["robot"]
    assert isinstance(robot, dict)
    assert robot["mode"] == "HOLD"


def test_a_service_that_hangs_is_ended_and_started_anew(sturdy: Run) -> None:
    run = sturdy
    old = run.child("app")
    assert old is not None
    workers = old.children(recursive=True)
    old.suspend()
    run.until(lambda: run.restarted("app", old.pid) and run.healthy())
    run.until(lambda: gone(workers))
    assert f"service (pid {old.pid}) hangs, stopped by SIGSTOP: no heartbeat for 3 s" in run.output


def test_a_motion_that_fails_in_the_background_is_visible(sturdy: Run) -> None:
    run = sturdy
    home = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]

    def ask(method: str, **fields: object) -> object:
        answer = httpx.post(
            f"{run.url}/{run.name}/MotionControl/{method}", json=fields, timeout=WAIT_S
        ).json()
        assert answer["code"] == 0, answer
        return answer["result"]

    ask("moveJoint", q=[2.0, *home[1:]], v=0.01)  # takes long
    ask("moveJoint", q=home)
    rtloop = run.child("rtloop")
    assert rtloop is not None
    rtloop.kill()
    run.until(lambda: ask("getExecId") == IDLE)
    assert "rtloop" in str(ask("getLastError"))
    assert ask("getQueueSize") == 0
    assert "the motion queue is emptied" in run.output
    run.until(run.healthy)
    ask("moveJoint", q=run.joints())  # and goes on working
    run.until(lambda: ask("getExecId") == IDLE)


def test_what_a_killed_supervisor_left_is_taken_over(run: Run) -> None:
    family = psutil.Process(run.process.pid).children(recursive=True)
    run.process.kill()
    run.process.wait(WAIT_S)
    run.until(lambda: gone(family))
    assert run.memory.exists()
    run.start()
    run.until(run.healthy)
    run.end()
    assert not run.memory.exists()


def test_what_lies_in_the_current_folder_is_not_taken_for_cobot(tmp_path: Path) -> None:
    """A clone's folder is called cobot too, and Python would look there first."""
    for name in ("cobot/config", "app", "rtloop", "config"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "__init__.py").write_text(
            "raise RuntimeError('the wrong one')\n", encoding="utf-8"
        )
    command = [str(Path(sys.executable).with_name("cobot")), "check"]
    environment = {**os.environ, "HOME": str(tmp_path)}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=WAIT_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "ok      backend: mujoco" in done.stdout


def test_a_port_in_use_is_named(shared: Run, tmp_path: Path) -> None:
    port = shared.url.rsplit(":", 1)[1]
    command = [*shared.command(), "--port", port]
    second = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert second.returncode == 1
    assert f"cannot listen on 127.0.0.1 port {port}: Address already in use" in second.stderr


def test_help_explains_itself_and_wrong_usage_is_refused() -> None:
    def cobot(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "cobot", *arguments],
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )

    help_text = cobot("--help")
    assert help_text.returncode == 0
    assert "cobot check" in help_text.stdout
    assert cobot("run", "--port", "99999").returncode == 2
    broken = cobot("check", "--config", "nowhere.yaml")
    assert broken.returncode == 1
    assert broken.stderr.startswith("cobot: ")
    assert "nowhere.yaml: no such file" in broken.stderr


def test_check_passes_the_shipped_configuration_and_names_what_is_wrong_in_another(tmp_path: Path) -> None:
    def check(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "cobot", "check", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)

    good = check()
    assert good.returncode == 0, good.stdout
    for name in ("endpoints", "robot", "position home", "position work", "position transport"):
        assert f"ok      {name}: " in good.stdout
    srdf = tmp_path / "bad.srdf"
    joints = "".join(
        f'<joint name="joint{i}" value="{v}"/>' for i, v in enumerate([0, 2.0, 0, -2.0, 0, 0, 0], 1)
    )
    straight = "".join(f'<joint name="joint{i}" value="0"/>' for i in range(1, 8))
    srdf.write_text(
        '<robot name="iiwa14"><group name="iiwa_arm"><chain base_link="base_link" tip_link="tcp"/></group>'
        f'<group_state name="home" group="iiwa_arm">{straight}</group_state>'
        f'<group_state name="folded" group="iiwa_arm">{joints}</group_state></robot>',
        encoding="utf-8",
    )
    config = tmp_path / "settings.yaml"
    config.write_text("robot: {srdf: bad.srdf}\n", encoding="utf-8")
    bad = check("--config", str(config))
    assert bad.returncode == 1
    assert "FAILED  position folded: " in bad.stdout
    assert "ok      position home: " in bad.stdout


@pytest.mark.thorough
def test_a_recording_goes_on_without_a_missing_cycle_when_recorder_and_rtloop_are_killed_or_stopped(
    sturdy: Run, tmp_path: Path
) -> None:
    """Oracle: mcap's reader. The record of the cycle in which rtloop was killed may be missing."""
    run = sturdy

    def recorder() -> dict[str, object]:
        found = (run.health() or {"recorder": None})["recorder"]
        return found if isinstance(found, dict) else {}

    def asked(action: str) -> list[str]:
        answer = httpx.post(f"{run.url}/recordings", json={"action": action}, timeout=WAIT_S)
        assert answer.status_code == 200, answer.text
        names: list[str] = answer.json()["names"]
        return names

    def asked_health() -> dict[str, Any]:
        return httpx.get(f"{run.url}/health", timeout=WAIT_S).json()  # type: ignore[no-any-return]

    run.until(lambda: recorder().get("alive"))
    (started,) = asked("start")
    for module in ("cobot.recorder", "rtloop", "cobot.recorder"):
        old = run.child(module)
        assert old is not None
        cycle = recorder()
        assert cycle["recording"] == started
        old.kill()
        run.until(lambda module=module, old=old: run.restarted(module, old.pid) and run.healthy())
        run.until(lambda old=old: recorder().get("alive") and recorder().get("pid") != old.pid)
    old = run.child("cobot.recorder")
    assert old is not None
    lost = recorder()["lost"]  # by fast motions of other tests
    old.suspend()
    silent = f"the recorder (pid {old.pid}) has not responded for"
    refused = httpx.post(f"{run.url}/recordings", json={"action": "dump"}, timeout=WAIT_S)
    assert refused.status_code == 503, refused.text
    assert silent in refused.json()["detail"]
    assert any(silent in problem for problem in asked_health()["problems"])  # long before it is replaced
    run.go_home()  # the arm does not need it
    run.until(lambda: recorder().get("alive") and recorder().get("pid") != old.pid)
    assert recorder()["lost"] == lost
    names = asked("stop")
    numbers = []
    for name in names:
        content = httpx.get(f"{run.url}/recordings/{name}", timeout=WAIT_S).content
        with io.BytesIO(content) as file:
            found = make_reader(file, validate_crcs=True).iter_messages(topics="/cycle")
            numbers += [message.sequence for _, _, message in found]
        assert httpx.delete(f"{run.url}/recordings/{name}", timeout=WAIT_S).status_code == 200
    steps = np.diff(numbers)
    assert len(numbers) > 100
    assert set(steps.tolist()) <= {1, 2}
    assert (steps == 2).sum() <= 1
