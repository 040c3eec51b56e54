"""The fastest rate along a reference motion that keeps limits of velocity, acceleration, jerk and torque.

A reference motion q(τ) is run at the rate r = dτ/dt. The unknown is its square b(τ) = r², a quadratic
B-spline whose knots bound the cells, so that the acceleration is continuous and the jerk bounded. With ' for
derivatives by τ,

    q̈ = q'' b + q' b' / 2                                 linear in b,
    q⃛ = √b (q''' b + 3/2 q'' b' + q' b'' / 2)             so |linear in b| ≤ J b^(-1/2),

and the duration, ∫ b^(-1/2) dτ, is convex. The right side of the jerk's limit is convex too: its tangent lies
below it, so a step within the linearised limit is also within the limit (Consolini, Locatelli, Minari, "A
sequential algorithm for jerk limited speed planning", 2021). An interior point method takes such steps: each
iterate is feasible, and each system to solve has five diagonals. The equations are those of Nocedal, Wright,
"Numerical Optimization", 2006, section 19.3, with the slacks eliminated and without the curvature of the
constraints.

The rows of eight stations at a time are computed in vector registers: the C functions at the top work on
blocks of `LANES` stations, each number as a row of eight. They are compiled for several processors, and the
best one is chosen when the module is loaded. Each lane does the same operations in the same order, so all
processors compute the same figures.

All in one file, so that the C compiler can optimise a whole iteration.
"""

from libc.math cimport fabs, isfinite, pow, sqrt
from libc.string cimport memset

import numpy as np

from cobot.arrays cimport bytes_of, doubles

