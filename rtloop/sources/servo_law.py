"""How a pass-through servo mode follows its targets: the law of lookahead time and gain.

    q'' = gain (target - (q + lookahead q'))

The position that the arm would have after the lookahead time is drawn to the target, as UR documents its
servoj: the higher the gain (1/s²), the faster the reaction; the longer the lookahead time (s), the less
overshoot. With ω = √gain it is a filter of second order with the damping ratio ω lookahead / 2: it follows
a ramp with a lag of the lookahead time, and reaches a target without error.
"""

from __future__ import annotations

from math import cos, cosh, exp, sin, sinh, sqrt

import numpy as np

from cobot.types import Array


class ServoLaw:
    """The law, solved exactly for a target that stands still within a cycle. Real-time safe.

    Attributes:
        reference: shape (3, n): rad, rad/s, rad/s².
        active: whether the law is applied; if not, the reference is the target.
    """

    def __init__(self, n: int, period_s: float) -> None:
        self.reference = np.zeros((3, n))
        self.active = False
        self._period_s = period_s
        self._lookahead_s = self._gain = 0.0
        self._step = np.eye(2)
        self._state = np.zeros((2, n))

    def begin(self, state: Array) -> None:
        """Start here, shape (3, n)."""
        np.copyto(self.reference, state)

    def tune(self, lookahead_s: float, gain: float) -> None:
        """Follow like this from now on; zero for none."""
        if lookahead_s == self._lookahead_s and gain == self._gain:
            return
        self._lookahead_s, self._gain = lookahead_s, gain
        self.active = lookahead_s > 0.0 and gain > 0.0
        if self.active:
            self._step[:] = transition(lookahead_s, gain, self._period_s)

    def follow(self, target: Array) -> None:
        """One period on, towards a target, shape (3, n)."""
        if not self.active:
            np.copyto(self.reference, target)
            return
        position, velocity, acceleration = self.reference
        np.subtract(position, target[0], out=self._state[0])
        self._state[1] = velocity
        np.dot(self._step, self._state, out=self.reference[:2])
        np.multiply(self._lookahead_s, velocity, out=acceleration)
        acceleration += position  # still relative to the target
        acceleration *= -self._gain
        position += target[0]


def transition(lookahead_s: float, gain: float, time_s: float) -> Array:
    """What becomes of (q - target, q') within a time, shape (2, 2): the exponential of the law's matrix.

    With A = [[0, 1], [-gain, -gain lookahead]], half its trace m and D = m² - gain,
    exp(A t) = exp(m t) (cosh(√D t) 1 + sinh(√D t) / √D (A - m 1)).
    """
    half = -0.5 * gain * lookahead_s
    discriminant = half * half - gain
    root = sqrt(abs(discriminant))
    if root * time_s < 1e-9:
        even, odd = 1.0, time_s
    elif discriminant > 0.0:
        even, odd = cosh(root * time_s), sinh(root * time_s) / root
    else:
        even, odd = cos(root * time_s), sin(root * time_s) / root
    rest = np.array([[-half, 1.0], [-gain, half]])  # A - m 1
    return np.asarray(exp(half * time_s) * (even * np.eye(2) + odd * rest))
