"""The WebSocket /robot/stream over a real network, against a running simulation in real time.

Oracles: a client made of `websockets`, `json` and `struct`; what REST says about the same arm; the numbers of
joint_limits.yaml, and numpy's differences of what the state block has of consecutive cycles; psutil for
memory.
"""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import yaml
from arm_activities import CLIENT
from cobot_run import HELPER_ENVIRONMENT, WAIT_S, Run, until
from streaming_client import StreamClient
from thorough import few
from websockets.exceptions import ConnectionClosed, ConnectionClosedError

from cobot import Mode, Robot
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.state_fields import state_dtype

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
CONFIG = Path(__file__).parents[3] / "config"
PATIENCE_S = 20.0
"""For a busy computer."""
LIMITS = yaml.safe_load((CONFIG / "joint_limits.yaml").read_text(encoding="utf-8"))["joint_limits"]


@pytest.fixture
def run(service: Run) -> Iterator[Run]:
    """The service with nobody else at it, its arm at home."""
    service.go_home()
    yield service
    until(lambda: health(service)["session"] is None)


@pytest.fixture
def client(run: Run) -> Iterator[StreamClient]:
    with StreamClient(run.url) as connected:
        yield connected


def post(run: Run, path: str, **body: object) -> httpx.Response:
    return httpx.post(f"{run.url}{path}", json=body, timeout=WAIT_S)


def health(run: Run) -> dict[str, Any]:
    return httpx.get(f"{run.url}/health", timeout=WAIT_S).json()


def sway(client: StreamClient, seconds: float, size_rad: float = 0.1) -> None:
    """Stream a slow wave on joint 1, from where it is at home."""
    for step in range(round(seconds * 50)):
        client.target([size_rad * np.sin(0.02 * step * 2.0), *HOME[1:]])
        time.sleep(0.02)


def test_a_local_clients_session_has_the_same_rights(client: StreamClient, run: Run) -> None:
    script = (
        "import sys, time\nfrom cobot import Mode, Robot\n"
        f"robot = Robot({run.memory.name.removeprefix('cobot-')!r})\n"
        "robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)\n"
        "control = robot.start_joint_impedance_control()\nprint('ready', flush=True)\nsys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as local:
        assert local.stdout is not None
        assert local.stdout.readline() == "ready\n"
        named = f"the robot is in use by a streaming client (process {local.pid})"
        motion = post(run, "/robot/move/named", name="home")
        assert (motion.status_code, motion.json()["code"]) == (409, "conflict")
        assert named in motion.json()["detail"]
        sequence = {"config": ("s.json", "{}", "application/json")}
        assert named in httpx.post(f"{run.url}/sequences/start", files=sequence, timeout=WAIT_S).text
        client.send("session")
        assert named in client.answer()["detail"]
        assert health(run)["session"]["client"] == f"a streaming client (process {local.pid})"
        stopped = post(run, "/stop").json()
        assert stopped["stopped"] == [f"a streaming client (process {local.pid})"]
        assert stopped["success"]
        assert health(run)["session"] is None
        local.kill()
    client.session()
    client.ended()


KILLED = """
import time
import numpy as np
from streaming_client import StreamClient
client = StreamClient({url!r})
client.session(inner_control_hz=100)
home = {home!r}
print("ready", flush=True)
for step in range(100000):
    client.target([0.2 * (1.0 - np.cos(0.02 * step)), *home[1:]])
    time.sleep(0.01)
"""


def test_a_killed_clients_arm_comes_to_rest_within_its_limits(run: Run) -> None:
    script = KILLED.format(url=run.url, home=HOME)
    memory = RobotMemory.attach(run.name, MemoryRole.READER)

    def look() -> np.ndarray:
        time.sleep(2e-4)
        return memory.state.read().reshape(1).copy()

    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=HELPER_ENVIRONMENT
    ) as other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline() == "ready\n"
            # On a busy computer many states are not seen: until enough have been in step.
            states = record_until(look, lambda state: abs(state["commanded_velocity"][0]) > 0.3, 150)
        finally:
            other.kill()
    states += record_until(look, lambda state: int(state["session"]) == 0)
    memory.close()
    run.until(lambda: "has ended: the connection to the client was lost" in run.output)
    require_limits(np.concatenate(states))
    assert health(run)["session"] is None
    assert health(run)["robot"]["mode"] == "HOLD"


def of(client: StreamClient) -> Callable[[], np.ndarray]:
    """The next state that a client gets, in binary."""
    return lambda: np.frombuffer(client.socket.recv(WAIT_S), state_dtype(7), 1, 16)


def follow(client: StreamClient, cycles: int) -> np.ndarray:
    """What a client gets in so many cycles."""
    end = int(of(client)()["cycle"][0]) + cycles
    return np.concatenate(record_until(of(client), lambda state: state["cycle"] >= end))


