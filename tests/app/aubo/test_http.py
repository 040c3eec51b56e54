"""Vendor services over HTTP, on the simulated robot and on virtual time.

Oracle: pinocchio for where the TCP is and what gravity asks of the joints; the REST endpoints for what the
arm does; what the client of section 8 of the manual expects, call by call.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from flange_tools import loaded
from independent_models import second_robot
from scipy.spatial.transform import Rotation
from virtual_service import VirtualService

from app.api.documentation.swagger import TAGS
from cobot.codes import Code
from cobot.robot.tool import Tool

IDLE = -1
HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
SETTLED_RAD = 2e-3
LATENCY_S = 0.002
"""What a call takes: who polls sees the arm move."""
LOOK_EVERY_S = 0.02


class Robot:
    """The services of one robot: `robot("RobotConfig", "getDof")` is the result of a call that succeeds."""

    def __init__(self, service: VirtualService) -> None:
        self.name, self.http = service.name, service

    def post(self, robot_class: str, method: str, **fields: Any) -> httpx.Response:
        self.http.sleep(LATENCY_S)
        return self.http.post(f"/{self.name}/{robot_class}/{method}", json=fields)

    def answer(self, robot_class: str, method: str, **fields: Any) -> dict[str, Any]:
        response = self.post(robot_class, method, **fields)
        assert response.status_code == 200, response.text
        content: dict[str, Any] = response.json()
        assert set(content) == {"code", "message", "result"}
        return content

    def __call__(self, robot_class: str, method: str, **fields: Any) -> Any:
        content = self.answer(robot_class, method, **fields)
        assert content["code"] == 0, content
        assert content["message"] == ""
        return content["result"]

    def fails(self, code: Code, robot_class: str, method: str, **fields: Any) -> str:
        content = self.answer(robot_class, method, **fields)
        assert content["code"] == code, content
        text: str = content["message"]
        return text

    @property
    def joints(self) -> list[float]:
        values: list[float] = self("RobotState", "getJointPositions")
        return values

    def done(self) -> list[int]:
        """Wait as the manual's client does; the move numbers that were seen, without repetitions."""
        seen: list[int] = []

        def ended() -> bool:
            number = self("MotionControl", "getExecId")
            if number not in seen:
                seen.append(number)
            return bool(number == IDLE)

        self.http.until(ended)
        self.http.until(lambda: self("RobotState", "isSteady"))
        return seen[:-1]


@pytest.fixture
def robot(service: VirtualService) -> Iterator[Robot]:
    """At home, and as it was when it was started."""
    service.go_home()
    robot = Robot(service)
    yield robot
    robot("RobotConfig", "resetLimits")
    robot.http.post("/stop").raise_for_status()
    robot.http.post("/robot/tool", {"clear": True}).raise_for_status()
    robot("MotionControl", "setSpeedFraction", fraction=1.0)
    robot.http.post("/stop").raise_for_status()


def moved(joints: list[float], **changes: float) -> list[float]:
    """Other joint angles: j1=0.2 adds 0.2 to the first."""
    out = list(joints)
    for name, change in changes.items():
        out[int(name[1:]) - 1] += change
    return out


def tcp(joints: list[float]) -> np.ndarray:
    return second_robot().forward(np.array(joints))[0]


def test_the_client_of_the_manual_finds_what_it_needs(robot: Robot) -> None:
    dof = robot("RobotConfig", "getDof")
    start = robot.joints
    assert dof == len(start) == 7
    assert robot("MotionControl", "getExecId") == IDLE
    goal = moved(start, j1=0.3, j4=-0.2)
    assert robot("MotionControl", "moveJoint", q=goal, a=0.3, v=0.3, blend_radius=0.0, duration=0.0) == 0
    assert robot("MotionControl", "getExecId") != IDLE  # seen within its first poll, however short the move
    assert len(robot.done()) == 1
    assert max(abs(a - b) for a, b in zip(robot.joints, goal, strict=True)) < 1e-3  # its tolerance


