"""What `rtloop.generators.target_estimate` computes, in numpy."""

from __future__ import annotations

import numpy as np

from cobot.types import Array

MAX_TARGETS = 64
CRUISE = 0.99
"""Of the velocity limit, for the velocity at a target: the rest is there to catch up with."""


def fit(count: int) -> Array:
    """Weights, shape (2, count), that give slope and curvature at the last of so many equidistant values.

    Of the parabola that fits them best; of the line, if there are two; zero, if there is one.
    """
    powers = np.vander(np.arange(1.0 - count, 1.0), min(count, 3), increasing=True)
    weights = np.zeros((3, count))
    weights[: powers.shape[1]] = np.linalg.pinv(powers)
    return weights[1:] * [[1.0], [2.0]]


FITS = [fit(count) if count else np.zeros((2, 0)) for count in range(MAX_TARGETS + 1)]


class Estimate:
    """What a stream does at its newest target. Real-time safe.

    A parabola is fitted to the newest targets, to three of them at the least. The mean velocity of the last
    interval alone would be right for half an interval ago: a reference that believes it has to speed up
    and slow down between any two commands as soon as the stream accelerates.

    Attributes:
        velocity, acceleration: at the newest target, each shape (n,), within the limits.
    """

    def __init__(self, max_velocity: Array, max_acceleration: Array, window_s: float) -> None:
        """From the targets of the last `window_s`: the longer, the less there is of the sender's noise."""
        n = len(max_velocity)
        self._window_s = window_s
        self._targets = np.zeros((MAX_TARGETS, n))  # the newest last
        self._relative = np.zeros((MAX_TARGETS, n))
        self._fit = np.zeros((2, n))
        self._bounds = np.stack([CRUISE * max_velocity, max_acceleration])
        self._scale = np.ones((2, 1))
        self.velocity, self.acceleration = self._fit
        self._known = 0

    @property
    def target(self) -> Array:
        """The newest one."""
        newest: Array = self._targets[-1]
        return newest

    def forget(self) -> None:
        """A new stream begins: its first target is one to rest at."""
        self._known = 0

    def rebase(self, target: Array) -> None:
        """The last target in other coordinates, of which only the origin counts."""
        self._targets += target - self._targets[-1]

    def update(self, target: Array, velocity: Array | None, duration_s: float) -> None:
        """Another target, one command period after the last; `velocity` is None or the sender's word."""
        self._targets[:-1] = self._targets[1:]
        self._targets[-1] = target
        window = max(3, min(round(self._window_s / duration_s) + 1, MAX_TARGETS))
        self._known = min(self._known + 1, window)
        np.subtract(self._targets, target, out=self._relative)  # exactly zero if nothing moves
        np.dot(FITS[self._known], self._relative[-self._known :], out=self._fit)
        self._scale[:, 0] = duration_s, duration_s * duration_s
        self._fit /= self._scale
        if velocity is not None:
            self.velocity[:] = velocity
        np.clip(self._fit, -self._bounds, self._bounds, out=self._fit)

    def extrapolate(self, ahead_s: float, out: Array) -> None:
        """Where the stream is so long after its newest target, shape (3, n)."""
        position, velocity, acceleration = out
        np.copyto(acceleration, self.acceleration)
        np.multiply(acceleration, ahead_s, out=velocity)
        velocity += self.velocity
        np.multiply(self.acceleration, -0.5 * ahead_s, out=position)
        position += velocity
        position *= ahead_s
        position += self._targets[-1]
