"""A running cobot on ROS 2, used by what nobody here wrote: Fast DDS (under rmw_fastrtps), Cyclone DDS, the
client of the section 8.0 of the manual; rclpy is in test_rclpy.py. Second oracle: the same over HTTP.
"""

from __future__ import annotations

import itertools
import json
import os
import queue
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, Run, answering, require_quick
from cyclone_peer import JointState, String, cyclone_participant, cyclone_reader, cyclone_writer
from dds_peers import own_domain
from manual_programs import run_script, script, shim_environment
from network_namespaces import connect, hosts
from ros_peer import Client, Peer, until
from thorough import few

from app.aubo.interfaces import interface_definitions
from cobot.codes import Code
from cobot.dds.rtps.announcements import LEASE_S
from cobot.robot.description import RobotDescription
from cobot.ros.messages import Messages

STRING = "std_msgs/msg/String"
JOINT_STATES = "sensor_msgs/msg/JointState"
HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
PERIOD = ("--period", "0.02", "--time", "0.02", "--watchdog", "5")
"""With time enough for a machine that does other things too."""

needs_manual = pytest.mark.skipif(script() is None, reason="the manual is not here")


class Ros:
    """A running cobot and a node on Fast DDS beside it."""

    def __init__(self, run: Run, domain: int, peer: Peer) -> None:
        self.run = run
        self.domain = domain
        self.peer = peer

    def client(self, method: str) -> Client:
        """Of a vendor service, by Class/method."""
        name = method.split("/")[1]
        type_ = f"aubo_interfaces/srv/{name[0].upper()}{name[1:]}"
        return self.peer.client(f"/{self.run.name}/{method}", type_).until_ready()

    def call(self, method: str, **request: Any) -> Any:
        answer = self.client(method).call(request)
        assert answer["code"] == 0, answer
        return answer["result"]

    def home(self) -> None:
        self.move(HOME)

    def move(self, joints: list[float]) -> None:
        with httpx.Client(base_url=self.run.url, timeout=WAIT_S) as http:
            http.post("/stop").raise_for_status()
            moved = http.post("/robot/move/joints", json={"joints": joints, "speed": 1.0})
            assert moved.json()["success"], moved.text

    def until_at(self, joints: list[float]) -> None:
        how = f"{self.run.health()}\n{self.run.output[-2000:]}"
        until(lambda: np.abs(np.subtract(self.run.joints(), joints)).max() < 0.01, f"not at {joints}: {how}")

    def topic(self, name: str) -> str:
        return f"/{self.run.name}/{name}"

    def script(self, folder: Path, *arguments: str) -> None:
        """Run the manual's client to its end, which must be a good one."""
        environment = shim_environment(self.domain)
        ended = run_script(folder, self.run.name, *arguments, python=sys.executable, environment=environment)
        assert ended.returncode == 0, f"{ended.stderr[-3000:]}\n{self.run.output[-2000:]}"


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Ros]:
    with own_domain() as domain:
        folder = tmp_path_factory.mktemp("ros")
        with (
            answering(Run(folder, clock="realtime", ros_domain=domain)) as run,
            Peer(domain, Messages(interface_definitions())) as peer,
        ):
            yield Ros(run, domain, peer)


@needs_manual
@pytest.mark.parametrize("mode", few(range(1, 8)))
def test_the_manual_s_client_moves_the_arm_to_zero_in_every_servo_mode(
    ros: Ros, mode: int, tmp_path: Path
) -> None:
    ros.move([0.4, -0.3, 0.2, -0.4, 0.1, 0.3, -0.2])  # from home it takes four times as long
    ros.script(tmp_path, "--mode", "current", "--servo-mode", str(mode), *PERIOD)
    ros.until_at([0.0] * 7)


@pytest.mark.thorough
@needs_manual
def test_the_manual_s_client_plays_joints_of_a_csv_file(ros: Ros, tmp_path: Path) -> None:
    ros.home()
    points = np.linspace(np.array(HOME) + 0.2, np.array(HOME) - 0.2, 60)
    path = tmp_path / "joints.csv"
    path.write_text("\n".join(",".join(map(str, point)) for point in points), encoding="utf-8")
    ros.script(
        tmp_path, "--mode", "csv", "--traj", str(path), "--point-type", "joint", "--servo-mode", "3", *PERIOD
    )
    ros.until_at(points[-1].tolist())


