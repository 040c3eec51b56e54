"""ROS messages as dicts and as CDR, and what a robot tells in them.

Oracles: bytes written by hand by the rules of CDR (OMG DDS-XTypes 1.3, 7.4.3; alignment within the payload);
rosbags' own serialisation of its own classes; the type hash that ROS 2 prints (`ros2 topic info -v`, REP
2016); pinocchio and MuJoCo, which read the URDF; scipy for rotations.
"""

from __future__ import annotations

import base64
import math
import struct
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from random_json import Garbage
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from cobot.errors import InputError
from cobot.ipc.state_fields import state_dtype
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.ros.messages import Messages, ros_time
from cobot.ros.robot_messages import JOINT_STATES, POSE, STRING, TRANSFORMS, WRENCH, RobotMessages
from cobot.ros.urdf import urdf
from cobot.types import JointLimits

SERVICE = "aubo_interfaces/srv/Blend"
ACTION = "aubo_interfaces/action/ServoMode"
DEFINITIONS = {
    SERVICE: "float64[] q  # rad\nfloat64 a 0.5\nstring<=5 name\n---\nint32 code\nint32 result\n",
    ACTION: "int32 mode\nPart part\n---\nint32 code\n---\nuint8[4] octets\nbool[] flags\nint8[<=2] few\n",
    "aubo_interfaces/msg/Part": "int8 A=1\nstring B='x'\nint8 class\nfloat32 x\n",
}


@pytest.fixture(scope="module")
def messages() -> Messages:
    return Messages(DEFINITIONS)


def test_a_string_is_length_text_and_nul(messages: Messages) -> None:
    content = messages.to_cdr("std_msgs/String".replace("/", "/msg/"), {"data": "hé"})
    assert content == b"\0\1\0\0" + struct.pack("<I", 4) + "hé".encode() + b"\0"
    big_endian = b"\0\0\0\0" + struct.pack(">I", 4) + "hé".encode() + b"\0"
    assert messages.from_cdr("std_msgs/msg/String", big_endian) == {"data": "hé"}


@pytest.mark.parametrize("wall_s", [0, 1_800_000_000, 2**31, 2**33])
def test_every_time_of_the_wall_can_be_told(messages: Messages, wall_s: int) -> None:
    """A clock set beyond 2038 ended all topics, with a traceback for each message. Oracle: int32."""
    content = {"header": {"stamp": ros_time(wall_s * 10**9 + 5)}}
    checked = messages.checked("sensor_msgs/msg/JointState", content)
    assert checked["header"]["stamp"]["sec"] == min(wall_s, 2**31 - 1)


def test_numbers_are_aligned_to_their_size(messages: Messages) -> None:
    content = messages.to_cdr(f"{SERVICE}_Request", {"q": [1.0, -2.5], "a": 0.25, "name": "ab"})
    by_hand = struct.pack("<I4xdddI", 2, 1.0, -2.5, 0.25, 3) + b"ab\0"
    assert content == b"\0\1\0\0" + by_hand


def test_an_empty_request_is_one_octet(messages: Messages) -> None:
    assert messages.to_cdr("std_srvs/srv/Trigger_Request", {}) == b"\0\1\0\0\0"
    assert messages.from_cdr("std_srvs/srv/Trigger_Request", b"\0\1\0\0\0") == {}
    assert messages.default("std_msgs/msg/Empty") == {}


