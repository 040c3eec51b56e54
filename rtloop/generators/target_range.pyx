"""Bounds on how far a stream's reference may go beyond its targets. See target_range.pyi."""

from libc.math cimport INFINITY, exp, fabs, fmax, fmin
from libc.string cimport memcpy, memset

import numpy as np

from cobot.arrays cimport checked_dof, doubles
from cobot.robot.quaternion cimport quat_between
from rtloop.generators.interpolation cimport plain

SHARE = 0.5
POSE_SHARE = 1.5
FADING_S = 2.0
STILL_S = 0.1
STILL_PERIODS = 2.5

cdef double ROUNDING = 1e-9  # rad; a smaller rotation is ignored.
cdef double STILL_AFTER_S = STILL_S, STILL_AFTER_PERIODS = STILL_PERIODS
# With a longer memory, faster steady streams can be followed without a lag. For example, a stream at 2 rad/s
# and 3 rad/s² needs 0.73 rad to stop.
cdef double FADING = FADING_S


cdef inline void add_step(double step, double fade, double* way, double* longest) noexcept nogil:
    """Add a step of the targets to the distance that they have moved in one direction. It is reset when they
    are back at their start.
    """
    way[0] = way[0] * fade + step
    longest[0] = fmax(longest[0] * fade, step)
    if way[0] <= 0.0:
        way[0] = longest[0] = 0.0


cdef class TargetRange:
    def __init__(self, int n, double period_s, double command_s, double share=SHARE):
        self.n, self.period_s, self.share = checked_dof(n), period_s, share
        self.c_expect(command_s)
        self.c_open()

    cdef void c_expect(self, double command_s) noexcept nogil:
        """Set the time until the next target is due."""
        self.still_after_s = fmax(STILL_AFTER_S, STILL_AFTER_PERIODS * command_s)

    cdef void c_begin(self, const double* position) noexcept nogil:
        """Begin a new stream at this position, which is initially the whole range."""
        cdef int i
        self.since_s = 0.0
        self.free = False
        for i in range(self.n):
            self.newest[i] = self.c_low[i] = self.c_high[i] = position[i]
            self.still_s[i] = 0.0
            self._forget(i)

    cdef void c_open(self) noexcept nogil:
        """Remove the bounds until the next `begin`."""
        cdef int i
        self.free = True
        for i in range(self.n):
            self.still_s[i] = 0.0
            self._open(i)

    cdef void c_open_at(self, const double* target) noexcept nogil:
        """Remove the bounds, except those of coordinates whose target is not moving."""
        cdef int i
        self.since_s = 0.0
        for i in range(self.n):
            if target[i] != self.newest[i]:
                self.still_s[i] = 0.0
            self.newest[i] = target[i]
            if self.still_s[i] < self.still_after_s:
                self._open(i)

    cdef void _open(self, int i) noexcept nogil:
        self.c_low[i], self.c_high[i] = -INFINITY, INFINITY
        self._forget(i)

    cdef void _forget(self, int i) noexcept nogil:
        """Forget the distance so far, because it belongs to an earlier motion."""
        self.rise[i] = self.fall[i] = self.longest_rise[i] = self.longest_fall[i] = 0.0

    cdef void c_update(self, const double* target) noexcept nogil:
        cdef double fade = exp(-self.since_s / FADING), step, before
        cdef int i
        self.since_s = 0.0
        for i in range(self.n):
            before = self.newest[i]
            step = target[i] - before
            self.newest[i] = target[i]
            if step != 0.0:
                self.still_s[i] = 0.0
            if self.free:
                continue
            if self.c_low[i] == -INFINITY:  # because the sender no longer states a motion
                self.c_low[i] = self.c_high[i] = before
            add_step(step, fade, &self.rise[i], &self.longest_rise[i])
            add_step(-step, fade, &self.fall[i], &self.longest_fall[i])
            if step > 0.0:
                self.c_high[i] = target[i] + self.share * fmax(self.rise[i] - self.longest_rise[i], 0.0)
                self.c_low[i] = fmin(self.c_low[i], target[i])
            elif step < 0.0:
                self.c_low[i] = target[i] - self.share * fmax(self.fall[i] - self.longest_fall[i], 0.0)
                self.c_high[i] = fmax(self.c_high[i], target[i])

    cdef void c_include(self, const double* target) noexcept nogil:
        """Include a target that is known in advance, so that the reference may go as far as this target."""
        cdef int i
        for i in range(self.n):
            self.c_low[i], self.c_high[i] = fmin(self.c_low[i], target[i]), fmax(self.c_high[i], target[i])

    cdef bint c_stands(self, int i, double target) noexcept nogil:
        """Whether this is the newest target of a coordinate and is not moving."""
        return target == self.newest[i] and self.still_s[i] >= self.still_after_s

    cdef void c_advance(self) noexcept nogil:
        cdef int i
        self.since_s += self.period_s
        for i in range(self.n):
            self.still_s[i] += self.period_s
            if self.free or self.still_s[i] < self.still_after_s:
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

    def extend(self, target):
        there = plain(target, (self.n,))
        self.c_include(doubles(there, self.n))

    def open_at(self, target):
        there = plain(target, (self.n,))
        self.c_open_at(doubles(there, self.n))

    def expect(self, double command_s):
        self.c_expect(command_s)

    def update(self, target):
        there = plain(target, (self.n,))
        self.c_update(doubles(there, self.n))

    def advance(self):
        self.c_advance()


