"""What `rtloop.sources.servo_law` computes, in numpy: q'' = gain (target - (q + lookahead q'))."""

from __future__ import annotations

import numpy as np

from cobot.types import Array


class ServoLaw:
    """The law, solved for a target that stands still within a cycle."""

    def __init__(self, n: int, period_s: float) -> None:
        self.reference = np.zeros((3, n))
        self.active = False
        self._period_s = period_s
        self._lookahead_s = self._gain = 0.0
        self._step = np.eye(2)

    def begin(self, state: Array) -> None:
        self.reference[:] = state

    def tune(self, lookahead_s: float, gain: float) -> None:
        self._lookahead_s, self._gain = lookahead_s, gain
        self.active = lookahead_s > 0.0 and gain > 0.0
        if self.active:
            self._step = transition(lookahead_s, gain, self._period_s)

    def follow(self, target: Array) -> None:
        if not self.active:
            self.reference[:] = target
            return
        off, velocity = self._step @ np.array([self.reference[0] - target[0], self.reference[1]])
        acceleration = -self._gain * (off + self._lookahead_s * velocity)
        self.reference[:] = off + target[0], velocity, acceleration


def transition(lookahead_s: float, gain: float, time_s: float) -> Array:
    """What becomes of (q - target, q') within a time, shape (2, 2): the exponential of the law's matrix.

    With A = [[0, 1], [-gain, -gain lookahead]], half its trace m and D = m² - gain,
    exp(A t) = exp(m t) (cosh(√D t) 1 + sinh(√D t) / √D (A - m 1)).
    """
    half = -0.5 * gain * lookahead_s
    root = np.emath.sqrt(half * half - gain)
    if abs(root) * time_s < 1e-9:
        even, odd = 1.0, time_s
    else:
        even, odd = np.cosh(root * time_s).real, (np.sinh(root * time_s) / root).real
    rest = np.array([[-half, 1.0], [-gain, half]])  # A - m 1
    return np.asarray(np.exp(half * time_s) * (even * np.eye(2) + odd * rest))
