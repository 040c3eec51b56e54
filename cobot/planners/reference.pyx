"""A first time parameterization along a path: fast where the path allows it, smooth, and at rest at both
ends.

The speed is limited by the velocities, and by the accelerations, in one pass forward and one backward (after
Bobrow, Dubowsky, Gibson, "Time-optimal control of robotic manipulators along specified paths", 1985). The
result need not be optimal, because the rate along it is optimised afterwards. It is only important that all
cells take about the same time. A mean over the time that a full acceleration takes to build up makes the
motion smooth. The result is a cubic B-spline, whose ends are at rest with a jerk that is not zero.
"""

from libc.math cimport ceil, fabs, sqrt

import numpy as np

from cobot.arrays cimport doubles

cdef double STILL = 1e-12  # A coordinate with a smaller share does not bound the acceleration.


cdef double _largest(
    const double* first, const double* second, int m, double square, double way
) noexcept nogil:
    """The largest acceleration along the path at a squared speed; `way` is 1 for forward, -1 for backward."""
    cdef double largest = 1e300
    cdef double amount
    cdef int j
    for j in range(m):
        amount = fabs(first[j])
        if amount > STILL:
            largest = min(largest, (1.0 - (way if first[j] > 0.0 else -way) * second[j] * square) / amount)
    return max(largest, 0.0)


cdef double _build_up(const double* first, const double* jerk, int points, int m) noexcept nogil:
    """Longest time to build up the largest acceleration at the largest jerk, s."""
    cdef double longest = 0.0
    cdef double a, b
    cdef int i, j
    for i in range(points):
        a = b = 0.0
        for j in range(m):
            a = max(a, fabs(first[i * m + j]))
            b = max(b, fabs(jerk[i * m + j]))
        if a > STILL:
            longest = max(longest, b / a)
    return longest


cdef void _limit(
    const double* first, const double* second, double* square, int points, int m, double step
) noexcept nogil:
    """Reduce the squared speeds to those that can be reached from rest and from which rest can be reached."""
    cdef double change
    cdef int i
    square[0] = square[points - 1] = 0.0
    for i in range(points - 1):
        change = 2.0 * step * _largest(&first[i * m], &second[i * m], m, square[i], 1.0)
        square[i + 1] = min(square[i + 1], square[i] + change)
    for i in range(points - 1, 0, -1):
        change = 2.0 * step * _largest(&first[i * m], &second[i * m], m, square[i], -1.0)
        square[i - 1] = min(square[i - 1], square[i] + change)


cdef class _Motion:
    """A motion with piecewise constant acceleration: time, way, speed, and the integral of the way at each
    point."""

    cdef int last
    cdef double length, end
    cdef double* time
    cdef double* speed
    cdef double* area
    cdef double step
    cdef int _at

    cdef void at(self, double time, double* area, double* way, double* speed) noexcept nogil:
        """The state at a time. Times must increase from call to call."""
        cdef double since, duration, acceleration
        cdef int i
        if time <= 0.0:
            area[0] = way[0] = speed[0] = 0.0
            return
        if time >= self.end:
            area[0] = self.area[self.last] + self.length * (time - self.end)
            way[0], speed[0] = self.length, 0.0
            return
        while self._at < self.last - 1 and self.time[self._at + 1] < time:
            self._at += 1
        i = self._at
        since, duration = time - self.time[i], self.time[i + 1] - self.time[i]
        acceleration = (self.speed[i + 1] - self.speed[i]) / duration
        speed[0] = self.speed[i] + acceleration * since
        way[0] = i * self.step + since * (self.speed[i] + 0.5 * acceleration * since)
        area[0] = self.area[i] + since * (
            i * self.step + since * (0.5 * self.speed[i] + acceleration * since / 6.0)
        )


def reference_motion(first, second, jerk, speed, double length, tuple bounds):
    """See reference.pyi.

    Args:
        first, second: first and second derivative of each coordinate by s, as shares of its acceleration
            limit, at equal steps of the path, shape (points, m).
        jerk: `first` as shares of the jerk limits, shape (points, m).
        speed: the largest speed of the path, shape (points,).
        bounds: the minimum and maximum number of cells, and the number of cells in the time in which the
            acceleration builds up.
    """
    cdef double least = bounds[0], most = bounds[1], per_window = bounds[2]
    cdef int points = len(first)
    cdef int m = np.shape(first)[1]
    cdef int i, cells
    cdef double window, cell_s, area, way, v, area_before, way_before, v_before
    first, second, jerk = (np.array(each, dtype=np.float64, order="C") for each in (first, second, jerk))
    square = np.array(speed, dtype=np.float64) ** 2
    times, areas = np.zeros(points), np.zeros(points)
    cdef double* p = doubles(first, points * m)
    cdef double* x = doubles(square, points)
    cdef double* t = doubles(times, points)
    cdef double* whole = doubles(areas, points)
    cdef double step = length / (points - 1)
    _limit(p, doubles(second, points * m), x, points, m, step)
    for i in range(points):
        x[i] = sqrt(x[i])
    cdef double duration
    for i in range(1, points):
        duration = 2.0 * step / (x[i] + x[i - 1])
        t[i] = t[i - 1] + duration
        whole[i] = whole[i - 1] + duration * ((i - 1) * step + duration * (2.0 * x[i - 1] + x[i]) / 6.0)
    window = min(_build_up(p, doubles(jerk, points * m), points, m), t[points - 1])
    cells = <int>min(max(ceil((t[points - 1] + window) / window * per_window), least), most)
    cell_s = (t[points - 1] + window) / cells
    cdef _Motion ahead = _motion(points, length, step, t, x, whole)
    cdef _Motion behind = _motion(points, length, step, t, x, whole)
    control = np.zeros(cells + 3)
    cdef double* c = doubles(control, cells + 3)
    for i in range(2, cells - 1):
        ahead.at(i * cell_s, &area, &way, &v)
        behind.at(i * cell_s - window, &area_before, &way_before, &v_before)
        # The control points of a cubic are its values less a sixth of its second derivative.
        c[i + 1] = (area - area_before - (v - v_before) * cell_s * cell_s / 6.0) / window
        c[i + 1] = min(max(c[i + 1], c[i]), length)
    for i in range(cells, cells + 3):
        c[i] = length
    return control, cell_s


cdef _Motion _motion(int points, double length, double step, double* time, double* speed, double* area):
    cdef _Motion motion = _Motion()
    motion.last, motion.length, motion.step, motion.end = points - 1, length, step, time[points - 1]
    motion.time, motion.speed, motion.area = time, speed, area
    return motion
