"""The cheapest path through a graph of arm angles: dynamic programming, place by place."""

from libc.math cimport INFINITY, fabs

import numpy as np

from cobot.arrays cimport bytes_of, doubles


cdef double _edge(
    const double* begin, const double* end, const double* weights, int dof, double step_rad
) noexcept nogil:
    """The cost of a straight motion of the joints; infinite if a joint turns too far."""
    cdef double total = 0.0
    cdef double step
    cdef int joint
    for joint in range(dof):
        step = fabs(end[joint] - begin[joint])
        if not step <= step_rad:
            return INFINITY
        step *= weights[joint]
        total += step * step
    return total


def cheapest(rows, costs, start, weights, int window, double step_rad):
    """See lattice.pyi."""
    given = np.ascontiguousarray(rows, dtype=np.float64)
    cdef Py_ssize_t n = given.shape[0], m = given.shape[1]
    cdef int dof = given.shape[2]
    best, scales = np.array(costs, dtype=np.float64, order="C"), np.array(weights, dtype=np.float64)
    first = np.array(start, dtype=np.float64)
    sources = np.zeros((n, m), dtype=np.float64)
    cdef double* node = doubles(given, n * m * dof)
    cdef double* cost = doubles(best, n * m)
    cdef double* source = doubles(sources, n * m)
    cdef double* scale = doubles(scales, dof)
    cdef double* begin = doubles(first, dof)
    cdef Py_ssize_t reached = 0
    with nogil:
        reached = _search(node, cost, source, scale, begin, n, m, dof, window, step_rad)
    if reached < n:
        return np.empty(0, dtype=np.intp), reached
    indices = np.empty(n, dtype=np.intp)
    indices[n - 1] = best[n - 1].argmin()
    for place in range(n - 1, 0, -1):
        indices[place - 1] = int(sources[place, indices[place]])
    return indices, reached


def link(rows, costs, before, costs_before, weights, double step_rad):
    """See lattice.pyi."""
    given = np.ascontiguousarray(rows, dtype=np.float64)
    earlier = np.ascontiguousarray(before, dtype=np.float64)
    cdef Py_ssize_t n = given.shape[0], m = earlier.shape[0]
    cdef int dof = given.shape[1]
    own, spent = np.array(costs, dtype=np.float64), np.array(costs_before, dtype=np.float64)
    scales, parents = np.array(weights, dtype=np.float64), np.zeros(n, dtype=np.float64)
    if n == 0:
        return parents.astype(np.intp), own
    cdef double* node = doubles(given, n * dof)
    cdef double* last = doubles(earlier, m * dof)
    cdef double* cost = doubles(own, n)
    cdef double* way = doubles(spent, m)
    cdef double* scale = doubles(scales, dof)
    cdef double* parent = doubles(parents, n)
    cdef Py_ssize_t each, other
    cdef double least, total
    with nogil:
        for each in range(n):
            least = INFINITY
            for other in range(m):
                if way[other] >= least:
                    continue
                total = way[other] + _edge(&last[other * dof], &node[each * dof], scale, dof, step_rad)
                if total < least:
                    least, parent[each] = total, other
            cost[each] += least
    return parents.astype(np.intp), own


def leads(rows, good, start, int window, double step_rad):
    """See lattice.pyi."""
    given = np.ascontiguousarray(rows, dtype=np.float64)
    cdef Py_ssize_t n = given.shape[0], m = given.shape[1]
    cdef int dof = given.shape[2]
    first, flags = np.array(start, dtype=np.float64), np.array(good, dtype=np.uint8, order="C")
    cdef double* node = doubles(given, n * m * dof)
    cdef double* begin = doubles(first, dof)
    cdef char* flag = bytes_of(flags, n * m)
    cdef Py_ssize_t reached = 0
    window = min(max(window, 0), m // 2)
    with nogil:
        reached = _lead(node, flag, begin, n, m, dof, window, step_rad)
    return reached


cdef Py_ssize_t _lead(
    const double* node, char* good, const double* begin, Py_ssize_t n, Py_ssize_t m, int dof, int window,
    double step_rad
) noexcept nogil:
    """Unmark the nodes that no path reaches. Returns the number of places that are reached."""
    cdef Py_ssize_t place, angle
    cdef bint any
    for place in range(n):
        any = False
        for angle in range(m):
            if not good[place * m + angle]:
                continue
            if place == 0:
                good[angle] = _is_step(begin, &node[angle * dof], dof, step_rad)
            else:
                good[place * m + angle] = _has_step(
                    &node[(place - 1) * m * dof], &good[(place - 1) * m], m, angle, window,
                    &node[(place * m + angle) * dof], dof, step_rad
                )
            any = any or good[place * m + angle]
        if not any:
            return place
    return n


cdef bint _has_step(
    const double* row, const char* good, Py_ssize_t m, Py_ssize_t angle, int window, const double* end,
    int dof, double step_rad
) noexcept nogil:
    """Whether a step leads to the joints `end` from a good node of the row. The nearest arm angles are tried
    first."""
    cdef int shift
    cdef Py_ssize_t other
    for shift in range(window + 1):
        other = (angle + shift) % m
        if good[other] and _is_step(&row[other * dof], end, dof, step_rad):
            return True
        other = (angle - shift + m) % m
        if good[other] and _is_step(&row[other * dof], end, dof, step_rad):
            return True
    return False


cdef bint _is_step(const double* begin, const double* end, int dof, double step_rad) noexcept nogil:
    """Whether no joint turns further than `step_rad`."""
    cdef int joint
    for joint in range(dof):
        if not fabs(end[joint] - begin[joint]) <= step_rad:
            return False
    return True


cdef Py_ssize_t _search(
    const double* node, double* cost, double* source, const double* scale, const double* begin,
    Py_ssize_t n, Py_ssize_t m, int dof, int window, double step_rad
) noexcept nogil:
    """Replace the nodes' costs by those of the cheapest paths to them. Returns the number of places that are
    reached."""
    cdef Py_ssize_t place, angle, other
    cdef double least, total
    cdef bint any
    cdef int shift
    for place in range(n):
        any = False
        for angle in range(m):
            if cost[place * m + angle] == INFINITY:
                continue
            least = INFINITY
            if place == 0:
                least = _edge(begin, &node[angle * dof], scale, dof, step_rad)
            else:
                for shift in range(-window, window + 1):
                    other = (angle + shift + m) % m
                    total = cost[(place - 1) * m + other]
                    if total < least:
                        total += _edge(
                            &node[((place - 1) * m + other) * dof], &node[(place * m + angle) * dof],
                            scale, dof, step_rad
                        )
                        if total < least:
                            least = total
                            source[place * m + angle] = other
            cost[place * m + angle] += least
            any = any or cost[place * m + angle] < INFINITY
        if not any:
            return place
    return n