def test_a_move_to_where_the_arm_is_is_seen_and_ends(robot: Robot) -> None:
    goal = moved(HOME, j2=0.1)
    assert robot("MotionControl", "moveJoint", q=goal) == 0
    (first,) = robot.done()
    assert robot("MotionControl", "moveJoint", q=goal) == 0
    assert robot("MotionControl", "getExecId") == first + 1
    assert robot.done() == [first + 1]


def test_inverse_kinematics_gives_a_start_that_move_joint_reaches(robot: Robot) -> None:
    pose = [0.45, 0.1, 0.5, 0.0, 3.1, 0.2]
    result = robot("RobotAlgorithm", "inverseKinematics", qnear=robot.joints, pose=pose)
    joints, code = json.loads(result)
    assert code == 0
    robot("MotionControl", "moveJoint", q=joints)
    robot.done()
    place, turn = second_robot().forward(np.array(robot.joints))
    np.testing.assert_allclose(place, pose[:3], atol=1e-3)
    assert (Rotation.from_euler("xyz", pose[3:]).inv() * Rotation.from_matrix(turn)).magnitude() < 5e-3
    reported = robot("RobotState", "getTcpPose")
    np.testing.assert_allclose(reported[:3], place, atol=1e-3)


@pytest.mark.parametrize(
    ("fields", "code", "words"),
    [
        ({"q": [0.0] * 6}, Code.INPUT, "q must have 7 angles, got 6"),
        ({"q": [9.0, *HOME[1:]]}, Code.LIMIT, "joint1"),
        ({"q": HOME, "v": -0.1}, Code.INPUT, "v must be above 0"),
        ({"q": HOME, "a": -0.1}, Code.INPUT, "a must be above 0"),
        ({"q": HOME, "duration": -1.0}, Code.INPUT, "duration must not be negative"),
        ({"q": HOME, "blend_radius": -0.1}, Code.INPUT, "blend_radius must not be negative"),
        (
            {"q": [0.0, 0.4, 0.0, -1.0, 0.0, 1.0, 0.0], "duration": 0.01},
            Code.INPUT,
            "the shortest possible duration is",
        ),
        ({"q": [0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0]}, Code.COLLISION, "floor"),
    ],
)
def test_a_move_that_cannot_be_is_refused_with_its_reason_and_nothing_moves(
    robot: Robot, fields: dict[str, Any], code: Code, words: str
) -> None:
    before = robot.joints
    content = robot.answer("MotionControl", "moveJoint", **fields)
    assert (content["code"], content["result"]) == (code, code)  # clients look at either
    assert words in content["message"]
    assert robot("MotionControl", "getExecId") == IDLE
    assert robot("RobotState", "isSteady")
    assert max(abs(a - b) for a, b in zip(robot.joints, before, strict=True)) < 1e-4


def test_requests_that_make_no_sense_have_the_status_that_says_so(robot: Robot) -> None:
    path = f"/{robot.name}/MotionControl/moveJoint"
    for body, words in (
        ({"qq": HOME}, "unknown key 'qq' (did you mean 'q'?)"),
        ({}, "q: is missing"),
        ({"q": "home"}, "q: must be a list"),
        ({"q": [True] * 7}, "q[0]: must be a number"),
        ([HOME], "must be an object"),
    ):
        response = robot.http.post(path, json=body)
        assert (response.status_code, response.json()["code"]) == (422, "input"), response.text
        assert words in response.json()["detail"]
    twice = robot.http.post(path, content='{"v": 1, "v": 2}', headers={"Content-Type": "application/json"})
    assert "occurs twice" in twice.json()["detail"]
    assert robot.http.post(path, content="{}", headers={"Content-Type": "text/plain"}).status_code == 415
    assert robot.http.post(f"/{robot.name}/RobotConfig/getDof").json()["result"] == 7  # no body, no fields
    for wrong, words in (
        ("/nobody/RobotConfig/getDof", "there is no robot 'nobody'; valid names: "),
        (f"/{robot.name}/RobotConfig/getDoff", "did you mean 'getDof'?"),
        (f"/{robot.name}/RobotConfigs/getDof", "there is no /"),
    ):
        response = robot.http.post(wrong)
        assert (response.status_code, response.json()["code"]) == (404, "not_found")
        assert words in response.json()["detail"]
    assert robot.http.get(f"/{robot.name}/RobotConfig/getDof").status_code == 405


