"""Clients of the service: `Client` speaks REST, `Robot` streams targets to an arm and reads its state."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cobot.client.controls import CartesianMotionForceControl, JointImpedanceControl, JointTorqueControl
    from cobot.client.fingers import ServedFingers
    from cobot.client.jobs import JobHandle
    from cobot.client.modes import SWITCHES, CoordType, Mode
    from cobot.client.rest import Client
    from cobot.client.robot import Robot
    from cobot.client.states import CartesianState, JointState, RobotInfo, RobotStates

_HOMES = {
    "CartesianMotionForceControl": "controls",
    "CartesianState": "states",
    "Client": "rest",
    "CoordType": "modes",
    "JobHandle": "jobs",
    "JointImpedanceControl": "controls",
    "JointState": "states",
    "JointTorqueControl": "controls",
    "Mode": "modes",
    "Robot": "robot",
    "RobotInfo": "states",
    "RobotStates": "states",
    "SWITCHES": "modes",
    "ServedFingers": "fingers",
}
__all__ = [
    "SWITCHES",
    "CartesianMotionForceControl",
    "CartesianState",
    "Client",
    "CoordType",
    "JobHandle",
    "JointImpedanceControl",
    "JointState",
    "JointTorqueControl",
    "Mode",
    "Robot",
    "RobotInfo",
    "RobotStates",
    "ServedFingers",
]


def __getattr__(name: str) -> Any:
    """Import a name on first use, so that a client that only uses REST loads neither numpy nor shared
    memory.
    """
    if name in _HOMES:
        return getattr(import_module(f"cobot.client.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'cobot.client' has no attribute {name!r}")
