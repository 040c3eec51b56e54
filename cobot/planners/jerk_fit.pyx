"""The motion within limits of velocity, acceleration and jerk that stays in a corridor: see jerk_fit.pyi.

All arrays have rows of joints, (n, dof). A difference is stored in the row of its first point, so the
differences of third order end three rows before the points.
"""

from libc.math cimport sqrt

import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from cobot.planners.corridor import STANDSTILL

WEIGHTS = (0.003, 0.3, 3.0, 1.0)
RELAXATION = 1.6
TURNS_PER_PLACE = 5
LEAD_STEPS = 3

cdef enum:
    ORDERS = 4
    AT_REST = 3
    BAND = 4

# Weights of the points in a difference of each order, the earliest point first.
cdef double[ORDERS][ORDERS] BINOMIAL = [
    [1.0, 0.0, 0.0, 0.0],
    [-1.0, 1.0, 0.0, 0.0],
    [1.0, -2.0, 1.0, 0.0],
    [-1.0, 3.0, -3.0, 1.0],
]


cdef struct Problem:
    Py_ssize_t points, rows
    int dof
    double interval_s, longest_shift_s, lead_s, last_s, standstill, relaxation
    double weights[ORDERS]
    double bounds[ORDERS][MAX_DOF]  # of the corridor, and of the differences
    double low[MAX_DOF]
    double high[MAX_DOF]
    const double* positions
    const double* directions
    double* control
    double* times_s
    const double* scheduled_s
    double* there
    double* direction
    double* wanted[ORDERS]
    double* owed[ORDERS]
    double* right
    double* factor


cdef void _row(const Problem* problem, const double* table, double time_s, double* out) noexcept nogil:
    """A row of the curve's table at a time, interpolated between two rows."""
    cdef double place = time_s / problem.interval_s
    cdef Py_ssize_t index = <Py_ssize_t>place
    cdef int joint
    index = max(0, min(index, problem.rows - 2))
    cdef double share = place - index
    cdef const double* before = table + index * problem.dof
    for joint in range(problem.dof):
        out[joint] = before[joint] + share * (before[problem.dof + joint] - before[joint])


cdef double _shift(const Problem* problem, Py_ssize_t row, const double* point) noexcept nogil:
    """The delay at which the straight piece of the corridor is nearest to a point."""
    cdef const double* there = problem.there + row * problem.dof
    cdef const double* direction = problem.direction + row * problem.dof
    cdef double along = 0.0, square = problem.standstill * problem.standstill
    cdef int joint
    for joint in range(problem.dof):
        along += (point[joint] - there[joint]) * direction[joint]
        square += direction[joint] * direction[joint]
    return max(-problem.longest_shift_s, min(along / square, problem.longest_shift_s))


cdef void _follow(Problem* problem, bint move) noexcept nogil:
    """Move the corridor to the points, in their order and near their schedule."""
    cdef double time_s = 0.0, moved_s
    cdef Py_ssize_t row
    cdef int dof = problem.dof
    for row in range(problem.points):
        if move:
            moved_s = problem.times_s[row] + _shift(problem, row, problem.control + row * dof)
            moved_s = min(moved_s, problem.scheduled_s[row] + problem.lead_s)
            moved_s = max(moved_s, problem.scheduled_s[row] - problem.lead_s)
            time_s = min(max(time_s, moved_s), problem.last_s)
            problem.times_s[row] = time_s
        _row(problem, problem.positions, problem.times_s[row], problem.there + row * dof)
        _row(problem, problem.directions, problem.times_s[row], problem.direction + row * dof)


cdef void _to_corridor(const Problem* problem, Py_ssize_t row, double* point) noexcept nogil:
    """Move a point to the nearest position within the corridor and the joints' ranges."""
    cdef double shift_s = _shift(problem, row, point)
    cdef const double* there = problem.there + row * problem.dof
    cdef const double* direction = problem.direction + row * problem.dof
    cdef double along, bound, nearest
    cdef int joint
    for joint in range(problem.dof):
        along = there[joint] + direction[joint] * shift_s
        bound = problem.bounds[0][joint]
        nearest = along + max(-bound, min(point[joint] - along, bound))
        point[joint] = max(problem.low[joint], min(nearest, problem.high[joint]))