def test_a_line_and_an_arc_end_where_they_shall(robot: Robot) -> None:
    start = robot("RobotState", "getTcpPose")
    goal = [start[0], start[1] + 0.15, start[2], *start[3:]]
    robot("MotionControl", "moveLine", pose=goal)
    robot.done()
    np.testing.assert_allclose(tcp(robot.joints), goal[:3], atol=1e-3)
    via = [start[0], start[1] + 0.075, start[2] - 0.075, *start[3:]]
    robot("MotionControl", "moveCircle", via_pose=via, end_pose=start)
    robot.done()
    np.testing.assert_allclose(tcp(robot.joints), start[:3], atol=1e-3)


def test_a_line_that_leads_nowhere_is_refused_and_the_queue_goes_on(robot: Robot) -> None:
    start = robot("RobotState", "getTcpPose")
    robot("MotionControl", "moveJoint", q=moved(HOME, j1=0.2))
    far = [3.0, *start[1:]]
    assert "lin:" in robot.fails(Code.UNREACHABLE, "MotionControl", "moveLine", pose=far)
    robot("MotionControl", "moveJoint", q=moved(HOME, j1=0.1))
    assert len(robot.done()) == 2
    assert abs(robot.joints[0] - 0.1) < SETTLED_RAD


def test_moves_follow_each_other_in_their_order(robot: Robot) -> None:
    for change in (0.2, -0.1, 0.1):
        robot("MotionControl", "moveJoint", q=moved(HOME, j1=change), v=1.0, a=4.0)
    assert robot("MotionControl", "getQueueSize") == 3
    assert not robot("RobotState", "isSteady")
    numbers = robot.done()
    assert numbers == list(range(numbers[0], numbers[0] + 3))
    assert robot("MotionControl", "getQueueSize") == 0
    assert abs(robot.joints[0] - 0.1) < SETTLED_RAD


def test_blended_moves_do_not_stop_in_between(robot: Robot) -> None:
    robot("MotionControl", "moveJoint", q=HOME)
    robot.done()
    corner, end = moved(HOME, j1=0.4), moved(HOME, j1=0.4, j4=0.4)
    robot("MotionControl", "moveJoint", q=corner, v=0.5, a=1.0, blend_radius=0.05)
    robot("MotionControl", "moveJoint", q=end, v=0.5, a=1.0)
    speeds, nearest = [], np.inf
    number = robot("MotionControl", "getExecId")
    while (now := robot("MotionControl", "getExecId")) != IDLE:
        robot.http.sleep(LOOK_EVERY_S)
        joints = robot("RobotState", "getTargetJointPositions")
        nearest = min(nearest, float(np.abs(np.subtract(joints, corner)).max()))
        if now == number + 1 and abs(joints[3] - end[3]) > 0.2 and abs(joints[3] - HOME[3]) > 0.01:
            speeds.append(np.abs(robot("RobotState", "getTargetJointSpeeds")).max())
    assert nearest > 1e-3  # the corner itself is left out
    assert speeds
    assert min(speeds) > 0.05
    assert max(abs(a - b) for a, b in zip(robot.joints, end, strict=True)) < SETTLED_RAD


def test_a_duration_decides_how_long_a_move_takes(robot: Robot) -> None:
    robot("MotionControl", "moveJoint", q=moved(robot.joints, j1=0.2), duration=1.5)
    number = robot("MotionControl", "getExecId")
    assert robot("MotionControl", "getDuration", exec_id=number) == pytest.approx(1.5)
    assert "no move 9999" in robot.fails(Code.NOT_FOUND, "MotionControl", "getDuration", exec_id=9999)
    robot.done()


def test_a_stop_empties_the_queue_and_says_so(robot: Robot) -> None:
    robot("MotionControl", "moveJoint", q=moved(HOME, j1=1.0), v=0.3)
    robot("MotionControl", "moveJoint", q=HOME, v=0.3)
    robot.http.until(lambda: abs(robot.joints[0]) > 0.05)
    stopped = robot.http.post("/stop").json()
    assert stopped["success"]
    assert "the motion queue" in stopped["message"]
    assert robot("MotionControl", "getExecId") == IDLE
    assert robot("MotionControl", "getQueueSize") == 0
    assert "stopped by POST /stop" in robot("MotionControl", "getLastError")
    assert robot("RobotState", "isSteady")
    assert 0.05 < robot.joints[0] < 0.95
    robot("MotionControl", "moveJoint", q=HOME)
    robot.done()
    assert robot("MotionControl", "getLastError") == ""


