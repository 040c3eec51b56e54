"""Grippers: the protocol of their drivers, and the drivers that ship with cobot.

protocol    what a driver has: commands, state, capabilities, options
registry    the drivers by name, and how one is made
positions   what two-position grippers have in common
digital     outputs that open and close, inputs that tell when
vacuum      a suction cup at outputs, with a sensor
point_rigs  simulated devices of these and of `simulated`, for the contract
simulated   the hand of a simulated cell
ros/        a gripper that has a ROS 2 driver
robotiq/    2F-85, 2F-140 and Hand-E over Modbus RTU, and a simulated one

docs/your-gripper.md is the guide to a driver of your own.
"""

from __future__ import annotations

from cobot.grippers.protocol import (
    Grasp,
    Gripper,
    GripperCapabilities,
    GripperError,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    PowerLoss,
)
from cobot.grippers.registry import gripper_class, gripper_names, make_gripper

__all__ = [
    "Grasp",
    "Gripper",
    "GripperCapabilities",
    "GripperError",
    "GripperOptions",
    "GripperState",
    "HeldObject",
    "IoPort",
    "PowerLoss",
    "gripper_class",
    "gripper_names",
    "make_gripper",
]
