"""ROS 2 over DDS: what a node on Fast DDS, the library below rmw_fastrtps, receives from a running cobot.

Long, because both ends of each measurement stand beside each other.
"""

from __future__ import annotations

import itertools
import json
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import rtps_peer
from cobot_run import Run
from dds_peers import own_domain
from real_ros import PYTHON, environment
from ros_peer import Client, Peer, until

from app.aubo.interfaces import interface_definitions
from benchmarks.service import reader
from benchmarks.table import Row, percentiles, row
from cobot.dds.names import ENCLAVE
from cobot.dds.rtps import Participant, Qos
from cobot.dds.rtps.announcements import LEASE_S
from cobot.ros.messages import Messages

JOINT_STATES = "sensor_msgs/msg/JointState"
BYTES = 292
"""Of a JointState of seven joints."""
POINT_PERIOD_S = 0.002
SWING_RAD = 0.01
RECOVERIES = 5
LOSSES = (0.1, 0.3)
PATIENCE_S = 20.0


class Ros:
    """A running cobot in its own domain, and a node on Fast DDS."""

    def __init__(self, run: Run, domain: int, peer: Peer) -> None:
        self.run, self.domain, self.peer = run, domain, peer

    def client(self, method: str, type_: str) -> Client:
        return self.peer.client(f"/{self.run.name}/{method}", type_).until_ready()

    def call(self, method: str, **request: Any) -> Any:
        """Call a vendor service over HTTP, and return its answer."""
        answer = httpx.post(f"{self.run.url}/{self.run.name}/{method}", json=request, timeout=60.0).json()
        if answer["code"]:
            raise RuntimeError(f"{method}: {answer['message']}")
        return answer["result"]


@contextmanager
def ros() -> Iterator[Ros]:
    with own_domain() as domain, tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        run = Run(Path(folder), "realtime", ros_domain=domain)
        try:
            run.until(run.healthy)
            with Peer(domain, Messages(interface_definitions())) as peer:
                yield Ros(run, domain, peer)
        finally:
            run.end()