cdef extern from *:
    """
    /* A sixth less time than with -O2, for the same figures. */
    #if defined(__GNUC__) && !defined(__clang__) && defined(__OPTIMIZE__)
    #pragma GCC optimize ("O3")
    #if defined(__x86_64__) && defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__)
    #define FOR_EACH_PROCESSOR __attribute__((target_clones("avx512f", "avx2", "default")))
    #endif
    #endif
    #ifndef FOR_EACH_PROCESSOR
    #define FOR_EACH_PROCESSOR
    #endif

    /* Not unrolled, so that each loop over the lanes becomes vector instructions. */
    #define LANES 8
    #define EACH_LANE _Pragma("GCC unroll 1") for (int l = 0; l < LANES; l++)
    typedef double Lanes[LANES];

    /* The bounds of one block of stations, each of shape (rows, LANES); `third` is NULL for accelerations.
       `inverse` (of the slacks), `dual` and `change` (of the duals): shape (rows, 2, LANES), the upper bound
       first. */
    typedef struct {
        int rows;
        const Lanes *basis, *first, *second, *third, *low, *high;
        Lanes *inverse, *dual, *change;
    } Block;

    /* b, b', b'' of each station; `at` has the three coefficients of its cell. */
    static inline void local_values(const Lanes *basis, const Lanes *at, Lanes *y) {
        for (int i = 0; i < 3; i++)
            EACH_LANE y[i][l] = basis[3 * i][l] * at[0][l] + basis[3 * i + 1][l] * at[1][l]
                + basis[3 * i + 2][l] * at[2][l];
    }

    /* A quadratic form in b, b', b'' and a gradient, by the coefficients of the cell: in `out` the lower
       triangle of the form (6 rows), then the gradient. */
    static inline void by_coefficients(const Lanes *basis, const Lanes *q, const Lanes *v, Lanes *out) {
        static const int row_of[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
        Lanes product[9];
        int n = 0;
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                const int *row = row_of[i];
                EACH_LANE product[3 * i + j][l] = q[row[0]][l] * basis[j][l] + q[row[1]][l] * basis[3 + j][l]
                    + q[row[2]][l] * basis[6 + j][l];
            }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j <= i; j++, n++)
                EACH_LANE out[n][l] = basis[i][l] * product[j][l] + basis[3 + i][l] * product[3 + j][l]
                    + basis[6 + i][l] * product[6 + j][l];
        for (int i = 0; i < 3; i++)
            EACH_LANE out[6 + i][l] = v[0][l] * basis[i][l] + v[1][l] * basis[3 + i][l]
                + v[2][l] * basis[6 + i][l];
    }

    /* Compute the slacks at the coefficients `at` and their terms of the system, in `out`. The duals advance
       by a share of their change; with `fresh`, the slacks determine new duals. */
    FOR_EACH_PROCESSOR
    static void assemble_block(const Block *block, const Lanes *at, double barrier, int fresh, double share,
                               Lanes *out) {
        Lanes y[3], root, bend, q[6] = {{0.0}}, v[3] = {{0.0}};
        local_values(block->basis, at, y);
        EACH_LANE {
            root[l] = 1.0 / sqrt(y[0][l]);
            bend[l] = -0.5 * root[l] / y[0][l];
        }
        for (int row = 0; row < block->rows; row++) {
            const double *restrict first = block->first[row], *restrict second = block->second[row];
            const double *restrict top = block->high[row];
            double *restrict upper = block->inverse[2 * row], *restrict lower = block->inverse[2 * row + 1];
            double *restrict push_down = block->dual[2 * row], *restrict push_up = block->dual[2 * row + 1];
            const double *restrict down = block->change[2 * row], *restrict up = block->change[2 * row + 1];
            if (!fresh)
                EACH_LANE push_down[l] += share * down[l], push_up[l] += share * up[l];
            if (block->third) {
                const double *restrict third = block->third[row];
                EACH_LANE {
                    double g0 = third[l], g1 = 1.5 * second[l], g2 = 0.5 * first[l];
                    double value = g0 * y[0][l] + g1 * y[1][l] + g2 * y[2][l], slope = top[l] * bend[l];
                    double high = 1.0 / (top[l] * root[l] - value), low = 1.0 / (top[l] * root[l] + value);
                    double above = barrier * high, below = barrier * low;
                    upper[l] = high, lower[l] = low;
                    if (fresh)
                        push_down[l] = above, push_up[l] = below;
                    /* The slacks' gradients are slope - g and slope + g. */
                    v[0][l] += (above + below) * slope + (below - above) * g0;
                    v[1][l] += (below - above) * g1;
                    v[2][l] += (below - above) * g2;
                    above = push_down[l] * high, below = push_up[l] * low;
                    double both = above + below, apart = below - above;
                    q[0][l] += both * (slope * slope + g0 * g0) + 2.0 * apart * slope * g0;
                    q[1][l] += (both * g0 + apart * slope) * g1;
                    q[2][l] += (both * g0 + apart * slope) * g2;
                    q[3][l] += both * g1 * g1;
                    q[4][l] += both * g1 * g2;
                    q[5][l] += both * g2 * g2;
                }
            } else {
                const double *restrict bottom = block->low[row];
                EACH_LANE {
                    double g0 = second[l], g1 = 0.5 * first[l], value = g0 * y[0][l] + g1 * y[1][l];
                    double high = 1.0 / (top[l] - value), low = 1.0 / (value - bottom[l]);
                    double above = barrier * high, below = barrier * low;
                    upper[l] = high, lower[l] = low;
                    if (fresh)
                        push_down[l] = above, push_up[l] = below;
                    v[0][l] += (below - above) * g0;
                    v[1][l] += (below - above) * g1;
                    double both = push_down[l] * high + push_up[l] * low;
                    q[0][l] += both * (g0 * g0);
                    q[1][l] += both * g0 * g1;
                    q[3][l] += both * g1 * g1;
                }
            }
        }
        by_coefficients(block->basis, (const Lanes *)q, (const Lanes *)v, out);
    }

    /* Compute the changes of the duals. `bounds` has for each lane: the largest share of a slack that the
       whole step uses up; the smallest step of the duals to a bound; the smallest step at which b loses 0.9
       of its value. */
    FOR_EACH_PROCESSOR
    static void step_block(const Block *block, const Lanes *at, const Lanes *move, double barrier,
                           double share, Lanes *bounds) {
        Lanes y[3], dy[3], bend, used, until, to_zero;
        local_values(block->basis, at, y);
        local_values(block->basis, move, dy);
        EACH_LANE {
            to_zero[l] = dy[0][l] < 0.0 ? -0.9 * y[0][l] / dy[0][l] : 1.0;
            bend[l] = -0.5 * dy[0][l] / (sqrt(y[0][l]) * y[0][l]);
            used[l] = bounds[0][l], until[l] = bounds[1][l];
        }
        for (int row = 0; row < block->rows; row++) {
            const double *restrict first = block->first[row], *restrict second = block->second[row];
            const double *restrict top = block->high[row];
            const double *restrict upper = block->inverse[2 * row];
            const double *restrict lower = block->inverse[2 * row + 1];
            const double *restrict push_down = block->dual[2 * row];
            const double *restrict push_up = block->dual[2 * row + 1];
            double *restrict change_down = block->change[2 * row];
            double *restrict change_up = block->change[2 * row + 1];
            Lanes along, slope;
            if (block->third) {
                const double *restrict third = block->third[row];
                EACH_LANE {
                    along[l] = third[l] * dy[0][l] + 1.5 * second[l] * dy[1][l] + 0.5 * first[l] * dy[2][l];
                    slope[l] = top[l] * bend[l];
                }
            } else
                EACH_LANE {
                    along[l] = second[l] * dy[0][l] + 0.5 * first[l] * dy[1][l];
                    slope[l] = 0.0;
                }
            EACH_LANE {
                double high = slope[l] - along[l], low = slope[l] + along[l];
                double of_high = -high * upper[l], of_low = -low * lower[l];
                double down = (barrier - push_down[l] * high) * upper[l] - push_down[l];
                double up = (barrier - push_up[l] * low) * lower[l] - push_up[l];
                double until_down = down < 0.0 ? -share * push_down[l] / down : 1.0;
                double until_up = up < 0.0 ? -share * push_up[l] / up : 1.0;
                change_down[l] = down, change_up[l] = up;
                of_high = of_low > of_high ? of_low : of_high;
                used[l] = of_high > used[l] ? of_high : used[l];
                until_down = until_up < until_down ? until_up : until_down;
                until[l] = until_down < until[l] ? until_down : until[l];
            }
        }
        EACH_LANE {
            bounds[0][l] = used[l], bounds[1][l] = until[l];
            bounds[2][l] = to_zero[l] < bounds[2][l] ? to_zero[l] : bounds[2][l];
        }
    }

    /* The weighted times b^(-1/2) of a block, and their terms of the system, in `out`. */
    FOR_EACH_PROCESSOR
    static void duration_block(const Lanes *basis, const Lanes *weight, const Lanes *at, Lanes *part,
                               Lanes *out) {
        Lanes y[3], q[6] = {{0.0}}, v[3] = {{0.0}};
        local_values(basis, at, y);
        EACH_LANE {
            (*part)[l] = (*weight)[l] / sqrt(y[0][l]);
            v[0][l] = 0.5 * (*part)[l] / y[0][l];
            q[0][l] = 0.75 * (*part)[l] / (y[0][l] * y[0][l]);
        }
        by_coefficients(basis, (const Lanes *)q, (const Lanes *)v, out);
    }
    """
    enum:
        LANES
    ctypedef double Lanes[8]
    ctypedef struct Block:
        int rows
        const Lanes* basis
        const Lanes* first
        const Lanes* second
        const Lanes* third
        const Lanes* low
        const Lanes* high
        Lanes* inverse
        Lanes* dual
        Lanes* change
    void local_values(const Lanes*, const Lanes*, Lanes*) noexcept nogil
    void assemble_block(const Block*, const Lanes*, double, bint, double, Lanes*) noexcept nogil
    void step_block(const Block*, const Lanes*, const Lanes*, double, double, Lanes*) noexcept nogil
    void duration_block(const Lanes*, const Lanes*, const Lanes*, Lanes*, Lanes*) noexcept nogil

