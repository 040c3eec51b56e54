"""Lua programs against a running service: topics through its rosbridge, motions, /sequences, `cobot lua`.

Oracles: a client made of `websockets` and `json` at the other end of the topics; what REST says about the
arm; the process table and exit statuses.
"""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import pytest
from cobot_run import WAIT_S, Run, require_quick, unique_name, until
from thorough import few
from websockets.sync.client import connect

from cobot.ros.messages import Messages

EXAMPLES = Path(__file__).parents[2] / "examples"
HOME = [0, 0, 0, -1.57, 0, 1.57, 0]


def cobot_lua(run: Run, source: str | Path, tmp_path: Path, *arguments: str) -> subprocess.Popen[str]:
    file = source if isinstance(source, Path) else tmp_path / "test.lua"
    if isinstance(source, str):
        file.write_text(source, encoding="utf-8")
    command = [sys.executable, "-m", "cobot", "lua", str(file), "--url", run.url, *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def said(process: subprocess.Popen[str]) -> list[str]:
    """What a program has said, without the times; that it has ended well."""
    output, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 0, output
    return [line.split(" ", 1)[1] for line in output.splitlines()]


class Peer:
    """Another rosbridge client."""

    def __init__(self, run: Run) -> None:
        self._opened = connect(run.url.replace("http", "ws") + "/rosbridge")

    def __enter__(self) -> Peer:
        self._socket = self._opened.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.__exit__(None, None, None)

    def send(self, op: str, **fields: Any) -> None:
        self._socket.send(json.dumps({"op": op, **fields}))

    def next(self) -> Any:
        """The next message on a topic."""
        while True:
            message = json.loads(self._socket.recv(WAIT_S))
            if message["op"] == "publish":
                return message["msg"]


def test_a_program_talks_to_another_client(shared: Run, tmp_path: Path) -> None:
    with Peer(shared) as peer:
        peer.send("subscribe", topic="/demo/joint4", type="std_msgs/msg/Float64")
        peer.send("advertise", topic="/demo/name", type="std_msgs/msg/String")
        process = cobot_lua(shared, EXAMPLES / "hello.lua", tmp_path)
        assert peer.next()["data"] == pytest.approx(shared.joints()[3], abs=1e-3)
        peer.send("publish", topic="/demo/name", msg={"data": "µ"})
        assert said(process) == ["hello µ", "done"]


def test_without_an_answer_it_goes_on(shared: Run, tmp_path: Path) -> None:
    assert said(cobot_lua(shared, EXAMPLES / "hello.lua", tmp_path)) == ["hello no answer", "done"]


def test_messages_that_are_no_atoms_are_cdr(shared: Run, tmp_path: Path) -> None:
    """Joint states are read as bytes and sent back; the codec, which has tests of its own, reads them."""
    source = f"""
    local r = require("ros_bind")
    local states = r.ros_subscriber_factory("/{shared.name}/joint_states", "sensor_msgs/msg/JointState", 1)
    local raw = r.ros_publisher_factory("/lua/raw", "sensor_msgs/msg/JointState")
    local ok, bytes = states:read_timeout(10000)
    textmsg(ok, type(bytes))
    raw:write(bytes)
    """
    with Peer(shared) as peer:
        peer.send("subscribe", topic="/lua/raw", type="sensor_msgs/msg/JointState")
        process = cobot_lua(shared, source, tmp_path)
        message = peer.next()
        assert said(process) == ["true string", "done"]
    assert message["name"] == [f"joint{number}" for number in range(1, 8)]
    assert Messages().checked("sensor_msgs/msg/JointState", message) == message
    np.testing.assert_allclose(message["position"], shared.joints(), atol=1e-3)


def test_a_topic_of_another_type_is_an_error_with_its_line(shared: Run, tmp_path: Path) -> None:
    source = f"""local r = require("ros_bind")
    r.ros_subscriber_factory("/{shared.name}/joint_states", "std_msgs/msg/String")"""
    process = cobot_lua(shared, source, tmp_path)
    output, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 2, output
    assert "test.lua:2: " in output
    assert "sensor_msgs/msg/JointState" in output


def test_the_pick_example_moves_the_arm_and_tells_it(http: httpx.Client, shared: Run, tmp_path: Path) -> None:
    with Peer(shared) as peer:
        peer.send("subscribe", topic="/demo/pick", type="std_msgs/msg/String")
        process = cobot_lua(shared, EXAMPLES / "pick.lua", tmp_path)
        assert peer.next() == {"data": "picked"}
        assert said(process)[-2].startswith("at home, joint 4 at -1.5")
    np.testing.assert_allclose(shared.joints(), HOME, atol=2e-3)


@pytest.mark.parametrize("named", [False, True])
def test_vendor_services_and_moves_of_the_robot_by_its_name(
    http: httpx.Client, shared: Run, tmp_path: Path, named: bool
) -> None:
    source = """
    textmsg(robot.call("RobotConfig", "getDof"))
    local pose = get_tcp_pose()
    movej({0.1, 0, 0, -1.57, 0, 1.57, 0}, 1.0)
    local near = get_joint_positions()
    local joints = from_json(robot.RobotAlgorithm.inverseKinematics({qnear = near, pose = pose}))
    movej(joints[1], 1.0)
    local back = get_tcp_pose()
    for i = 1, 3 do assert(math.abs(back[i] - pose[i]) < 1e-3) end
    """
    arguments = ["--robot", shared.name] if named else []
    assert said(cobot_lua(shared, source, tmp_path, *arguments)) == ["7", "done"]


def test_an_unknown_robot_is_named(shared: Run, tmp_path: Path) -> None:
    process = cobot_lua(shared, "get_joint_positions()", tmp_path, "--robot", "nobody")
    output, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode != 0
    assert f"valid names: {shared.name}" in output


def test_a_signal_ends_the_program_and_the_arm_comes_to_rest(
    http: httpx.Client, shared: Run, tmp_path: Path
) -> None:
    process = cobot_lua(shared, "movej({1.5, 0, 0, -1.57, 0, 1.57, 0}, 0.01)", tmp_path)
    until(lambda: http.get("/health").json()["robot"]["mode"] == "TRAJECTORY")
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=WAIT_S)
    assert process.returncode == 128 + signal.SIGINT, output
    until(lambda: http.get("/health").json()["robot"]["mode"] == "HOLD")


