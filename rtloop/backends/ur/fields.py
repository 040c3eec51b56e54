"""RTDE variables and the values of states, from Universal Robots' RTDE guide."""

from __future__ import annotations

from enum import IntEnum

AXES = 6


class UrRobotMode(IntEnum):
    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class SafetyMode(IntEnum):
    """Values of `safety_mode`. Values of 12 and above occur only in `safety_status`."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED_SAFETY_MODE = 11
    AUTOMATIC_MODE_SAFEGUARD_STOP = 12
    SYSTEM_THREE_POSITION_ENABLING_STOP = 13


class RuntimeState(IntEnum):
    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


FREEDRIVE_BUTTON = 1 << 2
"""Bit of `robot_status_bits` that is set while the button for hand guiding is pressed."""

_D, _V6, _V3, _U32, _U8 = "DOUBLE", "VECTOR6D", "VECTOR3D", "UINT32", "UINT8"

OUTPUTS: dict[str, str] = {
    "timestamp": _D,
    "target_q": _V6,
    "target_qd": _V6,
    "target_qdd": _V6,
    "target_current": _V6,
    "target_moment": _V6,
    "actual_q": _V6,
    "actual_qd": _V6,
    "actual_current": _V6,
    "actual_current_as_torque": _V6,
    "joint_control_output": _V6,
    "actual_TCP_pose": _V6,
    "actual_TCP_speed": _V6,
    "actual_TCP_force": _V6,
    "target_TCP_pose": _V6,
    "target_TCP_speed": _V6,
    "actual_digital_input_bits": "UINT64",
    "joint_temperatures": _V6,
    "actual_execution_time": _D,
    "robot_mode": "INT32",
    "joint_mode": "VECTOR6INT32",
    "safety_mode": "INT32",
    "safety_status": "INT32",
    "actual_tool_accelerometer": _V3,
    "speed_scaling": _D,
    "target_speed_fraction": _D,
    "actual_momentum": _D,
    "actual_main_voltage": _D,
    "actual_robot_voltage": _D,
    "actual_robot_current": _D,
    "actual_joint_voltage": _V6,
    "actual_digital_output_bits": "UINT64",
    "runtime_state": _U32,
    "elbow_position": _V3,
    "elbow_velocity": _V3,
    "robot_status_bits": _U32,
    "safety_status_bits": _U32,
    "analog_io_types": _U32,
    "standard_analog_input0": _D,
    "standard_analog_input1": _D,
    "standard_analog_output0": _D,
    "standard_analog_output1": _D,
    "io_current": _D,
    "tool_mode": _U32,
    "tool_analog_input_types": _U32,
    "tool_analog_input0": _D,
    "tool_analog_input1": _D,
    "tool_output_voltage": "INT32",
    "tool_output_current": _D,
    "tool_temperature": _D,
    "tcp_force_scalar": _D,
    "output_bit_registers0_to_31": _U32,
    "output_bit_registers32_to_63": _U32,
    "payload": _D,
    "payload_cog": _V3,
    "payload_inertia": _V6,
    "script_control_line": _U32,
    "ft_raw_wrench": _V6,
    "input_bit_registers0_to_31": _U32,
    "input_bit_registers32_to_63": _U32,
    **{f"output_bit_register_{n}": "BOOL" for n in range(64, 128)},
    **{f"input_bit_register_{n}": "BOOL" for n in range(64, 128)},
    **{f"{way}_int_register_{n}": "INT32" for way in ("output", "input") for n in range(48)},
    **{f"{way}_double_register_{n}": _D for way in ("output", "input") for n in range(48)},
}
"""Variables that a controller sends, with their types."""

INPUTS: dict[str, str] = {
    "speed_slider_mask": _U32,
    "speed_slider_fraction": _D,
    "standard_digital_output_mask": _U8,
    "standard_digital_output": _U8,
    "configurable_digital_output_mask": _U8,
    "configurable_digital_output": _U8,
    "standard_analog_output_mask": _U8,
    "standard_analog_output_type": _U8,
    "standard_analog_output_0": _D,
    "standard_analog_output_1": _D,
    "tool_digital_output_mask": _U8,
    "tool_digital_output": _U8,
    "external_force_torque": _V6,
    "input_bit_registers0_to_31": _U32,
    "input_bit_registers32_to_63": _U32,
    **{f"input_bit_register_{n}": "BOOL" for n in range(64, 128)},
    **{f"input_int_register_{n}": "INT32" for n in range(48)},
    **{f"input_double_register_{n}": _D for n in range(48)},
}
"""Variables that a client may set, with their types."""

ANSWERED = ("NOT_FOUND", "IN_USE")
"""Replies of a controller in place of a variable's type."""