def test_stop_move_waits_on_the_path_until_start_move(robot: Robot) -> None:
    goal = moved(HOME, j1=0.8)
    robot("MotionControl", "moveJoint", q=goal, v=0.4)
    robot.http.until(lambda: abs(robot.joints[0] - HOME[0]) > 0.05)
    robot("MotionControl", "stopMove")
    before = robot.joints
    speeds = [np.abs(robot("RobotState", "getTargetJointSpeeds")).max() for _ in range(20)]
    assert max(speeds) < 1e-9
    assert robot("MotionControl", "getExecId") != IDLE
    assert not robot("RobotState", "isSteady")
    assert max(abs(a - b) for a, b in zip(robot.joints, before, strict=True)) < 1e-3
    robot("MotionControl", "startMove")
    robot.done()
    assert max(abs(a - b) for a, b in zip(robot.joints, goal, strict=True)) < SETTLED_RAD


@pytest.mark.parametrize("method", ["clearPath", "stopJoint", "stopLine"])
def test_what_ends_the_moves_leaves_the_arm_at_rest_and_free(robot: Robot, method: str) -> None:
    robot("MotionControl", "moveJoint", q=moved(HOME, j1=-0.8), v=0.4)
    robot("MotionControl", "moveJoint", q=HOME, v=0.4)
    if method == "clearPath":
        robot("MotionControl", "stopMove")
    robot("MotionControl", method)
    assert robot("MotionControl", "getExecId") == IDLE
    assert robot("RobotState", "isSteady")
    assert method in robot("MotionControl", "getLastError")
    robot("MotionControl", "moveJoint", q=HOME)  # not waiting for startMove
    robot.done()


def test_a_gentler_stop_than_the_limits_is_not_supported(robot: Robot) -> None:
    assert "at least 10 rad/s²" in robot.fails(Code.NOT_SUPPORTED, "MotionControl", "stopJoint", acc=2.0)
    robot.fails(Code.NOT_SUPPORTED, "MotionControl", "stopLine", acc=1.0)
    assert robot("MotionControl", "stopJoint", acc=31.0) == 0


def test_the_speed_fraction_slows_down_what_runs(robot: Robot) -> None:
    robot("MotionControl", "setSpeedFraction", fraction=0.5)
    assert robot("MotionControl", "getSpeedFraction") == 0.5
    goal = moved(robot.joints, j1=0.4)
    robot("MotionControl", "moveJoint", q=goal, v=0.6, a=3.0)
    speeds = []
    while robot("MotionControl", "getExecId") != IDLE:
        robot.http.sleep(LOOK_EVERY_S)
        speeds.append(np.abs(robot("RobotState", "getTargetJointSpeeds")).max())
    assert 0.25 < max(speeds) <= 0.3 * (1 + 1e-6)
    for fraction in (0.005, 1.1, -0.5):
        robot.fails(Code.LIMIT, "MotionControl", "setSpeedFraction", fraction=fraction)


def test_one_owner_at_a_time_also_here(robot: Robot) -> None:
    robot("MotionControl", "moveJoint", q=moved(HOME, j1=0.5), v=0.3)
    refused = robot.http.post("/robot/move/named", json={"name": "home"})
    assert refused.status_code == 409
    assert "the motion queue" in refused.json()["detail"]
    robot.done()
    robot("MotionControl", "setServoModeSelect", qmode=1, watchdog_timeout=5.0)
    assert "a servo session" in robot.fails(Code.CONFLICT, "MotionControl", "moveJoint", q=HOME)
    robot("MotionControl", "setServoModeSelect", qmode=0)
    robot("MotionControl", "moveJoint", q=HOME)
    robot.done()


