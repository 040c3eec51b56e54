"""Parser for .msg, .srv and .action definitions, and standard definitions that are missing in `rosbags`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys.base import TypesysError, create_field_desc
from rosbags.typesys.msg import MSGParser

from cobot.errors import InputError

UUID = "unique_identifier_msgs/UUID goal_id\n"
TIME = "builtin_interfaces/Time"
_NAME = re.compile(r"([a-z][a-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)")
_SEPARATOR = re.compile(r"^---[^\S\n]*$", re.MULTILINE)

_TOLERANCE = "string name\nfloat64 position\nfloat64 velocity\nfloat64 acceleration\n"
_GRIP = "float64 position\nfloat64 effort\nbool stalled\nbool reached_goal\n"
_MULTI_DOF = "".join(
    f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{part}\n"
    for part in ("desired", "actual", "error")
)
_CONTROLLER = "string name\nstring state\nstring type\n"
_CLAIMS = (
    "string[] claimed_interfaces\nstring[] required_command_interfaces\nstring[] required_state_interfaces\n"
    "bool is_chainable\nbool is_chained\n"
)
_EXPORTED = "string[] exported_state_interfaces\n"
_CHAIN = "string[] reference_interfaces\nChainConnection[] chain_connections\n"
_DSR_READ = "int8 index\n---\nint8 value\nbool success\n"
_DSR_SET = "int8 index\nint8 value\n---\nbool success\n"
STANDARD = {
    "action_msgs/srv/CancelGoal": (
        "action_msgs/GoalInfo goal_info\n---\n"
        "int8 ERROR_NONE=0\nint8 ERROR_REJECTED=1\nint8 ERROR_UNKNOWN_GOAL_ID=2\n"
        "int8 ERROR_GOAL_TERMINATED=3\nint8 return_code\naction_msgs/GoalInfo[] goals_canceling\n"
    ),
    "control_msgs/msg/JointTolerance": _TOLERANCE,
    "control_msgs/msg/JointComponentTolerance": (
        "uint16 X_AXIS=1\nuint16 Y_AXIS=2\nuint16 Z_AXIS=3\nuint16 TRANSLATION=4\nuint16 ROTATION=5\n"
        "string joint_name\nuint16 component\nfloat64 position\nfloat64 velocity\nfloat64 acceleration\n"
    ),
    "control_msgs/action/FollowJointTrajectory": (
        "trajectory_msgs/JointTrajectory trajectory\n"
        "trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory\n"
        "JointTolerance[] path_tolerance\nJointComponentTolerance[] component_path_tolerance\n"
        "JointTolerance[] goal_tolerance\nJointComponentTolerance[] component_goal_tolerance\n"
        "builtin_interfaces/Duration goal_time_tolerance\n"
        "---\n"
        "int32 error_code\n"
        "int32 SUCCESSFUL = 0\nint32 INVALID_GOAL = -1\nint32 INVALID_JOINTS = -2\n"
        "int32 OLD_HEADER_TIMESTAMP = -3\nint32 PATH_TOLERANCE_VIOLATED = -4\n"
        "int32 GOAL_TOLERANCE_VIOLATED = -5\nstring error_string\n"
        "---\n"
        "std_msgs/Header header\nstring[] joint_names\n"
        "trajectory_msgs/JointTrajectoryPoint desired\ntrajectory_msgs/JointTrajectoryPoint actual\n"
        "trajectory_msgs/JointTrajectoryPoint error\n"
        "string[] multi_dof_joint_names\n" + _MULTI_DOF
    ),
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    "control_msgs/msg/DynamicInterfaceGroupValues": (
        "std_msgs/Header header\nstring[] interface_groups\ncontrol_msgs/InterfaceValue[] interface_values\n"
    ),
    "control_msgs/msg/GripperCommand": "float64 position\nfloat64 max_effort\n",
    "control_msgs/action/GripperCommand": f"GripperCommand command\n---\n{_GRIP}---\n{_GRIP}",
    "control_msgs/action/ParallelGripperCommand": (
        "sensor_msgs/JointState command\n---\n"
        "sensor_msgs/JointState state\nbool stalled\nbool reached_goal\n---\n"
        "sensor_msgs/JointState state\n"
    ),
    "controller_manager_msgs/msg/ChainConnection": "string name\nstring[] reference_interfaces\n",
    "controller_manager_msgs/msg/ControllerState": (
        f"{_CONTROLLER}bool is_async\nuint16 update_rate\n{_CLAIMS}{_EXPORTED}{_CHAIN}"
    ),
    "controller_manager_msgs/msg/HumbleControllerState": f"{_CONTROLLER}{_CLAIMS}{_CHAIN}",
    "controller_manager_msgs/msg/ExportingControllerState": f"{_CONTROLLER}{_CLAIMS}{_EXPORTED}{_CHAIN}",
    "controller_manager_msgs/srv/ListControllers": "---\nControllerState[] controller\n",
    "controller_manager_msgs/srv/HumbleListControllers": "---\nHumbleControllerState[] controller\n",
    "controller_manager_msgs/srv/ExportingListControllers": "---\nExportingControllerState[] controller\n",
    "controller_manager_msgs/srv/SwitchController": (
        "string[] activate_controllers\nstring[] deactivate_controllers\n"
        "int32 BEST_EFFORT=1\nint32 STRICT=2\nint32 strictness\n"
        "bool activate_asap\nbuiltin_interfaces/Duration timeout\n---\nbool ok\nstring message\n"
    ),
    "dsr_msgs2/srv/GetCtrlBoxAnalogInput": "int8 channel\n---\nfloat64 value\nbool success\n",
    "dsr_msgs2/srv/GetCtrlBoxDigitalInput": _DSR_READ,
    "dsr_msgs2/srv/GetCtrlBoxDigitalOutput": _DSR_READ,
    "dsr_msgs2/srv/GetToolDigitalInput": _DSR_READ,
    "dsr_msgs2/srv/GetToolDigitalOutput": _DSR_READ,
    "dsr_msgs2/srv/SetCtrlBoxDigitalOutput": _DSR_SET,
    "dsr_msgs2/srv/SetToolDigitalOutput": _DSR_SET,
    "lifecycle_msgs/srv/ChangeState": "lifecycle_msgs/Transition transition\n---\nbool success\n",
    "lifecycle_msgs/srv/GetState": "---\nlifecycle_msgs/State current_state\n",
    "lifecycle_msgs/srv/GetAvailableStates": "---\nlifecycle_msgs/State[] available_states\n",
    "lifecycle_msgs/srv/GetAvailableTransitions": (
        "---\nlifecycle_msgs/TransitionDescription[] available_transitions\n"
    ),
    "motoros2_interfaces/srv/ReadSingleIO": (
        "uint32 address\n---\nuint32 result_code\nstring message\nbool success\nint32 value\n"
    ),
    "motoros2_interfaces/srv/WriteSingleIO": (
        "uint32 address\nint32 value\n---\nuint32 result_code\nstring message\nbool success\n"
    ),
    "rcl_interfaces/srv/DescribeParameters": (
        "string[] names\n---\nrcl_interfaces/ParameterDescriptor[] descriptors\n"
    ),
    "rcl_interfaces/srv/GetParameters": "string[] names\n---\nrcl_interfaces/ParameterValue[] values\n",
    "rcl_interfaces/srv/GetParameterTypes": "string[] names\n---\nuint8[] types\n",
    "rcl_interfaces/srv/ListParameters": (
        "uint64 DEPTH_RECURSIVE=0\nstring[] prefixes\nuint64 depth\n"
        "---\nrcl_interfaces/ListParametersResult result\n"
    ),
    "rcl_interfaces/srv/SetParameters": (
        "rcl_interfaces/Parameter[] parameters\n---\nrcl_interfaces/SetParametersResult[] results\n"
    ),
    "rcl_interfaces/srv/SetParametersAtomically": (
        "rcl_interfaces/Parameter[] parameters\n---\nrcl_interfaces/SetParametersResult result\n"
    ),
    "std_srvs/srv/Empty": "---\n",
    "ur_msgs/msg/Analog": "uint8 VOLTAGE=0\nuint8 CURRENT=1\nuint8 pin\nuint8 domain\nfloat32 state\n",
    "ur_msgs/msg/Digital": "uint8 pin\nbool state\n",
    "ur_msgs/msg/IOStates": (
        "Digital[] digital_in_states\nDigital[] digital_out_states\nDigital[] flag_states\n"
        "Analog[] analog_in_states\nAnalog[] analog_out_states\n"
    ),
    "ur_msgs/srv/SetIO": "int8 fun\nint8 pin\nfloat32 state\n---\nbool success\n",
    "std_srvs/srv/SetBool": "bool data\n---\nbool success\nstring message\n",
    "std_srvs/srv/Trigger": "---\nbool success\nstring message\n",
    "xarm_msgs/srv/GetAnalogIO": "int16 ionum\n---\nint16 ret\nstring message\nfloat32 data\n",
    "xarm_msgs/srv/GetDigitalIO": "---\nint16 ret\nstring message\nint16[] digitals\n",
    "xarm_msgs/srv/SetDigitalIO": (
        "int16 ionum\nint16 value\nfloat32 delay_sec 0\nfloat32[] xyz\nfloat32 tol_r\n"
        "---\nint16 ret\nstring message\n"
    ),
}
DEFAULTS: dict[str, dict[str, Any]] = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}
"""Standard messages whose defaults are not zero."""


@dataclass(frozen=True, slots=True)
class ParsedMessage:
    """One message: its constants (name, type, value), its fields (name, description as in rosbags) and its
    defaults.
    """

    name: str
    constants: list[tuple[str, Any, Any]]
    fields: list[tuple[str, Any]]
    defaults: dict[str, Any]


_PARTS = {
    "msg": [""],
    "srv": ["_Request", "_Response"],
    "action": ["_Goal", "_Result", "_Feedback"],
}
_OF_ACTIONS = {
    "_SendGoal_Request": UUID + "{0}_Goal goal\n",
    "_SendGoal_Response": f"bool accepted\n{TIME} stamp\n",
    "_GetResult_Request": UUID,
    "_GetResult_Response": "int8 status\n{0}_Result result\n",
    "_FeedbackMessage": UUID + "{0}_Feedback feedback\n",
}
"""The messages that ROS 2 derives from the parts of an action. {0} is the action name."""


def message_names(name: str) -> list[str]:
    """The names of the messages that a definition defines.

    Raises:
        InputError: the name is invalid.
    """
    _, kind, _ = _split(name)
    return [name + part for part in (*_PARTS[kind], *(_OF_ACTIONS if kind == "action" else ()))]


def _split(name: str) -> tuple[str, str, str]:
    match = _NAME.fullmatch(name)
    if match is None:
        raise InputError(f"{name!r} is not a type such as std_msgs/msg/String")
    return match[1], match[2], match[3]


def parsed(name: str, text: str) -> list[ParsedMessage]:
    """The messages that a definition defines. For an action, these are all messages that ROS 2 derives from
    it.

    Args:
        name: pkg/msg/Name, pkg/srv/Name or pkg/action/Name.

    Raises:
        InputError: the name or the text is invalid.
    """
    _, kind, local = _split(name)
    parts = _PARTS[kind]
    texts = _SEPARATOR.split(text)
    if len(texts) != len(parts):
        raise InputError(
            f"{name}: a .{kind} has {len(parts)} parts, separated by lines of ---, got {len(texts)}"
        )
    pieces = {name + part: text for part, text in zip(parts, texts, strict=True)}
    if kind == "action":
        pieces |= {name + part: template.format(local) for part, template in _OF_ACTIONS.items()}
    return [_message(piece, text, pieces) for piece, text in pieces.items()]


def _message(name: str, text: str, own: Mapping[str, str]) -> ParsedMessage:
    try:
        (message,) = MSGParser(f"MSG: {name}\n{text.strip()}\n").specification()
    except (TypesysError, ValueError) as exc:
        raise InputError(f"{name}: is not a valid definition: {' '.join(str(exc).split())[:200]}") from exc
    fields = [(item.name, _local(create_field_desc(item.typ), own)) for item in message.fields]
    constants = [(item.name, item.typ.value, item.value) for item in message.constants]
    return ParsedMessage(
        name, constants, fields, {item.name: item.value for item in message.fields if item.value is not None}
    )


def _local(description: Any, own: Mapping[str, str]) -> Any:
    """Correct a type that rosbags has parsed. It assigns unqualified types to srv or action, although they
    are messages of the package.
    """
    kind, rest = description
    if kind == Nodetype.NAME:
        package, *_, last = rest.split("/")
        beside = f"{package}/action/{last}"
        return kind, beside if beside in own else f"{package}/msg/{last}"
    if kind == Nodetype.BASE:
        return description
    item, size = rest
    return kind, (_local(item, own), size)
