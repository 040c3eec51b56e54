"""Quintic polynomials: their bases, and motions of several coordinates that consist of them.

A quintic leads from one state, (3, n): position, velocity and acceleration, to another in a given time. Its
coefficients, (6, n), are those of the powers of s, the share of that time, in [0, 1]. Rows are contiguous.

Bases, motions and extrema are in one module so that the C compiler can inline the small functions that they
share.
"""

from math import comb

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

# By degree: the control points of a Bezier curve from its coefficients, as quotients of binomials.
cdef double[ORDER][ORDER][ORDER] BERNSTEIN
for _degree in range(ORDER):
    for _row in range(_degree + 1):
        for _column in range(_row + 1):
            BERNSTEIN[_degree][_row][_column] = comb(_row, _column) / comb(_degree, _column)

# For numpy code, in `cobot.trajectory` and in the tests: see polynomials.pyi.
FACTORS = np.array(FACTOR)
EXPONENTS = np.array([[max(power - order, 0) for power in range(ORDER)] for order in range(DERIVATIVES)])
HERMITE = np.array(FROM_ENDS)
for _table in (FACTORS, EXPONENTS, HERMITE):
    _table.flags.writeable = False


cdef void quintic_between(
    const double* start, const double* end, int n, double duration_s, double* coefficients
) noexcept nogil:
    """The coefficients of the quintic between two states, each (3, n).

    It is computed relative to the start, so that a coordinate at rest does not move because of rounding.
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
    """The basis of a derivative by time, (6,): the factors of the coefficients, beginning with the
    coefficient of its order."""
    cdef double power = 1.0
    cdef int i, _
    for _ in range(order):
        power /= duration_s
    for i in range(order, ORDER):
        basis[i] = FACTOR[order][i] * power
        power *= s


cdef inline double _sum(int order, const double* basis, const double* coefficients, int n) noexcept nogil:
    """The sum of coefficients times basis, from the highest power on, because the lowest term is usually the
    largest."""
    cdef double sum = 0.0
    cdef int i
    for i in range(ORDER - 1, order - 1, -1):
        sum += basis[i] * coefficients[i * n]
    return sum


cdef void quintic_at(
    const double* coefficients, int n, double time_s, double duration_s, double* out
) noexcept nogil:
    """Position, velocity and acceleration, (3, n), of a quintic with a duration, at a time after its
    start."""
    cdef double basis[ORDER]
    cdef int order, i
    for order in range(3):
        _basis(order, time_s / duration_s, duration_s, basis)
        for i in range(n):
            out[order * n + i] = _sum(order, basis, coefficients + i, n)


cdef void quintic_peaks(
    const double* coefficients, int n, int order, double duration_s, int places, double* peaks
) noexcept nogil:
    """The largest magnitudes of a derivative, (n,), at equidistant places from the start to the end, at least
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
            if amount > peaks[i] or amount != amount:  # NaN stays NaN
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


def pieces_at(breakpoints, coefficients, places):
    """The values and three derivatives, (4, m, n), of piecewise quintics, (pieces, n, 6), at places, (m,)."""
    cdef int pieces = len(coefficients), n = np.shape(coefficients)[1], m = len(places)
    cdef int each = m * n
    cdef int place, piece, i, low, high
    starts = np.array(breakpoints, dtype=np.float64)
    factors = np.array(coefficients, dtype=np.float64, order="C")
    wanted = np.array(places, dtype=np.float64)
    out = np.empty((DERIVATIVES, m, n))
    if m == 0:
        return out
    cdef double* begin = doubles(starts, pieces + 1)
    cdef double* row = doubles(factors, pieces * n * ORDER)
    cdef double* at = doubles(wanted, m)
    cdef double* values = doubles(out, DERIVATIVES * m * n)
    cdef const double* c
    cdef double* value
    cdef double t  # since the beginning of the piece
    with nogil:
        for place in range(m):
            low, high = 0, pieces
            while high - low > 1:
                piece = (low + high) // 2
                if begin[piece] <= at[place]:
                    low = piece
                else:
                    high = piece
            t = at[place] - begin[low]
            for i in range(n):
                c = &row[(low * n + i) * ORDER]
                value = &values[place * n + i]
                value[0] = ((((c[5] * t + c[4]) * t + c[3]) * t + c[2]) * t + c[1]) * t + c[0]
                value[each] = (((5.0 * c[5] * t + 4.0 * c[4]) * t + 3.0 * c[3]) * t + 2.0 * c[2]) * t + c[1]
                value[2 * each] = ((20.0 * c[5] * t + 12.0 * c[4]) * t + 6.0 * c[3]) * t + 2.0 * c[2]
                value[3 * each] = (60.0 * c[5] * t + 24.0 * c[4]) * t + 6.0 * c[3]
    return out


