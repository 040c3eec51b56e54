"""The permitted transitions between modes: one table for the code, the tests and docs/state-and-stop.md."""

from __future__ import annotations

from cobot.types import STREAMING, LoopMode

__all__ = ["STREAMING", "TRANSITIONS"]

_ENDED_BY = frozenset({LoopMode.STOPPING, LoopMode.ESTOP, LoopMode.FAULT})
TRANSITIONS: dict[LoopMode, frozenset[LoopMode]] = {
    LoopMode.HOLD: frozenset({LoopMode.TRAJECTORY, LoopMode.ESTOP, LoopMode.FAULT}) | STREAMING,
    LoopMode.TRAJECTORY: frozenset({LoopMode.HOLD}) | _ENDED_BY,
    LoopMode.STOPPING: frozenset({LoopMode.HOLD, LoopMode.ESTOP, LoopMode.FAULT}),
    LoopMode.ESTOP: frozenset({LoopMode.HOLD}),
    LoopMode.FAULT: frozenset({LoopMode.HOLD, LoopMode.ESTOP}),
    **dict.fromkeys(STREAMING, _ENDED_BY),
}
