"""rosbridge v2 over a real network, against a running simulation in real time.

Oracles: roslibpy and, in a browser, npm's roslib, clients that others have written; what REST says about the
same arm; a client made of `websockets` and `json` for what a well-behaved client does not do.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, Run, until
from folders import SUPPORT
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

SCRIPT = SUPPORT / "roslibpy_client.py"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0])


@pytest.fixture
def run(service: Run) -> Iterator[Run]:
    """The service with its arm at home."""
    service.go_home()
    yield service
    assert service.healthy()


def address(run: Run) -> str:
    return run.url.replace("http", "ws") + "/rosbridge"


def roslibpy(run: Run, scenario: str) -> dict[str, Any]:
    """What that scenario of tests/support/roslibpy_client.py has seen."""
    result = subprocess.run(
        [sys.executable, str(SCRIPT), address(run), run.name, scenario],
        capture_output=True,
        text=True,
        timeout=2 * WAIT_S,
        check=False,
    )
    assert result.returncode == 0, result.stderr[-4000:]
    found: dict[str, Any] = json.loads(result.stdout)
    return found


class Client:
    """A client of rosbridge that may do anything."""

    def __init__(self, run: Run, **options: Any) -> None:
        self._opened = connect(address(run), max_size=None, **options)
        self.socket: ClientConnection

    def __enter__(self) -> Client:
        self.socket = self._opened.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.__exit__(None, None, None)

    def send(self, op: str, **content: Any) -> None:
        self.socket.send(json.dumps({"op": op, **content}))

    def next(self, op: str) -> dict[str, Any]:
        """The next message of this kind."""
        while True:
            message: dict[str, Any] = json.loads(self.socket.recv(WAIT_S))
            if message["op"] == op:
                return message

    def call(self, name: str, args: Any = None) -> dict[str, Any]:
        self.send("call_service", service=name, args=args)
        return self.next("service_response")


def test_roslibpy_gets_the_topics_of_the_robot(run: Run) -> None:
    found = roslibpy(run, "count")
    rest = httpx.get(f"{run.url}/robot/joint_states", timeout=WAIT_S).json()
    newest = found["throttled"][-1]
    assert newest["name"] == rest["name"]
    np.testing.assert_allclose(newest["position"], rest["position"], atol=1e-3)
    assert abs(newest["header"]["stamp"]["sec"] - time.time()) < 60.0
    stamps = [
        np.array(
            [at["header"]["stamp"]["sec"] + 1e-9 * at["header"]["stamp"]["nanosec"] for at in found[name]]
        )
        for name in ("all", "throttled")
    ]
    assert all((np.diff(each) > 0.0).all() for each in stamps)
    assert 0.005 < np.median(np.diff(stamps[0])) < 0.05
    assert 0.08 < np.median(np.diff(stamps[1])) < 0.2
    pose = httpx.get(f"{run.url}/robot/pose", timeout=WAIT_S).json()
    where = found["tcp_pose"]["pose"]["position"]
    np.testing.assert_allclose(
        [where[axis] for axis in "xyz"], [pose["position"][axis] for axis in "xyz"], atol=1e-3
    )
    assert found["wrench"]["header"]["frame_id"] == "tcp"
    assert json.loads(found["status"]["data"])["mode"] == "HOLD"
    assert found["robot_description"]["data"].startswith("<?xml")
    assert len(found["tf"]["transforms"]) == 7
    assert found["tf_static"]["transforms"][-1]["child_frame_id"] == "tcp"


@pytest.mark.thorough
def test_two_clients_of_roslibpy_share_a_topic_and_a_service(run: Run) -> None:
    found = roslibpy(run, "chat")
    assert found["heard"] == {"stamp": {"sec": 7, "nanosec": 8}, "frame_id": "base"}
    assert found["answer"] == {"success": False, "message": "odd"}


def test_roslibpy_calls_services_and_asks_rosapi(run: Run) -> None:
    found = roslibpy(run, "ask")
    assert found["RobotConfig/getDof"] == {"code": 0, "message": "", "result": 7}
    pose = httpx.get(f"{run.url}/robot/pose", timeout=WAIT_S).json()["position"]
    forward = found["RobotAlgorithm/forwardKinematics"]
    assert forward["code"] == 0
    flat = json.loads(forward["result"])[0] if isinstance(forward["result"], str) else forward["result"]
    np.testing.assert_allclose(flat[:3], [pose[axis] for axis in "xyz"], atol=2e-3)
    assert "there is no service" in found["RobotAlgorithm/nothing"]
    assert f"/{run.name}/joint_cmd" in found["topics"]
    assert found["type"] == "sensor_msgs/msg/JointState"
    assert f"/{run.name}/RobotConfig/getDof" in found["services"]
    assert f"/{run.name}/servo_mode" in found["actions"]["action_servers"]
    assert found["nodes"] == ["/cobot"]
    assert found["message"]["typedefs"][0]["fieldnames"] == [
        "header",
        "name",
        "position",
        "velocity",
        "effort",
    ]
    assert found["request"]["typedefs"][0]["fieldtypes"] == ["bool"]


def test_roslibpy_follows_and_cancels_trajectories(run: Run) -> None:
    found = roslibpy(run, "follow")
    followed, cancelled, strange = found["followed"], found["cancelled"], found["strange"]
    assert (followed["status"], followed["values"]["error_code"]) == (SUCCEEDED, 0)
    turned = [told["actual"]["positions"][0] for told in followed["feedback"]]
    assert len(turned) > 10
    np.testing.assert_allclose(turned[-1], 0.2, atol=2e-3)
    assert cancelled["status"] == CANCELED
    assert "cancelled: the arm stopped on its path" in cancelled["values"]["error_string"]
    assert (strange["status"], strange["values"]["error_code"]) == (ABORTED, -2)
    at_rest = run.joints()
    assert 0.2 < at_rest[0] < 0.8
    np.testing.assert_allclose(at_rest[1:], HOME[1:], atol=2e-3)


def test_roslibpy_holds_a_servo_session_with_feedback_and_cancels_it(run: Run) -> None:
    found = roslibpy(run, "serve")
    assert found["last"]["points_accepted"] == 20
    assert found["refused"]["status"] == 0
    assert "already running" in found["refused"]["values"]
    assert found["end"]["status"] == 5
    assert found["end"]["values"]["points_accepted"] == 20
    assert abs(run.joints()[0]) > 0.005  # it has moved


@pytest.mark.thorough
def test_a_large_message_arrives_and_one_beyond_all_bounds_closes(run: Run) -> None:
    text = "x" * 3_000_000
    with Client(run) as one, Client(run) as other:
        other.send("subscribe", topic="/large", type="std_msgs/String")
        other.call("/rosapi/nodes")
        one.send("advertise", topic="/large", type="std_msgs/String")
        one.send("publish", topic="/large", msg={"data": text})
        assert other.next("publish")["msg"]["data"] == text
        with pytest.raises(ConnectionClosed):  # 1009, if it is read while the rest is still being sent
            ask_with(one, " " * (9 * 2**20))


def ask_with(client: Client, text: str) -> None:
    client.socket.send(text)
    client.next("status")


@pytest.mark.thorough
def test_a_motion_goes_on_while_a_large_message_is_taken_apart(run: Run) -> None:
    goal = {"transforms": [{}] * 25_000}  # checked off the event loop, whose silence stops the arm
    move = f"{run.url}/{run.name}/MotionControl/moveJoint"
    answer = httpx.post(move, json={"q": [0.9, 0, 0, -1.57, 0, 1.57, 0], "v": 0.25}, timeout=WAIT_S).json()
    assert answer["code"] == 0, answer
    with Client(run) as client:
        client.send("advertise", topic="/test/large", type="tf2_msgs/msg/TFMessage")
        client.send("publish", topic="/test/large", msg=goal)
        client.send("publish", topic="/test/large", msg={"transforms": [{}] * 31_000})
        assert "allowed: 30000" in client.next("status")["msg"]
    until(lambda: httpx.post(f"{run.url}/{run.name}/MotionControl/getExecId").json()["result"] == -1)
    assert httpx.post(f"{run.url}/{run.name}/MotionControl/getLastError").json()["result"] == ""
    assert abs(run.joints()[0] - 0.9) < 0.01


@pytest.mark.thorough
def test_a_flood_is_taken_and_others_are_served_meanwhile(run: Run) -> None:
    with Client(run) as flooding, Client(run) as other:
        for number in range(5000):
            flooding.send("publish", topic="/nobody", msg={"data": number})
        latencies = []
        for _ in range(20):
            begin_s = time.monotonic()
            assert other.call(f"/{run.name}/RobotConfig/getDof")["values"]["result"] == 7
            latencies.append(time.monotonic() - begin_s)
        assert run.healthy()
        flooding.send("set_level", level="none")
        assert flooding.call("/rosapi/nodes")["result"]


@pytest.mark.thorough
def test_who_does_not_read_costs_a_bounded_memory_and_is_told_why(run: Run) -> None:
    app = run.child("app")
    assert app is not None
    with Client(run) as lazy, Client(run) as other:
        other.send("advertise_service", service="/large", type="std_srvs/Trigger")
        other.call("/rosapi/nodes")
        before = app.memory_info().rss
        for _ in range(120):
            lazy.send("call_service", service="/large")
        for _ in range(120):
            asked = other.next("call_service")
            values = {"message": "x" * 2**20}
            other.send("service_response", service="/large", id=asked["id"], values=values, result=True)
        assert other.call("/rosapi/nodes")["result"]
        assert app.memory_info().rss - before < 150 * 2**20
        with pytest.raises(ConnectionClosed, match=r"1013.*reads its answers too slowly"):
            lazy.next("what never comes")
