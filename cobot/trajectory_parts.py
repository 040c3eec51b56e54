"""Parts of a trajectory."""

from __future__ import annotations

from math import comb

import numpy as np

from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array

SAME_S = 1e-9
"""Breakpoints closer together than this, s, are treated as one."""
_CHOOSE = np.array([[comb(p, j) if p >= j else 0 for p in range(ORDER)] for j in range(ORDER)], dtype=float)


def cut(trajectory: Trajectory, begin_s: float, end_s: float) -> Trajectory:
    """The part of a trajectory between two times. Its time begins at 0."""
    inner = trajectory.breakpoints_s[
        (trajectory.breakpoints_s > begin_s + SAME_S) & (trajectory.breakpoints_s < end_s - SAME_S)
    ]
    times = np.concatenate([[begin_s], inner, [end_s]])
    middles = 0.5 * (times[:-1] + times[1:])
    return Trajectory(times - begin_s, expanded(trajectory, times[:-1], middles))


def remainder_at(trajectory: Trajectory, time_s: float) -> tuple[Trajectory, float]:
    """The part of a motion that begins at the last breakpoint before a given time, and the time of that
    breakpoint, s.

    The polynomials are the same, bit for bit. The times are exact too; the time of the breakpoint is
    subtracted from them.
    """
    breakpoints = trajectory.breakpoints_s
    index = int(np.searchsorted(breakpoints, time_s, side="right")) - 1
    index = min(max(index, 0), trajectory.segments - 1)
    offset_s = float(breakpoints[index])
    left = Trajectory(
        breakpoints[index:] - offset_s,
        trajectory.coefficients[index:],
        trajectory.note,
        trajectory.changes,
        trajectory.notices,
    )
    return left, offset_s


def expanded(trajectory: Trajectory, origins_s: Array, inside_s: Array) -> Array:
    """For each time in `inside_s`, the coefficients of the trajectory's segment at that time. They are
    expanded about the corresponding time in `origins_s`. Shape: (n, dof, 6).
    """
    index = np.searchsorted(trajectory.breakpoints_s, inside_s, side="right") - 1
    since = origins_s - trajectory.breakpoints_s[index]
    power = np.maximum(np.arange(ORDER)[None, :] - np.arange(ORDER)[:, None], 0)
    shift = _CHOOSE * since[:, None, None] ** power
    return np.asarray(np.einsum("ndp,njp->ndj", trajectory.coefficients[index], shift))
