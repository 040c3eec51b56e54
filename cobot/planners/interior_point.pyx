"""The fastest rate along a reference motion that keeps limits of velocity, acceleration, jerk and torque.

A reference motion q(τ) is run at the rate r = dτ/dt. The unknown is its square b(τ) = r², a quadratic
B-spline whose knots bound the cells, so that the acceleration is continuous and the jerk bounded. With ' for
derivatives by τ,

    q̈ = q'' b + q' b' / 2                                 linear in b,
    q⃛ = √b (q''' b + 3/2 q'' b' + q' b'' / 2)             so |linear in b| ≤ J b^(-1/2),

and the duration, ∫ b^(-1/2) dτ, is convex. The right side of the jerk's limit is convex too: its tangent
lies below it, so a step that keeps the linearised limit keeps the limit (Consolini, Locatelli, Minari, "A
sequential algorithm for jerk limited speed planning", 2021). An interior point method takes such steps: each
iterate is feasible, and each system to solve has five diagonals. The equations are those of Nocedal, Wright,
"Numerical Optimization", 2006, section 19.3, with the slacks eliminated and without the curvature of the
constraints.

One file of 300 lines, so that the C compiler can optimise a whole iteration.
"""

from libc.math cimport fabs, isfinite, pow, sqrt

import numpy as np

from cobot.arrays cimport doubles

cdef extern from *:
    """
    /* A sixth less time than with -O2, for the same figures. */
    #if defined(__GNUC__) && !defined(__clang__) && defined(__OPTIMIZE__)
    #pragma GCC optimize ("O3")
    #endif
    """

cdef double BEGIN = 0.8  # Of the largest constant rate: there it begins.
cdef double TO_THE_BOUND = 0.99  # A step goes so much of the way to the nearest bound.
cdef double SHRINK = 0.2  # The barrier becomes so much smaller after a good step.
cdef double FIRST_GAP = 0.3