def test_an_action_becomes_the_messages_that_ros_makes_of_it(messages: Messages) -> None:
    goal_id = bytes(range(16))
    sent = {"goal_id": {"uuid": list(goal_id)}, "goal": {"mode": 5, "part": {"class": -1}}}
    content = messages.to_cdr(f"{ACTION}_SendGoal_Request", sent)
    assert content == b"\0\1\0\0" + goal_id + struct.pack("<ib3xf", 5, -1, 0.0)
    taken = messages.from_cdr(f"{ACTION}_SendGoal_Request", content)
    assert messages.octets(taken["goal_id"]["uuid"]) == goal_id
    assert messages.default(f"{ACTION}_SendGoal_Response").keys() == {"accepted", "stamp"}
    assert messages.default(f"{ACTION}_GetResult_Request").keys() == {"goal_id"}
    assert messages.default(f"{ACTION}_GetResult_Response").keys() == {"status", "result"}
    assert messages.default(f"{ACTION}_FeedbackMessage") == {
        "goal_id": {"uuid": base64.b64encode(bytes(16)).decode()},
        "feedback": {"octets": "AAAAAA==", "flags": [], "few": []},
    }


def test_follow_joint_trajectory_is_that_of_humble(messages: Messages) -> None:
    name = "control_msgs/action/FollowJointTrajectory"
    assert list(messages.default(f"{name}_Goal")) == [
        *("trajectory", "multi_dof_trajectory", "path_tolerance", "component_path_tolerance"),
        *("goal_tolerance", "component_goal_tolerance", "goal_time_tolerance"),
    ]
    assert list(messages.default(f"{name}_Feedback")) == [
        *("header", "joint_names", "desired", "actual", "error"),
        *("multi_dof_joint_names", "multi_dof_desired", "multi_dof_actual", "multi_dof_error"),
    ]
    codes = {constant: value for constant, _, value in messages.constants(f"{name}_Result")}
    assert codes == {
        "SUCCESSFUL": 0,
        "INVALID_GOAL": -1,
        "INVALID_JOINTS": -2,
        "OLD_HEADER_TIMESTAMP": -3,
        "PATH_TOLERANCE_VIOLATED": -4,
        "GOAL_TOLERANCE_VIOLATED": -5,
    }


def test_type_hashes_are_those_of_ros(messages: Messages) -> None:
    known = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert messages.type_hash("std_msgs/msg/String") == known


