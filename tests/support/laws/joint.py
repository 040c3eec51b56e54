"""What `rtloop.sources.joint` computes, in numpy.

The generators are given: they have oracles of their own (`laws.interpolation`, `laws.chunks`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from laws.target_checks import SLACK_S, joint_jumps

from cobot.ipc.layout import CHUNK_POINTS, Intervention
from cobot.types import Array
from rtloop.results import ACCEPTED

MAX_CHUNK_S = 600.0


class JointSource:
    """Joint targets, interpolated, or chunks of timed ones; whichever came last counts."""

    def __init__(
        self, interpolator: Any, chunks: Any, safe_velocity: Array, period_s: float, command_s: float
    ) -> None:
        dof = len(safe_velocity)
        self._interpolator, self._chunks = interpolator, chunks
        self._chunked = False
        self._time_s = 0.0  # of the chunks' reference
        self._velocity, self._period_s, self._command_s = safe_velocity, period_s, command_s
        self._last = np.zeros(dof)
        self.heading = np.zeros(dof)

    @property
    def reference(self) -> Array:
        followed: Array = (self._chunks if self._chunked else self._interpolator).reference
        return followed

    def begin(self, command: Array) -> None:
        self._chunked = False
        self._interpolator.begin(command)
        self._last = command[0].copy()

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        target = setpoint["joints"].copy()
        velocity = setpoint["joint_velocity"].copy() if setpoint["feed_forward"] else None
        if not np.isfinite(target).all() or (velocity is not None and not np.isfinite(velocity).all()):
            return Intervention.NOT_FINITE
        if joint_jumps(target, self._last, interval_s, self._velocity):
            return Intervention.JUMP
        if self._chunked:
            self.begin(self.reference.copy())
        self.heading, self._last = target - self.reference[0], target
        self._interpolator.aim(target, velocity, self._command_s)
        return None

    def take_chunk(self, chunk: np.ndarray, robot_time_s: float) -> Intervention | None:
        count, dof = min(int(chunk["count"]), CHUNK_POINTS), len(self._last)
        times_s, points = chunk["times_s"][:count].copy(), chunk["points"][:count, :dof].copy()
        if not (np.isfinite(times_s).all() and np.isfinite(points).all()):
            return Intervention.NOT_FINITE
        self._time_s = robot_time_s - self._period_s  # the reference is that of the cycle before
        if count and times_s[-1] > robot_time_s + MAX_CHUNK_S:
            return Intervention.LATE
        if self._chunk_jumps(times_s, points):
            return Intervention.JUMP
        if not self._chunked:
            self._chunks.begin(self.reference.copy())
        if self._chunks.take(times_s, points, self._time_s) != ACCEPTED:
            return Intervention.LATE
        self._chunked = True
        self._last, self.heading = points[-1].copy(), points[-1] - self.reference[0]
        return None

    def advance(self, external_effort: Array, wrench: Array) -> None:
        if self._chunked:
            self._time_s += self._period_s
            self._chunks.advance(self._time_s)
        else:
            self._interpolator.advance()

    def follow(self, command: Array) -> None:
        """The reference does not wait for the arm."""

    def _chunk_jumps(self, times_s: Array, points: Array) -> bool:
        """Whether the targets that are still ahead would take a joint faster than it can be."""
        ahead = times_s > self._time_s
        at = np.concatenate([[self._time_s - SLACK_S], times_s[ahead]])
        rows = np.vstack([self.reference[0], points[ahead]])
        excess = np.abs(np.diff(rows, axis=0)) - self._velocity * np.diff(at)[:, None]
        return bool((excess > 0.0).any())
