"""The WebSocket /robot/stream over a real network, against a running simulation in real time.

Oracles: a client made of `websockets`, `json` and `struct`; what REST says about the same arm; the numbers of
joint_limits.yaml, and numpy's differences of what was commanded in consecutive cycles; psutil for memory.
"""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from running import WAIT_S, Run, until
from streaming_client import StreamClient
from websockets.exceptions import ConnectionClosed, ConnectionClosedError, InvalidStatus

from cobot import Mode, Robot
from cobot.ipc.layout import chunk_dtype, session_dtype, setpoint_dtype, state_dtype

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
CONFIG = Path(__file__).parents[3] / "config"
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


def test_the_first_frame_says_what_robot_this_is(client: StreamClient, run: Run) -> None:
    hello = client.hello
    assert (hello["type"], hello["robot"], hello["dof"]) == (
        "hello",
        run.memory.name.removeprefix("cobot-"),
        7,
    )
    assert hello["joint_names"] == list(LIMITS)
    assert str(hello["layout"]) == health(run)["versions"]["layout"]
    assert (hello["period_s"], hello["command_timeout_s"]) == (0.001, 0.5)
    for name in ("min_position", "max_position", "max_velocity", "max_acceleration", "max_jerk"):
        assert hello[name] == [joint[name] for joint in LIMITS.values()], name


def test_states_as_json_are_those_that_rest_shows(client: StreamClient, run: Run) -> None:
    client.send("subscribe", rate_hz=50)
    states = [client.state() for _ in range(10)]
    sequence = [state["sequence"] for state in states]
    assert sequence == sorted(set(sequence))
    cycles = [state["cycle"] for state in states]
    assert cycles == sorted(set(cycles))
    assert states[-1]["mode"] == "HOLD"
    assert states[-1]["interventions"].keys() == health(run)["interventions"].keys()
    rest = httpx.get(f"{run.url}/robot/joint_states", timeout=WAIT_S).json()
    np.testing.assert_allclose(states[-1]["position"], rest["position"], atol=1e-4)


def test_binary_states_are_header_and_record(client: StreamClient) -> None:
    client.send("subscribe", rate_hz=1000, format="binary")
    frames = [client.socket.recv(WAIT_S) for _ in range(200)]
    dtype = state_dtype(7)
    assert {len(frame) for frame in frames} == {16 + dtype.itemsize}
    heads = np.frombuffer(b"".join(frame[:16] for frame in frames), "<u4,<u4,<u8")
    assert set(heads["f0"]) == {1}
    assert set(heads["f1"]) == {client.hello["layout"]}
    assert (np.diff(heads["f2"].astype(int)) >= 1).all()
    states = np.concatenate([np.frombuffer(frame, dtype, 1, 16) for frame in frames])
    assert (np.diff(states["cycle"].astype(int)) >= 1).all()
    np.testing.assert_allclose(states["position"][-1], HOME, atol=2e-3)


def test_targets_as_json_move_the_arm_and_an_end_brings_it_to_rest(client: StreamClient, run: Run) -> None:
    number = client.session(inner_control_hz=50)
    assert health(run)["session"]["number"] == number
    way = np.array([0.1, 0.05, 0.0, 0.05, 0.0, -0.05, 0.1])
    for share in np.linspace(0.0, 1.0, 50):
        client.target(HOME + share * way, velocities=list(way) if share < 1.0 else [0.0] * 7)
        time.sleep(0.02)
    client.send("subscribe", rate_hz=100)
    until(lambda: client.state()["setpoint_seen"] == client.number)
    time.sleep(0.2)
    assert client.ended() == {
        "type": "session_ended",
        "number": number,
        "reason": "the client has ended the session",
    }
    assert health(run)["robot"]["settled"]
    np.testing.assert_allclose(client.state()["commanded_position"], HOME + way, atol=5e-3)


def test_binary_frames_do_the_same(client: StreamClient, run: Run) -> None:
    wish = np.zeros((), session_dtype(7))
    wish["stream"], wish["interpolation"], wish["decimation"] = 1, 1, 20
    wish["stiffness"], wish["cartesian_stiffness"] = (
        client.hello["stiffness"],
        client.hello["cartesian_stiffness"],
    )
    wish["damping_ratio"] = wish["cartesian_damping_ratio"] = 0.7
    wish["max_contact_torque"] = wish["max_contact_wrench"] = np.inf
    wish["force_velocity"], wish["posture"] = 1.0, np.nan
    wish["force_frame"][3] = 1.0
    client.binary(2, 0, wish.tobytes())
    assert client.answer()["type"] == "session"
    setpoint = np.zeros((), setpoint_dtype(7))
    for step in range(1, 51):
        setpoint["number"] = step
        setpoint["joints"] = np.array(HOME) + 0.002 * step
        client.binary(3, step, setpoint.tobytes())
        time.sleep(0.02)
    client.send("subscribe", rate_hz=100)
    until(lambda: client.state()["setpoint_seen"] == 50)
    time.sleep(0.2)
    np.testing.assert_allclose(client.state()["commanded_position"], np.array(HOME) + 0.1, atol=5e-3)
    client.binary(6, 0)
    assert client.until_ended()["reason"] == "the client has ended the session"


