"""The last state that a crashed rtloop published."""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import MotionResult
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import RobotMemory, encoded
from cobot.reasons import ReasonCode
from cobot.types import LoopMode

MAX_RAD = 1e3
"""Maximum plausible position of a joint, rad. With a larger value, the state must be damaged."""


def last_state(memory: RobotMemory) -> np.ndarray | None:
    """Copy the last state that a crashed rtloop of the same supervisor published; None if it published none.

    If it crashed while publishing, the positions are a mixture of two cycles, which is accurate enough. If
    the values are invalid, the state is damaged, and it is unknown whether an e-stop or a fault was latched.
    In that case an e-stop is assumed.
    """
    block = memory.state
    if block.sequence == 0:
        return None
    if not block.try_read() and not _makes_sense(block.salvage()):
        block.data[...] = np.zeros((), block.data.dtype)
        block.data["position"] = np.nan
        block.data["mode"] = LoopMode.ESTOP
        block.data["reason"] = encoded("the state in shared memory was damaged when rtloop was started")
        block.data["reason_code"] = ReasonCode.DAMAGED.encode()
        block.data["reason_values"] = np.nan
        block.data["stops_seen"] = _read_counter(memory.requests, "stops")
        block.data["estops_seen"] = _read_counter(memory.requests, "estops")
        block.data["command_seen"] = _read_counter(memory.head, "id")
    return block.data.copy()


def _makes_sense(state: np.ndarray) -> bool:
    return (
        int(state["mode"]) in list(LoopMode)
        and int(state["motion_result"]) in list(MotionResult)
        and bool((np.abs(state["position"]) < MAX_RAD).all())
    )


def _read_counter(block: Block, field: str) -> int:
    return int(block.data[field]) if block.try_read() else 0
