"""What `rtloop.planned.path` does, said with numpy."""

from __future__ import annotations

import numpy as np

from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array

MAX_BREAKPOINTS = 24
"""That a stop looks at: where they are closer together, the path is smooth between them."""


def _derivative_maps() -> Array:
    """Shape (6, 18): powers of the time (6,) @ this = what each coefficient adds to each derivative."""
    maps = np.zeros((ORDER, ORDER, 3))  # power, coefficient, derivative
    for coefficient in range(ORDER):
        factor = 1.0
        for derivative in range(3):
            factor *= coefficient - derivative
            if coefficient > derivative:
                maps[coefficient - derivative - 1, coefficient, derivative] = factor
    return maps.reshape(ORDER, ORDER * 3)


_DERIVATIVES = _derivative_maps()


class Path:
    """Piecewise quintics.

    Attributes:
        duration_s: path time at the end.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self._times = trajectory.breakpoints_s
        self._coefficients = trajectory.coefficients
        self._segments = trajectory.segments
        self.duration_s = trajectory.duration_s

    def evaluate(self, times_s: Array, rates: Array, slopes: Array) -> Array:
        """Shape (n, 3, dof): P, P' r and P'' r² + P' r'."""
        last = self._segments
        index = np.searchsorted(self._times[1:last], times_s, side="right")
        u = (times_s - self._times[index])[:, None]
        powers = u ** np.arange(ORDER)
        position = np.einsum("njk,nk->nj", self._coefficients[index], powers)
        first, second, _ = self.sample(times_s)
        rate, slope = rates[:, None], slopes[:, None]
        return np.stack([position, first * rate, second * rate**2 + first * slope], axis=1)

    def breakpoints(self, from_s: float, to_s: float) -> Array:
        """The path's breakpoints between two path times, at the most `MAX_BREAKPOINTS` of them."""
        times = self._times[: self._segments + 1]
        begin, end = np.searchsorted(times, (from_s, to_s))
        return times[begin : end : 1 + (end - begin) // MAX_BREAKPOINTS]

    def sample(self, times_s: Array) -> Array:
        """First to third derivative at path times, shape (3, n, dof); at rest past the end."""
        inside = np.minimum(times_s, self.duration_s)
        last = self._segments
        index = np.searchsorted(self._times[1:last], inside, side="right")
        powers = np.empty((len(times_s), ORDER))
        powers[:, 0] = 1.0
        powers[:, 1:] = (inside - self._times[index])[:, None]
        np.multiply.accumulate(powers, axis=1, out=powers)
        basis = np.dot(powers, _DERIVATIVES).reshape(-1, ORDER, 3)
        values = np.matmul(self._coefficients[index], basis)
        values[times_s >= self.duration_s, :, 2] = 0.0
        return np.asarray(values.transpose(2, 0, 1))
