"""Action chunks: a policy sends its next waypoints, each with the time at which to reach it.

The reference follows a cubic spline through the waypoints. When a new chunk replaces the old one, a quintic
leads from the current reference to the first waypoint that can be reached within the limits. It matches
velocity and acceleration at both ends, so the reference is continuous up to the acceleration.
"""

from libc.math cimport INFINITY, isfinite
from libc.string cimport memcpy, memmove

import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from cobot.polynomials cimport quintic_at, quintic_between, quintic_peaks
from rtloop.generators.brake cimport Brake
from rtloop.generators.interpolation cimport copy_row, plain

from cobot.errors import InputError
from rtloop.results import ACCEPTED, Rejected

cdef enum:
    PLACES = 11  # Number of places of a blend at which velocity, acceleration and jerk are checked.

# A relative difference. The last two waypoints have the same acceleration, so without it rounding would
# decide between them.
cdef double TIE = 1e-9


cdef class ChunkInterpolator:
    """Follows chunks of waypoints. Real-time safe. See chunks.pyi."""

    def __init__(self, int n, double period_s, max_velocity, max_acceleration, max_jerk):
        self.n, self.period_s = checked_dof(n), period_s
        self.reference = np.zeros((3, n))
        self.waypoints, self.quintics = np.zeros((MAX_WAYPOINTS, 3, n)), np.zeros((MAX_WAYPOINTS, 6, n))
        self.ref = doubles(self.reference, 3 * n)
        self.ends = doubles(self.waypoints, MAX_WAYPOINTS * 3 * n)
        self.coefficients = doubles(self.quintics, MAX_WAYPOINTS * 6 * n)
        for row, bound in enumerate((max_velocity, max_acceleration, max_jerk)):
            copy_row(self.bounds[<int>row], bound, n)
        self.brake = Brake(period_s, max_acceleration, max_jerk)
        self._start_brake()

    cdef void c_begin(self, const double* state) noexcept nogil:
        """Start from this state, (3, n), without waypoints, and hold. A moving reference is brought to
        rest.
        """
        memmove(self.ref, state, 3 * self.n * sizeof(double))
        self.count = 0
        self._start_brake()

    cdef int c_take(
        self, const double* times_s, const double* points, int count, double now_s
    ) noexcept nogil:
        """Replace the waypoints ahead with these, (count,) and (count, n), from the first one that is not in
        the past.

        Returns:
            `CHUNK_TAKEN`, or the reason for a rejection as a number. A rejection changes only `late`.
        """
        # A waypoint that is due within this period is past: no motion can reach it in time.
        cdef double soon_s = now_s + self.period_s
        cdef double step_s
        cdef int first = 0, end, ahead, begin, i, n = self.n
        self.refused = self._flaw(times_s, points, count)
        if self.refused:
            return self.refused
        while first < count and times_s[first] < soon_s:
            first += 1
        self.late += first
        if first == count:
            self.refused, self.refused_count = CHUNK_PAST, first
            self.refused_s = now_s - times_s[count - 1]
            return self.refused
        # Old waypoints remain up to half a step before the first new one; closer ones may contradict it.
        step_s = times_s[first + 1] - times_s[first] if count - first > 1 else 2.0 * self.period_s
        end = self._index(times_s[first] - 0.5 * step_s)
        ahead = min(self._index(soon_s), end)
        begin = max(ahead - SUPPORT, 0)
        if end - ahead > MAX_CHUNK:
            self.refused, self.refused_count = CHUNK_FULL, end - ahead
            return self.refused
        memmove(self.times_s, self.times_s + begin, (end - begin) * sizeof(double))
        memmove(self.ends, self.ends + 3 * n * begin, 3 * n * (end - begin) * sizeof(double))
        self.count = end - begin
        for i in range(first, count):
            self.times_s[self.count] = times_s[i]
            memcpy(self.ends + 3 * n * self.count, points + n * i, n * sizeof(double))
            self.count += 1
        spline_rates(self.times_s, self.count, n, self.ends)
        self._connect(now_s, ahead - begin)
        return CHUNK_TAKEN

    cdef void c_advance(self, double now_s) noexcept nogil:
        """Calculate the reference for this time, which must not decrease.

        After the last waypoint, the reference decelerates to rest.
        """
        cdef double begin_s
        if not self.braking:
            while self.piece < self.pieces and now_s > self.knots_s[self.piece + 1] + 1e-9:
                self.piece += 1
                self.entered += 1
            if self.piece < self.pieces:
                begin_s = self.knots_s[self.piece]
                quintic_at(
                    self.coefficients + 6 * self.n * self.piece,
                    self.n,
                    now_s - begin_s,
                    self.knots_s[self.piece + 1] - begin_s,
                    self.ref,
                )
                return
            self.starved += 1
            self._start_brake()
        if self.brake.c_advance(self.ref):
            self.count = 0  # no waypoint leads to the current position

    cdef const double* c_waypoint(self, int ahead) noexcept nogil:
        """Return the waypoint `ahead` waypoints after the end of the current segment, (n,); NULL after the
        last.
        """
        cdef int piece = self.piece + ahead
        if self.braking or piece >= self.pieces:
            return NULL
        return self.ends + 3 * self.n * (self.count - self.pieces + piece)

    cdef double c_step_s(self) noexcept nogil:
        """Return the duration of the current segment, s."""
        return self.knots_s[self.piece + 1] - self.knots_s[self.piece]

    cdef int _flaw(self, const double* times_s, const double* points, int count) noexcept nogil:
        cdef int i
        if not 1 <= count <= MAX_CHUNK:
            return CHUNK_SHAPE
        for i in range(count):
            if not isfinite(times_s[i]):
                return CHUNK_NOT_FINITE
        for i in range(count * self.n):
            if not isfinite(points[i]):
                return CHUNK_NOT_FINITE
        for i in range(1, count):
            if times_s[i] - times_s[i - 1] < 0.5 * self.period_s:
                return CHUNK_TIMES
        return CHUNK_TAKEN

    cdef int _index(self, double time_s) noexcept nogil:
        """Return the index of the first waypoint that is not before this time."""
        cdef int i = 0
        while i < self.count and self.times_s[i] < time_s:
            i += 1
        return i

    cdef void _connect(self, double now_s, int first) noexcept nogil:
        """Connect the reference with quintics to the first reachable waypoint, from `first` on, and then the
        waypoints with each other.
        """
        cdef int i, n = self.n, knot = self._first_in_reach(now_s, first)
        self.knots_s[0], self.knots_s[1] = now_s, self.times_s[knot]
        quintic_between(
            self.ref, self.ends + 3 * n * knot, n, self.knots_s[1] - now_s, self.coefficients
        )
        self.pieces = 1
        for i in range(knot, self.count - 1):
            quintic_between(
                self.ends + 3 * n * i,
                self.ends + 3 * n * (i + 1),
                n,
                self.times_s[i + 1] - self.times_s[i],
                self.coefficients + 6 * n * self.pieces,
            )
            self.pieces += 1
            self.knots_s[self.pieces] = self.times_s[i + 1]
        self.piece, self.braking = 0, False
        self.entered += 1

    cdef int _first_in_reach(self, double now_s, int first) noexcept nogil:
        """Return the first waypoint to which a quintic stays within the limits; if there is none, the one to
        which the quintic exceeds them least.
        """
        cdef double coefficients[6 * MAX_DOF]
        cdef double excess, least = INFINITY
        cdef int i, best = first, n = self.n
        for i in range(first, self.count):
            quintic_between(self.ref, self.ends + 3 * n * i, n, self.times_s[i] - now_s, coefficients)
            excess = self._excess(coefficients, self.times_s[i] - now_s, max(least, 1.0))
            if excess <= 1.0:
                return i
            if excess < least * (1.0 - TIE):
                best, least = i, excess
        return best

    cdef double _excess(self, const double* coefficients, double duration_s, double enough) noexcept nogil:
        """Return the largest share of a limit that a quintic uses; infinity if the share is above `enough` or
        NaN. The jerk is checked first, because it is usually the largest share.
        """
        cdef double peaks[MAX_DOF]
        cdef double share, most = 0.0
        cdef int order, i
        for order in range(3, 0, -1):
            quintic_peaks(coefficients, self.n, order, duration_s, PLACES, peaks)
            for i in range(self.n):
                share = peaks[i] / self.bounds[order - 1][i]
                if not share <= enough:
                    return INFINITY
                most = max(most, share)
        return most

    cdef void _start_brake(self) noexcept nogil:
        self.brake.c_begin(self.ref)
        self.braking = True

    def _result(self):
        if self.refused == CHUNK_SHAPE:
            return Rejected(
                f"times and positions must be shape (k,) and (k, {self.n}), k from 1 to {MAX_CHUNK}"
            )
        if self.refused == CHUNK_NOT_FINITE:
            return Rejected("times and positions must be finite")
        if self.refused == CHUNK_TIMES:
            return Rejected("times must increase by at least half a cycle")
        if self.refused == CHUNK_PAST:
            return Rejected(
                f"all {self.refused_count} waypoints are in the past, the last one by {self.refused_s:.3f} s"
            )
        if self.refused == CHUNK_FULL:
            return Rejected(
                f"{self.refused_count} waypoints are still ahead, up to {MAX_CHUNK} are kept"
            )
        return ACCEPTED

    def begin(self, state):
        copy = plain(state, (3, self.n))
        self.c_begin(doubles(copy, 3 * self.n))

    def take(self, times_s, positions, double now_s):
        cdef int k = len(times_s)
        if np.ndim(times_s) != 1 or not 1 <= k <= MAX_CHUNK or np.shape(positions) != (k, self.n):
            self.refused = CHUNK_SHAPE
            return self._result()
        times, points = plain(times_s, (k,)), plain(positions, (k, self.n))
        self.c_take(doubles(times, k), doubles(points, k * self.n), k, now_s)
        return self._result()

    def advance(self, double now_s):
        self.c_advance(now_s)


