"""Converts a motion to the points of a goal, and the controller's feedback to progress."""

from __future__ import annotations

import numpy as np

from cobot.trajectory import from_hermite
from cobot.types import Array
from rtloop.backends.protocols import BackendError

AHEAD_S, FASTER = 0.3, 1.2
"""How far ahead of the last progress a position from the feedback is searched on the path: an offset, s, plus
this multiple of the elapsed time.
"""
SAME_RAD = 1e-5
OPEN_S = 1e-3
"""Minimum remaining time of the reported progress until the result arrives, s."""


def resampled(
    times_s: Array, rows: Array, max_points: int | None, deviation_rad: float
) -> tuple[Array, Array]:
    """Resample the points to at most `max_points`, evenly spaced in time.

    Raises:
        BackendError: quintics between these points would deviate from the path by more than `deviation_rad`.
    """
    if max_points is None or len(times_s) <= max_points:
        return times_s, rows
    whole = from_hermite(times_s, *rows)
    fewer_s = np.linspace(0.0, times_s[-1], max_points)
    fewer = np.array([whole.sample(fewer_s, order) for order in range(3)])
    off = np.abs(from_hermite(fewer_s, *fewer).sample(times_s) - rows[0])
    if not off.max() <= deviation_rad:
        raise BackendError(
            f"the motion has {len(times_s)} points, but the controller accepts at most {max_points} "
            f"(robot.backend.max_points); the arm would then leave its path by {off.max():.4f} rad, "
            f"allowed: {deviation_rad:g} rad (robot.backend.resampling_rad): make the motion shorter"
        )
    return fewer_s, fewer


class PathProgress:
    """The progress of a motion, calculated from the controller's own desired positions.

    A clock cannot be used, because the speed slider slows the motion down.

    Attributes:
        done_s: progress in the motion's own time, s.
    """

    def __init__(self, times_s: Array, positions: Array) -> None:
        self._times_s, self._positions = times_s, positions
        self._running_s = 0.0
        self.done_s = 0.0

    @property
    def duration_s(self) -> float:
        return float(self._times_s[-1])

    def look(self, running_s: float, place: Array | None, since_s: float) -> float:
        """Find the arm's position on the path, and return the progress, s.

        Args:
            running_s: time since the motion began, s.
            place: desired or measured position of the joints, shape (dof,), rad; None if unknown.
            since_s: progress of the motion since `place` was reported, s.
        """
        elapsed_s = max(running_s - self._running_s, 0.0)
        self._running_s = running_s
        if place is not None:
            latest_s = self.done_s + FASTER * elapsed_s + AHEAD_S
            found_s = self._find(place, self.done_s, latest_s, self.done_s + elapsed_s - since_s) + since_s
            self.done_s = min(max(self.done_s, found_s), self.duration_s - OPEN_S, running_s)
        return self.done_s

    def _find(self, place: Array, low_s: float, high_s: float, likely_s: float) -> float:
        """Return the time between `low_s` and `high_s` at which the path is nearest to `place`; of several,
        the one nearest to `likely_s`.
        """
        first = max(int(np.searchsorted(self._times_s, low_s - AHEAD_S)) - 1, 0)
        last = min(int(np.searchsorted(self._times_s, high_s)) + 1, len(self._times_s))
        starts, ends = self._positions[first : last - 1], self._positions[first + 1 : last]
        ways = ends - starts
        lengths = np.maximum((ways**2).sum(axis=1), 1e-18)
        shares = np.clip(((place - starts) * ways).sum(axis=1) / lengths, 0.0, 1.0)
        still = lengths <= 1e-16
        spans = np.diff(self._times_s[first:last])
        begun = self._times_s[first : last - 1]
        shares[still] = np.clip((likely_s - begun[still]) / spans[still], 0.0, 1.0)
        off = np.abs(starts + shares[:, None] * ways - place).max(axis=1)
        times_s = begun + shares * spans
        near = off <= off.min() + SAME_RAD
        return float(times_s[near][np.abs(times_s[near] - likely_s).argmin()])
