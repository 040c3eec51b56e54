"""Robotiq's adaptive grippers 2F-85, 2F-140 and Hand-E over Modbus RTU, on a serial port or over TCP.

registers   what the registers mean, and the models
rtu         frames of Modbus RTU, and a master
driver      the gripper
slave       a simulated gripper
simulator   `cobot simulate robotiq`: the simulated gripper on a pseudo terminal and over TCP
rig         the simulated gripper for the contract
"""

from __future__ import annotations

from cobot.grippers.robotiq.driver import RobotiqGripper

__all__ = ["RobotiqGripper"]
