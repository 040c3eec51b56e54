"""Which mode may follow which: the one table, for the code, the tests and docs/architecture.md."""

from __future__ import annotations

from cobot.types import Mode

STREAMING = frozenset({Mode.JOINT_IMPEDANCE, Mode.CARTESIAN, Mode.JOINT_TORQUE})

_ENDED_BY = frozenset({Mode.STOPPING, Mode.ESTOP, Mode.FAULT})
TRANSITIONS: dict[Mode, frozenset[Mode]] = {
    Mode.HOLD: frozenset({Mode.TRAJECTORY, Mode.ESTOP, Mode.FAULT}) | STREAMING,
    Mode.TRAJECTORY: frozenset({Mode.HOLD}) | _ENDED_BY,
    Mode.STOPPING: frozenset({Mode.HOLD, Mode.ESTOP, Mode.FAULT}),
    Mode.ESTOP: frozenset({Mode.HOLD}),
    Mode.FAULT: frozenset({Mode.HOLD, Mode.ESTOP}),
    **dict.fromkeys(STREAMING, _ENDED_BY),
}