cdef double BEGIN = 0.8  # The iteration begins at this share of the largest rate of the given shape.
cdef double TO_THE_BOUND = 0.99  # A step covers this share of the way to the nearest bound.
cdef double SHRINK = 0.2  # Factor by which the barrier decreases after a good step.
cdef double FIRST_GAP = 0.3


cdef class Stations:
    """Places in cells, each with the same number of rows.

    For an acceleration or a torque:  low ≤ second b + first b' / 2 ≤ high.
    For a jerk, with a third:         |third b + 3/2 second b' + first b'' / 2| ≤ high b^(-1/2).

    Attributes:
        cells: the cell of each station, shape (n,).
        basis: shape (n, 3, 3): rows b, b', b''; columns the three coefficients of the cell.
        first, second, third, low, high: shape (n, m).
    """

    cdef int _count, _rows, _blocks
    cdef object _kept
    cdef int* _cell  # For each station; the last station is repeated until its block is full.
    cdef Block _first_block

    def __init__(self, cells, basis, first, second, third, low, high):
        self._count, self._rows = np.shape(first)
        self._blocks = (self._count + LANES - 1) // LANES
        cdef int rows = self._rows
        cell = np.zeros(self._blocks * LANES, dtype=np.intc)
        cell[: self._count] = cells
        cell[self._count :] = cell[self._count - 1] if self._count else 0
        size = self._blocks * LANES * rows
        self._kept = kept = [cell, _in_blocks(np.reshape(basis, (self._count, 9)), self._count, 9)]
        kept += [_in_blocks(each, self._count, rows) for each in (first, second)]
        kept += [np.empty(max(size * width, 1)) for width in (1, 1, 2, 2)] + [np.zeros(max(2 * size, 1))]
        self._cell = <int*>bytes_of(cell, 0)
        cdef Block* block = &self._first_block
        block.rows = rows
        block.basis = <Lanes*>doubles(kept[1], 1)
        block.first, block.second = <Lanes*>doubles(kept[2], 1), <Lanes*>doubles(kept[3], 1)
        block.low, block.high = <Lanes*>doubles(kept[4], 1), <Lanes*>doubles(kept[5], 1)
        block.inverse, block.dual = <Lanes*>doubles(kept[6], 1), <Lanes*>doubles(kept[7], 1)
        block.change, block.third = <Lanes*>doubles(kept[8], 1), NULL
        if third is not None:
            kept.append(_in_blocks(third, self._count, rows))
            block.third = <Lanes*>doubles(kept[9], 1)
        self.bound(low, high)

    def bound(self, low, high):
        """See interior_point.pyi."""
        _into_blocks(low, self._count, self._rows, self._kept[4])
        _into_blocks(high, self._count, self._rows, self._kept[5])

    cdef Block _block(self, int number) noexcept nogil:
        """The rows of the next `LANES` stations."""
        cdef Block block = self._first_block
        cdef int at = number * self._rows
        block.basis += 9 * number
        block.first += at
        block.second += at
        block.low += at
        block.high += at
        block.inverse += 2 * at
        block.dual += 2 * at
        block.change += 2 * at
        if block.third != NULL:
            block.third += at
        return block

    cdef inline void _gather(self, int number, const double* c, Lanes* at) noexcept nogil:
        """The three coefficients of the cell of each station in a block."""
        cdef int lane, i
        for lane in range(LANES):
            for i in range(3):
                at[i][lane] = c[self._cell[number * LANES + lane] + i]

    cdef inline void _add(self, int number, const Lanes* terms, double* matrix, double* right) noexcept nogil:
        """Add the terms of a block to the system. The matrix, shape (n, 3), has the diagonal and the two
        diagonals below it."""
        cdef int lane, i, j, row, cell
        for lane in range(min(LANES, self._count - number * LANES)):
            cell, row = self._cell[number * LANES + lane], 0
            for i in range(3):
                for j in range(i + 1):
                    matrix[3 * (cell + j) + i - j] += terms[row][lane]
                    row += 1
                right[cell + i] += terms[6 + i][lane]

    cdef double largest_share(self, const double* c) noexcept nogil:
        """The largest factor by which c can be multiplied so that all bounds are kept; 0 if there is none."""
        cdef double largest = 1e300
        cdef double least = 1e300  # The smallest bound of its power of 3/2.
        cdef double high, low, value
        cdef Lanes at[3]
        cdef Lanes y[3]
        cdef Block block
        cdef int number, row, lane
        for number in range(self._blocks):
            block = self._block(number)
            self._gather(number, c, at)
            local_values(block.basis, at, y)
            for row in range(self._rows):
                for lane in range(LANES):
                    high, low = block.high[row][lane], block.low[row][lane]
                    value = 0.5 * block.first[row][lane]
                    if block.third != NULL:
                        value = value * y[2][lane] + 1.5 * block.second[row][lane] * y[1][lane]
                        value = fabs(block.third[row][lane] * y[0][lane] + value) * sqrt(y[0][lane])
                        if value != 0.0:
                            least = min(least, high / value)
                        continue
                    value = block.second[row][lane] * y[0][lane] + value * y[1][lane]
                    if not (low < 0.0 < high):
                        return 0.0
                    elif value > 0.0:
                        largest = min(largest, high / value)
                    elif value < 0.0:
                        largest = min(largest, low / value)
        return min(largest, pow(least, 2.0 / 3.0)) if least < 1e299 else largest

    cdef void assemble(
        self, const double* c, double barrier, bint fresh, double share, double* matrix, double* right
    ) noexcept nogil:
        """Compute the slacks at c and add their terms to the system. The duals advance by a share of their
        change; with `fresh`, the slacks determine new duals."""
        cdef Lanes at[3]
        cdef Lanes terms[9]
        cdef Block block
        cdef int number
        for number in range(self._blocks):
            block = self._block(number)
            self._gather(number, c, at)
            assemble_block(&block, at, barrier, fresh, share, terms)
            self._add(number, terms, matrix, right)

    cdef void step(
        self, const double* c, const double* move, double barrier, double* primal, double* dual
    ) noexcept nogil:
        """Compute the changes of the duals, and reduce the step lengths `primal` and `dual` so that all
        bounds are kept."""
        cdef Lanes at[3]
        cdef Lanes along[3]
        cdef Lanes bounds[3]
        cdef Block block
        cdef int number, lane
        for lane in range(LANES):
            bounds[0][lane] = 0.0
            bounds[1][lane] = bounds[2][lane] = 1.0
        for number in range(self._blocks):
            block = self._block(number)
            self._gather(number, c, at)
            self._gather(number, move, along)
            step_block(&block, at, along, barrier, TO_THE_BOUND, bounds)
        for lane in range(LANES):
            primal[0] = min(primal[0], bounds[2][lane])
            if bounds[0][lane] * primal[0] > TO_THE_BOUND:
                primal[0] = TO_THE_BOUND / bounds[0][lane]
            dual[0] = min(dual[0], bounds[1][lane])