def dds(seconds: float, calls: int, points: int) -> Iterator[Row]:
    """Joint states, services, servo points, a long trajectory, a killed process, and lost packets."""
    with ros() as running:
        for rate_hz in (200, 1000):
            yield from _joint_states(running, rate_hz, seconds)
        yield from _to_rclpy(running, seconds)
        yield _round_trips(running, calls)
        yield _points(running, points)
        yield _long_trajectory(running)
        yield _recoveries(running)
    for share in LOSSES:
        yield _losses(share, points // 50)


def _joint_states(running: Ros, rate_hz: int, seconds: float) -> Iterator[Row]:
    """The age of a measurement when it arrives, and the time that a message takes between two Fast DDS
    nodes.
    """
    value = {"type": 3, "double_value": float(rate_hz)}
    parameter = {"name": "joint_states_rate_hz", "value": value}
    setter = running.peer.client("/cobot/set_parameters", "rcl_interfaces/srv/SetParameters").until_ready()
    setter.call({"parameters": [parameter]})
    states = running.peer.subscription(f"/{running.run.name}/joint_states", JOINT_STATES, depth=1000)
    states.until_matched()
    process = running.run.child("cobot.dds")
    assert process is not None
    used, begun_s = process.cpu_times(), time.monotonic()
    states.drain()
    time.sleep(seconds)
    took_s = time.monotonic() - begun_s
    spent = process.cpu_times()
    ages_ms = [(came_ns - _stamp_ns(message)) / 1e6 for came_ns, message in states.arrivals()]
    core = 100.0 * (spent.user + spent.system - used.user - used.system) / took_s
    with rtps_peer.running(running.domain) as sender, rtps_peer.running(running.domain) as receiver:
        floor = _between_peers(sender, receiver, int(rate_hz * seconds), 1.0 / rate_hz)
    yield row(
        f"joint_states at {rate_hz} Hz to a Fast DDS node: age on arrival; {len(ages_ms) / took_s:.0f} Hz, "
        f"{core:.1f} % of a core",
        "ms",
        (*percentiles(ages_ms)[:2], max(ages_ms)),
        "Fast DDS to Fast DDS, a message of that size",
        floor,
        columns=("p50", "p99", "largest"),
    )


def _to_rclpy(running: Ros, seconds: float) -> Iterator[Row]:
    """The share of the joint states at 1 kHz that reaches rclpy. `_joint_states` has set this rate."""
    if not PYTHON.exists():
        print("left out: rclpy, whose wheels do not fit here", file=sys.stderr)
        return
    node = [str(PYTHON), str(Path(__file__).with_name("rclpy_node.py"))]
    around = environment(domain=running.domain)

    def heard_hz(topic: str) -> float:
        listening = [*node, "listen", topic, str(seconds)]
        done = subprocess.run(listening, env=around, stdout=subprocess.PIPE, text=True, check=True)
        return float(done.stdout)

    ours = heard_hz(f"/{running.run.name}/joint_states")
    with subprocess.Popen([*node, "publish", "/peer/joint_states", "1000"], env=around) as publisher:
        try:
            theirs = heard_hz("/peer/joint_states")
        finally:
            publisher.kill()
    yield row(
        "joint_states at 1000 Hz that reach an rclpy node of Jazzy",
        "messages/s",
        (ours,),
        "those of an rclpy node at 1000 Hz that reach it",
        (theirs,),
        columns=("received",),
        aim="as many",
    )


def _stamp_ns(message: dict[str, Any]) -> int:
    stamp = message["header"]["stamp"]
    return int(stamp["sec"]) * 10**9 + int(stamp["nanosec"])


def _round_trips(running: Ros, calls: int) -> Row:
    client = running.client("RobotConfig/getDof", "aubo_interfaces/srv/GetDof")
    url = f"{running.run.url}/{running.run.name}/RobotConfig/getDof"
    over_dds, over_http = [], []
    with httpx.Client() as http:
        for _ in range(calls):
            for kind, ask in ((over_dds, client.call), (over_http, lambda: http.post(url, json={}))):
                begun_ns = time.monotonic_ns()
                ask()
                kind.append((time.monotonic_ns() - begun_ns) / 1e6)
    return row(
        "service getDof over DDS, there and back", "ms", percentiles(over_dds), "HTTP", percentiles(over_http)
    )


def _points(running: Ros, count: int) -> Row:
    """A servo session with this number of points at 500 Hz: the number of points that have moved the arm."""
    name = running.run.name
    publisher = running.peer.publisher(f"/{name}/joint_cmd", "std_msgs/msg/String", depth=1000)
    publisher.until_matched()
    home = np.array(running.call("RobotState/getJointPositions"))

    def say(**message: Any) -> None:
        publisher.publish({"data": json.dumps(message)})

    say(type="servo_control", command="set_mode", mode=3, watchdog_timeout=2.0, send_period=POINT_PERIOD_S)
    until(lambda: running.call("MotionControl/isServoModeEnabled"), "the session has not begun")
    begun_s = time.monotonic()
    for number in range(1, count + 1):
        phase = 2.0 * np.pi * 0.5 * number * POINT_PERIOD_S
        position = home + SWING_RAD * np.sin(phase) * (1.0 - np.exp(-0.1 * phase))
        say(
            type="servo_point", session_id=1, point_id=number, point_type="joint",
            position=position.round(6).tolist(), time=POINT_PERIOD_S, lookahead_time=0.1, gain=200,
        )  # fmt: skip
        time.sleep(max(0.0, begun_s + number * POINT_PERIOD_S - time.monotonic()))
    until(lambda: json.loads(running.call("MotionControl/getServoFeedback"))["buffered"] == 0, "points wait")
    feedback = json.loads(running.call("MotionControl/getServoFeedback"))
    say(type="servo_control", command="stop")
    until(
        lambda: json.loads(running.call("MotionControl/getServoFeedback"))["state"] == "idle",
        "the session has not ended",
    )
    taken, refused = feedback["points_taken"], feedback["points_refused"]
    return row(
        f"servo points of {count} sent at 500 Hz over DDS: {feedback['underruns']} underruns",
        "",
        (count - taken, feedback["points_received"], refused),
        "sent",
        (1, count, 1),
        columns=("lost", "received", "refused"),
        ratio_of="received",
        aim="0 lost",
    )


def _long_trajectory(running: Ros, points: int = 5000) -> Row:
    """The time from sending a goal with this number of points to its acceptance. Over rosbridge the same goal
    would be JSON.
    """
    type_ = "control_msgs/action/FollowJointTrajectory"
    goal = running.client("follow_joint_trajectory/_action/send_goal", f"{type_}_SendGoal")
    cancel = running.client("follow_joint_trajectory/_action/cancel_goal", "action_msgs/srv/CancelGoal")
    state = reader(running.run).state.read()
    start = np.array(state["commanded_position"])
    names = [f"joint{index}" for index in range(1, len(start) + 1)]
    took_ms, plain_ms = [], []
    trajectory = {"joint_names": names, "points": []}
    for index in range(points):
        time_s = 0.01 * (index + 1)
        position = start + SWING_RAD * (1.0 - np.cos(0.5 * time_s))
        seconds, nanoseconds = divmod(round(time_s * 1e9), 10**9)
        trajectory["points"].append(
            {"positions": position.tolist(), "time_from_start": {"sec": seconds, "nanosec": nanoseconds}}
        )
    for attempt in itertools.count(1):
        identity = {"uuid": list(attempt.to_bytes(16, "big"))}
        request = {"goal_id": identity, "goal": {"trajectory": trajectory}}
        begun_ns = time.monotonic_ns()
        answer = goal.begin(request)
        plain_ms.append((time.monotonic_ns() - begun_ns) / 1e6)
        accepted = answer(60.0)["accepted"]
        took_ms.append((time.monotonic_ns() - begun_ns) / 1e6 - plain_ms[-1])
        if not accepted:
            raise RuntimeError("the goal was refused")
        cancel.call({"goal_info": {"goal_id": identity}})
        until(lambda: running.call("RobotState/isSteady"), "the arm moves on")
        if attempt == 5:
            break
    return row(
        f"FollowJointTrajectory with {points} points, sent to accepted",
        "ms",
        percentiles(took_ms),
        "its serialisation by the client",
        percentiles(plain_ms),
    )


def _recoveries(running: Ros) -> Row:
    """The time without an answer for a client that calls a service repeatedly while the ROS process is killed
    and restarted.
    """
    client = running.client("RobotConfig/getDof", "aubo_interfaces/srv/GetDof")
    took_s = []
    for _ in range(RECOVERIES):
        killed = running.run.until(lambda: running.run.child("cobot.dds"))
        killed.kill()
        begun_s = time.monotonic()
        until(lambda: client.matches() == (0, 0), "the dead one is still there")
        until(lambda: client.matches() == (1, 1), "the new process is not found")
        client.call()
        took_s.append(time.monotonic() - begun_s)
    return row(
        "the ros2 process is killed: until a service answers over DDS again",
        "s",
        (min(took_s), statistics.median(took_s), max(took_s)),
        "the lease, for which nodes believe in a dead one that nobody takes leave for",
        3 * (LEASE_S,),
        columns=("least", "p50", "largest"),
        ratio_of="p50",
        aim="3 s",
    )


def _losses(share: float, count: int) -> Row:
    """Messages from cobot to Fast DDS while this share of all packets is lost on cobot's side, in both
    directions.
    """
    dice = random.Random(5)
    turn = threading.Lock()

    def lost() -> bool:
        with turn:
            return dice.random() < share

    lossy, whole = (_to_peer(count, 0.005, loss) for loss in (lost, None))
    return row(
        f"{count} messages at 200 Hz to Fast DDS, {share:.0%} of all packets lost: "
        f"{count - lossy['count']} messages lost",
        "ms",
        _delays_ms(lossy),
        "no packet lost",
        _delays_ms(whole),
        columns=("p50", "p99", "largest"),
        aim="0 lost",
    )


def _to_peer(count: int, period_s: float, loss: Callable[[], bool] | None) -> dict[str, Any]:
    """The number of cobot's messages that a Fast DDS reader has received."""
    with own_domain() as domain, rtps_peer.running(domain) as peer:
        ours = Participant(domain, localhost_only=True, user_data=ENCLAVE, loss=loss)
        try:
            writer = ours.create_writer("ours", "Type", Qos(depth=None))
            peer.reader("ours")
            peer.wait("ours")
            until(lambda: writer.matched, "the peer is not found")
            begun_s = time.monotonic()
            for number in range(1, count + 1):
                writer.write(rtps_peer.numbered(number, BYTES))
                time.sleep(max(0.0, begun_s + number * period_s - time.monotonic()))
            return _settled(peer, "ours", count)
        finally:
            ours.close()


def _between_peers(
    sender: rtps_peer.Peer, receiver: rtps_peer.Peer, count: int, period_s: float
) -> tuple[float, ...]:
    receiver.reader("theirs")
    sender.writer("theirs")
    sender.wait("theirs")
    receiver.wait("theirs")
    sender.write("theirs", count, BYTES, round(1e6 * period_s))
    return _delays_ms(_settled(receiver, "theirs", count))


def _settled(peer: rtps_peer.Peer, topic: str, count: int) -> dict[str, Any]:
    """The reader's report when all messages have arrived, or after some seconds."""
    report = peer.report(topic)
    deadline_s = time.monotonic() + PATIENCE_S
    while report["count"] < count and time.monotonic() < deadline_s:
        time.sleep(0.1)
        report = peer.report(topic)
    return report


def _delays_ms(report: dict[str, Any]) -> tuple[float, ...]:
    return tuple(1e3 * report[name] for name in ("p50_s", "p99_s", "max_s"))