@pytest.mark.parametrize("cartesian", [False, True])
def test_servo_points_move_the_arm(robot: Robot, cartesian: bool) -> None:
    robot("MotionControl", "moveJoint", q=HOME)
    robot.done()
    goal = moved(HOME, j1=0.1, j4=0.05)
    assert not robot("MotionControl", "isServoModeEnabled")
    robot.fails(Code.CONFLICT, "MotionControl", "servoJoint", q=goal)
    robot("MotionControl", "setServoModeSelect", qmode=1, watchdog_timeout=5.0)
    assert robot("MotionControl", "isServoModeEnabled")
    assert robot("MotionControl", "getServoMode") == robot("MotionControl", "getServoModeSelect") == 1
    if cartesian:
        pose, _ = json.loads(robot("RobotAlgorithm", "forwardKinematics", q=goal))
        robot("MotionControl", "servoCartesian", pose=pose)
    else:
        robot("MotionControl", "servoJoint", q=goal, t=0.02)
    place = tcp(goal)
    robot.http.until(lambda: np.linalg.norm(tcp(robot.joints) - place) < 1e-3)
    assert json.loads(robot("MotionControl", "getServoFeedback"))["points_accepted"] == 1
    robot.fails(Code.INPUT, "MotionControl", "servoJoint", q=goal[:5])
    robot.fails(Code.UNREACHABLE, "MotionControl", "servoCartesian", pose=[3.0, 0, 0, 0, 0, 0])
    robot("MotionControl", "setServoMode", enable=False)
    assert not robot("MotionControl", "isServoModeEnabled")
    assert robot("MotionControl", "getServoMode") == 0
    robot.fails(Code.INPUT, "MotionControl", "setServoModeSelect", qmode=9)


def test_the_state_is_what_rest_and_another_library_say(robot: Robot) -> None:
    states = robot.http.get("/robot/joint_states").json()
    joints = np.array(robot.joints)
    np.testing.assert_allclose(joints, states["position"], atol=1e-5)
    np.testing.assert_allclose(robot("RobotState", "getJointSpeeds"), 0.0, atol=1e-3)
    np.testing.assert_allclose(robot("RobotState", "getTargetJointPositions"), joints, atol=SETTLED_RAD)
    gravity = second_robot().gravity(joints)
    for method in ("getJointTorqueSensors", "getTargetJointTorques"):
        np.testing.assert_allclose(robot("RobotState", method), gravity, atol=0.2)
    np.testing.assert_allclose(robot("RobotState", "getJointExternalTorques"), 0.0, atol=0.2)
    np.testing.assert_allclose(robot("RobotState", "getTcpForce"), 0.0, atol=1.0)
    for method in ("TargetJointSpeeds", "TargetJointAccelerations", "TcpSpeed"):
        np.testing.assert_allclose(robot("RobotState", f"get{method}"), 0.0, atol=1e-3)
    assert len(robot("RobotState", "getTcpForceSensors")) == 6
    for method in ("getTcpPose", "getTargetTcpPose", "getToolPose"):  # this arm's TCP is its flange
        np.testing.assert_allclose(robot("RobotState", method)[:3], tcp(list(joints)), atol=1e-4)
    assert robot("RobotState", "getRobotModeType") == "Idle"
    assert robot("RobotState", "getSafetyModeType") == "Normal"
    assert robot("RobotState", "isPowerOn") is True
    assert robot("RobotState", "isCollisionOccurred") is False
    assert robot("RobotState", "isWithinSafetyLimits") is True
    assert isinstance(robot("RobotState", "getModeReason"), str)


def test_poses_are_those_of_the_tool(robot: Robot) -> None:
    offset = [0.0, 0.03, 0.1, 0.0, 0.2, 0.0]
    robot("RobotConfig", "setTcpOffset", offset=offset)
    place, turn = second_robot().forward(np.array(robot.joints))
    tip = robot("RobotState", "getTcpPose")
    np.testing.assert_allclose(tip[:3], place + turn @ offset[:3], atol=1e-4)
    goal = [tip[0], tip[1] + 0.1, tip[2], tip[3] + 0.3, *tip[4:]]
    robot("MotionControl", "moveLine", pose=goal)
    robot.done()
    place, turn = second_robot().forward(np.array(robot.joints))
    np.testing.assert_allclose(place + turn @ offset[:3], goal[:3], atol=1e-3)
    np.testing.assert_allclose(robot("RobotState", "getToolPose")[:3], place, atol=1e-3)
    reached = Rotation.from_matrix(turn) * Rotation.from_euler("xyz", offset[3:])
    assert (reached.inv() * Rotation.from_euler("xyz", goal[3:])).magnitude() < 5e-3