cdef double _difference(const Problem* problem, int order, Py_ssize_t row, int joint) noexcept nogil:
    cdef const double* point = problem.control + row * problem.dof + joint
    cdef int dof = problem.dof
    if order == 0:
        return point[0]
    if order == 1:
        return point[dof] - point[0]
    if order == 2:
        return (point[2 * dof] - point[dof]) - (point[dof] - point[0])
    return ((point[3 * dof] - point[2 * dof]) - (point[2 * dof] - point[dof])) - (
        (point[2 * dof] - point[dof]) - (point[dof] - point[0])
    )


cdef void _project(Problem* problem, bint first) noexcept nogil:
    """Project the differences onto each bound separately, and accumulate the remainders in `owed`."""
    cdef double value[MAX_DOF]
    cdef double aim[MAX_DOF]
    cdef double bound, relaxation = problem.relaxation
    cdef double* wanted
    cdef double* owed
    cdef Py_ssize_t row
    cdef int order, joint
    for order in range(ORDERS):
        for row in range(problem.points - order):
            wanted = problem.wanted[order] + row * problem.dof
            owed = problem.owed[order] + row * problem.dof
            for joint in range(problem.dof):
                value[joint] = _difference(problem, order, row, joint)
                if not first:
                    value[joint] *= relaxation
                    value[joint] += (1.0 - relaxation) * wanted[joint] + owed[joint]
                aim[joint] = value[joint]
            if order == 0:
                _to_corridor(problem, row, aim)
            for joint in range(problem.dof):
                if order > 0:
                    bound = problem.bounds[order][joint]
                    aim[joint] = max(-bound, min(aim[joint], bound))
                wanted[joint] = aim[joint]
                owed[joint] = 0.0 if first else value[joint] - aim[joint]


cdef void _pull(Problem* problem) noexcept nogil:
    """Compute the right side: the transposed differences of the wanted values, less the contribution of the
    fixed ends."""
    cdef int order, k, joint, dof = problem.dof
    cdef double weight, value
    cdef double* right
    cdef Py_ssize_t row, last = problem.points - AT_REST
    for row in range(problem.points * dof):
        problem.right[row] = 0.0
    for order in range(ORDERS):
        weight = problem.weights[order]
        for row in range(problem.points - order):
            right = problem.right + row * dof
            for joint in range(dof):
                value = problem.wanted[order][row * dof + joint] - problem.owed[order][row * dof + joint]
                value -= _of_ends(problem, order, row, joint, last)
                value *= weight
                for k in range(order + 1):
                    right[k * dof + joint] += BINOMIAL[order][k] * value


cdef double _of_ends(
    const Problem* problem, int order, Py_ssize_t row, int joint, Py_ssize_t last
) noexcept nogil:
    """The contribution of the fixed points at both ends to a difference."""
    cdef double total = 0.0
    cdef int k
    if row >= AT_REST and row + order < last:
        return 0.0
    for k in range(order + 1):
        if row + k < AT_REST or row + k >= last:
            total += BINOMIAL[order][k] * problem.control[(row + k) * problem.dof + joint]
    return total


cdef int _factorise(Problem* problem) noexcept nogil:
    """Compute the Cholesky factor of the free points' matrix, row by row, diagonal first. -1 if it is not
    positive definite."""
    cdef Py_ssize_t count = problem.points - 2 * AT_REST, row, left
    cdef int back, order, k, inner
    cdef double value
    cdef double* factor = problem.factor
    for row in range(count):
        for back in reversed(range(BAND)):
            if back > row:
                factor[row * BAND + back] = 0.0
                continue
            value = 0.0
            for order in range(ORDERS):
                for k in range(order + 1 - back):
                    value += problem.weights[order] * BINOMIAL[order][k] * BINOMIAL[order][k + back]
            left = row - back
            for inner in range(1, BAND - back):
                if inner > left:
                    break
                value -= factor[row * BAND + back + inner] * factor[left * BAND + inner]
            if back > 0:
                factor[row * BAND + back] = value / factor[left * BAND]
            elif value <= 0.0:
                return -1
            else:
                factor[row * BAND] = sqrt(value)
    return 0


