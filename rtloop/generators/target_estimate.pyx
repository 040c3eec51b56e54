"""Estimates the velocity and acceleration of a stream of targets at its newest target."""

from libc.math cimport fmin, rint
from libc.string cimport memmove

import numpy as np

from cobot.arrays cimport doubles
from rtloop.generators.interpolation cimport clipped, copy_row, plain

# Velocity at which a target is passed, as a share of the limit. The rest of the limit is for catching up.
cdef double CRUISE = 0.99


def fit(int count):
    """Return the weights, shape (2, count), for the slope and curvature at the last of `count` evenly spaced
    values.

    They are for the best-fitting parabola; with two values for a line; with one value they are zero.
    """
    powers = np.vander(np.arange(1.0 - count, 1.0), min(count, 3), increasing=True)
    weights = np.zeros((3, count))
    weights[: powers.shape[1]] = np.linalg.pinv(powers)
    return weights[1:] * [[1.0], [2.0]]


def _fits():
    """Return the weights for each count, shape (MAX_TARGETS + 1, 2, MAX_TARGETS), zero beyond the count."""
    table = np.zeros((MAX_TARGETS + 1, 2, MAX_TARGETS))
    for count in range(1, MAX_TARGETS + 1):
        table[count, :, :count] = fit(count)
    return table


FITS = _fits()
cdef double* c_fits = doubles(FITS, (MAX_TARGETS + 1) * 2 * MAX_TARGETS)


cdef class Estimate:
    """The motion of a stream at its newest target. Real-time safe. See target_estimate.pyi."""

    def __init__(self, max_velocity, max_acceleration, double window_s):
        self.n, self.window_s = len(max_velocity), window_s
        self.newest = &self.targets[MAX_TARGETS - 1][0]
        copy_row(self.max_velocity, CRUISE * np.asarray(max_velocity), self.n)
        copy_row(self.max_acceleration, max_acceleration, self.n)

    cdef void c_forget(self) noexcept nogil:
        """Begin a new stream, which is at rest at its first target."""
        self.known = 0

    cdef void c_rebase(self, const double* target) noexcept nogil:
        """Replace the last target with its value in other coordinates. Only the shift of the origin
        matters.
        """
        cdef double shift
        cdef int i, row
        for i in range(self.n):
            shift = target[i] - self.newest[i]
            for row in range(MAX_TARGETS - max(self.known, 1), MAX_TARGETS):
                self.targets[row][i] += shift

    cdef void c_update(self, const double* target, const double* velocity, double duration_s) noexcept nogil:
        """Add a target, one command period after the last one. `velocity` is NULL or the velocity stated by
        the client.
        """
        cdef int window = max(3, <int>fmin(rint(self.window_s / duration_s) + 1.0, MAX_TARGETS))
        cdef int i, row, first
        cdef const double* weights
        cdef double slope, curvature, off
        first = MAX_TARGETS - min(self.known + 1, MAX_TARGETS)
        memmove(
            self.targets[first], self.targets[first + 1], (MAX_TARGETS - 1 - first) * sizeof(self.targets[0])
        )
        self.known = min(self.known + 1, window)
        first = MAX_TARGETS - self.known
        weights = c_fits + 2 * MAX_TARGETS * self.known
        for i in range(self.n):
            self.newest[i] = target[i]
            slope = curvature = 0.0
            for row in range(self.known):
                off = self.targets[first + row][i] - target[i]  # exactly zero if nothing moves
                slope += weights[row] * off
                curvature += weights[MAX_TARGETS + row] * off
            slope = slope / duration_s if velocity == NULL else velocity[i]
            self.c_velocity[i] = clipped(slope, self.max_velocity[i])
            self.c_acceleration[i] = clipped(curvature / (duration_s * duration_s), self.max_acceleration[i])

    cdef void c_extrapolate(self, double ahead_s, double* out) noexcept nogil:
        """Extrapolate the stream by this time after its newest target, (3, n)."""
        cdef double velocity, acceleration
        cdef int i, n = self.n
        for i in range(n):
            acceleration = self.c_acceleration[i]
            velocity = acceleration * ahead_s + self.c_velocity[i]
            out[i] = (velocity - 0.5 * ahead_s * acceleration) * ahead_s + self.newest[i]
            out[n + i], out[2 * n + i] = velocity, acceleration

    cdef bint c_moves(self) noexcept nogil:
        """Whether the velocity at the newest target is not zero."""
        cdef int i
        for i in range(self.n):
            if self.c_velocity[i] != 0.0:
                return True
        return False

    @property
    def target(self):
        return np.array(self.targets[MAX_TARGETS - 1])[: self.n]

    @property
    def velocity(self):
        return np.array(self.c_velocity)[: self.n]

    @property
    def acceleration(self):
        return np.array(self.c_acceleration)[: self.n]

    def forget(self):
        self.c_forget()

    def rebase(self, target):
        last = plain(target, (self.n,))
        self.c_rebase(doubles(last, self.n))

    def update(self, target, velocity, double duration_s):
        there = plain(target, (self.n,))
        stated = None if velocity is None else plain(velocity, (self.n,))
        self.c_update(doubles(there, self.n), NULL if stated is None else doubles(stated, self.n), duration_s)

    def extrapolate(self, double ahead_s, out):
        self.c_extrapolate(ahead_s, doubles(out, 3 * self.n))
