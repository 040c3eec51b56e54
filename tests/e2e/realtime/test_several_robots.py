"""Two robots under one `cobot run`: each moves, stops, breaks and is restarted by itself.

Oracles: the process table (psutil), where the arms are as HTTP shows it, and httpx and websockets as clients.
The clock is that of the wall: with the fast one, nothing could be under way at the same time.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from chromium import CHROMIUM, Page, browsing
from cobot_run import WAIT_S, Pair, unique_name, until
from lerobot_stand_in import PLUGIN
from wheels import build, client_wheel

from cobot import Robot
from cobot.client import Client

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.4, 0.1, 0.0, -1.4, 0.0, 1.4, 0.2]
EXAMPLES = Path(__file__).parents[3] / "examples"
SESSION = Path(__file__).parents[2] / "cobot" / "learning" / "lerobot_session.py"
LEROBOT_PYTHONS = {"3.11": "0.4", "3.12": "0.6"}
"""Versions of LeRobot by the Python of their environment."""


def rtloop(pair: Pair, robot: str) -> psutil.Process | None:
    for process in psutil.Process(pair.process.pid).children():
        try:
            command = process.cmdline()
            if command[1:4] == ["-P", "-m", "rtloop"] and command[command.index("--robot") + 1] == robot:
                return process
        except (psutil.NoSuchProcess, psutil.ZombieProcess):
            continue
    return None


@pytest.fixture
def http(pair: Pair) -> Iterator[httpx.Client]:
    """Both arms at home."""
    pair.until(pair.healthy)
    with httpx.Client(base_url=pair.url, timeout=WAIT_S) as client:
        go_home(pair, client)
        yield client


def go_home(pair: Pair, client: httpx.Client) -> None:
    client.post("/stop").raise_for_status()
    with ThreadPoolExecutor() as threads:
        both = [pair.left, pair.right]
        for answer in threads.map(lambda name: move(client, name, HOME, speed=1.0), both):
            assert answer.json()["success"], answer.text


def move(client: httpx.Client, robot: str, joints: list[float], speed: float = 0.5) -> httpx.Response:
    return client.post(f"/robots/{robot}/move/joints", json={"joints": joints, "speed": speed})


def send(client: httpx.Client, robot: str, seconds: float, joints: list[float] = AWAY) -> int:
    """Have it move for so long; the motion's number."""
    body = {"points": [{"positions": joints, "time_from_start": seconds}]}
    answer = client.post(f"/robots/{robot}/trajectory/send", json=body)
    assert answer.status_code == 200, answer.text
    return int(answer.json()["motion_id"])


def robot_health(client: httpx.Client, robot: str) -> dict[str, Any]:
    answer = client.get(f"/robots/{robot}/health").json()
    return {**answer, **answer["robot"]}


def moving(client: httpx.Client, robot: str) -> bool:
    return bool(robot_health(client, robot)["mode"] == "TRAJECTORY")


def arrived(client: httpx.Client, robot: str, motion: int) -> bool:
    lines = client.get(f"/robots/{robot}/trajectory/logs").json()["lines"]
    ended = [line for line in lines if f"motion {motion}: " in line and "accepted" not in line]
    assert not ended or ended[-1].endswith("arrived and settled"), ended
    return bool(ended)


def joints(client: httpx.Client, robot: str) -> list[float]:
    answer = client.get(f"/robots/{robot}/joint_states")
    answer.raise_for_status()
    return list(answer.json()["position"])


def test_a_killed_rtloop_leaves_the_motion_of_the_other_alone(pair: Pair, http: httpx.Client) -> None:
    left_process = rtloop(pair, pair.left)
    assert left_process is not None
    for seconds in (8.0, 32.0, 96.0):  # so long that the motion outlasts the restart on this computer
        old = rtloop(pair, pair.right)
        assert old is not None
        left = send(http, pair.left, seconds)
        send(http, pair.right, 300.0)
        before = robot_health(http, pair.left)["interventions"]
        old.kill()
        pair.until(lambda pid=old.pid: (new := rtloop(pair, pair.right)) is not None and new.pid != pid)
        pair.until(pair.healthy)
        outlasts = moving(http, pair.left)
        pair.until(lambda motion=left: arrived(http, pair.left, motion))
        if outlasts:
            break
        go_home(pair, http)
    assert outlasts
    assert joints(http, pair.left) == pytest.approx(AWAY, abs=2e-3)
    health = robot_health(http, pair.left)
    kinds = {kind for kind, count in health["interventions"].items() if count != before[kind]}
    assert kinds <= {"overrun"}, "nothing of the other robot's is caught here"
    assert health["rtloop"]["pid"] == left_process.pid
    assert f"rtloop {pair.right} (pid {old.pid}) ended: SIGKILL" in pair.output
    assert move(http, pair.right, HOME).json()["success"]


