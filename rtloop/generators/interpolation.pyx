"""A reference for every cycle, calculated from commands that arrive less often.

The kinds differ in how the reference moves until the next command is due: not at all (`Hold`), at constant
velocity (`Linear`), on a smooth polynomial (`Quintic`), or on the fastest profile within the limits of
velocity, acceleration and jerk (`OnlineTrajectory`). The coordinates are joints (rad) or a chart of poses; SI
units.
"""

from libc.string cimport memcpy, memmove

import numpy as np

from cobot.arrays cimport checked_dof, doubles

# A command period that ends later than a cycle by at most this share of the cycle is treated as ending with
# it.
cdef double EARLY = 1e-6
cdef double GRACE_SHARE = 0.25
cdef double GRACE_S = 0.002


cdef double grace_s(double duration_s) noexcept nogil:
    """Return how long a stream with this period continues without a command, s. A command that is late by
    less does not disturb the motion.
    """
    return GRACE_SHARE * duration_s + GRACE_S


cdef object plain(object values, tuple shape):
    """Return a copy for compiled code: contiguous, of float64."""
    copy = np.empty(shape)
    copy[...] = values
    return copy


cdef void copy_row(double* into, object values, Py_ssize_t size) except *:
    """Copy this number of values from an array, or repeat a single number."""
    row = plain(values, (size,))
    memcpy(into, doubles(row, size), size * sizeof(double))


cdef class Interpolator:
    """Turns commands into references. Real-time safe. See interpolation.pyi.

    The C methods take arrays of shape (3, n) as three consecutive rows. A velocity may be NULL.
    """

    def __cinit__(self, int n, double period_s, *args):
        self.n, self.period_s = checked_dof(n), period_s
        self.reference = np.zeros((3, n))
        self.ref = doubles(self.reference, 3 * n)

    cdef void c_begin(self, const double* state) noexcept nogil:
        """Start from this state without commands, and hold. A moving reference is brought to rest."""

    cdef void c_rebase(self, const double* state, const double* target) noexcept nogil:
        """Replace the current reference and the last target with their values in other coordinates. Must be
        followed by an `aim`.
        """
        memmove(self.ref, state, 3 * self.n * sizeof(double))

    cdef void c_aim(self, const double* target, const double* velocity, double duration_s) noexcept nogil:
        """Accept a new command, to be reached in `duration_s`, which is one command period."""

    cdef void c_advance(self) noexcept nogil:
        """Advance by one period."""

    def begin(self, state):
        copy = plain(state, (3, self.n))
        self.c_begin(doubles(copy, 3 * self.n))

    def rebase(self, state, target):
        here, last = plain(state, (3, self.n)), plain(target, (self.n,))
        self.c_rebase(doubles(here, 3 * self.n), doubles(last, self.n))

    def aim(self, target, velocity, double duration_s):
        there = plain(target, (self.n,))
        if velocity is None:
            self.c_aim(doubles(there, self.n), NULL, duration_s)
            return
        with_velocity = plain(velocity, (self.n,))
        self.c_aim(doubles(there, self.n), doubles(with_velocity, self.n), duration_s)

    def advance(self):
        self.c_advance()


cdef class Hold(Interpolator):
    """No interpolation: the reference is the newest target."""

    cdef void c_begin(self, const double* state) noexcept nogil:
        memmove(self.ref, state, 3 * self.n * sizeof(double))
        self.left_s = 0.0

    cdef void c_aim(self, const double* target, const double* velocity, double duration_s) noexcept nogil:
        cdef int i, n = self.n
        for i in range(n):
            self.ref[i] = target[i]
            self.ref[n + i] = 0.0 if velocity == NULL else velocity[i]
            self.ref[2 * n + i] = 0.0
        self.left_s = max(duration_s, self.period_s)

    cdef void c_advance(self) noexcept nogil:
        cdef int i
        self.left_s -= self.period_s
        if self.left_s < -EARLY * self.period_s:
            for i in range(self.n, 3 * self.n):
                self.ref[i] = 0.0  # a silent client must not move the arm


cdef class Linear(Interpolator):
    """Moves at constant velocity from the current reference to the target, within one command period, and
    then rests.
    """

    cdef void c_begin(self, const double* state) noexcept nogil:
        memmove(self.ref, state, 3 * self.n * sizeof(double))
        memcpy(self.target, self.ref, self.n * sizeof(double))
        self.cycle, self.cycles = 0, 0.0

    cdef void c_aim(self, const double* target, const double* velocity, double duration_s) noexcept nogil:
        cdef int i
        duration_s = max(duration_s, self.period_s)
        for i in range(self.n):
            self.start[i], self.target[i] = self.ref[i], target[i]
            self.way[i] = target[i] - self.start[i]
            self.velocity[i] = self.way[i] / duration_s
        self.cycle, self.cycles = 0, duration_s / self.period_s

    cdef void c_advance(self) noexcept nogil:
        # If a period ends within a cycle, the reference arrives with that cycle, still moving.
        cdef bint moving = self.cycle < self.cycles - EARLY
        cdef double share
        cdef int i, n = self.n
        self.cycle += 1
        share = self.cycle / self.cycles if self.cycle < self.cycles - EARLY else 1.0
        for i in range(n):
            self.ref[i] = self.way[i] * share + self.start[i] if share < 1.0 else self.target[i]
            self.ref[n + i] = self.velocity[i] if moving else 0.0
            self.ref[2 * n + i] = 0.0