cdef void spline_rates(const double* times_s, int count, int n, double* ends) noexcept nogil:
    """Calculate velocity and acceleration at the knots of the cubic spline through points. The first and last
    segments are parabolas. A single point is at rest; between two points the segment is straight.

    The velocities solve a tridiagonal system (C. de Boor, "A Practical Guide to Splines", chapter IV), which
    is solved by elimination without pivoting (L. Thomas), because every inner row is diagonally dominant.

    Args:
        times_s: (count,), at most `MAX_WAYPOINTS`.
        ends: (count, 3, n): contains the positions; velocities and accelerations are written to it.
    """
    cdef double upper[MAX_WAYPOINTS]
    cdef double before, after, pivot, slope, last_slope
    cdef int i, k, row = 3 * n
    cdef double* here
    if count < 3:
        for i in range(n):
            slope = (ends[row + i] - ends[i]) / (times_s[1] - times_s[0]) if count == 2 else 0.0
            for k in range(count):
                ends[row * k + n + i], ends[row * k + 2 * n + i] = slope, 0.0
        return
    upper[0] = 1.0
    for i in range(n):
        ends[n + i] = 2.0 * (ends[row + i] - ends[i]) / (times_s[1] - times_s[0])
    for k in range(1, count - 1):
        before, after = times_s[k] - times_s[k - 1], times_s[k + 1] - times_s[k]
        here = ends + row * k
        pivot = 1.0 / (2.0 * (before + after) - after * upper[k - 1])
        upper[k] = before * pivot
        for i in range(n):
            last_slope, slope = (here[i] - here[i - row]) / before, (here[i + row] - here[i]) / after
            here[n + i] = (3.0 * (after * last_slope + before * slope) - after * here[n + i - row]) * pivot
    here = ends + row * (count - 1)
    before = times_s[count - 1] - times_s[count - 2]
    for i in range(n):
        slope = (here[i] - here[i - row]) / before
        here[n + i] = (2.0 * slope - here[n + i - row]) / (1.0 - upper[count - 2])
    for k in range(count - 2, -1, -1):
        here = ends + row * k
        for i in range(n):
            here[n + i] -= upper[k] * here[n + i + row]
    for k in range(count - 1):
        here, after = ends + row * k, times_s[k + 1] - times_s[k]
        for i in range(n):
            slope = (here[i + row] - here[i]) / after
            here[2 * n + i] = (6.0 * slope - 4.0 * here[n + i] - 2.0 * here[n + i + row]) / after
    here = ends + row * (count - 1)
    for i in range(n):
        slope = (here[i] - here[i - row]) / before
        here[2 * n + i] = (2.0 * here[n + i - row] + 4.0 * here[n + i] - 6.0 * slope) / before


def spline(times_s, points):
    cdef int k = len(times_s), n = np.shape(points)[1]
    if k > MAX_WAYPOINTS:
        raise InputError(f"{k} waypoints, allowed: up to {MAX_WAYPOINTS}")
    times, ends = plain(times_s, (k,)), np.zeros((k, 3, n))
    ends[:, 0] = points
    spline_rates(doubles(times, k), k, n, doubles(ends, 3 * n * k))
    return ends[:, 1], ends[:, 2]