cdef double _root(const double* p, int degree, double low, double high) noexcept nogil:
    """The zero of a polynomial that changes its sign once between two places, by bisection and Newton's
    steps."""
    cdef double x = 0.5 * (low + high), value, slope, following
    cdef bint rising = _horner(p, degree, low) < 0.0
    cdef int k, _
    for _ in range(100):
        value = slope = 0.0
        for k in range(degree, -1, -1):
            slope = slope * x + value
            value = value * x + p[k]
        if (value < 0.0) == rising:
            low = x
        else:
            high = x
        following = x - value / slope if slope != 0.0 else low
        if not (low < following < high):
            following = 0.5 * (low + high)
        if fabs(following - x) <= 1e-15:
            break
        x = following
    return x


cdef inline double _horner(const double* p, int degree, double x) noexcept nogil:
    cdef double value = 0.0
    cdef int k
    for k in range(degree, -1, -1):
        value = value * x + p[k]
    return value


cdef double _greatest(const double* p, int degree) noexcept nogil:
    """The largest magnitude on [0, 1] of a polynomial of up to degree 4. It is at an end, or where the slope
    is zero.

    Between two zeros of a derivative, the derivative of one order less has at most one zero. So the zeros are
    found from the linear derivative upwards.
    """
    cdef double slopes[4][5]
    cdef double borders[6]
    cdef double found[6]
    cdef double greatest = max(fabs(p[0]), fabs(_horner(p, degree, 1.0)))
    cdef int count = 0, level, i, k, fresh
    for k in range(degree):
        slopes[0][k] = (k + 1) * p[k + 1]
    for level in range(1, degree):
        for k in range(degree - level):
            slopes[level][k] = (k + 1) * slopes[level - 1][k + 1]
    for level in range(degree - 2, -1, -1):  # Of degree 1 and above.
        borders[0] = 0.0
        for i in range(count):
            borders[i + 1] = found[i]
        borders[count + 1] = 1.0
        fresh = 0
        for i in range(count + 1):
            if (_horner(slopes[level], degree - 1 - level, borders[i]) < 0.0) != (
                _horner(slopes[level], degree - 1 - level, borders[i + 1]) < 0.0
            ):
                found[fresh] = _root(slopes[level], degree - 1 - level, borders[i], borders[i + 1])
                fresh += 1
        count = fresh
    for i in range(count):
        greatest = max(greatest, fabs(_horner(p, degree, found[i])))
    return greatest


def hermite(times, positions, velocities, accelerations):
    """The quintics, (pieces, n, 6), between values and derivatives, (pieces + 1, n) each."""
    given = [np.array(each, dtype=np.float64, order="C") for each in (positions, velocities, accelerations)]
    clock = np.array(times, dtype=np.float64)
    cdef int pieces = len(clock) - 1, n = np.shape(given[0])[1]
    cdef int piece, i, row, column, at
    for each in given:
        if each.shape != (pieces + 1, n):
            raise ValueError(f"values of shape {each.shape}, not ({pieces + 1}, {n})")
    out = np.empty((max(pieces, 0), n, ORDER))
    if out.size == 0:
        return out
    cdef const double* time = doubles(clock, pieces + 1)
    cdef const double* position = doubles(given[0], (pieces + 1) * n)
    cdef const double* velocity = doubles(given[1], (pieces + 1) * n)
    cdef const double* acceleration = doubles(given[2], (pieces + 1) * n)
    cdef double* c = doubles(out, pieces * n * ORDER)
    cdef double ends[ORDER]
    cdef double duration, square, sum, power
    with nogil:
        for piece in range(pieces):
            duration = time[piece + 1] - time[piece]
            square = duration * duration
            for i in range(n):
                at = piece * n + i
                ends[1], ends[2] = velocity[at] * duration, acceleration[at] * square
                ends[3] = position[at + n] - position[at]
                ends[4], ends[5] = velocity[at + n] * duration, acceleration[at + n] * square
                c[at * ORDER], c[at * ORDER + 1] = position[at], ends[1] / duration
                c[at * ORDER + 2] = 0.5 * ends[2] / square
                power = square * duration
                for row in range(3, ORDER):
                    sum = FROM_ENDS[row][1] * ends[1]
                    for column in range(2, ORDER):
                        sum += FROM_ENDS[row][column] * ends[column]
                    c[at * ORDER + row] = sum / power
                    power *= duration
    return out