cdef class PoseRange:
    def __init__(self, double period_s, double command_s, double share=POSE_SHARE):
        self.chart = TargetRange(6, period_s, command_s, share)
        self.newest[3] = 1.0

    cdef void c_begin(self, const double* pose) noexcept nogil:
        """Begin a new stream at this pose."""
        cdef double there[6]
        memcpy(self.newest, pose, 7 * sizeof(double))
        memcpy(there, pose, 3 * sizeof(double))
        memset(there + 3, 0, 3 * sizeof(double))
        self.chart.c_begin(there)

    cdef void c_open(self) noexcept nogil:
        """Remove the bounds until the next `begin`."""
        self.chart.c_open()

    cdef void c_update(self, const double* pose, bint states_motion) noexcept nogil:
        cdef double there[6]
        cdef int i
        quat_between(self.newest + 3, pose + 3, there + 3)
        for i in range(3):
            there[i] = pose[i]
            there[3 + i] = self.chart.newest[3 + i] + (there[3 + i] if fabs(there[3 + i]) > ROUNDING else 0.0)
        memcpy(self.newest, pose, 7 * sizeof(double))
        if states_motion:
            self.chart.c_open_at(there)
        else:
            self.chart.c_update(there)

    cdef void c_advance(self) noexcept nogil:
        self.chart.c_advance()

    cdef bint c_stands(self, const double* pose) noexcept nogil:
        """Whether this is the newest pose and is not moving."""
        cdef int i
        for i in range(7):
            if pose[i] != self.newest[i]:
                return False
        for i in range(6):
            if not self.chart.c_stands(i, self.chart.newest[i]):
                return False
        return True

    cdef void c_room(self, const double* pose, double* low, double* high) noexcept nogil:
        """Calculate the distance of a pose to the lower and upper bounds, (6,) each: m, and rad about the
        axes of the base frame.
        """
        cdef double off[6]
        cdef int i
        for i in range(3):
            off[i] = pose[i] - self.newest[i]
        quat_between(self.newest + 3, pose + 3, off + 3)
        for i in range(6):
            low[i] = self.chart.c_low[i] - self.chart.newest[i] - off[i]
            high[i] = self.chart.c_high[i] - self.chart.newest[i] - off[i]

    def begin(self, pose):
        here = plain(pose, (7,))
        self.c_begin(doubles(here, 7))

    def update(self, pose, bint states_motion=False):
        there = plain(pose, (7,))
        self.c_update(doubles(there, 7), states_motion)

    def advance(self):
        self.c_advance()

    def stands(self, pose):
        there = plain(pose, (7,))
        return bool(self.c_stands(doubles(there, 7)))

    def room(self, pose):
        here, low, high = plain(pose, (7,)), np.empty(6), np.empty(6)
        self.c_room(doubles(here, 7), doubles(low, 6), doubles(high, 6))
        return low, high