cdef class Stations:
    """Places in cells, each with the same number of rows.

    Of an acceleration or a torque:  low ≤ second b + first b' / 2 ≤ high.
    Of a jerk, if there is a third:  |third b + 3/2 second b' + first b'' / 2| ≤ high b^(-1/2).

    Attributes:
        cells: the cell of each station, shape (n,).
        basis: shape (n, 3, 3): rows b, b', b''; columns the three coefficients of the cell.
        first, second, third, low, high: shape (n, m).
    """

    cdef int _count, _rows
    cdef object _kept
    cdef double* _cell
    cdef double* _basis
    cdef double* _first
    cdef double* _second
    cdef double* _third
    cdef double* _low
    cdef double* _high
    cdef double* _inverse  # Of the slacks at the upper bound, then at the lower one, of each row.
    cdef double* _dual
    cdef double* _change  # Of the duals.

    def __init__(self, cells, basis, first, second, third, low, high):
        self._count, self._rows = np.shape(first)
        cdef Py_ssize_t size = self._count * self._rows
        given = (cells, basis, first, second, low, high)
        kept = [np.asarray(each, dtype=np.float64, order="C") for each in given]
        for each in kept[2:]:
            if each.shape != (self._count, self._rows):
                raise ValueError(f"rows of shape {each.shape} instead of {(self._count, self._rows)}")
        kept.append(np.asarray(third, dtype=np.float64, order="C") if third is not None else np.zeros(1))
        kept += [np.empty(2 * size) for _ in range(3)]
        self._kept = kept
        self._cell, self._basis = doubles(kept[0], self._count), doubles(kept[1], 9 * self._count)
        if size == 0:
            return
        self._first, self._second = doubles(kept[2], size), doubles(kept[3], size)
        self._low, self._high = doubles(kept[4], size), doubles(kept[5], size)
        self._third = doubles(kept[6], size) if third is not None else NULL
        self._inverse, self._dual = doubles(kept[7], 2 * size), doubles(kept[8], 2 * size)
        self._change = doubles(kept[9], 2 * size)

    cdef inline void _values(self, int station, const double* c, double* y) noexcept nogil:
        """b, b', b'' at a station."""
        cdef const double* basis = &self._basis[9 * station]
        cdef const double* at = &c[<int>self._cell[station]]
        cdef int i
        for i in range(3):
            y[i] = basis[3 * i] * at[0] + basis[3 * i + 1] * at[1] + basis[3 * i + 2] * at[2]

    cdef inline void _row(self, int index, double* g) noexcept nogil:
        """Derivatives of the row's value by b, b' and b''."""
        if self._third != NULL:
            g[0], g[1], g[2] = self._third[index], 1.5 * self._second[index], 0.5 * self._first[index]
        else:
            g[0], g[1], g[2] = self._second[index], 0.5 * self._first[index], 0.0

    cdef double constant_rate(self) noexcept nogil:
        """The largest constant b that keeps all bounds; 0 if none does."""
        cdef double largest = 1e300
        cdef double least = 1e300  # Of the bounds of b^(3/2).
        cdef double high, low
        cdef int index
        for index in range(self._count * self._rows):
            if self._third != NULL:
                if self._third[index] != 0.0:
                    least = min(least, self._high[index] / fabs(self._third[index]))
                continue
            high, low = self._high[index], self._low[index]
            if not (low < 0.0 < high):
                return 0.0
            if self._second[index] > 0.0:
                largest = min(largest, high / self._second[index])
            elif self._second[index] < 0.0:
                largest = min(largest, low / self._second[index])
        return min(largest, pow(least, 2.0 / 3.0)) if least < 1e299 else largest

    cdef void assemble(
        self, const double* c, double barrier, bint fresh, double* matrix, double* right
    ) noexcept nogil:
        """Compute the slacks at c and add their terms to the system. With `fresh`, the slacks also determine
        new duals."""
        cdef double y[3]
        cdef double g[3]
        cdef double q[9]
        cdef double v[3]
        cdef double root, bend, slope, value, high, low, above, below, both, apart, push, pull
        cdef int station, row, index
        for station in range(self._count):
            self._values(station, c, y)
            root = 1.0 / sqrt(y[0])
            bend = -0.5 * root / y[0]
            for row in range(9):
                q[row] = 0.0
            v[0] = v[1] = v[2] = 0.0
            for row in range(self._rows):
                index = station * self._rows + row
                self._row(index, g)
                value = g[0] * y[0] + g[1] * y[1] + g[2] * y[2]
                if self._third != NULL:
                    slope = self._high[index] * bend
                    high, low = self._high[index] * root - value, self._high[index] * root + value
                else:
                    slope = 0.0
                    high, low = self._high[index] - value, value - self._low[index]
                high, low = 1.0 / high, 1.0 / low
                self._inverse[2 * index], self._inverse[2 * index + 1] = high, low
                above, below = barrier * high, barrier * low
                if fresh:
                    self._dual[2 * index], self._dual[2 * index + 1] = above, below
                # The slacks' gradients are slope - g and slope + g.
                push, pull = above + below, below - above
                v[0] += push * slope + pull * g[0]
                v[1] += pull * g[1]
                v[2] += pull * g[2]
                above, below = self._dual[2 * index] * high, self._dual[2 * index + 1] * low
                both, apart = above + below, below - above
                q[0] += both * (slope * slope + g[0] * g[0]) + 2.0 * apart * slope * g[0]
                q[1] += (both * g[0] + apart * slope) * g[1]
                q[2] += (both * g[0] + apart * slope) * g[2]
                q[4] += both * g[1] * g[1]
                q[5] += both * g[1] * g[2]
                q[8] += both * g[2] * g[2]
            q[3], q[6], q[7] = q[1], q[2], q[5]
            _add(&self._basis[9 * station], <int>self._cell[station], q, v, matrix, right)

    cdef void step(
        self, const double* c, const double* move, double barrier, double* primal, double* dual
    ) noexcept nogil:
        """Compute the changes of the duals, and reduce the step lengths `primal` and `dual` so that all
        bounds are kept."""
        cdef double y[3]
        cdef double dy[3]
        cdef double g[3]
        cdef double bend, slope, along, change, inverse, dual_now
        cdef int station, row, index, side
        for station in range(self._count):
            self._values(station, c, y)
            self._values(station, move, dy)
            if dy[0] < 0.0:
                primal[0] = min(primal[0], -0.9 * y[0] / dy[0])
            bend = -0.5 * dy[0] / (sqrt(y[0]) * y[0])
            for row in range(self._rows):
                index = station * self._rows + row
                self._row(index, g)
                along = g[0] * dy[0] + g[1] * dy[1] + g[2] * dy[2]
                slope = self._high[index] * bend if self._third != NULL else 0.0
                for side in range(2):
                    change = slope + (along if side else -along)
                    inverse, dual_now = self._inverse[2 * index + side], self._dual[2 * index + side]
                    if -change * inverse * primal[0] > TO_THE_BOUND:
                        primal[0] = -TO_THE_BOUND / (change * inverse)
                    change = (barrier - dual_now * change) * inverse - dual_now
                    if -change * dual[0] > TO_THE_BOUND * dual_now:
                        dual[0] = -TO_THE_BOUND * dual_now / change
                    self._change[2 * index + side] = change

    cdef void go(self, double share) noexcept nogil:
        """Change the duals by a share of their step."""
        cdef int index
        for index in range(2 * self._count * self._rows):
            self._dual[index] += share * self._change[index]


