"""The modes of a `Robot`, and the changes between them that are allowed. Code, tests and documents use this
one table.
"""

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
    """The reference frame in which another frame is given."""

    WORLD = 0
    TCP = 1


_CHOSEN = frozenset(Mode) - {Mode.UNKNOWN}
SWITCHES: dict[Mode, frozenset[Mode]] = {
    Mode.UNKNOWN: frozenset({Mode.IDLE}),
    **dict.fromkeys(_CHOSEN, _CHOSEN),
}
"""Changes of the mode that are allowed while the arm does not move and no session is open. Any mode may
follow any other, with one exception: UNKNOWN means that the robot does not answer. It changes only to IDLE
and cannot be selected.
"""

JOINT_STREAMS = frozenset({Mode.RT_JOINT_IMPEDANCE, Mode.NRT_JOINT_IMPEDANCE})
CARTESIAN_STREAMS = frozenset({Mode.RT_CARTESIAN_MOTION_FORCE, Mode.NRT_CARTESIAN_MOTION_FORCE})