def record_until(look: Callable[[], np.ndarray], condition: Any, in_step: int = 0) -> list[np.ndarray]:
    """What is seen until a state meets the condition and so many in a session followed the cycle before."""
    states: list[np.ndarray] = []
    followed = 0
    deadline_s = time.monotonic() + WAIT_S
    while time.monotonic() < deadline_s:
        states.append(look())
        if len(states) > 1 and states[-2]["session"][0]:
            followed += int(states[-1]["cycle"][0] - states[-2]["cycle"][0] == 1)
        if followed >= in_step and condition(states[-1][0]):
            return states
    raise AssertionError("did not happen")


def require_limits(states: np.ndarray) -> None:
    """Differences count between cycles that follow each other; a session's end re-bases the command."""
    streamed = states[states["session"] != 0]
    apart_s = np.diff(streamed["cycle"].astype(np.int64)) * 1e-3
    together = apart_s == 1e-3
    assert together.sum() > 100
    position = streamed["commanded_position"]
    velocity = np.diff(position, axis=0)[together] / 1e-3
    jerk = np.diff(streamed["commanded_acceleration"], axis=0)[together] / 1e-3
    for found, name in (
        (velocity, "max_velocity"),
        (streamed["commanded_acceleration"], "max_acceleration"),
        (jerk, "max_jerk"),
    ):
        bound = np.array([joint[name] for joint in LIMITS.values()])
        assert (np.abs(found) <= bound * 1.001 + 1e-9).all(), (name, np.abs(found).max(axis=0))


def test_a_client_that_does_not_read_costs_nothing_and_gets_the_newest(
    client: StreamClient, run: Run
) -> None:
    process = run.child("app")
    assert process is not None
    client.send("subscribe", rate_hz=1000, format="binary")
    client.socket.recv(WAIT_S)
    seen = 0
    while seen <= 500:  # A busy service sends fewer: then another one does not read.
        with StreamClient(run.url, max_queue=4) as deaf:
            deaf.send("subscribe", rate_hz=1000)
            deaf.state()
            follow(client, 500)
            before = process.memory_info().rss
            # Some seconds: less than after which who reads nothing is sent away.
            states = follow(client, 1500)
            assert process.memory_info().rss - before < 4e6
            seen += len(states)
            newest = int(states["cycle"][-1])
            last = until(
                lambda deaf=deaf, newest=newest: (state := deaf.state())["cycle"] >= newest and state
            )
            assert last["sequence"] > 0
    assert health(run)["status"] == "ok"


def test_a_frame_that_is_too_large_ends_its_connection_only(client: StreamClient, run: Run) -> None:
    with StreamClient(run.url) as other:
        other.socket.send("x" * 70_000)
        with pytest.raises(ConnectionClosedError, match="1009"):
            other.answer()
    client.send("subscribe")
    client.state()


def test_a_connection_that_breaks_off_ends_its_session(run: Run) -> None:
    client = StreamClient(run.url)
    client.session(inner_control_hz=50)
    sway(client, 0.6)
    client.socket.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    client.socket.socket.close()  # a reset, no farewell
    until(lambda: health(run)["session"] is None)
    assert "has ended: the connection to the client was lost" in run.output
    assert health(run)["robot"]["mode"] == "HOLD"


@pytest.mark.thorough
def test_a_client_that_hangs_loses_its_session_and_the_right_to_stream(run: Run) -> None:
    """Its process is stopped: the connection stands, and nobody answers (docs/conventions.md)."""
    command = [sys.executable, "-c", CLIENT, run.url]
    hung = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert hung.stdout is not None
    try:
        assert hung.stdout.readline() == "streaming\n"
        hung.send_signal(signal.SIGSTOP)
        begin_s = time.monotonic()
        until(lambda: health(run)["session"] is None)
        assert time.monotonic() - begin_s < 10.0 + 2.0 * PATIENCE_S
        assert health(run)["robot"]["mode"] == "HOLD"
        with StreamClient(run.url) as again:
            again.session()
            again.ended()
    finally:
        hung.kill()
        hung.communicate()


def test_a_lost_rtloop_ends_the_session(run: Run) -> None:
    with StreamClient(run.url) as client:
        client.session(inner_control_hz=50)
        sway(client, 0.4)
        rtloop = run.child("rtloop")
        assert rtloop is not None
        rtloop.kill()
        # The service misses it, or first its successor, which on a busy computer takes its time to begin.
        reason = client.until_ended()["reason"]
        missed = r"rtloop \(pid \d+\) (is gone|has published nothing for .* s); cobot run restarts it .*"
        assert reason == "rtloop was restarted" or re.fullmatch(missed, reason), reason
        run.until(run.healthy)
        client.session()
        client.ended()


