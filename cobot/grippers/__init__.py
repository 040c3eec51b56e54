"""Grippers: the protocol of their drivers, and the drivers that ship with cobot.

protocol    the interface of a driver: commands, state, capabilities, options
registry    the drivers by name, and the creation of a driver
positions   base of grippers with two positions
digital     a gripper that outputs open and close, with inputs that report its end positions
vacuum      a suction cup that outputs switch, with a sensor
point_rigs  simulated devices for digital, vacuum and simulated, on which the contract runs
simulated   the hand of a simulated cell
ros/        a gripper that already has a ROS 2 driver
robotiq/    2F-85, 2F-140 and Hand-E over Modbus RTU, and a simulated one

docs/your-gripper.md explains how to write a driver.
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
