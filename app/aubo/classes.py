"""All vendor service classes. Importing this module completes `REGISTRY`."""

from __future__ import annotations

from app.aubo import (
    force_control,
    io_control,
    math,
    modbus_signals,
    motion_control,
    register_control,
    robot_algorithm,
    robot_config,
    robot_manage,
    robot_state,
    runtime_machine,
    serial_ports,
    socket_client,
    sync_move,
    system_info,
    trace_log,
)
from app.aubo.registry import REGISTRY

__all__ = ["CLASSES", "MODULES", "REGISTRY"]

MODULES = (
    math,
    robot_config,
    robot_state,
    motion_control,
    robot_algorithm,
    runtime_machine,
    register_control,
    modbus_signals,
    io_control,
    force_control,
    sync_move,
    serial_ports,
    socket_client,
    trace_log,
    system_info,
    robot_manage,
)
"""Importing these modules registers all services."""

for _service in tuple(REGISTRY.values()):
    assert _service.role  # raises an error if the service has no role

CLASSES: dict[str, str] = {
    "Math": "Poses [x, y, z, rx, ry, rz] (m, rad, fixed-axis roll, pitch, yaw) and quaternions [w, x, y, z].",
    "RobotConfig": "Properties and limits of the arm; the tool and the payload.",
    "RobotState": "Measured state of the arm.",
    "MotionControl": "Motions in a queue, and servo modes.",
    "RobotAlgorithm": "Kinematics and dynamics of the model; nothing moves.",
    "RuntimeMachine": "Programs: sequences and Lua files.",
    "RegisterControl": "Registers, named variables, the watchdog, Modbus signals.",
    "IoControl": "Digital and analog inputs and outputs, simulated.",
    "ForceControl": "Cartesian force control.",
    "SyncMove": "Frames, and synchronous motions of several robots.",
    "Serial": "Serial ports of the controller.",
    "Socket": "TCP connections of the controller.",
    "Trace": "Messages for the log and for the operator.",
    "SystemInfo": "Versions and times.",
    "RobotManage": "Power, faults, modes.",
}
"""The description of each class, in the order of the documentation."""