def test_what_is_missing_has_the_default_of_ros(messages: Messages) -> None:
    assert messages.checked(f"{SERVICE}_Request", {}) == {"q": [], "a": 0.5, "name": ""}
    pose = messages.default("geometry_msgs/msg/Pose")
    assert pose["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert messages.checked("geometry_msgs/msg/Pose", {"orientation": {"z": 1}})["orientation"]["w"] == 1.0


def test_defaults_are_nobody_elses(messages: Messages) -> None:
    messages.default("geometry_msgs/msg/PoseStamped")["pose"]["position"]["x"] = 7.0
    assert messages.default("geometry_msgs/msg/PoseStamped")["pose"]["position"]["x"] == 0.0


TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"


@pytest.mark.parametrize(
    ("name", "written", "meant"),
    [
        ("sensor_msgs/msg/JointState", {"position": 0.5}, {"position": [0.5]}),
        ("sensor_msgs/msg/JointState", {"name": "joint1"}, {"name": ["joint1"]}),
        (TRAJECTORY, {"points": {"positions": 1}}, {"points": [{"positions": [1.0]}]}),
        (TRAJECTORY, {"header": [], "points": []}, {}),
        ("sensor_msgs/msg/JointState", {"header": {"frame_id": []}}, {}),
        ("std_msgs/msg/Bool", {"data": []}, {"data": False}),
        ("std_msgs/msg/String", [], {}),
    ],
)
def test_lists_of_one_without_brackets_and_an_empty_list_for_nothing_are_read(
    messages: Messages, name: str, written: Any, meant: dict[str, Any]
) -> None:
    """As MATLAB writes them. Oracle: the same message with all its brackets."""
    assert messages.checked(name, written) == messages.checked(name, meant)


@pytest.mark.parametrize(
    ("name", "wrong", "sentence"),
    [
        (
            "sensor_msgs/msg/JointState",
            {"position": [0, 0.5, 1, "x"]},
            r"position\[3\]: must be a number, got 'x'",
        ),
        ("sensor_msgs/msg/JointState", {"position": "1.0"}, "position: must be a list, got '1.0'"),
        ("sensor_msgs/msg/JointState", {"position": None}, "position: must be a list, got null"),
        ("sensor_msgs/msg/JointState", {"position": True}, "position: must be a list, got true"),
        ("sensor_msgs/msg/JointState", {"name": 1.0}, "name: must be a list, got 1.0"),
        (
            "sensor_msgs/msg/JointState",
            {"header": {"stamp": {"sec": 2**31}}},
            "header.stamp.sec: int32 must be from",
        ),
        (
            "sensor_msgs/msg/JointState",
            {"positon": []},
            r"unknown key 'positon' \(did you mean 'position'\?\)",
        ),
        ("sensor_msgs/msg/JointState", {"header": [1]}, r"header: must be an object, got \[1\]"),
        ("sensor_msgs/msg/JointState", [1], r"JointState: must be an object"),
        ("std_msgs/msg/String", {"data": 3}, "data: must be a string, got 3"),
        ("std_msgs/msg/String", {"data": "\ud800"}, "data: is not valid Unicode"),
        ("std_msgs/msg/Bool", {"data": 1}, "data: must be true or false, got 1"),
        ("std_msgs/msg/UInt8", {"data": -1}, "data: uint8 must be from 0 to 255, got -1"),
        ("std_msgs/msg/UInt8", {"data": 1.5}, "data: must be an integer, got 1.5"),
        ("std_msgs/msg/Int8", {"data": True}, "data: must be an integer, got true"),
        ("std_msgs/msg/Int32", {"data": None}, "data: must be an integer, got null"),
        ("std_msgs/msg/Float64", {"data": True}, "data: must be a number, got true"),
        ("std_msgs/msg/Float64", {"data": 10**400}, "data: must be a number, got 1000"),
        ("std_msgs/msg/Float32", {"data": 1e39}, "data: float32 must be up to 3.40"),
        (f"{SERVICE}_Request", {"name": "äöü"}, "name: has 6 bytes, allowed: 5"),
        (f"{ACTION}_Feedback", {"octets": "AAAA"}, "octets: must have 4 items, got 3"),
        (f"{ACTION}_Feedback", {"octets": "A!"}, "octets: must be base64"),
        (f"{ACTION}_Feedback", {"octets": [1, 2, 3, 256]}, r"octets\[3\]: uint8 must be from 0 to 255"),
        (f"{ACTION}_Feedback", {"octets": None}, "octets: must be base64"),
        (f"{ACTION}_Feedback", {"few": [1, 2, 3]}, "few: must have no more than 2 items, got 3"),
        (f"{ACTION}_Goal", {"part": {"x": {}}}, "part.x: must be a number, got {}"),
    ],
)
def test_an_error_names_place_value_and_limit(
    messages: Messages, name: str, wrong: Any, sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        messages.checked(name, wrong)
    with pytest.raises(InputError, match=sentence):
        messages.to_cdr(name, wrong)


def test_an_unknown_field_is_refused_with_the_valid_ones(messages: Messages) -> None:
    with pytest.raises(InputError, match="valid keys: header, name, position, velocity, effort"):
        messages.checked("sensor_msgs/msg/JointState", {"q": []})


def test_numbers_may_be_written_as_other_languages_do(messages: Messages) -> None:
    assert messages.checked("std_msgs/msg/Int32", {"data": 3.0}) == {"data": 3}
    assert messages.checked("std_msgs/msg/Float64", {"data": 3}) == {"data": 3.0}
    assert math.isnan(messages.checked("std_msgs/msg/Float64", {"data": None})["data"])
    header = messages.checked("std_msgs/msg/Header", {"stamp": {"secs": 3, "nsecs": 4}})
    assert header["stamp"] == {"sec": 3, "nanosec": 4}


def test_infinity_and_nan_survive_cdr(messages: Messages) -> None:
    sent = {"data": [math.inf, -math.inf, math.nan]}
    taken = messages.from_cdr(
        "std_msgs/msg/Float64MultiArray", messages.to_cdr("std_msgs/msg/Float64MultiArray", sent)
    )
    assert taken["data"][:2] == sent["data"][:2]
    assert math.isnan(taken["data"][2])


@pytest.mark.parametrize(
    ("definitions", "sentence"),
    [
        ({"x/srv/Y": "int32 a\n"}, "has 2 parts, separated by lines of ---, got 1"),
        ({"x/action/Y": "---\n"}, "has 3 parts"),
        ({"x/msg/Y": "integer a\n"}, "there is no type 'x/msg/integer' here"),
        ({"x/msg/Y": "int32 = a b c\n"}, "is not a valid definition"),
        ({"x/Y": ""}, "is not a type such as"),
        ({"std_msgs/msg/String": "int32 data\n"}, "already present with different definition"),
        ({"x/msg/Y": "int32 a 'x'\n"}, "must be an integer"),
    ],
)
def test_a_wrong_definition_is_refused(definitions: dict[str, str], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Messages(definitions).default(next(iter(definitions)))


def test_an_unknown_type_is_refused(messages: Messages) -> None:
    for call in (messages.default, messages.fields, messages.type_hash):
        with pytest.raises(InputError, match="there is no type 'x/msg/Y' here"):
            call("x/msg/Y")
    with pytest.raises(InputError, match="no type 'std_msgs/srv/String'"):
        messages.resolved("std_msgs/String", "srv")
    assert messages.resolved("std_msgs/String", "msg") == "std_msgs/msg/String"
    assert messages.resolved("aubo_interfaces/ServoMode", "action") == ACTION


def test_each_type_survives_the_way_through_cdr(messages: Messages) -> None:
    for name in messages:
        default = messages.default(name)
        assert messages.checked(name, default) == default, name
        assert messages.from_cdr(name, messages.to_cdr(name, default)) == default, name


def test_cdr_is_that_of_rosbags_own_classes(messages: Messages) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](7, 8), "base")
    arrays = [np.array(values, np.float64) for values in ([1.0, 2.0], [], [3.0])]
    native = types["sensor_msgs/msg/JointState"](header, ["a", "b"], *arrays)
    sent = {
        "header": {"stamp": {"sec": 7, "nanosec": 8}, "frame_id": "base"},
        "name": ["a", "b"],
        "position": [1.0, 2.0],
        "velocity": [],
        "effort": [3.0],
    }
    content = bytes(store.serialize_cdr(native, "sensor_msgs/msg/JointState", little_endian=True))
    assert messages.to_cdr("sensor_msgs/msg/JointState", sent) == content
    assert messages.from_cdr("sensor_msgs/msg/JointState", content) == sent


FLOATS = st.floats(allow_nan=False)
JOINT_STATE = st.fixed_dictionaries(
    {},
    optional={
        "header": st.fixed_dictionaries(
            {"stamp": st.fixed_dictionaries({"sec": st.integers(-(2**31), 2**31 - 1)}), "frame_id": st.text()}
        ),
        "name": st.lists(st.text()),
        "position": st.lists(FLOATS | st.integers(-(2**53), 2**53)),
        "velocity": st.lists(FLOATS),
    },
)


@given(JOINT_STATE)
@hypothesis_settings(max_examples=200)
def test_any_joint_state_survives_the_way_through_cdr(sent: dict[str, Any]) -> None:
    content = MESSAGES.to_cdr("sensor_msgs/msg/JointState", sent)
    taken = MESSAGES.from_cdr("sensor_msgs/msg/JointState", content)
    assert taken == MESSAGES.checked("sensor_msgs/msg/JointState", sent)
    for name, value in sent.items():
        if name != "header":
            assert taken[name] == value
    assert MESSAGES.to_cdr("sensor_msgs/msg/JointState", taken) == content


@given(st.binary(max_size=200), st.sampled_from(["sensor_msgs/msg/JointState", f"{ACTION}_SendGoal_Request"]))
@hypothesis_settings(max_examples=500)
def test_no_bytes_do_more_than_be_refused(content: bytes, name: str) -> None:
    for bytes_ in (content, b"\0\1\0\0" + content):
        try:
            taken = MESSAGES.from_cdr(name, bytes_)
        except InputError as exc:
            assert str(exc).startswith(name)  # noqa: PT017  some are well
        else:
            assert taken.keys() == MESSAGES.default(name).keys()


@pytest.mark.parametrize("seed", range(5))
def test_no_json_does_more_than_be_refused(seed: int) -> None:
    garbage = Garbage(seed)
    for _ in range(1000):
        content = garbage.value()
        for wrong in (content, {"header": content}, {"position": content}, {"name": [content]}):
            try:
                MESSAGES.to_cdr("sensor_msgs/msg/JointState", wrong)
            except InputError as exc:
                assert str(exc).startswith("sensor_msgs/msg/JointState: ")  # noqa: PT017  some are well


MESSAGES = Messages(DEFINITIONS)


@pytest.fixture
def made(robot: RobotDescription) -> RobotMessages:
    return RobotMessages(robot.model, "base_link", "tcp")


def some_state(robot: RobotDescription, joints: list[float]) -> np.ndarray:
    state = np.zeros((), state_dtype(7))
    state["position"] = joints
    robot.model.forward_into(np.array(joints), state["tcp"])
    state["wrench"] = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    state["velocity"], state["effort"] = 0.5, np.arange(7.0)
    state["measured_monotonic_ns"] = time.monotonic_ns() - 2_000_000_000
    state["reason"] = b"because"
    return state


JOINTS = [0.3, -0.4, 0.5, -1.2, 0.7, 0.8, -0.9]


def test_joint_states_are_those_of_the_record(
    messages: Messages, made: RobotMessages, robot: RobotDescription
) -> None:
    before_s = time.time()
    message = messages.checked(JOINT_STATES, made.joint_state(some_state(robot, JOINTS)))
    assert message["name"] == [f"joint{number}" for number in range(1, 8)]
    assert message["position"] == JOINTS
    assert message["velocity"] == [0.5] * 7
    assert message["effort"] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    stamp = message["header"]["stamp"]
    assert -2.01 < stamp["sec"] + 1e-9 * stamp["nanosec"] - before_s < 60.0 - 2.0


def test_pose_and_wrench_fit_the_tree_of_frames(
    messages: Messages, made: RobotMessages, robot: RobotDescription
) -> None:
    """Multiplying the transforms from base to TCP gives the pose; the wrench is turned by it."""
    state = some_state(robot, JOINTS)
    moving = messages.checked(TRANSFORMS, made.transforms(state))["transforms"]
    fixed = messages.checked(TRANSFORMS, made.static_transforms())["transforms"]
    parents = {each["child_frame_id"]: each for each in (*moving, *fixed)}
    assert len(parents) == 9
    place, turn, frame = np.zeros(3), Rotation.identity(), "tcp"
    while frame != "base_link":
        step = parents[frame]["transform"]
        onto = Rotation.from_quat([step["rotation"][axis] for axis in "xyzw"])
        place = onto.apply(place) + [step["translation"][axis] for axis in "xyz"]
        turn = onto * turn
        frame = parents[frame]["header"]["frame_id"]
    assert parents["base_link"]["header"]["frame_id"] == "world"
    pose = messages.checked(POSE, made.pose(state))
    assert pose["header"]["frame_id"] == "base_link"
    np.testing.assert_allclose([pose["pose"]["position"][axis] for axis in "xyz"], place, atol=1e-12)
    told = Rotation.from_quat([pose["pose"]["orientation"][axis] for axis in "xyzw"])
    assert (told.inv() * turn).magnitude() < 1e-9
    wrench = messages.checked(WRENCH, made.wrench(state))
    assert wrench["header"]["frame_id"] == "tcp"
    force = turn.apply([wrench["wrench"]["force"][axis] for axis in "xyz"])
    np.testing.assert_allclose(force, [1.0, 2.0, 3.0], atol=1e-12)
    torque = turn.apply([wrench["wrench"]["torque"][axis] for axis in "xyz"])
    np.testing.assert_allclose(torque, [0.1, 0.2, 0.3], atol=1e-12)


def test_a_prefix_keeps_two_robots_apart_in_one_tree(robot: RobotDescription) -> None:
    made = RobotMessages(robot.model, "base_link", "tcp", "left/")
    fixed = made.static_transforms()["transforms"]
    assert [(each["header"]["frame_id"], each["child_frame_id"]) for each in fixed] == [
        ("world", "left/base_link"),
        ("left/link7", "left/tcp"),
    ]
    assert made.joint_state(some_state(robot, JOINTS))["header"]["frame_id"] == "left/base_link"


def test_the_status_is_a_json_object(
    messages: Messages, made: RobotMessages, robot: RobotDescription
) -> None:
    content = messages.checked(STRING, made.status(some_state(robot, JOINTS)))["data"]
    assert '"mode": "HOLD"' in content
    assert '"reason": "because"' in content


def test_the_urdf_is_the_same_robot_for_pinocchio(made: RobotMessages, robot: RobotDescription) -> None:
    text = made.description()["data"]
    model = pinocchio.buildModelFromXML(text)
    data = model.createData()
    limits = robot.limits
    assert tuple(model.names)[1:] == limits.names
    np.testing.assert_allclose(model.lowerPositionLimit, limits.min_position)
    np.testing.assert_allclose(model.upperPositionLimit, limits.max_position)
    np.testing.assert_allclose(model.velocityLimit, limits.max_velocity)
    np.testing.assert_allclose(model.effortLimit, limits.max_effort)
    random = np.random.default_rng(5)
    for _ in range(20):
        joints = random.uniform(limits.min_position, limits.max_position)
        pinocchio.framesForwardKinematics(model, data, joints)
        place = data.oMf[model.getFrameId("tcp")]
        expected = robot.model.forward(joints)
        np.testing.assert_allclose(place.translation, expected.position, atol=1e-12)
        turn = Rotation.from_matrix(place.rotation)
        assert (turn.inv() * Rotation.from_quat(expected.quaternion, scalar_first=True)).magnitude() < 1e-7
        gravity = pinocchio.computeGeneralizedGravity(model, data, joints)
        np.testing.assert_allclose(gravity, robot.model.gravity_torques(joints), atol=1e-9)


ODD = """
<mujoco model="odd"><worldbody><body name="base_link" pos="1 2 3" quat="1 1 0 0">
 <geom type="box" size=".1 .2 .3"/>
 <body name="arm" pos="0 0 .5" quat="1 0 2 0"><joint name="joint1" axis="0 1 1" pos=".1 .2 .3" ref=".4"/>
  <geom type="ellipsoid" size=".1 .2 .3" contype="0" conaffinity="0"/>
  <body pos="0 .1 0"><geom type="capsule" size=".05 .1"/><site name="tcp" pos=".1 .2 .3" quat="1 2 3 4"/>
  </body>
 </body></body></worldbody></mujoco>
"""


def test_joints_beside_their_links_origin_and_odd_shapes_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "odd.xml"
    path.write_text(ODD, encoding="utf-8")
    one = {name: [value] for name, value in zip(RATES, (-1.0, 1.0, 2.0, 3.0, 4.0, 5.0), strict=True)}
    model = RobotModel.load(path, JointLimits(("joint1",), **one))
    text = urdf(model.mj, model.limits, model.tcp_site)
    theirs = pinocchio.buildModelFromXML(text)
    data = theirs.createData()
    spec = mujoco.MjSpec.from_string(text)
    spec.compiler.fusestatic = False
    assert spec.compile().ngeom == 1 + 3  # MuJoCo leaves out what does not collide
    assert text.count("<visual>") == 1 + 1 + 3
    for joint in (-0.9, 0.0, 0.6):
        pinocchio.framesForwardKinematics(theirs, data, np.array([joint]))
        base = data.oMf[theirs.getFrameId("base_link")]
        place = base.inverse() * data.oMf[theirs.getFrameId("tcp")]
        expected = model.forward(np.array([joint]))
        np.testing.assert_allclose(place.translation, expected.position, atol=1e-12)
        turn = Rotation.from_matrix(place.rotation)
        assert (turn.inv() * Rotation.from_quat(expected.quaternion, scalar_first=True)).magnitude() < 1e-7


RATES = ("min_position", "max_position", "max_velocity", "max_acceleration", "max_jerk", "max_effort")


def test_a_urdf_made_of_our_urdf_is_the_same_robot(
    made: RobotMessages, robot: RobotDescription, tmp_path: Path
) -> None:
    path = tmp_path / "again.urdf"
    path.write_text(made.description()["data"], encoding="utf-8")
    again = RobotModel.load(path, robot.limits)
    np.testing.assert_allclose(
        again.forward(np.array(JOINTS)).position, robot.model.forward(np.array(JOINTS)).position, atol=1e-12
    )
    twice = RobotMessages(again, "base_link", "tcp")
    assert [each["child_frame_id"] for each in twice.static_transforms()["transforms"]].count("tcp") == 1
    assert twice.description()["data"].count('<link name="tcp"') == 1


def test_a_promised_type_is_there_and_its_text_read_when_it_is_needed() -> None:
    messages, name = Messages(), "demo_msgs/srv/Ask"
    wrong, action = "demo_msgs/srv/Wrong", "demo_msgs/action/Go"
    messages.add_lazily(
        {
            name: "Part asked\n---\nint32 answered 3\n",
            wrong: "integer a\n---\n",
            action: "---\n---\nPart part\n",
            "demo_msgs/msg/Part": "int32 number\n",
        }
    )
    assert messages.has_service(name)
    assert messages.has_service(wrong)
    with pytest.raises(InputError, match="there is no type 'demo_msgs/msg/integer' here"):
        messages.default(f"{wrong}_Request")
    assert f"{name}_Request" in messages
    assert messages.resolved("demo_msgs/Ask", "srv") == name
    request = messages.to_cdr(f"{name}_Request", {"asked": {"number": 3}})
    assert messages.from_cdr(f"{name}_Request", request) == {"asked": {"number": 3}}
    assert messages.default(f"{name}_Response") == {"answered": 3}
    assert messages.has_service(name)
    assert not messages.has_service("demo_msgs/srv/Other")
    assert messages.resolved("demo_msgs/Go", "action") == action
    assert messages.default(f"{action}_FeedbackMessage")["feedback"] == {"part": {"number": 0}}


def test_a_promised_type_cannot_be_given_another_text() -> None:
    messages, name = Messages(), "demo_msgs/msg/Part"
    messages.add_lazily({name: "int32 number\n"})
    messages.add({name: "int32 number  # the same\n"})
    with pytest.raises(InputError, match="already present with different definition"):
        messages.add({name: "int64 number\n"})
    with pytest.raises(InputError, match="already present with different definition"):
        messages.add({"std_srvs/srv/Empty": "int32 a\n---\n"})


def test_a_promise_changes_nothing_of_what_there_is() -> None:
    promised, added = Messages(), Messages(DEFINITIONS)
    promised.add_lazily(DEFINITIONS)
    assert sorted(promised) == sorted(added)
    assert promised.definitions == added.definitions
    for name in added:
        assert promised.fields(name) == added.fields(name)
        assert promised.constants(name) == added.constants(name)
        assert promised.default(name) == added.default(name)
        assert promised.type_hash(name) == added.type_hash(name)
