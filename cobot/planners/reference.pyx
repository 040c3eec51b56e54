"""A first time parameterization along a path: fast where the path allows it, smooth, and at rest at both
ends.

The speed is limited by the velocities, and by the accelerations, in one pass forward and one backward (after
Bobrow, Dubowsky, Gibson, "Time-optimal control of robotic manipulators along specified paths", 1985). The
result need not be optimal, because the rate along it is optimised afterwards. A mean over the time that a
full acceleration takes to build up makes the motion smooth. The result is a cubic B-spline, whose ends are at
rest with a jerk that is not zero.

Its cells take the same time, or more time where the motion hardly uses its acceleration limits: most of a
slow motion keeps the speed that a velocity limit allows, and needs few cells for this.
"""

from libc.math cimport cbrt, ceil, fabs, sqrt

import numpy as np

from cobot.arrays cimport doubles

cdef double STILL = 1e-12  # A coordinate with a smaller share does not bound the acceleration.
# The shortest cells are where more than 1 / DENSE of an acceleration limit is used. Elsewhere cells are up to
# MAX_FACTOR times longer, but no cell is longer than the distance between two places of the path.
cdef double DENSE = 3.0
cdef double MAX_FACTOR = 10.0
# Largest change of this factor over the duration of a shortest cell. Averages over MEAN values then make it
# smooth, because a jump in the durations of cells would be a jerk at the first rate. This jerk is a larger
# share of its limit if a full acceleration takes longer to reach the speed. If that takes more than `GENTLE`
# times as long as the acceleration takes to build up, durations change more slowly, by up to `MAX_GENTLER`.
cdef double CHANGE = 0.07
cdef int MEAN = 17
cdef double GENTLE = 2.0
cdef double MAX_GENTLER = 10.0
cdef int MEANS = 3
# Cells have equal durations unless this share of them suffices and the maximum number is not exceeded. If all
# cells had to be longer than needed, the longest ones would be too long to keep a speed.
cdef double WORTH = 0.7
cdef int MAX_EVEN = 20000


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


cdef void _use(
    const double* first, const double* second, const double* speed, int points, int m, double step,
    double* shares
) noexcept nogil:
    """The largest share of an acceleration limit that each interval of the path uses, (points - 1,)."""
    cdef double along
    cdef int i, j, k
    for i in range(points - 1):
        along, shares[i] = 0.5 * (speed[i + 1] * speed[i + 1] - speed[i] * speed[i]) / step, 0.0
        for k in range(i, i + 2):
            for j in range(m):
                shares[i] = max(
                    shares[i], fabs(first[k * m + j] * along + second[k * m + j] * speed[k] * speed[k])
                )


cdef _factors(
    const double* time, const double* shares, int intervals, double cell_s, int even, int mean,
    double gentler
):
    """How many times longer than `cell_s` a cell may take, at the middle of each of `even` cells, (even,).

    Args:
        time, shares: of the motion before the mean, see `_use`.
        mean: the number of cells over which the mean is taken.
        gentler: factor by which the durations change more slowly than by `CHANGE`.
    """
    cdef int place = 0, i, k, _mean
    cdef int half = <int>(gentler * MEAN / 2.0)
    cdef double begin, end, used, passed, least
    cdef double change = CHANGE / gentler
    dense, factors = np.zeros(even), np.empty(even)
    cdef double* needed = doubles(dense, even)
    cdef double* factor = doubles(factors, even)
    for i in range(even):
        begin, end = i * cell_s, (i + 1) * cell_s
        while place < intervals - 1 and time[place + 1] <= begin:
            place += 1
        used = passed = 0.0
        for k in range(place, intervals):
            if time[k] >= end:
                break
            used = max(used, shares[k])
            passed += (min(time[k + 1], end) - max(time[k], begin)) / (time[k + 1] - time[k])
        needed[i] = max(DENSE * used, passed)
        if i <= mean or end >= time[intervals] - mean * cell_s:  # a step of the path can be too long for this
            needed[i] = 1.0
    for i in range(even):
        least = 1.0 / MAX_FACTOR
        for k in range(max(0, i - mean), min(even, i + 2)):
            least = max(least, needed[k])
        factor[i] = 1.0 / min(least, 1.0)
    for i in range(1, even):
        factor[i] = min(factor[i], factor[i - 1] + change)
    for i in range(even - 2, -1, -1):
        factor[i] = min(factor[i], factor[i + 1] + change)
    before, after = np.zeros(half, dtype=np.intp), np.full(half, even - 1)
    padded = np.concatenate([before, np.arange(even), after])
    weights = np.full(2 * half + 1, 1.0 / (2 * half + 1))
    for _mean in range(MEANS):
        factors = np.convolve(factors[padded], weights, mode="valid")
    return factors


