"""The real-time client: streams targets to an arm at any rate, and reads its state."""

from __future__ import annotations

from cobot.realtime.controls import (
    CartesianMotionForceControl,
    JointImpedanceControl,
    JointTorqueControl,
)
from cobot.realtime.modes import SWITCHES, CoordType, Mode
from cobot.realtime.robot import Robot
from cobot.realtime.states import CartesianState, JointState, RobotInfo, RobotStates

__all__ = [
    "SWITCHES",
    "CartesianMotionForceControl",
    "CartesianState",
    "CoordType",
    "JointImpedanceControl",
    "JointState",
    "JointTorqueControl",
    "Mode",
    "Robot",
    "RobotInfo",
    "RobotStates",
]
