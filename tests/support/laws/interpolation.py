"""What `rtloop.generators.interpolation` computes, in numpy."""

from __future__ import annotations

import numpy as np
from laws.smooth_interpolation import EARLY

from cobot.types import Array


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
