"""The gripper record in shared memory. The service writes it, and rtloop publishes it with the state of the
arm.
"""

from __future__ import annotations

import math

import numpy as np

from cobot.grippers.protocol import GripperState
from cobot.ipc.layout import GripperObject


def fill_gripper(record: np.ndarray, state: GripperState, read_ns: int) -> None:
    """Write a state into a record of `cobot.ipc.state_fields.GRIPPER_RECORD`.

    Args:
        read_ns: CLOCK_MONOTONIC when the gripper was read.
    """
    for name in ("width", "commanded_width", "force"):
        value = getattr(state, name)
        record[f"gripper_{name}"] = math.nan if value is None else value
    record["gripper_moving"] = state.moving
    held = GripperObject.UNKNOWN if state.object is None else GripperObject[state.object.name]
    record["gripper_object"] = held
    record["gripper_monotonic_ns"] = read_ns
