"""FollowJointTrajectory over rosbridge, on virtual time; with clients of others: tests/e2e/realtime.

Oracles: what REST says about the same arm; numpy.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from asgi_client import Socket
from cobot_run import WAIT_S
from virtual_service import VirtualService

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0])
NAMES = [f"joint{number}" for number in range(1, 8)]


@pytest.fixture(autouse=True)
def run(service: VirtualService) -> VirtualService:
    """The service with its arm at home."""
    service.go_home()
    return service


@pytest.fixture
def bridge(run: VirtualService) -> Iterator[Socket]:
    with run.connect("/rosbridge") as made:
        yield made


def following(times_s: np.ndarray, turns: np.ndarray, **fields: Any) -> dict[str, Any]:
    """The goal in which joint 1 turns so and all others stay at home."""
    positions = np.tile(HOME, (len(times_s), 1))
    positions[:, 0] = turns
    points = [
        {"positions": row, "time_from_start": {"sec": int(at), "nanosec": round(at % 1 * 1e9)}}
        for row, at in zip(positions.tolist(), times_s.tolist(), strict=True)
    ]
    return {"trajectory": {"joint_names": NAMES, "points": points}, **fields}


def send(bridge: Socket, run: VirtualService, goal_id: str, goal: dict[str, Any]) -> None:
    bridge.send(
        json.dumps(
            {
                "op": "send_action_goal",
                "id": goal_id,
                "action": f"/{run.name}/follow_joint_trajectory",
                "action_type": "control_msgs/action/FollowJointTrajectory",
                "args": goal,
                "feedback": True,
            }
        )
    )


def result(bridge: Socket, goal_id: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What became of the goal, and the feedback on the way."""
    told = []
    while True:
        message: dict[str, Any] = json.loads(bridge.recv(WAIT_S))
        if message.get("id") != goal_id:
            continue
        if message["op"] == "action_result":
            return message, told
        if message["op"] == "action_feedback":
            told.append(message["values"])


def test_five_thousand_points_are_followed(run: VirtualService, bridge: Socket) -> None:
    """One each 1 ms, on a curve that the arm is then seen on."""
    times_s = np.arange(1, 5001) * 0.001
    turns = 0.1 * (1.0 - np.cos(2.0 * np.pi * times_s / 5.0)) ** 2 / 4.0
    begun_s = run.clock.now_s()
    send(bridge, run, "long", following(times_s, turns))
    message, told = result(bridge, "long")
    assert message["values"] == {"error_code": 0, "error_string": ""}
    assert run.clock.now_s() - begun_s >= 5.0
    at_s = [
        each["desired"]["time_from_start"]["sec"] + 1e-9 * each["desired"]["time_from_start"]["nanosec"]
        for each in told
    ]
    desired = [each["desired"]["positions"][0] for each in told]
    np.testing.assert_allclose(
        desired, np.interp(at_s, np.append(0, times_s), np.append(0, turns)), atol=1e-5
    )
    assert np.abs([each["error"]["positions"] for each in told]).max() < 0.02


def test_a_newer_goal_preempts_across_clients(run: VirtualService, bridge: Socket) -> None:
    send(bridge, run, "old", following(np.array([8.0]), np.array([0.8])))
    run.until(lambda: abs(run.joints()[0]) > 0.01)
    with run.connect("/rosbridge") as other:
        send(other, run, "new", following(np.array([3.0]), np.array([0.0])))
        newer, _ = result(other, "new")
    older, _ = result(bridge, "old")
    assert (older["status"], newer["status"]) == (ABORTED, SUCCEEDED)
    assert "preempted by a newer goal" in older["values"]["error_string"]
    np.testing.assert_allclose(run.joints(), HOME, atol=2e-3)


def test_fjt_control_switches_the_action_off_and_to_a_servo_mode(run: VirtualService, bridge: Socket) -> None:
    def control(**fields: Any) -> None:
        message = {"data": json.dumps({"type": "fjt_control", **fields})}
        topic = f"/{run.name}/joint_cmd"
        bridge.send(json.dumps({"op": "publish", "topic": topic, "type": "std_msgs/String", "msg": message}))

    control(enable=False)
    send(bridge, run, "off", following(np.array([1.0]), np.array([0.1])))
    off, _ = result(bridge, "off")
    assert not off["result"]
    control(enable=True, fjt_mode=5, fjt_send_period=0.02)
    send(bridge, run, "servo", following(np.array([2.0]), np.array([0.1])))
    servo, told = result(bridge, "servo")
    assert servo["values"] == {"error_code": 0, "error_string": ""}
    assert len(told) > 5
    control(enable=True, fjt_mode=0)
    np.testing.assert_allclose(run.joints()[0], 0.1, atol=0.01)
