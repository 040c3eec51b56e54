"""The role that each vendor service needs. A method that matches no pattern of its class cannot be
registered.

Operators move the arm, switch its outputs and write the values that programs read. Programmers change
settings for later motions (tool, payload, limits, frames, watchdogs), and open serial ports and network
connections.
"""

from __future__ import annotations

from fnmatch import fnmatchcase
from functools import cache

from cobot.access.roles import Role

LOOKING = ("get*", "is*", "has*")
ROLES: dict[str, tuple[tuple[Role, tuple[str, ...]], ...]] = {
    "Math": ((Role.OBSERVER, ("*",)),),
    "RobotConfig": ((Role.OBSERVER, LOOKING), (Role.PROGRAMMER, ("set*", "resetLimits"))),
    "RobotState": ((Role.OBSERVER, LOOKING),),
    "MotionControl": (
        (Role.OBSERVER, LOOKING),
        (Role.OPERATOR, ("move*", "stop*", "startMove", "clearPath", "servo*", "setServoMode*")),
        (Role.OPERATOR, ("setSpeedFraction",)),
    ),
    "RobotAlgorithm": ((Role.OBSERVER, ("forward*", "inverse*", "calibrateTcpPosition")),),
    "RuntimeMachine": (
        (Role.OBSERVER, LOOKING),
        (Role.OPERATOR, ("loadProgram", "runProgram", "start", "stop", "abort", "pause", "resume")),
    ),
    "RegisterControl": (
        (Role.OBSERVER, (*LOOKING, "modbusGet*")),
        (Role.PROGRAMMER, ("modbusAdd*", "modbusDelete*", "modbusSetSignalUpdateFrequency", "setWatchDog")),
        (Role.OPERATOR, ("modbusSetOutputSignal", "set*", "clearNamedVariable")),
    ),
    "IoControl": (
        (Role.OBSERVER, LOOKING),
        (Role.PROGRAMMER, ("set*Domain",)),
        (Role.OPERATOR, ("set*",)),
    ),
    "ForceControl": (
        (Role.OBSERVER, LOOKING),
        (Role.OPERATOR, ("fcEnable", "fcDisable", "setTargetForce")),
        (Role.PROGRAMMER, ("setDynamicModel", "fcSetSensorThresholds", "fcSetSensorLimits")),
    ),
    "SyncMove": (
        (Role.OBSERVER, (*LOOKING, "axisGroupGet*", "frameGet*", "frameConvertPose")),
        (Role.OPERATOR, ("syncMove*", "axisGroupMoveJoint", "frameMove")),
        (Role.PROGRAMMER, ("axisGroupAdd", "axisGroupDelete", "frameAdd", "frameAttach", "frameDelete*")),
    ),
    "Serial": ((Role.PROGRAMMER, ("serial*",)),),
    "Socket": ((Role.PROGRAMMER, ("socket*",)),),
    "Trace": ((Role.OBSERVER, ("peek",)), (Role.OPERATOR, ("textmsg", "notify", "alarm", "popup"))),
    "SystemInfo": ((Role.OBSERVER, LOOKING),),
    "RobotManage": (
        (Role.OBSERVER, LOOKING),
        (Role.OPERATOR, ("poweron", "startup", "releaseRobotBrake", "poweroff", "lockRobotBrake")),
        (Role.OPERATOR, ("setUnlockProtectiveStop", "backdrive", "freedrive", "startRecord", "stopRecord")),
        (Role.PROGRAMMER, ("setOperationalMode", "setSim")),
    ),
}
"""For each class, roles with patterns of method names. A method has the role of the first pattern that
matches.
"""
CONTROLLED: dict[str, tuple[str, ...]] = {
    "RobotConfig": ("set*", "resetLimits"),
    "IoControl": ("set*Output*",),
    "RegisterControl": ("modbusSetOutputSignal",),
    "ForceControl": ("setTargetForce", "setDynamicModel", "fcSet*"),
    "RuntimeMachine": ("loadProgram",),
    "SyncMove": ("frame[ADM]*", "axisGroup[AD]*"),
}
"""Services that do not move the arm, but affect other clients' motions or a held object. While a client has
control, only that client may call them. Services that move the arm check control themselves. Registers need
no control, because programs share them with monitoring clients.
"""


@cache
def role_of(robot_class: str, method: str) -> Role:
    """Return the role that a service needs.

    Raises:
        TypeError: a programming error: the service is not in the table.
    """
    for role, patterns in ROLES.get(robot_class, ()):
        if any(fnmatchcase(method, pattern) for pattern in patterns):
            return role
    raise TypeError(f"{robot_class}/{method} has no role: give it one in app.aubo.roles")


@cache
def needs_control(robot_class: str, method: str) -> bool:
    """Whether the service is rejected while another client has control; see `CONTROLLED`."""
    return any(fnmatchcase(method, pattern) for pattern in CONTROLLED.get(robot_class, ()))
