"""The planned path that is being executed: piecewise quintics P(s) of the path time s."""

from libc.math cimport fabs, fmin, isfinite
from libc.string cimport memcmp

import numpy as np

from cobot.arrays cimport checked_dof, doubles

cdef enum:
    PARTS = 8  # Number of parts of a segment at whose ends the position is checked.


cdef class Path:
    def __cinit__(self, Py_ssize_t capacity, Py_ssize_t dof):
        self.capacity, self.dof = capacity, checked_dof(dof)
        self.breakpoints_s = np.zeros(capacity + 1)
        self.coefficients = np.zeros((capacity, dof, ORDER))
        self.c_breakpoints_s = doubles(self.breakpoints_s, capacity + 1)
        self.c_coefficients = doubles(self.coefficients, capacity * dof * ORDER)

    def begin(self, Py_ssize_t segments):
        self._require(segments - 1, segments)
        self.segments, self.index = segments, 0
        self.duration_s = self.c_breakpoints_s[segments]

    def evaluate(self, double path_time_s, double rate, double slope, out):
        self.c_evaluate(path_time_s, rate, slope, doubles(out, 3 * self.dof))

    def sample(self, times_s):
        values = np.zeros((len(times_s), 3, self.dof))
        for time_s, out in zip(times_s, values, strict=True):
            self.c_sample(time_s, doubles(out, 3 * self.dof))
        return values.transpose(1, 0, 2)

    def breakpoints(self, double from_s, double to_s):
        cdef double found[MAX_BREAKPOINTS]
        cdef int i, count = self.c_breakpoints(from_s, to_s, found)
        return np.array([found[i] for i in range(count)])

    def continues(self, Path old not None, double offset_s, double from_s, double until_s):
        if old.dof != self.dof:
            raise ValueError(f"a path of {old.dof} joints for one of {self.dof}")
        return self.c_continues(old, offset_s, from_s, until_s)

    def increases(self, Py_ssize_t begin, Py_ssize_t end):
        cdef Py_ssize_t i
        cdef double* times = self.c_breakpoints_s
        self._require(begin, end - 1)
        for i in range(begin, end):
            if not isfinite(times[i]) or (times[i] <= times[i - 1] if i > 0 else times[i] != 0.0):
                return False
        return True

    def is_finite(self, Py_ssize_t begin, Py_ssize_t end):
        cdef Py_ssize_t i
        self._require(begin, end)
        for i in range(begin * self.dof * ORDER, end * self.dof * ORDER):
            if not isfinite(self.c_coefficients[i]):
                return False
        return True

    def stays_within(self, Py_ssize_t begin, Py_ssize_t end, low, high):
        cdef Py_ssize_t segment
        cdef int joint
        cdef double* lowest = doubles(low, self.dof)
        cdef double* highest = doubles(high, self.dof)
        cdef double* c
        cdef double length, reach
        self._require(begin, end)
        for segment in range(begin, end):
            length = self.c_breakpoints_s[segment + 1] - self.c_breakpoints_s[segment]
            for joint in range(self.dof):
                c = self.c_coefficients + (segment * self.dof + joint) * ORDER
                reach = _reach(c, length)
                if lowest[joint] <= c[0] - reach and c[0] + reach <= highest[joint]:
                    continue
                if not _places_within(c, length, lowest[joint], highest[joint]):
                    return False
        return True

    cdef void c_evaluate(self, double path_time_s, double rate, double slope, double* out) noexcept nogil:
        """Evaluate the joints at a path time that is not before the last one: P, P' r and P'' r² + P' r'."""
        cdef int joint
        cdef double u, first, second
        cdef double* c
        while self.index < self.segments - 1 and path_time_s >= self.c_breakpoints_s[self.index + 1]:
            self.index += 1
        u = path_time_s - self.c_breakpoints_s[self.index]
        for joint in range(self.dof):
            c = self.c_coefficients + (self.index * self.dof + joint) * ORDER
            first, second = _first(c, u), _second(c, u)
            out[joint] = _position(c, u)
            out[self.dof + joint] = first * rate
            out[2 * self.dof + joint] = second * (rate * rate) + first * slope

    cdef void c_sample(self, double path_time_s, double* out) noexcept nogil:
        """Calculate the first to third derivative at a path time, shape (3, dof); zero beyond the end."""
        cdef int joint
        cdef double inside = fmin(path_time_s, self.duration_s), u
        cdef Py_ssize_t segment = self._breakpoints_before(inside, True) - 1
        cdef double* c
        segment = max(min(segment, self.segments - 1), 0)
        u = inside - self.c_breakpoints_s[segment]
        for joint in range(self.dof):
            c = self.c_coefficients + (segment * self.dof + joint) * ORDER
            out[joint] = _first(c, u)
            out[self.dof + joint] = _second(c, u)
            out[2 * self.dof + joint] = _third(c, u) if path_time_s < self.duration_s else 0.0

    cdef bint c_continues(self, Path old, double offset_s, double from_s, double until_s) noexcept nogil:
        """Whether this path, between two of its path times, equals `old` bit for bit at times that are later
        by the offset.
        """
        cdef Py_ssize_t here = max(self._breakpoints_before(from_s, True) - 1, 0), there
        cdef size_t piece = self.dof * ORDER
        cdef double* mine = self.c_breakpoints_s
        cdef double* olds = old.c_breakpoints_s
        if here >= self.segments:
            return False
        there = max(old._breakpoints_before(mine[here] + offset_s, False) - 1, 0)
        # because the sum above is rounded
        while there < old.segments and olds[there] - offset_s < mine[here]:
            there += 1
        while there < old.segments and olds[there] - offset_s == mine[here]:
            if memcmp(
                self.c_coefficients + here * piece, old.c_coefficients + there * piece, piece * sizeof(double)
            ):
                return False
            here, there = here + 1, there + 1
            if mine[here] >= until_s and olds[there] - offset_s >= until_s:
                return True
            if here == self.segments:
                return False
        return False

    cdef int c_breakpoints(self, double from_s, double to_s, double* out) noexcept nogil:
        """Collect up to `MAX_BREAKPOINTS` breakpoints between two path times. Returns their number."""
        cdef Py_ssize_t begin = self._breakpoints_before(from_s, False)
        cdef Py_ssize_t end = self._breakpoints_before(to_s, False)
        cdef Py_ssize_t every = 1 + max(end - begin, 0) // MAX_BREAKPOINTS
        cdef int count = 0
        while begin < end and count < MAX_BREAKPOINTS:
            out[count] = self.c_breakpoints_s[begin]
            count += 1
            begin += every
        return count

    cdef Py_ssize_t _breakpoints_before(self, double path_time_s, bint including) noexcept nogil:
        """Return the number of breakpoints before a path time, optionally including those exactly at it."""
        cdef Py_ssize_t low = 0, high = self.segments + 1, middle
        cdef double found
        while low < high:
            middle = (low + high) // 2
            found = self.c_breakpoints_s[middle]
            if found < path_time_s or (including and found == path_time_s):
                low = middle + 1
            else:
                high = middle
        return low

    cdef int _require(self, Py_ssize_t begin, Py_ssize_t end) except -1:
        if not 0 <= begin <= end <= self.capacity:
            raise ValueError(f"a path of {self.capacity} segments has none from {begin} to {end}")
        return 0