def test_a_paused_rtloop_of_one_keeps_nobody_waiting_for_the_other(pair: Pair, http: httpx.Client) -> None:
    process = rtloop(pair, pair.right)
    assert process is not None
    process.suspend()
    try:
        pair.until(lambda: http.get(f"/robots/{pair.right}/joint_states").status_code == 503)
        left = send(http, pair.left, 1.0)
        pair.until(lambda: arrived(http, pair.left, left))
        both = http.post("/stop").json()
        assert not both["success"]
        assert f"{pair.left}: nothing was running; the arm is at rest" in both["message"]
        assert http.post(f"/robots/{pair.left}/stop").json()["success"]
    finally:
        process.resume()
    pair.until(pair.healthy)


def test_a_sequence_moves_the_robot_at_whose_address_it_was_started(pair: Pair, http: httpx.Client) -> None:
    sequence = {"waypoints": [{"joints": AWAY, "speed": 0.8}]}
    started = http.post(
        f"/robots/{pair.right}/sequences/start",
        files={"config": ("s.json", json.dumps(sequence), "application/json")},
        data={"n_iterations": "1"},
    )
    assert started.status_code == 200, started.text

    def status() -> dict[str, Any]:
        return dict(http.get(f"/robots/{pair.right}/sequences/status").json())

    pair.until(lambda: status()["status"] == "finished")
    logs = http.get(f"/robots/{pair.right}/sequences/logs").json()["lines"]
    assert status()["returncode"] == 0, logs
    assert joints(http, pair.right) == pytest.approx(AWAY, abs=2e-3)
    assert joints(http, pair.left) == pytest.approx(HOME, abs=2e-3)
    assert http.get("/sequences/status").json()["status"] == "idle"


def test_the_python_clients_reach_either_robot(pair: Pair, http: httpx.Client) -> None:
    with Client(pair.url, robot=pair.right) as client:
        client.move_joints(AWAY, speed=0.8)
        assert client.joint_states()["position"] == pytest.approx(AWAY, abs=2e-3)
    for address in (f"{pair.url}/robots/{pair.right}", pair.right):  # over the network, and on this computer
        with Robot(address, connect_retries=0) as robot:
            assert robot.states().q == pytest.approx(AWAY, abs=2e-3)
    with Robot(pair.url, connect_retries=0) as robot:
        assert robot.states().q == pytest.approx(HOME, abs=2e-3)


