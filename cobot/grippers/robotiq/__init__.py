"""Robotiq's adaptive grippers 2F-85, 2F-140 and Hand-E over Modbus RTU, on a serial port or
over TCP, or over the text protocol of the URCap.

registers   what the registers mean, and the models
rtu         frames of Modbus RTU, and a master
urcap       the text protocol of the URCap
link        what a driver needs of either
driver      the gripper
slave       a simulated gripper
text_slave  the same over the text protocol
simulator   `cobot simulate robotiq`: the simulated gripper on a pseudo terminal and over TCP
rig         the simulated gripper for the contract
"""

from __future__ import annotations

from cobot.grippers.robotiq.driver import RobotiqGripper

__all__ = ["RobotiqGripper"]