@pytest.mark.thorough
@needs_manual
def test_the_manual_s_client_plays_poses_of_a_csv_file(
    ros: Ros, robot: RobotDescription, tmp_path: Path
) -> None:
    ros.home()
    start = ros.call("RobotState/getTcpPose")
    poses = [[start[0] - 0.002 * step, start[1] + 0.002 * step, *start[2:]] for step in range(50)]
    path = tmp_path / "poses.csv"
    path.write_text("\n".join(",".join(map(str, pose)) for pose in poses), encoding="utf-8")
    arguments = ("--mode", "csv", "--traj", str(path), "--point-type", "cartesian", "--servo-mode", "4")
    ros.script(tmp_path, *arguments, *PERIOD)

    def off() -> float:
        reached = robot.model.forward(np.array(ros.run.joints())).position
        return float(np.abs(reached - poses[-1][:3]).max())

    until(lambda: off() < 0.002, "the TCP is not at the last pose")


@pytest.mark.thorough
@needs_manual
def test_the_manual_s_client_moves_the_arm_from_another_computer(tmp_path: Path) -> None:
    with hosts(2) as (here, there), own_domain() as domain, here.inside():
        connect(here, there, 0)
        with answering(Run(tmp_path, "realtime", domain, ros_elsewhere=True)) as run:
            near_zero = {"joints": [0.1] * 7, "speed": 1.0}
            httpx.post(f"{run.url}/robot/move/joints", json=near_zero, timeout=WAIT_S).raise_for_status()
            arguments = (run.name, "--mode", "current", "--servo-mode", "4", *PERIOD)
            with there.inside():
                environment = shim_environment(domain, localhost_only=False)
                ended = run_script(tmp_path, *arguments, python=sys.executable, environment=environment)
            assert ended.returncode == 0, f"{ended.stderr[-3000:]}\n{run.output[-2000:]}"
            run.until(lambda: np.abs(run.joints()).max() < 0.01)


def test_services_answer_as_over_http(ros: Ros) -> None:
    ros.home()
    for method in (
        "RobotConfig/getDof",
        "RobotConfig/getName",
        "MotionControl/getExecId",
        "RobotState/isSteady",
    ):
        http = httpx.post(f"{ros.run.url}/{ros.run.name}/{method}", json={}, timeout=WAIT_S).json()
        assert ros.client(method).call() == http
    joints = ros.call("RobotState/getJointPositions")
    assert np.abs(np.array(joints) - HOME).max() < 1e-3
    solved = json.loads(
        ros.call("RobotAlgorithm/inverseKinematics", qnear=joints, pose=ros.call("RobotState/getTcpPose"))
    )
    assert np.abs(np.array(solved[0]) - joints).max() < 1e-3
    assert solved[1] == 0
    wrong = ros.client("MotionControl/moveJoint").call({"q": [9.0] * 7, "a": 0.5, "v": 0.5})
    assert wrong["code"] == Code.LIMIT
    assert wrong["message"]


def test_joint_states_come_at_their_rate_with_the_time_of_their_measurement(ros: Ros) -> None:
    heard = ros.peer.subscription(ros.topic("joint_states"), JOINT_STATES, depth=1000)
    heard.until_matched()
    messages = [heard.get() for _ in range(200)]
    stamps = [
        1_000_000_000 * each["header"]["stamp"]["sec"] + each["header"]["stamp"]["nanosec"]
        for each in messages
    ]
    assert all(later > earlier for earlier, later in itertools.pairwise(stamps))
    assert abs(time.time_ns() - stamps[-1]) < 5e9
    assert messages[0]["name"] == [f"joint{number}" for number in range(1, 8)]
    assert {len(messages[0][key]) for key in ("position", "velocity", "effort")} == {7}
    over_http = httpx.get(f"{ros.run.url}/robot/joint_states").json()
    assert messages[-1]["position"] == pytest.approx(over_http["position"], abs=1e-3)