@pytest.mark.thorough
def test_a_killed_service_leaves_no_session_behind(run: Run) -> None:
    client = StreamClient(run.url)
    client.session(inner_control_hz=50)
    sway(client, 0.4)
    service = run.child("app")
    assert service is not None
    service.kill()
    run.until(lambda: run.restarted("app", service.pid) and run.healthy())
    assert health(run)["session"] is None
    assert health(run)["robot"]["reason"] == "the streaming client has died"
    client.socket.close()
    with StreamClient(run.url) as again:
        again.session()
        again.ended()


@pytest.mark.thorough
def test_sigterm_during_a_session_ends_everything_at_once(tmp_path: Path) -> None:
    run = Run(tmp_path, clock="realtime")
    try:
        run.until(run.healthy)
        with StreamClient(run.url) as client:
            client.session(inner_control_hz=50)
            client.send("subscribe", rate_hz=1000)
            sway(client, 0.4)
            run.process.send_signal(signal.SIGTERM)
            with contextlib.suppress(ConnectionClosed):
                while True:
                    client.socket.recv(WAIT_S)
        assert run.process.wait(WAIT_S) == 0
        for word in ("ERROR", "Traceback", "exception"):
            assert word not in run.output
    finally:
        run.end()


@pytest.mark.parametrize("where", few(["local", "remote"]))
def test_a_script_runs_here_and_there(run: Run, where: str) -> None:
    name = run.url if where == "remote" else run.memory.name.removeprefix("cobot-")
    with Robot(name) as robot:
        assert robot.info().DoF == 7
        assert robot.info().serial_num == run.memory.name.removeprefix("cobot-")
        np.testing.assert_allclose(robot.states().q, HOME, atol=2e-3)
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        with robot.start_joint_impedance_control(100) as control:
            assert control.is_running()
            for step in range(60):
                control.set_target_joints([0.001 * step, *HOME[1:]])
                time.sleep(0.01)
            until(lambda: abs(control.get_state().q[0] - 0.059) < 5e-3)
        assert not control.is_running()
        robot.switch_mode(Mode.RT_CARTESIAN_MOTION_FORCE)
        with robot.start_cartesian_control(100) as poses:
            pose = poses.get_state().tcp_pose
            goal = [pose[0], pose[1], pose[2] - 0.03, *pose[3:]]
            assert poses.move_to_pose_sync(goal, 0.8, WAIT_S)
            np.testing.assert_allclose(poses.get_state().tcp_pose[:3], goal[:3], atol=3e-3)
            poses.trigger_estop()
            until(lambda: not robot.operational())
        assert not robot.estop_released()
        robot.clear_fault()
        until(robot.operational)
        robot.switch_mode(Mode.NRT_PLAN_EXECUTION)
        robot.execute_plan("PLAN-Home", speed=1.0)
        until(lambda: not robot.busy())
        assert robot.stopped()


def reaches(run: Run, joint1_rad: float) -> float:
    """How far the first joint comes, rad, when targets lead it there from home in two seconds; and back."""
    run.go_home()
    with StreamClient(run.url) as client:
        client.session(inner_control_hz=50)
        for step in range(100):
            client.target([joint1_rad * step / 100, *HOME[1:]])
            time.sleep(0.02)
        before, reached = -1.0, 0.0
        while abs(reached - before) > 1e-3:  # until it rests
            for _ in range(50):
                client.target([joint1_rad, *HOME[1:]])
                time.sleep(0.02)
            before, reached = reached, run.joints()[0]
        ended = client.ended()
    run.go_home()
    assert ended["reason"] == "the client has ended the session"
    return reached


def surface_of_a_ball(radius_m: float, number: int) -> list[list[float]]:
    """Points about the origin, shape (number, 3), m."""
    points = np.random.default_rng(0).normal(size=(number, 3))
    return (radius_m * points / np.linalg.norm(points, axis=1, keepdims=True)).tolist()


@pytest.mark.thorough
@pytest.mark.parametrize(
    "solid",
    [
        {"shape": "sphere", "radius": 0.05},
        {"shape": "point_cloud", "voxel": 0.005, "points": surface_of_a_ball(0.05, 10_000)},
    ],
    ids=["sphere", "point_cloud"],
)
def test_a_stream_keeps_away_from_an_object_of_the_scene_after_a_restart_too(
    run: Run, solid: dict[str, Any]
) -> None:
    """The object is where the hand would be after two thirds of the way."""
    post(run, "/robot/move/joints", joints=[0.8, *HOME[1:]])
    pose = httpx.get(f"{run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    assert reaches(run, 1.2) == pytest.approx(1.2, abs=0.01), "nothing is in the way"
    try:
        post(run, "/scene", objects={"ball": {**solid, **pose}}).raise_for_status()
        assert 0.2 < reaches(run, 1.2) < 0.75
        rtloop = run.child("rtloop")
        assert rtloop is not None
        rtloop.kill()
        run.until(lambda: run.restarted("rtloop", rtloop.pid) and run.healthy())
        assert 0.2 < reaches(run, 1.2) < 0.75
    finally:
        post(run, "/scene", clear=True).raise_for_status()
