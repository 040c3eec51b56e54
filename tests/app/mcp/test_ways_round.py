"""Ways round the fence that are none: streams, rosbridge, vendor services, programs, with an agent's token.

Oracles: where the arm is, and the tables of roles, of which nothing that moves may be an agent's.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from mcp_agent import FAR, HOME, NEAR, Cell

from app.aubo import roles as vendor
from app.routes import ENDPOINTS
from cobot.access.roles import Role

LUA = "robot.move_joints({1.6, 0.1, 0, -1.6, 0, 1.5, 0})"
FJT = "control_msgs/action/FollowJointTrajectory"


@pytest.fixture
def still(cell: Cell) -> Any:
    """The arm is at home before and after."""
    cell.goes_to(HOME)
    yield
    cell.service.sleep(0.5)
    np.testing.assert_allclose(cell.joints(), HOME, atol=2e-3)


def test_what_an_agent_may_change_by_rest_moves_nothing() -> None:
    """Who adds to this list makes another door for agents."""
    changing = {name: each.role for name, each in ENDPOINTS.items() if not name.startswith("GET ")}
    given = {name for name, role in changing.items() if role <= Role.AGENT}
    plans = {
        f"POST /robot/plan/{what}"
        for what in ("named", "pose", "joints", "arc", "path", "sequence", "gripper")
    }
    stops = {"POST /stop", "POST /robot/gripper/stop"}
    others = stops | {
        "POST /robot/plans/{plan}/rehearse",
        "POST /robot/plans/{plan}/improve",
        "POST /{robot}/{Class}/{method}",
    }
    assert given == plans | others | {
        f"WS {path}" for path in ("/events", "/foxglove", "/robot/stream", "/rosbridge")
    }
    for name, patterns in vendor.ROLES.items():
        for role, methods in patterns:
            if role <= Role.AGENT:
                assert not {method[:4] for method in methods} & {"move", "serv", "set*", "sync", "load"}, name


@pytest.mark.parametrize(
    "asked", [{"type": "session"}, {"type": "jog", "joints": [0.1] * 7}, {"type": "control"}]
)
@pytest.mark.usefixtures("still")
def test_a_stream_opens_no_session_for_an_agent(cell: Cell, asked: dict[str, Any]) -> None:
    with cell.service.connect("/robot/stream", **cell.agent.headers) as socket:
        socket.send(json.dumps(asked))
        assert "has the role agent" in refusal(socket)


def refusal(socket: Any) -> str:
    """What it is told about its role; raises AssertionError if that is nothing."""
    for _ in range(20):
        message = socket.recv()
        if isinstance(message, str) and "role" in message:
            return message
    raise AssertionError("not refused")


PUBLISHED = {
    "op": "publish",
    "topic": "ROBOT/joint_cmd",
    "type": "sensor_msgs/JointState",
    "msg": {"position": FAR},
}
ROSBRIDGE: list[dict[str, Any]] = [
    {"op": "advertise", "topic": "ROBOT/joint_cmd", "type": "sensor_msgs/JointState"},
    PUBLISHED,
    {
        "op": "call_service",
        "service": "ROBOT/MotionControl/moveJoint",
        "args": {"q": FAR, "a": 1.0, "v": 1.0},
    },
    {"op": "call_service", "service": "ROBOT/MotionControl/servoJoint", "args": {"q": FAR}},
    {"op": "call_service", "service": "ROBOT/RuntimeMachine/runProgram", "args": {}},
    {"op": "send_action_goal", "action": "ROBOT/follow_joint_trajectory", "action_type": FJT, "args": {}},
    {"op": "fragment", "id": "1", "num": 0, "total": 1, "data": json.dumps(PUBLISHED)},
]


@pytest.mark.parametrize("asked", ROSBRIDGE, ids=lambda asked: asked["op"])
@pytest.mark.usefixtures("still")
def test_rosbridge_moves_nothing_for_an_agent(cell: Cell, asked: dict[str, Any]) -> None:
    with cell.service.connect("/rosbridge", **cell.agent.headers) as socket:
        socket.send(json.dumps(asked | {"id": "1"}).replace("ROBOT", f"/{cell.service.name}"))
        assert "has the role agent" in refusal(socket)


VENDOR: list[tuple[str, dict[str, Any]]] = [
    ("MotionControl/moveJoint", {"q": NEAR, "a": 1.0, "v": 1.0}),
    ("MotionControl/setServoModeSelect", {"mode": 1}),
    ("RuntimeMachine/loadProgram", {"program": "pick"}),
    ("RuntimeMachine/runProgram", {}),
    ("RobotManage/freedrive", {"enable": True}),
    ("RobotConfig/setTcpOffset", {"offset": [0.0] * 6}),
    ("ForceControl/fcEnable", {}),
    ("Serial/serialOpen", {"device": "/dev/ttyS0"}),
]


@pytest.mark.parametrize(("method", "arguments"), VENDOR)
@pytest.mark.usefixtures("still")
def test_no_vendor_service_moves_anything_for_an_agent(
    cell: Cell, method: str, arguments: dict[str, Any]
) -> None:
    answer = cell.service.post(f"/{cell.service.name}/{method}", json=arguments, headers=cell.agent.headers)
    assert answer.status_code == 403, answer.text
    assert "has the role agent" in answer.json()["detail"]


@pytest.mark.usefixtures("still")
def test_no_program_runs_for_an_agent(cell: Cell) -> None:
    """Nor does a token that an agent has seen make it a sequence."""
    script = {"files": {"file": ("pick.lua", LUA, "text/plain")}}
    answer = cell.service.post("/sequences/start", headers=cell.agent.headers, **script)
    assert answer.status_code == 403, answer.text
    assert "has the role agent" in answer.json()["detail"]
    pretending = cell.agent.headers | {"x-motion-token": "guessed", "x-control-token": "guessed"}
    moved = cell.service.post("/robot/move/joints", json={"joints": FAR}, headers=pretending)
    assert moved.status_code == 403, moved.text
