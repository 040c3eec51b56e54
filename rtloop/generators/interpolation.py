"""A reference for every cycle, made of commands that come less often.

Each kind answers in its own way what happens until the next command is due: nothing (`Hold`), a constant
velocity (`Linear`), a smooth polynomial (`Quintic`), the fastest profile that keeps the limits of velocity,
acceleration and jerk (`OnlineTrajectory`). The coordinates are joints (rad) or a chart of poses; SI units.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cobot.ipc.layout import Interpolation
from cobot.types import Array
from rtloop.generators.smooth_interpolation import EARLY, OnlineTrajectory, Quintic


class Interpolator(Protocol):
    """Turns commands into references. Real-time safe.

    Attributes:
        reference: where to be in this cycle, shape (3, n): position, velocity, acceleration. Owned here,
            overwritten by each call.
    """

    reference: Array

    def begin(self, state: Array) -> None:
        """Start here, shape (3, n), forget all commands, and hold (what moves is brought to rest)."""
        ...

    def rebase(self, state: Array, target: Array) -> None:
        """The present reference and the last target in other coordinates; an `aim` has to follow."""
        ...

    def aim(self, target: Array, velocity: Array | None, duration_s: float) -> None:
        """A new command, shape (n,), to be reached `duration_s` from now: one command period.

        Args:
            velocity: at the target, as the sender states it; None: estimated where it is needed.
        """
        ...

    def advance(self) -> None:
        """One period on."""
        ...


class Hold:
    """No interpolation: the reference is the newest target."""

    def __init__(self, n: int, period_s: float) -> None:
        self.reference = np.zeros((3, n))
        self._period_s = period_s
        self._left_s = 0.0

    def begin(self, state: Array) -> None:
        self.reference[:] = state
        self._left_s = 0.0

    def rebase(self, state: Array, target: Array) -> None:
        self.reference[:] = state

    def aim(self, target: Array, velocity: Array | None, duration_s: float) -> None:
        self.reference[0] = target
        self.reference[1] = 0.0 if velocity is None else velocity
        self.reference[2] = 0.0
        self._left_s = max(duration_s, self._period_s)

    def advance(self) -> None:
        self._left_s -= self._period_s
        if self._left_s < -EARLY * self._period_s:
            self.reference[1:] = 0.0  # whoever has fallen silent does not move


class Linear:
    """Constant velocity from where the reference is to the target, over one command period; then it rests."""

    def __init__(self, n: int, period_s: float) -> None:
        self.reference = np.zeros((3, n))
        self._period_s = period_s
        self._start, self._way, self._target, self._velocity = np.zeros((4, n))
        self._cycle, self._cycles = 0, 0.0

    def begin(self, state: Array) -> None:
        self.reference[:] = state
        self._target[:] = state[0]
        self._cycle, self._cycles = 0, 0.0

    def rebase(self, state: Array, target: Array) -> None:
        self.reference[:] = state

    def aim(self, target: Array, velocity: Array | None, duration_s: float) -> None:
        duration_s = max(duration_s, self._period_s)
        np.copyto(self._start, self.reference[0])
        np.copyto(self._target, target)
        np.subtract(target, self._start, out=self._way)
        np.divide(self._way, duration_s, out=self._velocity)
        self._cycle, self._cycles = 0, duration_s / self._period_s

    def advance(self) -> None:
        position, velocity, acceleration = self.reference
        acceleration[:] = 0.0
        # A period that ends within a cycle: the reference arrives with that cycle, still moving.
        velocity[:] = self._velocity if self._cycle < self._cycles - EARLY else 0.0
        self._cycle += 1
        if self._cycle < self._cycles - EARLY:
            np.multiply(self._way, self._cycle / self._cycles, out=position)
            position += self._start
        else:
            position[:] = self._target


def make_interpolator(
    kind: Interpolation,
    n: int,
    period_s: float,
    max_velocity: Array,
    max_acceleration: Array,
    max_jerk: Array,
) -> Interpolator:
    """An interpolator of n coordinates; the limits are shape (n,), in units of the coordinates."""
    if kind is Interpolation.NONE:
        return Hold(n, period_s)
    if kind is Interpolation.LINEAR:
        return Linear(n, period_s)
    smooth = Quintic if kind is Interpolation.QUINTIC else OnlineTrajectory
    return smooth(n, period_s, max_velocity, max_acceleration, max_jerk)