cdef inline double _position(const double* c, double u) noexcept nogil:
    return c[0] + u * (c[1] + u * (c[2] + u * (c[3] + u * (c[4] + u * c[5]))))


cdef inline double _first(const double* c, double u) noexcept nogil:
    return c[1] + u * (2.0 * c[2] + u * (3.0 * c[3] + u * (4.0 * c[4] + u * (5.0 * c[5]))))


cdef inline double _second(const double* c, double u) noexcept nogil:
    return 2.0 * c[2] + u * (6.0 * c[3] + u * (12.0 * c[4] + u * (20.0 * c[5])))


cdef inline double _third(const double* c, double u) noexcept nogil:
    return 6.0 * c[3] + u * (24.0 * c[4] + u * (60.0 * c[5]))


cdef inline double _reach(const double* c, double u) noexcept nogil:
    """Return a fast upper bound of the distance from the segment's start to u."""
    return u * (
        fabs(c[1]) + u * (fabs(c[2]) + u * (fabs(c[3]) + u * (fabs(c[4]) + u * fabs(c[5]))))
    )


cdef bint _places_within(const double* c, double length, double lowest, double highest) noexcept nogil:
    cdef int part
    for part in range(PARTS + 1):
        if not lowest <= _position(c, length * part / PARTS) <= highest:
            return False
    return True
