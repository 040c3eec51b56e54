"""Which mode may follow which: the one table, for the code, the tests and docs/architecture.md."""

from __future__ import annotations

from cobot.types import Mode

TRANSITIONS: dict[Mode, frozenset[Mode]] = {
    Mode.HOLD: frozenset({Mode.TRAJECTORY, Mode.ESTOP, Mode.FAULT}),
    Mode.TRAJECTORY: frozenset({Mode.HOLD, Mode.STOPPING, Mode.ESTOP, Mode.FAULT}),
    Mode.STOPPING: frozenset({Mode.HOLD, Mode.ESTOP, Mode.FAULT}),
    Mode.ESTOP: frozenset({Mode.HOLD}),
    Mode.FAULT: frozenset({Mode.HOLD, Mode.ESTOP}),
}