@pytest.mark.thorough
def test_the_example_moves_both(pair: Pair, http: httpx.Client) -> None:
    ended = subprocess.run(
        [sys.executable, str(EXAMPLES / "two_robots.py")],
        env={**os.environ, "COBOT_URL": pair.url},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr


@pytest.mark.thorough
def test_a_robot_that_cannot_start_does_not_keep_the_other_from_starting(tmp_path: Path) -> None:
    run = Pair(tmp_path, second=", backend: 'no.such:Arm'")
    try:
        run.until(lambda: (run.health() or {"status": ""})["status"] == "ok")
        with httpx.Client(base_url=run.url, timeout=WAIT_S) as client:
            answer = client.post("/robot/move/joints", json={"joints": AWAY, "speed": 1.0})
            assert answer.json().get("success"), answer.text + run.output
            assert client.get(f"/robots/{run.right}/joint_states").status_code == 503
            assert robot_health(client, run.right)["problems"] == ["rtloop has not started yet"]
        assert f"rtloop {run.right}: ERROR robot.backend: cannot load 'no.such:Arm'" in run.output
    finally:
        run.end()
    for name in (run.left, run.right):
        assert not (Path("/dev/shm") / f"cobot-{name}").exists()


def test_a_start_of_two_robots_is_refused_while_one_of_them_runs(pair: Pair, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    free = unique_name()
    other.write_text(
        f"logs: logs\nweb: {{port: 0}}\nrobots: [{{name: {free}}}, {{name: {pair.right}}}]\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "cobot", "run", "--config", str(other)]
    second = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=False)
    assert second.returncode == 1
    assert f"pid {pair.process.pid} runs as its supervisor" in second.stderr
    assert not (Path("/dev/shm") / f"cobot-{free}").exists()
    assert pair.healthy()


@pytest.mark.thorough
def test_the_panel_has_a_tab_for_each_robot(pair: Pair, http: httpx.Client, tmp_path: Path) -> None:
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    with browsing(tmp_path, "--enable-unsafe-swiftshader") as tools:
        page = Page(tools)
        page.visit(f"{pair.url}/")

        def shown() -> Any:
            """Joint 1 as the panel has it."""
            return page.run("window.cobotPanel?.state?.position?.[0] ?? null")

        until(lambda: page.run("document.querySelectorAll('#robots [role=tab]').length") == 2)
        until(lambda: shown() is not None)
        assert move(http, pair.right, AWAY, speed=1.0).json()["success"]
        assert shown() == pytest.approx(HOME[0], abs=0.01)
        page.click(f'[data-robot="{pair.right}"]')
        until(lambda: shown() == pytest.approx(AWAY[0], abs=0.01))
        selected = "document.querySelector('#robots [aria-selected=true]').innerText"
        assert page.run(selected) == pair.right
        page.key("ArrowRight", "ArrowRight")  # after the last one comes the first
        until(lambda: shown() == pytest.approx(HOME[0], abs=0.01))
        assert page.run("document.activeElement.dataset.robot") == pair.left


@pytest.fixture(scope="module")
def plugin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the distributions cobot-client and lerobot_robot_cobot, as pip would unpack them."""
    folder = tmp_path_factory.mktemp("plugin")
    for number, wheel in enumerate((client_wheel, lambda into: build(PLUGIN, into))):
        (place := folder / str(number)).mkdir()
        with zipfile.ZipFile(wheel(place)) as archive:
            archive.extractall(folder)
    return folder


def lerobot_session(python: str, plugin: Path, *arguments: str) -> dict[str, Any]:
    """A report of tests/cobot/learning/lerobot_session.py with LeRobot's own classes in this Python."""
    interpreter = Path(sys.prefix) / "lerobot" / python / "bin" / "python"
    if not interpreter.exists():
        pytest.skip(f"needs LeRobot {LEROBOT_PYTHONS[python]} for Python {python}: make setup-dev")
    places = (str(plugin), str(plugin / "cobot_client"))  # the second one is in a .pth of the wheel
    ended = subprocess.run(
        [str(interpreter), str(SESSION), *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(places), "HF_LEROBOT_HOME": str(plugin / "home")},
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-3000:]
    report: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    assert report["version"].startswith(f"{LEROBOT_PYTHONS[python]}.")
    return report


@pytest.mark.thorough
@pytest.mark.parametrize("python", LEROBOT_PYTHONS)
def test_lerobots_own_classes_drive_one_arm_and_two(
    pair: Pair, http: httpx.Client, plugin: Path, python: str
) -> None:
    """Oracle: LeRobot's registry of plug-ins, its command line and its base classes of robots and cameras."""
    camera = "{wrist: {type: still, fps: 30, width: 8, height: 6}}"
    left = f"{pair.url}/robots/{pair.left}"
    one = lerobot_session(
        python, plugin, "--robot.type=cobot", f"--robot.url={left}", f"--robot.cameras={camera}"
    )
    assert one["allowed"]
    assert one["is a robot"]
    assert one["type"] == "cobot"
    assert one["connected"] == [True, False]
    assert one["features"]
    assert one["change"] == {"joint1.pos": pytest.approx(0.3, abs=0.05)}
    assert one["pictures"] == {"wrist": [6, 8, 3, 2, 0]}
    methods = one["dataset"]  # those that cobot-to-lerobot calls
    assert {"repo_id", "fps", "features", "root", "robot_type", "use_videos"} <= set(methods["create"])
    assert {"add_frame", "save_episode", "finalize", "num_episodes", "num_frames"} <= set(methods)

    both = lerobot_session(
        python,
        plugin,
        "--robot.type=bi_cobot",
        "--robot.id=two",
        f"--robot.left_arm_config.url={left}",
        f"--robot.left_arm_config.cameras={camera}",
        f"--robot.right_arm_config.url={pair.url}/robots/{pair.right}",
    )
    assert (both["type"], both["connected"], both["features"]) == ("bi_cobot", [True, False], True)
    near = pytest.approx(0.3, abs=0.05)
    assert both["change"] == {"left_joint1.pos": near, "right_joint1.pos": near}
    assert both["pictures"] == {"left_wrist": [6, 8, 3, 2, 0]}
    # Both arms are free: they move at a request.
    go_home(pair, http)