def test_frames_and_the_description_are_there_for_who_comes_late(ros: Ros, robot: RobotDescription) -> None:
    peer = ros.peer
    for topic in ("/robot_description", ros.topic("robot_description")):
        assert "<robot" in peer.subscription(topic, STRING, latched=True).get()["data"]
    static = peer.subscription("/tf_static", "tf2_msgs/msg/TFMessage", latched=True).get()["transforms"]
    assert {each["child_frame_id"] for each in static} == {"base_link", "tcp"}
    moving = peer.subscription("/tf", "tf2_msgs/msg/TFMessage").get()["transforms"]
    assert {each["child_frame_id"] for each in moving} == {f"link{number}" for number in range(1, 8)}
    pose = peer.subscription(ros.topic("tcp_pose"), "geometry_msgs/msg/PoseStamped").get()
    expected = robot.model.forward(np.array(ros.run.joints())).position
    assert list(pose["pose"]["position"].values()) == pytest.approx(expected.tolist(), abs=1e-3)
    wrench = peer.subscription(ros.topic("wrench"), "geometry_msgs/msg/WrenchStamped").get()
    assert wrench["header"]["frame_id"] == "tcp"
    status = json.loads(peer.subscription(ros.topic("status"), STRING).get()["data"])
    assert status["mode"] == "HOLD"


@pytest.mark.thorough
def test_cyclone_dds_reads_states_and_moves_the_arm(ros: Ros) -> None:
    ros.home()
    goal = np.array(HOME) + 0.1
    with cyclone_participant(ros.domain) as participant:
        states = cyclone_reader(participant, f"rt{ros.topic('joint_states')}", JointState)
        commands = cyclone_writer(participant, f"rt{ros.topic('joint_cmd')}", String)
        until(lambda: commands.get_matched_subscriptions() and states.get_matched_publications(), "no cobot")
        control = {"type": "servo_control", "command": "set_mode", "mode": 1, "watchdog_timeout": 2.0}
        commands.write(String(json.dumps(control)))
        point = {"type": "servo_point", "session_id": 5, "point_type": "joint", "position": goal.tolist()}

        def arrived() -> bool:
            point["point_id"] = point.get("point_id", 0) + 1
            commands.write(String(json.dumps(point)))
            return any(np.abs(np.array(state.position) - goal).max() < 0.005 for state in states.take(N=100))

        until(arrived, "the arm does not arrive")
        commands.write(String(json.dumps({"type": "servo_control", "command": "stop"})))


def test_a_servo_session_is_held_by_its_action(ros: Ros) -> None:
    ros.home()
    below, type_ = ros.topic("servo_mode/_action"), "aubo_interfaces/action/ServoMode"
    feedback = ros.peer.subscription(f"{below}/feedback", f"{type_}_FeedbackMessage")
    feedback.until_matched()
    send = ros.peer.client(f"{below}/send_goal", f"{type_}_SendGoal").until_ready()
    result = ros.peer.client(f"{below}/get_result", f"{type_}_GetResult").until_ready()
    cancel = ros.peer.client(f"{below}/cancel_goal", "action_msgs/srv/CancelGoal").until_ready()
    commands = ros.peer.publisher(ros.topic("joint_cmd"), STRING, depth=100)
    commands.until_matched()
    goal_id = {"uuid": list(os.urandom(16))}
    assert send.call({"goal_id": goal_id, "goal": {"mode": 3, "watchdog_timeout": 5.0, "send_period": 0.02}})[
        "accepted"
    ]
    ended = result.begin({"goal_id": goal_id})
    for number in range(1, 21):
        point = {"type": "servo_point", "session_id": 1, "point_id": number, "position": HOME, "time": 0.02}
        commands.publish({"data": json.dumps(point)})
    told = feedback.until(lambda message: message["feedback"]["points_accepted"] == 20)
    assert told["feedback"]["point_id"] == 20
    assert len(cancel.call({"goal_info": {"goal_id": goal_id}})["goals_canceling"]) == 1
    answer = ended(WAIT_S)
    assert (answer["status"], answer["result"]["code"]) == (5, 0)
    assert (answer["result"]["points_accepted"], answer["result"]["points_refused"]) == (20, 0)


