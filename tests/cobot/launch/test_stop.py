"""`cobot stop` at a cycle that runs in this process, and at none. Oracle: rtloop's own state."""

from __future__ import annotations

import io
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from rig import Rig

from cobot.config import Settings, load_settings
from cobot.errors import LayoutError
from cobot.ipc import shm
from cobot.ipc.layout import MotionResult
from cobot.launch import cli
from cobot.launch import stop as command
from cobot.launch.running_config import RunningConfig
from cobot.launch.stop import stop
from cobot.planners import MotionRequest, plan
from cobot.types import LoopMode, PlannerName, Scaling


@contextmanager
def turning(rig: Rig) -> Iterator[None]:
    """Its cycle runs beside the test."""
    ended = threading.Event()

    def turn() -> None:
        while not ended.is_set():
            rig.step(5)
            time.sleep(0.001)

    thread = threading.Thread(target=turn)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def start_motion(rig: Rig) -> None:
    goal = rig.home + 0.5 * np.eye(7)[0]
    assert rig.start(plan(rig.robot, MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(0.1)))) == ""


def said(rig: Rig, *, latched: bool = False) -> tuple[bool, str]:
    out = io.StringIO()
    at_rest = stop([rig.memory.robot], latched=latched, out=out)
    return at_rest, out.getvalue().removeprefix(f"{rig.memory.robot}: ").removesuffix("\n")


def test_a_motion_is_stopped_and_waited_for(rig: Rig) -> None:
    start_motion(rig)
    with turning(rig):
        assert said(rig) == (True, "stopped motion 1; the arm is at rest")
    assert rig.result is MotionResult.STOPPED


def test_without_a_motion_it_says_so(rig: Rig) -> None:
    with turning(rig):
        assert said(rig) == (True, "nothing was running; the arm is at rest")


def test_it_waits_until_the_service_has_followed(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the service would end a motion that is requested right after the stop.

    Oracle: two heartbeats, as the service sends them after the stop.
    """
    monkeypatch.setattr(command, "FOLLOWED_S", 60.0)
    beats = 0

    def beat() -> None:
        nonlocal beats
        while not rig.memory.outside_stops.value:
            time.sleep(0.001)
        for _ in range(2):
            time.sleep(0.1)
            beats += 1
            rig.memory.heartbeat.publish()

    thread = threading.Thread(target=beat)
    with turning(rig):
        thread.start()
        assert said(rig) == (True, "nothing was running; the arm is at rest")
        assert beats == 2
    thread.join()


def test_an_estop_is_latched(rig: Rig) -> None:
    start_motion(rig)
    with turning(rig):
        answer = "stopped motion 1; the arm is at rest; latched until POST /robot/reset"
        assert said(rig, latched=True) == (True, answer)
    assert rig.mode is LoopMode.ESTOP


def test_without_a_cycle_nobody_says_that_the_arm_rests(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "REST_S", 0.5)
    start_motion(rig)
    at_rest, text = said(rig)
    assert not at_rest
    assert text.startswith(
        "stop requested; motion 1; the arm is NOT known to be at rest: rtloop has published"
    )
    rig.run()
    assert rig.result is MotionResult.STOPPED, "the stop waits for rtloop"


def test_an_rtloop_that_has_ended_is_not_waited_for(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    monkeypatch.setattr(command, "REST_S", 60.0)
    start_motion(rig)
    rig.memory.statistics.data["pid"] = ended.pid
    rig.memory.statistics.publish()
    at_rest, text = said(rig)
    assert not at_rest
    assert text.endswith(": rtloop is not running")


def test_several_stop_at_once_and_one_that_does_not_run_fails_all(rig: Rig) -> None:
    out = io.StringIO()
    start_motion(rig)
    with turning(rig):
        assert not stop(["nobody-here", rig.memory.robot], latched=False, out=out)
    assert "nobody-here: NOT stopped: robot 'nobody-here' is not running" in out.getvalue()
    assert f"{rig.memory.robot}: stopped motion 1; the arm is at rest" in out.getvalue()


def test_the_memory_of_another_version_is_left_alone(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shm, "LAYOUT_VERSION", 99)
    with pytest.raises(LayoutError):
        shm.RobotMemory.attach(rig.memory.robot, shm.MemoryRole.READER)
    at_rest, text = said(rig)
    assert not at_rest
    assert "NOT stopped" in text
    assert rig.memory.outside_stops.value == 0


def test_the_command_needs_no_settings_when_a_robot_is_named(
    rig: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with turning(rig):
        assert cli.main(["stop", "--robot", rig.memory.robot]) == cli.EXIT_OK
        mine = tmp_path / "mine.yaml"
        mine.write_text(f"robot: {{name: {rig.memory.robot}}}\n", encoding="utf-8")
        assert cli.main(["stop", "--config", str(mine)]) == cli.EXIT_OK
    assert capsys.readouterr().out.count("nothing was running; the arm is at rest") == 2
    assert cli.main(["stop", "--robot", "nobody-here"]) == cli.EXIT_FAILED


def test_the_audit_of_the_cobot_that_runs_has_it(rig: Rig, settings: Settings, tmp_path: Path) -> None:
    robot = settings.robot.model_copy(update={"name": rig.memory.robot})
    running = RunningConfig.of(rig.memory.robot)
    running.create(settings.model_copy(update={"robot": robot, "logs": tmp_path}))
    try:
        with turning(rig):
            assert cli.main(["stop", "--robot", rig.memory.robot]) == cli.EXIT_OK
        assert f"stop {rig.memory.robot}" in load_settings(running.file).audit_file.read_text(
            encoding="utf-8"
        )
    finally:
        running.remove()


ELSEWHERE = "http://robot.example:8007"


@pytest.mark.parametrize("url", [ELSEWHERE, "http://[half", ""])
def test_who_stops_a_robot_of_another_computer_is_told_what_to_type(
    url: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing runs here: that is not the end of what can be done."""
    monkeypatch.setenv("COBOT_URL", url)
    monkeypatch.setattr(command, "robots_running", list)
    assert cli.main(["stop"]) == cli.EXIT_FAILED
    said = capsys.readouterr()
    assert (
        said.out == "no robot is running on this computer; for a robot on another computer: "
        "cobot stop --url http://ROBOT:8007\n"
    )
    hint = (
        "cobot: the service of COBOT_URL was NOT asked, because it is on another computer: cobot stop "
        f"--url {url}\n"
    )
    assert said.err == (hint if url else "")


@pytest.mark.parametrize(
    ("url", "told"),
    [(ELSEWHERE, True), ("http://localhost:9000", False), ("http://127.0.0.1:8007", False)],
)
def test_who_stops_the_robots_of_this_computer_is_told_that_another_one_goes_on(
    rig: Rig, url: str, told: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COBOT_URL", url)
    with turning(rig):
        assert cli.main(["stop", "--robot", rig.memory.robot]) == cli.EXIT_OK
    said = capsys.readouterr()
    assert "the arm is at rest" in said.out
    assert ("NOT asked" in said.err) is told