def test_the_tcp_moves_to_a_pose_and_a_move_can_be_cancelled(client: StreamClient, run: Run) -> None:
    client.session(stream="cartesian", inner_control_hz=50)
    client.send("subscribe", rate_hz=50)
    pose = client.state()["tcp"]
    goal = [pose[0], pose[1] + 0.05, *pose[2:]]
    client.send("move", sequence=1, pose=goal, duration_s=1.0)
    until(lambda: client.state()["move_running"])
    until(lambda: not client.state()["move_running"])
    np.testing.assert_allclose(client.state()["tcp"][:3], goal[:3], atol=3e-3)
    client.send("move", sequence=2, pose=pose, duration_s=20.0)
    until(lambda: client.state()["move_running"])
    client.send("cancel", sequence=3)
    until(lambda: not client.state()["move_running"])
    client.ended()


WRONG = [
    ("{", "input", "not valid JSON"),
    ("[]", "input", "must be a JSON object"),
    ("null", "input", "must be a JSON object"),
    ('{"type": "jump"}', "input", "there is no frame of type 'jump'; valid are: subscribe, session"),
    ('{"type": []}', "input", "there is no frame of type []"),
    ('{"type": "end", "type": "end"}', "input", "the key 'type' stands twice"),
    ('{"type": "subscribe", "rate_hz": 0}', "input", "rate_hz"),
    ('{"type": "subscribe", "rate_hz": 1001}', "input", "rate_hz"),
    ('{"type": "subscribe", "rate": 10}', "input", "unknown key 'rate' (did you mean 'rate_hz'?); valid"),
    ('{"type": "target", "sequence": 99}', "input", "joints: is missing"),
    ('{"type": "target", "sequence": 99, "joints": [0]}', "input", "joints must have 7 numbers"),
    ('{"type": "target", "sequence": 99, "joints": [NaN, 0, 0, 0, 0, 0, 0]}', "input", "finite"),
    ('{"type": "target", "sequence": 99, "joints": [1e999, 0, 0, 0, 0, 0, 0]}', "input", "finite"),
    ('{"type": "target", "sequence": 99, "pose": [0]}', "input", "unknown key 'pose'"),
    ('{"type": "target", "sequence": 0, "joints": [0, 0, 0, 0, 0, 0, 0]}', "input", "sequence"),
    ('{"type": "chunk", "sequence": 99, "times_s": [2, 1], "points": [[0,0,0,0,0,0,0],[0,0,0,0,0,0,0]]}',
     "input", "times_s must increase"),
    ('{"type": "chunk", "sequence": 99, "times_s": [], "points": []}', "input", "from 1 to 64 points, got 0"),
    ('{"type": "session"}', "conflict", "the robot is in use by WS /robot/stream from 127.0.0.1"),
    (b"", "input", "16 bytes of header"),
    (b"\0" * 16, "layout", "layout version 0"),
]  # fmt: skip


def test_wrong_frames_are_answered_and_change_nothing(client: StreamClient, run: Run) -> None:
    client.session()
    client.target(HOME)
    for frame, code, words in WRONG:
        client.socket.send(frame)
        answer = client.answer()
        assert (answer["type"], answer["code"]) == ("error", code), frame
        assert words in answer["detail"], frame
    layout = client.hello["layout"]
    client.binary(9, 1)
    assert "there is no binary frame of kind 9; valid are: 1 (state)" in client.answer()["detail"]
    client.binary(3, 99, b"\0" * 7, layout)
    assert client.answer() == {
        "type": "error",
        "code": "input",
        "detail": f"a record setpoint has {setpoint_dtype(7).itemsize} bytes, got 7",
        "about": "setpoint",
        "sequence": 99,
    }
    poison = np.zeros((), setpoint_dtype(7))
    poison["joints"] = np.nan
    client.binary(3, 99, poison.tobytes())
    assert "joints must be finite" in client.answer()["detail"]
    client.target(HOME)  # and the session goes on
    client.send("subscribe", rate_hz=100)
    until(lambda: client.state()["setpoint_seen"] == client.number)
    assert client.state()["mode"] == "JOINT_IMPEDANCE"
    client.ended()
    np.testing.assert_allclose(run.joints(), HOME, atol=2e-3)