FJT = "control_msgs/action/FollowJointTrajectory"


def trajectory(positions: np.ndarray, times_s: np.ndarray) -> dict[str, Any]:
    """A goal of FollowJointTrajectory."""
    points = [
        {"positions": list(point), "time_from_start": {"sec": int(at), "nanosec": int(at % 1 * 1e9)}}
        for point, at in zip(positions.tolist(), times_s.tolist(), strict=True)
    ]
    names = [f"joint{number}" for number in range(1, 8)]
    return {"trajectory": {"joint_names": names, "points": points}}


def test_a_trajectory_is_followed_with_feedback_to_its_goal(ros: Ros) -> None:
    ros.home()
    below = ros.topic("follow_joint_trajectory/_action")
    feedback = ros.peer.subscription(f"{below}/feedback", f"{FJT}_FeedbackMessage", depth=1000)
    feedback.until_matched()
    send = ros.peer.client(f"{below}/send_goal", f"{FJT}_SendGoal").until_ready()
    result = ros.peer.client(f"{below}/get_result", f"{FJT}_GetResult").until_ready()
    # 5000 points: larger than a datagram, and than what is decoded in the event loop.
    times_s = np.linspace(0.001, 5.0, 5000)
    share = (1.0 - np.cos(np.pi * times_s / 5.0)) / 2.0
    positions = np.array(HOME) + 0.3 * share[:, None]
    goal_id = {"uuid": list(os.urandom(16))}
    assert send.call({"goal_id": goal_id, "goal": trajectory(positions, times_s)})["accepted"], (
        ros.run.output[-2000:]
    )
    told = feedback.get()["feedback"]
    assert told["joint_names"] == [f"joint{number}" for number in range(1, 8)]
    answer = result.call({"goal_id": goal_id})
    assert (answer["status"], answer["result"]["error_code"]) == (4, 0), answer
    assert np.abs(np.array(ros.run.joints()) - positions[-1]).max() < 0.01


def test_a_trajectory_that_is_cancelled_comes_to_rest_on_its_path(ros: Ros) -> None:
    ros.home()
    below = ros.topic("follow_joint_trajectory/_action")
    send = ros.peer.client(f"{below}/send_goal", f"{FJT}_SendGoal").until_ready()
    result = ros.peer.client(f"{below}/get_result", f"{FJT}_GetResult").until_ready()
    cancel = ros.peer.client(f"{below}/cancel_goal", "action_msgs/srv/CancelGoal").until_ready()
    goal_id = {"uuid": list(os.urandom(16))}
    goal = trajectory(np.array([HOME]) + 0.5, np.array([10.0]))
    assert send.call({"goal_id": goal_id, "goal": goal})["accepted"]
    until(lambda: np.abs(ros.run.joints() - np.array(HOME)).max() > 0.01, "the arm does not move")
    assert len(cancel.call({"goal_info": {"goal_id": goal_id}})["goals_canceling"]) == 1
    assert result.call({"goal_id": goal_id})["status"] == 5
    assert np.ptp(np.array(ros.run.joints()) - HOME) < 0.01  # all joints have gone the same way


def restarted(ros: Ros, module: str, act: Callable[[], Any]) -> None:
    """Kill a process, do something, and wait until there is another."""
    child = ros.run.until(lambda: ros.run.child(module))
    os.kill(child.pid, signal.SIGKILL)
    act()
    ros.run.until(lambda: ros.run.restarted(module, child.pid))


def test_calls_are_answered_while_the_service_is_dead_and_again_after_it(ros: Ros) -> None:
    get_dof = ros.client("RobotConfig/getDof")
    assert get_dof.call()["result"] == 7
    restarted(ros, "app", lambda: until(lambda: get_dof.call()["code"] == Code.UNAVAILABLE, "no refusal"))
    until(lambda: get_dof.call()["code"] == Code.OK, "the service does not come back")


