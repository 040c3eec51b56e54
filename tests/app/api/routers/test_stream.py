"""The WebSocket /robot/stream on virtual time; tests/e2e/realtime has what needs a network, or processes.

Oracles: a client made of `json` and `struct`; what REST says about the same arm; the numbers of
joint_limits.yaml.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import yaml
from asgi_client import Refused
from cobot_run import WAIT_S
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from streaming_client import Frames
from virtual_service import VirtualService

from app.api.stream_frames import read_frame
from cobot.ipc.layout import Stream, chunk_dtype, session_dtype, setpoint_dtype
from cobot.ipc.state_fields import state_dtype

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
CONFIG = Path(__file__).parents[4] / "config"
LIMITS = yaml.safe_load((CONFIG / "joint_limits.yaml").read_text(encoding="utf-8"))["joint_limits"]


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    """The service with nobody else at it, its arm at home."""
    service.go_home()
    yield service
    service.until(lambda: health(service)["session"] is None)


@pytest.fixture
def client(run: VirtualService) -> Iterator[Frames]:
    with connect(run) as connected:
        yield connected


def connect(run: VirtualService, **headers: str) -> Frames:
    return Frames(run.connect("/robot/stream", **headers))


def post(run: VirtualService, path: str, **body: object) -> httpx.Response:
    return run.post(path, body)


def health(run: VirtualService) -> dict[str, Any]:
    return run.health()


def sway(run: VirtualService, client: Frames, seconds: float, size_rad: float = 0.1) -> None:
    """Stream a slow wave on joint 1, from where it is at home."""
    for step in range(round(seconds * 50)):
        client.target([size_rad * np.sin(0.02 * step * 2.0), *HOME[1:]])
        run.sleep(0.02)


def test_the_first_frame_says_what_robot_this_is(client: Frames, run: VirtualService) -> None:
    hello = client.hello
    assert (hello["type"], hello["robot"], hello["dof"]) == (
        "hello",
        run.name,
        7,
    )
    assert hello["joint_names"] == list(LIMITS)
    assert str(hello["layout"]) == health(run)["versions"]["layout"]
    assert (hello["period_s"], hello["command_timeout_s"]) == (0.001, 0.5)
    for name in ("min_position", "max_position", "max_velocity", "max_acceleration", "max_jerk"):
        assert hello[name] == [joint[name] for joint in LIMITS.values()], name


def test_a_changed_tool_is_reported_with_the_place_of_the_flange(client: Frames, run: VirtualService) -> None:
    client.send("subscribe", rate_hz=50)
    try:
        assert run.post("/robot/tool", {"tcp": {"z": 0.2}}).status_code == 200
        told = client.answer()
        with connect(run) as later:
            assert later.hello["flange"] == told["flange"], "a new client gets the current one"
    finally:
        assert run.post("/robot/tool", {"tcp": {}}).status_code == 200
    assert told["type"] == "tool"
    assert told["flange"] == pytest.approx([0.0, 0.0, -0.2, 1.0, 0.0, 0.0, 0.0], abs=1e-9)
    assert client.answer()["flange"] == pytest.approx(client.hello["flange"])


def test_states_as_json_are_those_that_rest_shows(client: Frames, run: VirtualService) -> None:
    client.send("subscribe", rate_hz=50)
    states = [client.state() for _ in range(10)]
    sequence = [state["sequence"] for state in states]
    assert sequence == sorted(set(sequence))
    cycles = [state["cycle"] for state in states]
    assert cycles == sorted(set(cycles))
    assert states[-1]["mode"] == "HOLD"
    assert states[-1]["interventions"].keys() == health(run)["interventions"].keys()
    rest = run.get("/robot/joint_states").json()
    np.testing.assert_allclose(states[-1]["position"], rest["position"], atol=1e-4)


def test_binary_states_are_header_and_record(client: Frames) -> None:
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


def test_targets_as_json_move_the_arm_and_an_end_brings_it_to_rest(
    client: Frames, run: VirtualService
) -> None:
    number = client.session(inner_control_hz=50)
    assert health(run)["session"]["number"] == number
    way = np.array([0.1, 0.05, 0.0, 0.05, 0.0, -0.05, 0.1])
    for share in np.linspace(0.0, 1.0, 50):
        client.target(HOME + share * way, velocities=list(way) if share < 1.0 else [0.0] * 7)
        run.sleep(0.02)
    client.send("subscribe", rate_hz=100)
    run.until(lambda: client.state()["setpoint_seen"] == client.number)
    run.sleep(0.2)
    assert client.ended() == {
        "type": "session_ended",
        "number": number,
        "reason": "the client has ended the session",
    }
    assert health(run)["robot"]["settled"]
    np.testing.assert_allclose(client.state()["commanded_position"], HOME + way, atol=5e-3)


def test_binary_frames_do_the_same(client: Frames, run: VirtualService) -> None:
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
        run.sleep(0.02)
    client.send("subscribe", rate_hz=100)
    run.until(lambda: client.state()["setpoint_seen"] == 50)
    run.sleep(0.2)
    np.testing.assert_allclose(client.state()["commanded_position"], np.array(HOME) + 0.1, atol=5e-3)
    client.binary(6, 0)
    assert client.until_ended()["reason"] == "the client has ended the session"


def test_the_tcp_moves_to_a_pose_and_a_move_can_be_cancelled(client: Frames, run: VirtualService) -> None:
    client.session(stream="cartesian", inner_control_hz=50)
    client.send("subscribe", rate_hz=50)
    pose = client.state()["tcp"]
    goal = [pose[0], pose[1] + 0.05, *pose[2:]]
    client.send("move", sequence=1, pose=goal, duration_s=1.0)
    run.until(lambda: client.state()["move_running"])
    run.until(lambda: not client.state()["move_running"])
    np.testing.assert_allclose(client.state()["tcp"][:3], goal[:3], atol=3e-3)
    client.send("move", sequence=2, pose=pose, duration_s=20.0)
    run.until(lambda: client.state()["move_running"])
    client.send("cancel", sequence=3)
    run.until(lambda: not client.state()["move_running"])
    client.ended()


WRONG = [
    ("{", "input", "not valid JSON"),
    ("[]", "input", "must be a JSON object"),
    ("null", "input", "must be a JSON object"),
    ('{"type": "jump"}', "input", "there is no frame of type 'jump'; valid types: subscribe, session"),
    ('{"type": []}', "input", "there is no frame of type []"),
    ('{"type": "end", "type": "end"}', "input", "the key 'type' occurs twice"),
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


def test_wrong_frames_are_answered_and_change_nothing(client: Frames, run: VirtualService) -> None:
    client.session()
    client.target(HOME)
    for frame, code, words in WRONG:
        client.socket.send(frame)
        answer = client.answer()
        assert (answer["type"], answer["code"]) == ("error", code), frame
        assert words in answer["detail"], frame
    layout = client.hello["layout"]
    client.binary(9, 1)
    assert "there is no binary frame of kind 9; valid kinds: 1 (state)" in client.answer()["detail"]
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
    run.until(lambda: client.state()["setpoint_seen"] == client.number)
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
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@example(frame="[" * 60_000)
@example(frame='{"type": "target", "sequence": 1e400}')
@given(frame=FRAMES)
def test_no_frame_without_a_session_moves_the_arm_or_ends_the_connection(
    service: VirtualService, shared_client: Frames, frame: str | bytes
) -> None:
    before = service.joints()
    shared_client.socket.send(frame)
    shared_client.send("end")  # is answered in any case: there is no session
    while (answer := shared_client.answer())["about"] != "end":
        assert answer["type"] == "error"
    np.testing.assert_allclose(service.joints(), before, atol=2e-3)
    assert health(service)["session"] is None


@pytest.fixture(scope="module")
def shared_client(service: VirtualService) -> Iterator[Frames]:
    with connect(service) as connected:
        yield connected


@pytest.mark.parametrize("interpolation", ["none", "linear", "quintic", "ruckig"])
def test_a_first_target_that_is_too_far_away_is_answered_once(
    client: Frames, run: VirtualService, interpolation: str
) -> None:
    client.session(inner_control_hz=30, interpolation=interpolation)
    for _ in range(30):
        client.target([0.8, 0.3, *HOME[2:]])
        run.sleep(1 / 30)
    error = client.answer()
    assert (error["type"], error["code"], error["about"]) == ("error", "input", "target")
    assert ("joint1 is at 0.000, but the target is at 0.800: 0.800 apart. A stream must begin") in error[
        "detail"
    ]
    sway(run, client, 0.5)
    client.send("end")
    assert client.answer()["type"] == "session_ended", "no second error before it"


def test_a_first_pose_that_is_too_far_away_is_answered_once(client: Frames, run: VirtualService) -> None:
    client.session(stream="cartesian", inner_control_hz=30)
    client.send("target", sequence=1, pose=[9.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0])
    run.sleep(0.2)
    assert "the target is at (9.000, 0.000, 1.000) m in the base frame" in client.answer()["detail"]


def test_frames_out_of_order_are_refused_and_counted(client: Frames, run: VirtualService) -> None:
    client.session()
    client.target(HOME)
    client.target(HOME)
    for stale in (2, 1):
        client.send("target", sequence=stale, joints=[0.5, *HOME[1:]])
        assert client.answer()["detail"] == f"sequence must increase: {stale} comes after 2"
    assert health(run)["session"]["refused"] == 2
    client.ended()
    np.testing.assert_allclose(run.joints(), HOME, atol=2e-3)


def test_a_second_client_may_look_but_not_stream(client: Frames, run: VirtualService) -> None:
    client.session()
    with connect(run) as other:
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
    client: Frames, run: VirtualService
) -> None:
    client.session()
    sequence = {"config": ("s.json", json.dumps({"waypoints": []}), "application/json")}
    answers = [
        post(run, "/robot/move/named", name="home"),
        post(run, "/trajectory/send", points=[{"positions": HOME, "time_from_start": 1.0}]),
        run.post("/sequences/start", files=sequence),
    ]
    for answer in answers:
        assert (answer.status_code, answer.json()["code"]) == (409, "conflict"), answer.text
        assert "the robot is in use by WS /robot/stream from 127.0.0.1:" in answer.json()["detail"]
    assert health(run)["service"]["motion"].startswith("WS /robot/stream from")
    client.ended()


def test_no_session_begins_during_a_motion(client: Frames, run: VirtualService) -> None:
    points = [{"positions": [0.5, *HOME[1:]], "time_from_start": 20.0}]
    assert post(run, "/trajectory/send", points=points).status_code == 200
    client.send("session")
    answer = client.answer()
    assert (answer["code"], answer["about"]) == ("conflict", "session")
    assert "in use by POST /trajectory/send" in answer["detail"]
    post(run, "/stop")
    client.session()
    client.ended()


def test_a_stop_ends_the_session_and_everybody_learns_of_it(client: Frames, run: VirtualService) -> None:
    number = client.session(inner_control_hz=50)
    sway(run, client, 0.6)
    stopped = post(run, "/stop").json()
    assert stopped["success"], stopped
    assert stopped["stopped"][0].startswith("WS /robot/stream from 127.0.0.1:")
    assert health(run)["session"] is None
    ended = client.until_ended()
    assert (ended["number"], ended["reason"], ended["reason_code"]) == (
        number,
        "stop requested",
        "stop_requested",
    )
    client.target(HOME)
    assert client.answer()["code"] == "stopped"
    client.session()
    client.ended()


def test_an_estop_of_the_client_is_latched(client: Frames, run: VirtualService) -> None:
    client.session(inner_control_hz=50)
    sway(run, client, 0.6)
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
    client: Frames, run: VirtualService
) -> None:
    client.session(inner_control_hz=50)
    before = health(run)["interventions"]["command_timeout"]
    sway(run, client, 0.6)
    run.until(lambda: health(run)["interventions"]["command_timeout"] == before + 1)
    assert 0.0 <= health(run)["last_interventions_s"]["command_timeout"] < 1.0
    assert health(run)["last_interventions_s"]["not_finite"] is None
    run.until(lambda: "intervention command_timeout at " in run.output)
    client.target(HOME)
    client.ended()


def test_there_are_only_so_many_connections(run: VirtualService) -> None:
    clients: list[Frames] = []

    def connect_many() -> None:
        for _ in range(40):
            clients.append(connect(run))  # noqa: PERF401 - those before the last are closed below

    try:
        with pytest.raises(Refused) as refused:
            connect_many()
        assert refused.value.status == 503
        assert (
            json.loads(refused.value.body)["detail"]
            == "32 streaming connections are already open, which is the maximum"
        )
        assert 30 <= len(clients) <= 32, "other tests may have one"
    finally:
        for each in clients:
            each.socket.close()
    run.until(lambda: try_connect(run))


def try_connect(run: VirtualService) -> bool:
    try:
        connect(run).socket.close()
    except Refused:
        return False
    return True


def test_a_page_of_somebody_elses_cannot_connect(run: VirtualService) -> None:
    with pytest.raises(Refused) as refused:
        connect(run, origin="http://evil.example")
    assert "a page of http://evil.example may not move the robot" in refused.value.body.decode()
    with connect(run, origin=run.url) as page:
        assert page.hello["type"] == "hello"


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ({"type": "target", "sequence": 1, "joints": 0.5, "velocities": []}, {"joints": [0.5]}),
        ({"type": "chunk", "sequence": 1, "times_s": 0.1, "points": [0.1, 0.2]}, {"points": [[0.1, 0.2]]}),
        ({"type": "session", "stiffness": [], "force_axes": []}, {"stiffness": None, "force_axes": None}),
        ({"type": "jog", "joints": [], "twist": []}, {"joints": None, "twist": None}),
    ],
)
def test_lists_of_one_without_brackets_and_an_empty_list_for_nothing_are_read(
    written: dict[str, Any], meant: dict[str, Any]
) -> None:
    """As MATLAB writes them, as in the bodies of requests."""
    frame = read_frame(written, Stream.JOINT_IMPEDANCE)
    assert {name: getattr(frame, name) for name in meant} == meant
    assert frame == read_frame({**written, **meant}, Stream.JOINT_IMPEDANCE)


def test_a_chunk_of_poses_is_for_nobody(client: Frames) -> None:
    client.session(stream="cartesian")
    chunk = np.zeros((), chunk_dtype(7))
    chunk["count"] = 1
    client.binary(4, 1, chunk.tobytes())
    assert "a cartesian stream does not accept chunks" in client.answer()["detail"]
    client.ended()
