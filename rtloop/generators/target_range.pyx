"""How far a stream's reference may go beyond its targets. See target_range.pyi."""

from libc.math cimport INFINITY, exp, fmax, fmin

import numpy as np

from cobot.arrays cimport checked_dof, doubles
from rtloop.generators.interpolation cimport plain

SHARE = 0.5
FADING_S = 2.0
STILL_S = 0.1
STILL_PERIODS = 2.5

cdef double ALLOWED = SHARE
cdef double STILL_AFTER_S = STILL_S, STILL_AFTER_PERIODS = STILL_PERIODS
# The longer the memory, the faster a steady stream may be until it is followed with a lag: 2 rad/s at
# 3 rad/s² need 0.73 rad to stop.
cdef double FADING = FADING_S


cdef inline void add_step(double step, double fade, double* way, double* longest) noexcept nogil:
    """A step of the targets, added to their way in one direction; the way ends where they are back at its
    start."""
    way[0] = way[0] * fade + step
    longest[0] = fmax(longest[0] * fade, step)
    if way[0] <= 0.0:
        way[0] = longest[0] = 0.0


cdef class TargetRange:
    def __init__(self, int n, double period_s, double command_s):
        self.n, self.period_s = checked_dof(n), period_s
        self.c_expect(command_s)
        self.c_open()

    cdef void c_expect(self, double command_s) noexcept nogil:
        """The next target is due in this time."""
        self.still_after_s = fmax(STILL_AFTER_S, STILL_AFTER_PERIODS * command_s)

    cdef void c_begin(self, const double* position) noexcept nogil:
        """A new stream begins here: nothing beyond this position is a target yet."""
        cdef int i
        self.since_s = 0.0
        for i in range(self.n):
            self.newest[i] = self.c_low[i] = self.c_high[i] = position[i]
            self._forget(i)

    cdef void c_open(self) noexcept nogil:
        """No bounds until the next `begin`."""
        cdef int i
        self.since_s = 0.0
        for i in range(self.n):
            self.c_low[i], self.c_high[i] = -INFINITY, INFINITY
            self.newest[i] = 0.0
            self._forget(i)
            self.still_s[i] = -INFINITY

    cdef void _forget(self, int i) noexcept nogil:
        """The targets so far were those of another motion."""
        self.still_s[i] = self.rise[i] = self.fall[i] = self.longest_rise[i] = self.longest_fall[i] = 0.0

    cdef void c_update(self, const double* target) noexcept nogil:
        cdef double fade = exp(-self.since_s / FADING), step
        cdef int i
        self.since_s = 0.0
        for i in range(self.n):
            step = target[i] - self.newest[i]
            self.newest[i] = target[i]
            add_step(step, fade, &self.rise[i], &self.longest_rise[i])
            add_step(-step, fade, &self.fall[i], &self.longest_fall[i])
            if step > 0.0:
                self.c_high[i] = target[i] + ALLOWED * fmax(self.rise[i] - self.longest_rise[i], 0.0)
                self.c_low[i] = fmin(self.c_low[i], target[i])
            elif step < 0.0:
                self.c_low[i] = target[i] - ALLOWED * fmax(self.fall[i] - self.longest_fall[i], 0.0)
                self.c_high[i] = fmax(self.c_high[i], target[i])
            else:
                continue
            self.still_s[i] = 0.0

    cdef void c_advance(self) noexcept nogil:
        cdef int i
        self.since_s += self.period_s
        for i in range(self.n):
            self.still_s[i] += self.period_s
            if self.still_s[i] < self.still_after_s:
                continue
            self.c_low[i] = self.c_high[i] = self.newest[i]
            self._forget(i)

    @property
    def low(self):
        return np.array(self.c_low)[: self.n]

    @property
    def high(self):
        return np.array(self.c_high)[: self.n]

    def begin(self, position):
        here = plain(position, (self.n,))
        self.c_begin(doubles(here, self.n))

    def open(self):
        self.c_open()

    def expect(self, double command_s):
        self.c_expect(command_s)

    def update(self, target):
        there = plain(target, (self.n,))
        self.c_update(doubles(there, self.n))

    def advance(self):
        self.c_advance()