cdef double _speeding_up(const double* first, const double* speed, int points, int m) noexcept nogil:
    """The longest time, s, in which a full acceleration reaches the speed."""
    cdef double longest = 0.0
    cdef int i, j
    for i in range(points):
        for j in range(m):
            longest = max(longest, fabs(first[i * m + j]) * speed[i])
    return longest


cdef class _Motion:
    """A motion with piecewise constant acceleration: time, way (the distance along the path), speed, and the
    integral of the way at each point."""

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
        speed: the largest path speed, shape (points,).
        bounds: the minimum and maximum number of cells, and the number of cells in the time in which the
            acceleration builds up.
    """
    cdef double least = bounds[0], most = bounds[1], per_window = bounds[2]
    cdef int points = len(first)
    cdef int m = np.shape(first)[1]
    cdef int i, cells, even
    cdef double window, cell_s, area, way, v, area_before, way_before, v_before, mean_s, longer_s
    cdef double change, gentler
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
    cdef double end_s = t[points - 1] + window
    even = <int>min(max(ceil(end_s / window * per_window), least), max(<double>MAX_EVEN, most))
    shares = np.empty(points - 1)
    _use(p, doubles(second, points * m), x, points, m, step, doubles(shares, points - 1))
    cell_s = end_s / even
    gentler = cbrt(_speeding_up(p, x, points, m) / (GENTLE * window))
    factors = _factors(
        t, doubles(shares, points - 1), points - 1, cell_s, even, <int>per_window + 1,
        min(max(gentler, 1.0), MAX_GENTLER),
    )
    amounts = np.concatenate([[0.0], np.cumsum(1.0 / factors)])
    if amounts[even] > min(WORTH * even, most):
        cells = <int>min(<double>even, most)
        cell_s = end_s / cells
        ends, widths = cell_s * np.arange(cells + 1.0), np.ones(cells)
    else:
        cells = <int>min(max(ceil(amounts[even]), least), most)
        places = np.interp(np.arange(cells + 1.0) * (amounts[even] / cells), amounts, np.arange(even + 1.0))
        ends, widths = cell_s * places, np.diff(places)
    cdef double* end = doubles(ends, cells + 1)
    cdef double* width = doubles(widths, cells)
    cdef _Motion ahead = _motion(points, length, step, t, x, whole)
    cdef _Motion behind = _motion(points, length, step, t, x, whole)
    control = np.zeros(cells + 3)
    cdef double* c = doubles(control, cells + 3)
    for i in range(2, cells - 1):
        ahead.at(end[i], &area, &way, &v)
        behind.at(end[i] - window, &area_before, &way_before, &v_before)
        # The control points of a cubic are its values less a sixth of its second derivative.
        mean_s, longer_s = 0.5 * cell_s * (width[i - 1] + width[i]), cell_s * (width[i] - width[i - 1])
        change = (v - v_before) * mean_s * mean_s + (way - way_before) * longer_s
        c[i + 1] = min(max((area - area_before - change / 6.0) / window, c[i]), length)
    for i in range(cells, cells + 3):
        c[i] = length
    return control, widths


cdef _Motion _motion(int points, double length, double step, double* time, double* speed, double* area):
    cdef _Motion motion = _Motion()
    motion.last, motion.length, motion.step, motion.end = points - 1, length, step, time[points - 1]
    motion.time, motion.speed, motion.area = time, speed, area
    return motion