cdef void _add(
    const double* basis, int cell, const double* q, const double* v, double* matrix, double* right
) noexcept nogil:
    """Add a quadratic form in b, b', b'' and a gradient to the system. The matrix, shape (n, 3), has the
    diagonal and the two diagonals below it."""
    cdef double product[9]
    cdef double sum
    cdef int i, j, k
    for i in range(3):
        for j in range(3):
            product[3 * i + j] = q[3 * i] * basis[j] + q[3 * i + 1] * basis[3 + j]
            product[3 * i + j] += q[3 * i + 2] * basis[6 + j]
    for i in range(3):
        right[cell + i] += v[0] * basis[i] + v[1] * basis[3 + i] + v[2] * basis[6 + i]
        for j in range(i + 1):
            sum = 0.0
            for k in range(3):
                sum += basis[3 * k + i] * product[3 * k + j]
            matrix[3 * (cell + j) + i - j] += sum


cdef double _duration(Stations times, const double* c, double* matrix, double* right) noexcept nogil:
    """Σ high b^(-1/2). Its terms are added to the system unless `matrix` is NULL."""
    cdef double y[3]
    cdef double q[9]
    cdef double v[3]
    cdef double sum = 0.0
    cdef double part
    cdef int station, i
    for i in range(9):
        q[i] = 0.0
    v[1] = v[2] = 0.0
    for station in range(times._count):
        times._values(station, c, y)
        part = times._high[station] / sqrt(y[0])
        sum += part
        if matrix != NULL:
            v[0], q[0] = 0.5 * part / y[0], 0.75 * part / (y[0] * y[0])
            _add(&times._basis[9 * station], <int>times._cell[station], q, v, matrix, right)
    return sum


cdef bint _solve(double* a, double* x, int n) noexcept nogil:
    """Solve A x = right in place by Cholesky, for a positive definite A with five diagonals. False if A is
    not."""
    cdef int i
    for i in range(n):
        if not (a[3 * i] > 0.0 and isfinite(a[3 * i])):
            return False
        a[3 * i] = sqrt(a[3 * i])
        if i + 1 < n:
            a[3 * i + 1] /= a[3 * i]
            a[3 * i + 3] -= a[3 * i + 1] * a[3 * i + 1]
        if i + 2 < n:
            a[3 * i + 2] /= a[3 * i]
            a[3 * i + 4] -= a[3 * i + 1] * a[3 * i + 2]
            a[3 * i + 6] -= a[3 * i + 2] * a[3 * i + 2]
    for i in range(n):
        if i > 0:
            x[i] -= a[3 * i - 2] * x[i - 1]
        if i > 1:
            x[i] -= a[3 * i - 4] * x[i - 2]
        x[i] /= a[3 * i]
    for i in range(n - 1, -1, -1):
        if i + 1 < n:
            x[i] -= a[3 * i + 1] * x[i + 1]
        if i + 2 < n:
            x[i] -= a[3 * i + 2] * x[i + 2]
        x[i] /= a[3 * i]
    return True


def fastest_rate(int cells, Stations times, list bounded, double gap, int iterations):
    """See interior_point.pyi.

    Args:
        times: `high` are the weights of b^(-1/2) in the duration, one row.
        bounded: the limits of the rate.
        gap: the iteration ends when at most this share of the duration is left to gain.

    Raises:
        ValueError: no rate keeps the bounds, not even a very small one.
    """
    cdef int n = cells + 2
    cdef int number = 0, i
    cdef Stations each
    cdef double constant = 1e300
    for each in bounded:
        constant = min(constant, each.constant_rate())
    if not (0.0 < constant < 1e299):
        raise ValueError("no rate keeps the bounds" if constant <= 0.0 else "nothing bounds the rate")
    solution, matrix, right = np.full(n, BEGIN * constant), np.empty(3 * n), np.empty(n)
    cdef double* c = doubles(solution, n)
    cdef double* a = doubles(matrix, 3 * n)
    cdef double* x = doubles(right, n)
    cdef double duration = _duration(times, c, NULL, NULL)
    cdef double rows = 0.0
    for each in bounded:
        rows += 2 * each._count * each._rows
    cdef double barrier = FIRST_GAP * duration / rows
    cdef double primal, dual
    cdef bint done = False
    for number in range(iterations):
        matrix[:] = 0.0
        right[:] = 0.0
        _duration(times, c, a, x)
        for each in bounded:
            each.assemble(c, barrier, number == 0, a, x)
        if not _solve(a, x, n):
            break
        primal = dual = 1.0
        for each in bounded:
            each.step(c, x, barrier, &primal, &dual)
        for i in range(n):
            c[i] += primal * x[i]
        for each in bounded:
            each.go(dual)
        duration = _duration(times, c, NULL, NULL)
        done = barrier * rows < gap * duration
        if primal > 0.5 and dual > 0.5:
            if done:
                break
            barrier = max(barrier * SHRINK, 0.5 * gap * duration / rows)
        elif primal > 0.1:
            barrier = max(barrier * 0.7, 0.5 * gap * duration / rows)
    return solution, barrier * rows / duration, number + 1