NAMES = st.sampled_from(["type", "sequence", "joints", "pose", "rate_hz", "stream", "times_s", "points", "x"])
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
    | st.sampled_from(["target", "chunk", "move", "cancel", "subscribe", "session"]),
    lambda inner: st.lists(inner, max_size=8) | st.dictionaries(NAMES, inner, max_size=4),
    max_leaves=12,
)  # fmt: skip
FRAMES = (
    st.dictionaries(NAMES, VALUES, max_size=5).map(json.dumps)
    | st.text(max_size=40)
    | st.binary(max_size=64)
    | st.tuples(st.integers(0, 9), st.binary(max_size=2000)).map(
        lambda made: made[0].to_bytes(4, "little") + b"\3\0\0\0" + made[1]
    )
)


@settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@example(frame="[" * 60_000)
@example(frame='{"type": "target", "sequence": 1e400}')
@given(frame=FRAMES)
def test_no_frame_without_a_session_moves_the_arm_or_ends_the_connection(
    service: Run, shared_client: StreamClient, frame: str | bytes
) -> None:
    before = service.joints()
    shared_client.socket.send(frame)
    shared_client.send("end")  # is answered in any case: there is no session
    while (answer := shared_client.answer())["about"] != "end":
        assert answer["type"] == "error"
    np.testing.assert_allclose(service.joints(), before, atol=2e-3)
    assert health(service)["session"] is None


@pytest.fixture(scope="module")
def shared_client(service: Run) -> Iterator[StreamClient]:
    with StreamClient(service.url) as connected:
        yield connected


def test_frames_out_of_order_are_refused_and_counted(client: StreamClient, run: Run) -> None:
    client.session()
    client.target(HOME)
    client.target(HOME)
    for stale in (2, 1):
        client.send("target", sequence=stale, joints=[0.5, *HOME[1:]])
        assert client.answer()["detail"] == f"sequence must increase: {stale} comes after 2"
    assert health(run)["session"]["refused"] == 2
    client.ended()
    np.testing.assert_allclose(run.joints(), HOME, atol=2e-3)


def test_a_second_client_may_look_but_not_stream(client: StreamClient, run: Run) -> None:
    client.session()
    with StreamClient(run.url) as other:
        other.send("session")
        answer = other.answer()
        assert answer["code"] == "conflict"
        assert "in use by WS /robot/stream from 127.0.0.1:" in answer["detail"]
        other.target([1.0, *HOME[1:]])
        assert "there is no session" in other.answer()["detail"]
        other.send("estop")
        assert "there is no session" in other.answer()["detail"]
        other.send("subscribe", rate_hz=100)
        assert other.state()["mode"] == "JOINT_IMPEDANCE"
    client.ended()


def test_motions_and_sequences_wait_for_a_session_and_learn_who_streams(
    client: StreamClient, run: Run
) -> None:
    client.session()
    sequence = {"config": ("s.json", json.dumps({"waypoints": []}), "application/json")}
    answers = [
        post(run, "/robot/move/named", name="home"),
        post(run, "/trajectory/send", points=[{"positions": HOME, "time_from_start": 1.0}]),
        httpx.post(f"{run.url}/sequences/start", files=sequence, timeout=WAIT_S),
    ]
    for answer in answers:
        assert (answer.status_code, answer.json()["code"]) == (409, "conflict"), answer.text
        assert "the robot is in use by WS /robot/stream from 127.0.0.1:" in answer.json()["detail"]
    assert health(run)["service"]["motion"].startswith("WS /robot/stream from")
    client.ended()


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


def test_no_session_begins_during_a_motion(client: StreamClient, run: Run) -> None:
    points = [{"positions": [0.5, *HOME[1:]], "time_from_start": 20.0}]
    assert post(run, "/trajectory/send", points=points).status_code == 200
    client.send("session")
    answer = client.answer()
    assert (answer["code"], answer["about"]) == ("conflict", "session")
    assert "in use by POST /trajectory/send" in answer["detail"]
    post(run, "/stop")
    client.session()
    client.ended()


def test_a_stop_ends_the_session_and_everybody_learns_of_it(client: StreamClient, run: Run) -> None:
    number = client.session(inner_control_hz=50)
    sway(client, 0.6)
    stopped = post(run, "/stop").json()
    assert stopped["success"], stopped
    assert stopped["stopped"][0].startswith("WS /robot/stream from 127.0.0.1:")
    assert health(run)["session"] is None
    assert client.until_ended() == {"type": "session_ended", "number": number, "reason": "stop requested"}
    client.target(HOME)
    assert client.answer()["code"] == "stopped"
    client.session()
    client.ended()