cdef _in_blocks(given, int count, int rows):
    """Numbers of shape (count, rows) in blocks of `LANES` stations, shape (blocks, rows, LANES). The last
    station is repeated until its block is full."""
    found = np.empty(max((count + LANES - 1) // LANES * LANES * rows, 1))
    _into_blocks(given, count, rows, found)
    return found


cdef int _into_blocks(given, int count, int rows, found) except -1:
    """See `_in_blocks`."""
    array = np.array(given, dtype=np.float64, order="C")
    if array.shape != (count, rows):
        raise ValueError(f"rows of shape {array.shape} instead of {(count, rows)}")
    if array.size == 0:
        return 0
    cdef int station, row, of
    cdef const double* row_of = doubles(array, count * rows)
    cdef double* out = doubles(found, (count + LANES - 1) // LANES * LANES * rows)
    for station in range((count + LANES - 1) // LANES * LANES):
        of = min(station, count - 1)
        for row in range(rows):
            out[(station // LANES * rows + row) * LANES + station % LANES] = row_of[of * rows + row]
    return 0


cdef double _duration(Stations times, const double* c, double* matrix, double* right) noexcept nogil:
    """Σ high b^(-1/2). Its terms are added to the system."""
    cdef Lanes at[3]
    cdef Lanes terms[9]
    cdef Lanes part
    cdef Block block
    cdef double sum = 0.0
    cdef int number, lane
    for number in range(times._blocks):
        block = times._block(number)
        times._gather(number, c, at)
        duration_block(block.basis, block.high, at, &part, terms)
        for lane in range(min(LANES, times._count - number * LANES)):
            sum += part[lane]
        times._add(number, terms, matrix, right)
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


def fastest_rate(begin, Stations times, list bounded, double gap, int iterations):
    """See interior_point.pyi.

    Args:
        begin: the coefficients to begin with, except for a factor, shape (cells + 2,).
        times: its `high` contains the weights of b^(-1/2) in the duration, in one row.
        bounded: the limits of the rate.
        gap: the iteration ends when at most this share of the duration is left to gain.

    Raises:
        ValueError: no rate keeps the bounds, not even a very small one.
    """
    cdef int n = len(begin)
    cdef int number = 0, i
    cdef Stations each
    cdef double share = 1e300
    solution, matrix, right = np.array(begin, dtype=np.float64), np.zeros(3 * n), np.zeros(n)
    cdef double* c = doubles(solution, n)
    for each in bounded:
        share = min(share, each.largest_share(c))
    if not (0.0 < share < 1e299):
        raise ValueError("no rate keeps the bounds" if share <= 0.0 else "nothing bounds the rate")
    solution *= BEGIN * share
    cdef double* a = doubles(matrix, 3 * n)
    cdef double* x = doubles(right, n)
    cdef double duration = _duration(times, c, a, x)
    cdef double rows = 0.0
    for each in bounded:
        rows += 2 * each._count * each._rows
    cdef double barrier = FIRST_GAP * duration / rows
    cdef double primal, dual = 0.0
    cdef bint done = False
    for number in range(iterations):
        for each in bounded:
            each.assemble(c, barrier, number == 0, dual, a, x)
        if not _solve(a, x, n):
            break
        primal = dual = 1.0
        for each in bounded:
            each.step(c, x, barrier, &primal, &dual)
        for i in range(n):
            c[i] += primal * x[i]
        memset(a, 0, 3 * n * sizeof(double))
        memset(x, 0, n * sizeof(double))
        duration = _duration(times, c, a, x)
        done = barrier * rows < gap * duration
        if primal > 0.5 and dual > 0.5:
            if done:
                break
            barrier = max(barrier * SHRINK, 0.5 * gap * duration / rows)
        elif primal > 0.1:
            barrier = max(barrier * 0.7, 0.5 * gap * duration / rows)
    return solution, barrier * rows / duration, number + 1
