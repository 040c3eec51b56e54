"""The modes of a `Robot`, and the allowed changes between them. Code, tests and docs use this one table."""

from __future__ import annotations

from enum import IntEnum


class Mode(IntEnum):
    """The mode of a `Robot`, which `Robot.switch_mode` selects."""

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
    """The frame in which another frame is given."""

    WORLD = 0
    TCP = 1


_CHOSEN = frozenset(Mode) - {Mode.UNKNOWN}
SWITCHES: dict[Mode, frozenset[Mode]] = {
    Mode.UNKNOWN: frozenset({Mode.IDLE}),
    **dict.fromkeys(_CHOSEN, _CHOSEN),
}
"""Allowed changes of the mode while the arm rests and no session is open. Any mode may follow any other.
Exception: UNKNOWN, which means that the robot does not answer, changes only to IDLE and cannot be
selected."""

JOINT_STREAMS = frozenset({Mode.RT_JOINT_IMPEDANCE, Mode.NRT_JOINT_IMPEDANCE})
CARTESIAN_STREAMS = frozenset({Mode.RT_CARTESIAN_MOTION_FORCE, Mode.NRT_CARTESIAN_MOTION_FORCE})