# As a sequence


def start(http: httpx.Client, source: str, **fields: Any) -> dict[str, Any]:
    files = {"config": ("dir/pick.lua", source.encode(), "text/x-lua")}
    data = {"n_iterations": 1, "delay_between_iterations": 0, **fields}
    answer = http.post("/sequences/start", files=files, data=data)
    assert answer.status_code == 200, answer.text
    started: dict[str, Any] = answer.json()
    return started


def finished(http: httpx.Client) -> dict[str, Any]:
    def status() -> Any:
        found = http.get("/sequences/status").json()
        return found["status"] == "finished" and found

    end: dict[str, Any] = until(status)
    return end


def log(http: httpx.Client) -> str:
    return "\n".join(http.get("/sequences/logs", params={"n": 20}).json()["lines"])


def test_a_lua_file_runs_as_a_sequence_and_owns_the_motion(http: httpx.Client) -> None:
    start(
        http,
        "textmsg('iteration') movej({0.2, 0, 0, -1.57, 0, 1.57, 0}, 1.0) move_named('home', 1.0)",
        n_iterations=2,
    )
    end = finished(http)
    assert (end["returncode"], end["iteration"], end["n_iterations"]) == (0, 2, 2), log(http)
    assert log(http).count("iteration") >= 2


def test_the_vendor_services_of_a_program_move_on_its_behalf(http: httpx.Client) -> None:
    start(
        http,
        """
        robot.MotionControl.moveJoint({q = {0.1, 0, 0, -1.57, 0, 1.57, 0}, a = 1.0, v = 1.0})
        while robot.MotionControl.getExecId() ~= -1 do sleep(0.02) end
        textmsg("at", get_joint_positions()[1])
        """,
    )
    assert finished(http)["returncode"] == 0, log(http)
    assert "at 0.1" in log(http) or "at 0.09" in log(http)


@pytest.mark.parametrize(
    "source",
    few(
        [
            "while true do pcall(function() while true do end end) end",
            "while true do pcall(movej, {1.5, 0, 0, -1.57, 0, 1.57, 0}, 0.01) end",
            "local x = ('a'):rep(100000):find((('.-'):rep(50)) .. 'b')",
            "pcall(sleep, 1e6) while true do end",
        ],
        2,
    ),
)
def test_stop_ends_a_program_whatever_it_does(http: httpx.Client, source: str) -> None:
    """A stop shall take two seconds at the most."""

    def stopping_s() -> float:
        word = f"begun-{unique_name()}"
        pid = start(http, f"textmsg('{word}') {source}")["pid"]
        until(lambda: word in log(http))
        stop = http.post("/stop").json()
        assert stop["success"], stop
        ended = finished(http)["returncode"]
        assert not psutil.pid_exists(pid)
        if ended == -signal.SIGKILL:  # it had a second to go by itself, on a busy computer
            return math.inf
        assert ended == 128 + signal.SIGTERM
        return float(stop["duration_s"])

    require_quick(stopping_s, 2.0)


@pytest.mark.parametrize(
    ("source", "returncode", "words"),
    few(
        [
            ("x = = 1", 2, "pick.lua:1: unexpected symbol near '='"),
            ("\nlocal t = nil; t.x = 1", 2, "pick.lua:2: attempt to index a nil value"),
            ("\n\nmovel({3, 0, 0.5, 0, 0, 0})", 3, "pick.lua:3: "),
            ("movej({9, 0, 0, 0, 0, 0, 0})", 2, "pick.lua:1: joint angle of joint1 is 9"),
            ("os.execute('true')", 2, "attempt to index a nil value (global 'os')"),
        ],
        3,
    ),
)
def test_a_bad_program_ends_with_its_line(
    http: httpx.Client, source: str, returncode: int, words: str
) -> None:
    start(http, source)
    assert finished(http)["returncode"] == returncode, log(http)
    assert words in log(http)
