"""What the arm is used for, and which use may follow which: the one table, for code, tests and docs."""

from __future__ import annotations

from enum import IntEnum


class Mode(IntEnum):
    """What a `Robot` is used for; `Robot.switch_mode` chooses it."""

    UNKNOWN = 0
    IDLE = 1
    RT_JOINT_TORQUE = 2
    RT_JOINT_IMPEDANCE = 3
    RT_CARTESIAN_MOTION_FORCE = 4
    NRT_JOINT_IMPEDANCE = 5
    NRT_CARTESIAN_MOTION_FORCE = 6
    NRT_PLAN_EXECUTION = 7
    NRT_PRIMITIVE_EXECUTION = 8


class CoordType(IntEnum):
    """The frame that another one is given in."""

    WORLD = 0
    TCP = 1


_CHOSEN = frozenset(Mode) - {Mode.UNKNOWN}
SWITCHES: dict[Mode, frozenset[Mode]] = {
    Mode.UNKNOWN: frozenset({Mode.IDLE}),
    **dict.fromkeys(_CHOSEN, _CHOSEN),
}
"""Any use may follow any other while the arm rests and no session is open; UNKNOWN, when the robot does not
answer, is left for IDLE only, and never chosen."""

JOINT_STREAMS = frozenset({Mode.RT_JOINT_IMPEDANCE, Mode.NRT_JOINT_IMPEDANCE})
CARTESIAN_STREAMS = frozenset({Mode.RT_CARTESIAN_MOTION_FORCE, Mode.NRT_CARTESIAN_MOTION_FORCE})
