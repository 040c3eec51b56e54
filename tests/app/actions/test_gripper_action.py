"""The gripper's actions over rosbridge, on virtual time. Oracles: a toy, whose fingers go 0.2 m/s and stop at
its part; the meaning of the fields in control_msgs; the jobs that REST reports.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from asgi_client import Socket
from cobot_run import WAIT_S
from virtual_service import VirtualService

from cobot.grippers.contract.toy import DEVICES, STROKE_M, ToyDevice

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
GAP, JOINTS = "gripper_cmd", "parallel_gripper_cmd"
TYPES = {GAP: "control_msgs/action/GripperCommand", JOINTS: "control_msgs/action/ParallelGripperCommand"}
PART_M = 0.04
FINGERS = ["gripper_finger_1", "gripper_finger_2"]


class Client:
    """A service with a toy gripper, and a client of its rosbridge."""

    def __init__(self, service: VirtualService, socket: Socket) -> None:
        self.service, self.socket = service, socket

    @property
    def toy(self) -> ToyDevice:
        return DEVICES["toy"]

    def send(self, goal_id: str, action: str, command: dict[str, Any]) -> None:
        name = f"/{self.service.name}/gripper/{action}"
        goal = {"action": name, "action_type": TYPES[action], "args": {"command": command}, "feedback": True}
        self.socket.send(json.dumps({"op": "send_action_goal", "id": goal_id, **goal}))

    def result(self, goal_id: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        """The answer to a goal, and the feedback before it."""
        told = []
        while True:
            message = json.loads(self.socket.recv(WAIT_S))
            if message.get("id") == goal_id and message["op"] == "action_result":
                return message, told
            if message.get("id") == goal_id and message["op"] == "action_feedback":
                told.append(message["values"])

    def go(self, action: str, **command: Any) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        self.send("goal", action, command)
        return self.result("goal")

    def job(self) -> dict[str, Any]:
        jobs: list[dict[str, Any]] = self.service.get("/jobs").json()["jobs"]
        return max((each for each in jobs if each["kind"] == "gripper"), key=lambda each: each["created_at"])


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    folder: Path = tmp_path_factory.mktemp("gripper")
    made = VirtualService(folder, of_robot="gripper: {type: 'cobot.grippers.contract.toy:ToyGripper'}")
    DEVICES["toy"] = ToyDevice(made.clock.now_s)
    with made.serving():
        yield made


@pytest.fixture
def client(service: VirtualService) -> Iterator[Client]:
    toy = DEVICES["toy"]
    toy.object_m, toy.unplugged, toy.fault = None, False, ""
    service.until(service.healthy)
    service.post("/robot/gripper/release", {}).raise_for_status()
    with service.connect("/rosbridge") as socket:
        yield Client(service, socket)


def test_a_goal_goes_to_its_width_with_feedback_on_the_way(client: Client) -> None:
    answer, told = client.go(GAP, position=0.02, max_effort=30.0)
    assert (answer["result"], answer["status"]) == (True, SUCCEEDED)
    assert answer["values"] == {
        "position": pytest.approx(0.02),
        "effort": 0.0,
        "stalled": False,
        "reached_goal": True,
    }
    widths = [each["position"] for each in told]
    assert len(widths) > 3
    assert widths == sorted(widths, reverse=True)
    assert not any(each["stalled"] or each["reached_goal"] for each in told)
    assert client.toy.force_n == 30.0
    assert client.job()["state"] == "finished"


def test_fingers_that_a_part_stops_hold_it_and_have_succeeded_with_stalled(client: Client) -> None:
    client.toy.object_m = PART_M
    answer, _ = client.go(GAP, position=0.0, max_effort=20.0)
    assert answer["status"] == SUCCEEDED
    assert answer["values"] == {
        "position": pytest.approx(PART_M),
        "effort": 20.0,
        "stalled": True,
        "reached_goal": False,
    }
    assert client.service.get("/robot/gripper").json()["state"]["object"] == "held_inside"


def test_a_part_that_a_goal_grasps_is_attached_to_the_scene(client: Client) -> None:
    rest = client.service.client("http://robot.test")
    place = {key: rest.pose()["position"][key] for key in "xyz"}
    rest.put_object("part", "box", size=[PART_M, 0.04, 0.04], mass=0.5, **place)
    client.toy.object_m = PART_M
    client.go(JOINTS, name=FINGERS[:1], position=[0.0])
    assert client.service.get("/robot/gripper").json()["held"] == "part"
    client.toy.object_m = None
    client.go(GAP, position=STROKE_M)
    assert client.service.get("/robot/gripper").json()["held"] is None
    client.service.post("/scene", {"clear": True}).raise_for_status()


@pytest.mark.parametrize(
    "command",
    [
        {"position": [0.015]},
        {"name": FINGERS[1:], "position": [0.015], "velocity": [0.05], "effort": [25.0]},
        {"name": FINGERS, "position": [0.015, 0.015], "velocity": [0.05, 0.05]},
    ],
)
def test_finger_joints_slide_by_half_of_the_width(client: Client, command: dict[str, Any]) -> None:
    answer, told = client.go(JOINTS, **command)
    assert answer["status"] == SUCCEEDED
    state = answer["values"].pop("state")
    assert answer["values"] == {"stalled": False, "reached_goal": True}
    assert (state["name"], state["position"]) == (FINGERS, pytest.approx([0.015, 0.015]))
    assert client.toy.width_m() == pytest.approx(0.03)
    assert told[0]["state"]["position"][0] > 0.015


def test_a_speed_is_a_largest_speed(client: Client) -> None:
    """Oracle: the width changes twice as fast as a finger slides; 0.05 m at 0.1 m/s."""
    begun_s = client.service.clock.now_s()
    client.go(JOINTS, position=[0.015], velocity=[0.05])
    assert client.service.clock.now_s() - begun_s == pytest.approx((STROKE_M - 0.03) / 0.1, abs=0.05)
    client.go(JOINTS, position=[0.03], velocity=[100.0], effort=[1e6])
    assert client.toy.width_m() == pytest.approx(0.06)


def test_a_cancel_stops_the_fingers(client: Client) -> None:
    client.send("goal", GAP, {"position": 0.0, "max_effort": 0.0})
    client.service.until(lambda: client.toy.width_m() < STROKE_M - 0.01)
    name = f"/{client.service.name}/gripper/{GAP}"
    client.socket.send(json.dumps({"op": "cancel_action_goal", "id": "goal", "action": name}))
    answer, _ = client.result("goal")
    assert answer["status"] == CANCELED
    client.service.sleep(0.1)
    width = client.toy.width_m()
    assert 0.01 < width < STROKE_M
    client.service.sleep(0.5)
    assert client.toy.width_m() == width
    assert client.job()["state"] == "cancelled"


def test_of_two_clients_the_later_one_has_the_gripper(client: Client) -> None:
    client.send("first", GAP, {"position": 0.0, "max_effort": 0.0})
    client.service.until(lambda: client.toy.width_m() < STROKE_M - 0.01)
    with client.service.connect("/rosbridge") as socket:
        second = Client(client.service, socket)
        second.send("second", JOINTS, {"position": [0.03]})
        assert client.result("first")[0]["status"] == ABORTED
        assert second.result("second")[0]["status"] == SUCCEEDED
    assert client.toy.width_m() == pytest.approx(0.06)


def test_a_command_over_rest_replaces_a_goal_and_its_reason_is_on_rosout(client: Client) -> None:
    client.socket.send(json.dumps({"op": "subscribe", "topic": "/rosout"}))
    client.send("goal", GAP, {"position": 0.0, "max_effort": 0.0})
    client.service.until(lambda: client.toy.width_m() < STROKE_M - 0.01)
    client.service.post("/robot/gripper/release", {}).raise_for_status()
    told: list[dict[str, Any]] = []
    while len(told) < 2:
        message = json.loads(client.socket.recv(WAIT_S))
        if message["op"] == "publish" or (message.get("id") == "goal" and message["op"] == "action_result"):
            told.append(message)
    (said,) = (each["msg"] for each in told if each["op"] == "publish")
    assert f"a goal of /{client.service.name}/gripper/{GAP} fails: preempted by release" in said["msg"]
    (answer,) = (each for each in told if each["op"] == "action_result")
    assert answer["status"] == ABORTED


@pytest.mark.parametrize(
    ("action", "command", "words"),
    [
        (GAP, {"position": 0.2}, "the width is 0.2 m, but the gripper allows 0 to 0.1 m"),
        (GAP, {"position": -0.01}, "position is -0.01; it must be a number from 0 on"),
        (GAP, {"position": None}, "position is nan"),
        (GAP, {"position": 0.02, "max_effort": None}, "effort is nan"),
        (GAP, {"position": 0.02, "max_effort": 0.001}, "the gripper needs at least"),
        (GAP, {"position": "wide"}, "position"),
        (JOINTS, {}, "command.position must be 1 numbers, got 0"),
        (
            JOINTS,
            {"name": ["joint1"], "position": [0.02]},
            ("it must contain each of gripper_finger_1 and gripper_finger_2 once"),
        ),
        (JOINTS, {"name": FINGERS, "position": [0.01, 0.02]}, "must be the same for both fingers"),
        (JOINTS, {"name": FINGERS, "position": [0.01]}, "must be 2 numbers, got 1"),
        (JOINTS, {"name": FINGERS[:1] * 2, "position": [0.01, 0.01]}, "gripper_finger_2 once"),
        (JOINTS, {"position": [0.02], "velocity": [0.1, 0.1]}, "command.velocity must be 1 numbers or none"),
        (JOINTS, {"position": [None]}, "position is nan"),
        (JOINTS, {"name": FINGERS, "position": [0.01, None]}, "must be the same for both fingers"),
        (JOINTS, {"position": [0.02], "effort": [-3.0]}, "effort is -3"),
    ],
)
def test_a_goal_that_makes_no_sense_is_rejected_in_words_and_nothing_moves(
    client: Client, action: str, command: dict[str, Any], words: str
) -> None:
    answer, told = client.go(action, **command)
    assert answer["result"] is False
    assert words in str(answer["values"])
    assert told == []
    assert client.toy.width_m() == STROKE_M


def test_a_gripper_that_is_unplugged_on_the_way_ends_the_goal_and_rejects_the_next(client: Client) -> None:
    client.send("goal", GAP, {"position": 0.0, "max_effort": 0.0})
    client.service.until(lambda: client.toy.width_m() < STROKE_M - 0.01)
    client.toy.unplugged = True
    answer, _ = client.result("goal")
    assert answer["status"] == ABORTED
    answer, _ = client.go(GAP, position=0.08)
    assert answer["result"] is False
    assert "the toy does not answer" in str(answer["values"])


def test_the_fingers_are_the_last_joints_of_the_joint_states(client: Client) -> None:
    client.go(GAP, position=0.03)
    topic = f"/{client.service.name}/joint_states"
    for name in (topic, f"/{client.service.name}/gripper/joint_states"):
        client.socket.send(json.dumps({"op": "subscribe", "topic": name}))
        client.socket.send(json.dumps({"op": "unsubscribe", "topic": "/none"}))
        while (message := json.loads(client.socket.recv(WAIT_S))).get("topic") != name:
            pass
        state = message["msg"]
        assert state["name"][-2:] == FINGERS
        assert len(state["name"]) == len(state["position"]) == len(state["velocity"]) == len(state["effort"])
        assert state["position"][-2:] == pytest.approx([0.015, 0.015])
        client.socket.send(json.dumps({"op": "unsubscribe", "topic": name}))
    assert len(state["name"]) == 2
    assert math.isfinite(state["velocity"][0])