def control_points(coefficients, widths):
    """The control points of polynomials as Bezier curves, (pieces, order, n); see polynomials.pyi."""
    cdef int pieces = np.shape(coefficients)[0], n = np.shape(coefficients)[1]
    cdef int order = np.shape(coefficients)[2]
    cdef int piece, i, k, row
    rows = np.array(coefficients, dtype=np.float64, order="C")
    lengths = np.array(widths, dtype=np.float64)
    if lengths.shape != (pieces,) or order > ORDER:
        raise ValueError(f"polynomials of shape {rows.shape} on intervals of shape {lengths.shape}")
    out = np.empty((pieces, order, n))
    if out.size == 0:
        return out
    cdef const double* given = doubles(rows, pieces * n * order)
    cdef const double* width = doubles(lengths, pieces)
    cdef double* point = doubles(out, pieces * n * order)
    cdef double unit[ORDER]
    cdef double sum
    with nogil:
        for piece in range(pieces):
            unit[0] = 1.0
            for k in range(1, order):
                unit[k] = unit[k - 1] * width[piece]
            for i in range(n):
                for row in range(order):
                    sum = 0.0
                    for k in range(row + 1):
                        sum += given[(piece * n + i) * order + k] * unit[k] * BERNSTEIN[order - 1][row][k]
                    point[(piece * order + row) * n + i] = sum
    return out


def jumps(coefficients, durations):
    """The jumps of position, velocity and acceleration, (3, pieces - 1, n), from the end of each quintic to
    the start of the next one, and the magnitudes at that start; see polynomials.pyi."""
    cdef int pieces = len(coefficients), n = np.shape(coefficients)[1]
    cdef int piece, i, order, k, at
    rows = np.array(coefficients, dtype=np.float64, order="C")
    lengths = np.array(durations, dtype=np.float64)
    gaps, starts = np.empty((3, pieces - 1, n)), np.empty((3, pieces - 1, n))
    if gaps.size == 0:
        return gaps, starts
    cdef double* row = doubles(rows, pieces * n * ORDER)
    cdef double* duration = doubles(lengths, pieces)
    cdef double* gap = doubles(gaps, 3 * (pieces - 1) * n)
    cdef double* start = doubles(starts, 3 * (pieces - 1) * n)
    cdef const double* c
    cdef double end
    with nogil:
        for piece in range(pieces - 1):
            for i in range(n):
                c = &row[(piece * n + i) * ORDER]
                for order in range(3):
                    end = 0.0
                    for k in range(ORDER - 1, order - 1, -1):
                        end = end * duration[piece] + FACTOR[order][k] * c[k]
                    at = (order * (pieces - 1) + piece) * n + i
                    start[at] = FACTOR[order][order] * c[n * ORDER + order]
                    gap[at] = fabs(end - start[at])
                    start[at] = fabs(start[at])
    return gaps, starts


cdef double _control(const double* p, int degree) noexcept nogil:
    """An upper bound of the magnitude on [0, 1] of a polynomial of up to degree 4: its largest control
    point."""
    cdef double greatest = 0.0
    cdef double point
    cdef int i, k
    for i in range(degree + 1):
        point = 0.0
        for k in range(i + 1):
            point += BERNSTEIN[degree][i][k] * p[k]
        greatest = max(greatest, fabs(point))
    return greatest


def greatest_rates(coefficients, durations, enough=None):
    """The exact largest magnitudes of velocity, acceleration and jerk, (3, pieces, n), of quintics.

    The coefficients, shape (pieces, n, 6), are those of powers of the time since each piece's start. See
    polynomials.pyi for `enough`.
    """
    cdef int pieces = len(coefficients), n = np.shape(coefficients)[1]
    cdef int piece, i, order, k
    rows = np.array(coefficients, dtype=np.float64, order="C")
    lengths = np.array(durations, dtype=np.float64)
    out = np.zeros((DERIVATIVES - 1, pieces, n))
    if out.size == 0:
        return out
    if enough is not None:
        out[...] = enough
    cdef double* row = doubles(rows, pieces * n * ORDER)
    cdef double* duration = doubles(lengths, pieces)
    cdef double* greatest = doubles(out, (DERIVATIVES - 1) * pieces * n)
    cdef double p[5]
    cdef double power, bound
    cdef Py_ssize_t at
    with nogil:
        for piece in range(pieces):
            for i in range(n):
                for order in range(1, DERIVATIVES):
                    power = 1.0
                    for k in range(order, ORDER):
                        p[k - order] = FACTOR[order][k] * row[(piece * n + i) * ORDER + k] * power
                        power *= duration[piece]
                    at = ((order - 1) * pieces + piece) * n + i
                    bound = _control(p, ORDER - 1 - order)
                    greatest[at] = bound if bound <= greatest[at] else _greatest(p, ORDER - 1 - order)
    return out