def test_vendor_payload_is_the_tool_and_really_weighs(robot: Robot) -> None:
    before, joints = np.array(robot("RobotState", "getJointTorqueSensors")), np.array(robot.joints)
    point = {"cog": [0.02, -0.05, 0.12], "aom": [0.0] * 3, "inertia": [0.0] * 6}
    robot("RobotConfig", "setPayload", m=10.0, **point)
    assert robot.http.get("/robot/tool").json()["mass"] == 10.0
    robot.http.sleep(0.3)
    load = Tool(mass=10.0, centre=(0.02, -0.05, 0.12))
    expected = loaded(load).gravity(joints) - second_robot().gravity(joints)
    np.testing.assert_allclose(
        np.array(robot("RobotState", "getJointTorqueSensors")) - before, expected, atol=0.1
    )
    assert np.abs(expected).max() > 10.0
    robot("MotionControl", "moveJoint", q=moved(HOME, j1=0.3), v=0.2)
    robot.fails(Code.CONFLICT, "RobotConfig", "setPayload", m=5.0, **point)
    robot("RobotConfig", "setPayload", m=10.0, **point)  # as it is: no change
    robot.done()
    assert robot.http.get("/robot/tool").json()["mass"] == 10.0


def test_tightened_limits_are_kept_by_moves(robot: Robot) -> None:
    robot("RobotConfig", "setJointMaxSpeeds", speeds=[0.2] * 7)
    robot("RobotConfig", "setJointMaxPositions", positions=[0.5] * 5 + [1.6, 0.5])
    robot.fails(Code.LIMIT, "MotionControl", "moveJoint", q=moved(HOME, j1=0.6))
    robot("MotionControl", "moveJoint", q=moved(HOME, j1=0.3), v=1.0)
    speeds = []
    while robot("MotionControl", "getExecId") != IDLE:
        robot.http.sleep(LOOK_EVERY_S)
        speeds.append(np.abs(robot("RobotState", "getTargetJointSpeeds")).max())
    assert max(speeds) <= 0.2 * (1 + 1e-6)


def test_swagger_shows_each_service_in_its_class(robot: Robot) -> None:
    schema = robot.http.get("/openapi/vendor.json").json()
    move = schema["paths"]["/{robot}/MotionControl/moveJoint"]["post"]
    assert move["tags"] == ["MotionControl"]
    body = move["requestBody"]["content"]["application/json"]["schema"]
    assert body["required"] == ["q"]
    assert body["additionalProperties"] is False
    assert body["properties"]["v"]["default"] == 0.5
    assert "rad/s" in body["properties"]["v"]["description"]
    assert move["parameters"][0] == {"$ref": "#/components/parameters/robot"}
    assert robot.name in schema["components"]["parameters"]["robot"]["schema"]["enum"]
    assert (
        robot.post("MotionControl", "moveJoint", **body["examples"][0]).json()["code"] == 0
    )  # works unedited
    robot.done()
    plain = robot.http.get("/openapi.json").json()["tags"]
    assert [tag["name"] for tag in plain] == [tag["name"] for tag in TAGS]
    described = {tag["name"]: tag["description"] for tag in schema["tags"]}
    assert {path.split("/")[2] for path in schema["paths"] if path.startswith("/{robot}/")} == set(described)


def test_a_body_too_large_is_refused(robot: Robot) -> None:
    response = robot.http.post(f"/{robot.name}/Math/poseInverse", json={"pose": [0.0] * 1_000_000})
    assert response.status_code == 413
    large = robot.post("Math", "poseInverse", pose=[0.0] * 60_000)  # decoded beside the event loop
    assert large.json()["code"] == Code.INPUT
    assert robot.http.post(f"/{robot.name}/Math/poseInverse", json={"pose": [0] * 70_000}).status_code == 422
