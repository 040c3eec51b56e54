"""Quintic polynomials: their bases, and how motions of several coordinates are made of them.

A quintic leads from one state, (3, n): position, velocity and acceleration, to another in a given time. Its
coefficients, (6, n), are those of the powers of s, the share of that time, in [0, 1]. Rows are contiguous.
"""

from libc.math cimport fabs

import numpy as np

from cobot.arrays cimport doubles

cdef double[DERIVATIVES][ORDER] FACTOR = [
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
    [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
    [0.0, 0.0, 2.0, 6.0, 12.0, 20.0],
    [0.0, 0.0, 0.0, 6.0, 24.0, 60.0],
]
cdef double[ORDER][ORDER] FROM_ENDS = [
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
    [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
    [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
    [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5],
]

# What numpy works with, in `cobot.trajectory` and in the tests: see polynomials.pyi.
FACTORS = np.array(FACTOR)
EXPONENTS = np.array([[max(power - order, 0) for power in range(ORDER)] for order in range(DERIVATIVES)])
HERMITE = np.array(FROM_ENDS)
for _table in (FACTORS, EXPONENTS, HERMITE):
    _table.flags.writeable = False


cdef void quintic_between(
    const double* start, const double* end, int n, double duration_s, double* coefficients
) noexcept nogil:
    """The coefficients of the quintic between two states, each (3, n).

    It is computed from the start on, so that what does not move does not move by a rounding either.
    """
    cdef double square = duration_s * duration_s
    cdef double ends[ORDER]
    cdef double sum
    cdef int i, row, column
    for i in range(n):
        ends[0], ends[1], ends[2] = 0.0, start[n + i] * duration_s, start[2 * n + i] * square
        ends[3], ends[4], ends[5] = end[i] - start[i], end[n + i] * duration_s, end[2 * n + i] * square
        for row in range(ORDER):
            sum = 0.0
            for column in range(ORDER):
                sum += FROM_ENDS[row][column] * ends[column]
            coefficients[row * n + i] = sum
        coefficients[i] = start[i]


cdef inline void _basis(int order, double s, double duration_s, double* basis) noexcept nogil:
    """Of a derivative by time, (6,): what each coefficient from that of its order on is multiplied with."""
    cdef double power = 1.0
    cdef int i, _
    for _ in range(order):
        power /= duration_s
    for i in range(order, ORDER):
        basis[i] = FACTOR[order][i] * power
        power *= s


cdef inline double _sum(int order, const double* basis, const double* coefficients, int n) noexcept nogil:
    """The highest power first: the lowest one is the largest in a motion, and is rounded once."""
    cdef double sum = 0.0
    cdef int i
    for i in range(ORDER - 1, order - 1, -1):
        sum += basis[i] * coefficients[i * n]
    return sum


cdef void quintic_at(
    const double* coefficients, int n, double time_s, double duration_s, double* out
) noexcept nogil:
    """Position, velocity and acceleration, (3, n), so long after the start of a quintic of a duration."""
    cdef double basis[ORDER]
    cdef int order, i
    for order in range(3):
        _basis(order, time_s / duration_s, duration_s, basis)
        for i in range(n):
            out[order * n + i] = _sum(order, basis, coefficients + i, n)


cdef void quintic_peaks(
    const double* coefficients, int n, int order, double duration_s, int places, double* peaks
) noexcept nogil:
    """The greatest amounts of a derivative, (n,), at equidistant places from the start to the end, at least
    two."""
    cdef double basis[ORDER]
    cdef double amount
    cdef int place, i
    for i in range(n):
        peaks[i] = 0.0
    for place in range(places):
        _basis(order, place / <double>(places - 1), duration_s, basis)
        for i in range(n):
            amount = fabs(_sum(order, basis, coefficients + i, n))
            if amount > peaks[i] or amount != amount:  # what is no number stays
                peaks[i] = amount


def between(start, end, double duration_s):
    cdef int n = np.shape(start)[1]
    both, coefficients = np.ascontiguousarray([start, end], float), np.empty((ORDER, n))
    cdef double* ends = doubles(both, 6 * n)
    quintic_between(ends, ends + 3 * n, n, duration_s, doubles(coefficients, ORDER * n))
    return coefficients


def evaluate(coefficients, double time_s, double duration_s, out):
    cdef int n = np.shape(coefficients)[1]
    quintic_at(doubles(coefficients, ORDER * n), n, time_s, duration_s, doubles(out, 3 * n))


def peaks(coefficients, double duration_s, int places):
    cdef int n = np.shape(coefficients)[1]
    out = np.empty((3, n))
    cdef double* rows = doubles(out, 3 * n)
    cdef int order
    for order in range(3):
        quintic_peaks(doubles(coefficients, ORDER * n), n, order + 1, duration_s, places, rows + order * n)
    return out