cdef void _solve(Problem* problem) noexcept nogil:
    """Compute the free points that are nearest to all wanted values."""
    cdef Py_ssize_t count = problem.points - 2 * AT_REST, row
    cdef int back, joint, dof = problem.dof
    cdef const double* factor = problem.factor
    cdef double* point
    cdef double share
    for row in range(count):
        point = problem.control + (row + AT_REST) * dof
        for joint in range(dof):
            point[joint] = problem.right[(row + AT_REST) * dof + joint]
        for back in range(1, min(BAND, <int>min(row, BAND) + 1)):
            share = factor[row * BAND + back]
            for joint in range(dof):
                point[joint] -= share * point[joint - back * dof]
        for joint in range(dof):
            point[joint] /= factor[row * BAND]
    for row in reversed(range(count)):
        point = problem.control + (row + AT_REST) * dof
        for back in range(1, min(BAND, <int>min(count - 1 - row, BAND) + 1)):
            share = factor[(row + back) * BAND + back]
            for joint in range(dof):
                point[joint] -= share * point[joint + back * dof]
        for joint in range(dof):
            point[joint] /= factor[row * BAND]


cdef void _alternate(Problem* problem, int turns, int turns_per_place) noexcept nogil:
    cdef int turn
    _follow(problem, False)
    _project(problem, True)
    for turn in range(1, turns + 1):
        _pull(problem)
        _solve(problem)
        _project(problem, False)
        if turn % turns_per_place == 0:
            _follow(problem, True)


def fit(asked, control, times_s, step_s, limits, corridor, turns):
    cdef Problem problem
    cdef int order, joint
    dof = checked_dof(control.shape[1])
    origin = control[0].copy()
    points = np.ascontiguousarray(control - origin)
    times, scheduled = np.array(times_s), np.array(times_s)
    positions = np.ascontiguousarray(asked.centres - origin)
    directions = np.array(asked.directions)
    count = len(points)
    kept = [np.empty((count, dof)) for _ in range(2 * ORDERS + 3)]
    factor = np.empty((count, BAND))
    bounds = [
        corridor,
        limits.max_velocity * step_s,
        limits.max_acceleration * step_s**2,
        limits.max_jerk * step_s**3,
    ]
    problem.points, problem.rows, problem.dof = count, len(positions), dof
    problem.interval_s, problem.longest_shift_s = asked.interval_s, asked.step_s
    problem.lead_s, problem.scheduled_s = LEAD_STEPS * asked.step_s, doubles(scheduled, count)
    problem.last_s, problem.standstill, problem.relaxation = asked.duration_s, STANDSTILL, RELAXATION
    problem.positions, problem.directions = doubles(positions, 2 * dof), doubles(directions, 2 * dof)
    problem.control, problem.times_s = doubles(points, 2 * AT_REST * dof), doubles(times, count)
    for order in range(ORDERS):
        problem.weights[order] = WEIGHTS[order] / float(np.mean(bounds[order])) ** 2
        problem.wanted[order] = doubles(kept[order], 1)
        problem.owed[order] = doubles(kept[ORDERS + order], 1)
        for joint in range(dof):
            problem.bounds[order][joint] = bounds[order][joint]
    for joint in range(dof):
        problem.low[joint] = limits.min_position[joint] - origin[joint]
        problem.high[joint] = limits.max_position[joint] - origin[joint]
    problem.there, problem.direction, problem.right = (
        doubles(kept[2 * ORDERS], 1), doubles(kept[2 * ORDERS + 1], 1), doubles(kept[2 * ORDERS + 2], 1)
    )
    problem.factor = doubles(factor, 1)
    cdef int number = turns, per_place = TURNS_PER_PLACE, failed
    with nogil:
        failed = _factorise(&problem)
        if not failed:
            _alternate(&problem, number, per_place)
    if failed:
        raise ArithmeticError("the fit's matrix is not positive definite")
    return points + origin, times