@pytest.mark.thorough
def test_the_client_finds_a_restarted_ros_process(ros: Ros) -> None:
    get_dof = ros.client("RobotConfig/getDof")
    states = ros.peer.subscription(ros.topic("joint_states"), JOINT_STATES)
    states.until_matched()

    def away_s() -> float:
        killed_s = time.monotonic()
        # Who finds the new one no longer believes in the dead one: each call that can be made is answered.
        restarted(
            ros,
            "cobot.dds",
            lambda: until(lambda: get_dof.matches() == (0, 0), "the dead one is still there"),
        )
        until(lambda: get_dof.matches() == (1, 1), "the new process is not found")
        assert get_dof.call()["result"] == 7
        return time.monotonic() - killed_s

    require_quick(away_s, LEASE_S)  # else it came back no sooner than the dead one is missed anyway
    states.drain()
    states.get()


@pytest.mark.parametrize("activity", few(["goal", "servo"]))
def test_what_came_by_way_of_a_ros_process_ends_with_it(ros: Ros, activity: str) -> None:
    """The arm comes to rest; its client is left without an answer, as by a computer that is gone, and asks
    the next process.
    """
    ros.home()
    goal_id = {"uuid": list(os.urandom(16))}
    if activity == "goal":
        below, type_ = ros.topic("follow_joint_trajectory/_action"), FJT
        asked = trajectory(np.array([HOME]) + 0.5, np.array([20.0]))
    else:
        below, type_ = ros.topic("servo_mode/_action"), "aubo_interfaces/action/ServoMode"
        asked = {"mode": 1, "watchdog_timeout": 60.0, "send_period": 0.02}
    send = ros.peer.client(f"{below}/send_goal", f"{type_}_SendGoal").until_ready()
    result = ros.peer.client(f"{below}/get_result", f"{type_}_GetResult").until_ready()
    assert send.call({"goal_id": goal_id, "goal": asked})["accepted"]
    ended = result.begin({"goal_id": goal_id})
    if activity == "servo":
        commands = ros.peer.publisher(ros.topic("joint_cmd"), STRING, depth=100)
        commands.until_matched()
        point = {"type": "servo_point", "session_id": 1, "point_id": 1, "time": 0.02}
        commands.publish({"data": json.dumps(point | {"position": [0.1, *HOME[1:]]})})
    until(lambda: np.abs(ros.run.joints() - np.array(HOME)).max() > 0.01, "the arm does not move")

    def rests() -> bool:
        robot = (ros.run.health() or {"robot": {}})["robot"]
        assert isinstance(robot, dict)
        return robot.get("mode") == "HOLD"

    def missed() -> None:
        until(rests, "the arm does not come to rest")
        until(lambda: send.matches() == (0, 0), "the dead one is still there")

    restarted(ros, "cobot.dds", missed)
    until(lambda: send.matches() == (1, 1), "the next process is not found")
    assert np.abs(np.array(ros.run.joints()) - HOME).max() < 0.49, "it did not go to its end"
    with pytest.raises(queue.Empty):
        ended(0.0)
    again = {"goal_id": {"uuid": list(os.urandom(16))}, "goal": asked}
    assert send.call(again)["accepted"]


def test_states_fall_silent_with_the_robot_and_the_status_says_why(ros: Ros) -> None:
    states = ros.peer.subscription(ros.topic("joint_states"), JOINT_STATES, depth=1000)
    status = ros.peer.subscription(ros.topic("status"), STRING)
    states.until_matched()
    status.until_matched()
    child = ros.run.until(lambda: ros.run.child("rtloop"))
    os.kill(child.pid, signal.SIGSTOP)
    told = status.until(lambda message: json.loads(message["data"])["mode"] == "UNAVAILABLE")
    states.drain()
    assert "rtloop has published nothing for" in json.loads(told["data"])["reason"]
    for _ in range(3):
        status.get()
    assert states.drain() == []
    os.kill(child.pid, signal.SIGCONT)
    states.get()
    status.until(lambda message: json.loads(message["data"])["mode"] != "UNAVAILABLE")
