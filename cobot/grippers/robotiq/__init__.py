"""Robotiq's adaptive grippers 2F-85, 2F-140 and Hand-E over Modbus RTU, on a serial port or
over TCP, or over the text protocol of the URCap.

registers   the meaning of the registers, and the models
rtu         frames of Modbus RTU, and a master
urcap       the text protocol of the URCap
link        the interface of both for the driver
driver      the gripper
slave       a simulated gripper
text_slave  the simulated gripper over the text protocol
simulator   `cobot simulate robotiq`: the simulated gripper on a pseudo terminal and over TCP
rig         the simulated gripper for the contract
"""

from __future__ import annotations

from cobot.grippers.robotiq.driver import RobotiqGripper

__all__ = ["RobotiqGripper"]
