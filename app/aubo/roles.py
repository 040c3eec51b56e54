"""Which role each vendor service needs. What no pattern of its class fits cannot be registered.

Who operates moves the arm, switches its outputs and writes what programs read. Who programs changes what
holds for the motions after it: the tool, the payload, limits, frames, watchdogs; and opens ways out of the
controller: serial ports, connections.
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
"""By class: roles with patterns of methods' names, of which the first that fits counts."""
CONTROLLED: dict[str, tuple[str, ...]] = {
    "RobotConfig": ("set*", "resetLimits"),
    "IoControl": ("set*Output*",),
    "RegisterControl": ("modbusSetOutputSignal",),
    "ForceControl": ("setTargetForce", "setDynamicModel", "fcSet*"),
    "RuntimeMachine": ("loadProgram",),
    "SyncMove": ("frame[ADM]*", "axisGroup[AD]*"),
}
"""Services that move nothing and still affect other clients' motions or what the arm holds. While a client
has control, only that client may call them. Services that move the arm check control themselves. Registers
need no control, because programs share them with monitoring clients."""


@cache
def role_of(robot_class: str, method: str) -> Role:
    """The role that a service needs.

    Raises:
        TypeError: the table does not know it: a programming error.
    """
    for role, patterns in ROLES.get(robot_class, ()):
        if any(fnmatchcase(method, pattern) for pattern in patterns):
            return role
    raise TypeError(f"{robot_class}/{method} has no role: give it one in app.aubo.roles")


@cache
def needs_control(robot_class: str, method: str) -> bool:
    """Whether it is refused while another client has control; see `CONTROLLED`."""
    return any(fnmatchcase(method, pattern) for pattern in CONTROLLED.get(robot_class, ()))
