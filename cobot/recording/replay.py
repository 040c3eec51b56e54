"""Converts a recorded motion to the points of a trajectory, which the service checks and times again."""

from __future__ import annotations

import io

import numpy as np

from cobot.errors import InputError
from cobot.recording.reader import Cycles
from cobot.types import Array

REST_RAD = 1e-4
"""Before and after the motion, the arm is within this distance of the motion's first or last position,
rad.
"""


def points_of(cycles: Cycles, every_s: float, *, measured: bool = False) -> tuple[Array, Array]:
    """The points of the recorded motion: times (s) that begin at 0, and joint positions (rad). Shapes: (n,)
    and (n, dof).

    The time without movement before and after the motion is left out.

    Args:
        every_s: time between two points.
        measured: whether to use the measured positions instead of the commanded ones.

    Raises:
        InputError: the arm does not move in the recording, or cycles are missing.
    """
    positions = cycles.position if measured else cycles.commanded
    if cycles.missing:
        raise InputError(
            f"{cycles.missing} cycles are missing in the recording, so the path of the arm is unknown"
        )
    far = np.abs(positions - positions[0]).max(axis=1) > REST_RAD
    if not far.any():
        raise InputError(f"in the recording no joint moves by more than {REST_RAD} rad")
    begin = max(0, int(np.flatnonzero(far)[0]) - 1)
    left = np.abs(positions - positions[-1]).max(axis=1) > REST_RAD
    end = min(len(positions) - 1, int(np.flatnonzero(left)[-1]) + 1)
    step = max(1, round(every_s / cycles.period_s))
    chosen = np.unique(np.append(np.arange(begin, end, step), end))
    return cycles.times_s[chosen] - cycles.times_s[begin], positions[chosen]


def csv_of(times_s: Array, positions: Array) -> str:
    """The points as CSV for POST /trajectory/send_csv. The arm must be at the first point when the motion
    begins.
    """
    out = io.StringIO()
    header = ",".join([*(f"joint{joint + 1}" for joint in range(positions.shape[1])), "t"])
    np.savetxt(out, np.column_stack([positions, times_s]), "%.9f", ",", header=header, comments="")
    return out.getvalue()