def test_an_estop_of_the_client_is_latched(client: StreamClient, run: Run) -> None:
    client.session(inner_control_hz=50)
    sway(client, 0.6)
    client.send("estop")
    assert client.until_ended()["reason"] == "e-stop requested by the streaming client"
    client.send("session")
    assert client.answer()["code"] == "not_ready"
    client.send("estop")
    assert client.answer()["code"] == "conflict"
    assert post(run, "/robot/reset").status_code == 200
    client.session()
    client.ended()


def test_a_silent_clients_arm_comes_to_rest_and_the_log_and_health_say_so(
    client: StreamClient, run: Run
) -> None:
    client.session(inner_control_hz=50)
    before = health(run)["interventions"]["command_timeout"]
    sway(client, 0.6)
    until(lambda: health(run)["interventions"]["command_timeout"] == before + 1)
    assert 0.0 <= health(run)["last_interventions_s"]["command_timeout"] < WAIT_S
    assert health(run)["last_interventions_s"]["not_finite"] is None
    run.until(lambda: "intervention command_timeout at " in run.output)
    client.target(HOME)
    client.ended()


KILLED = """
import sys, time
sys.path.insert(0, {tests!r})
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


def test_a_killed_clients_arm_comes_to_rest_within_its_limits(client: StreamClient, run: Run) -> None:
    tests = str(Path(__file__).parents[2])
    script = KILLED.format(tests=tests, url=run.url, home=HOME)
    client.send("subscribe", rate_hz=1000, format="binary")
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "ready\n"
        states = record_until(client, lambda state: abs(float(state["commanded_velocity"][0])) > 0.3)
        other.send_signal(signal.SIGKILL)
    states += record_until(client, lambda state: int(state["session"]) == 0)
    run.until(lambda: "has ended: the connection to the client was lost" in run.output)
    require_limits(np.concatenate(states))
    assert health(run)["session"] is None
    assert health(run)["robot"]["mode"] == "HOLD"


def record_until(client: StreamClient, condition: Any) -> list[np.ndarray]:
    states: list[np.ndarray] = []
    deadline_s = time.monotonic() + WAIT_S
    while time.monotonic() < deadline_s:
        frame = client.socket.recv(WAIT_S)
        states.append(np.frombuffer(frame, state_dtype(7), 1, 16))
        if condition(states[-1][0]):
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
    with StreamClient(run.url, max_queue=4) as deaf:
        deaf.send("subscribe", rate_hz=1000)
        deaf.state()
        record_until(client, lambda state: state["cycle"] % 1000 == 0)
        before = process.memory_info().rss
        states = np.concatenate(
            record_until(client, lambda state: state["cycle"] % 4000 == 0)
        )  # some seconds
        assert process.memory_info().rss - before < 4e6
        assert len(states) > 500
        newest = int(states["cycle"][-1])
        seen = until(lambda: (state := deaf.state())["cycle"] >= newest and state)
        assert seen["sequence"] > 0
    assert health(run)["status"] == "ok"


def test_there_are_only_so_many_connections(run: Run) -> None:
    clients: list[StreamClient] = []

    def connect_many() -> None:
        for _ in range(40):
            clients.append(StreamClient(run.url))  # noqa: PERF401 - those before the last are closed below

    try:
        with pytest.raises(InvalidStatus) as refused:
            connect_many()
        assert refused.value.response.status_code == 503
        assert json.loads(refused.value.response.body)["detail"] == "32 connections stream already"
        assert 30 <= len(clients) <= 32, "other tests may have one"
    finally:
        for each in clients:
            each.socket.close()
    until(lambda: try_connect(run))


def try_connect(run: Run) -> bool:
    try:
        StreamClient(run.url).socket.close()
    except InvalidStatus:
        return False
    return True


def test_a_page_of_somebody_elses_cannot_connect(run: Run) -> None:
    with pytest.raises(InvalidStatus) as refused:
        StreamClient(run.url, origin="http://evil.example")
    assert "a page of http://evil.example may not move the robot" in refused.value.response.body.decode()
    with StreamClient(run.url, origin=run.url) as page:
        assert page.hello["type"] == "hello"


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


def test_a_lost_rtloop_ends_the_session(run: Run) -> None:
    with StreamClient(run.url) as client:
        client.session(inner_control_hz=50)
        sway(client, 0.4)
        rtloop = run.child("rtloop")
        assert rtloop is not None
        rtloop.kill()
        assert client.until_ended()["reason"] == "rtloop was restarted"
        run.until(run.healthy)
        client.session()
        client.ended()


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


def test_a_chunk_of_poses_is_for_nobody(client: StreamClient) -> None:
    client.session(stream="cartesian")
    chunk = np.zeros((), chunk_dtype(7))
    chunk["count"] = 1
    client.binary(4, 1, chunk.tobytes())
    assert "a cartesian stream takes no chunks" in client.answer()["detail"]
    client.ended()


@pytest.mark.parametrize("where", ["local", "remote"])
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
