"""RRT-Connect in joint space (J. Kuffner and S. LaValle, 2000, doi 10.1109/ROBOT.2000.844730), compiled.

OMPL's RRTConnect calls Python for every configuration and every motion, and its random numbers are seeded
once per process. This implementation shares no state, and the same seed gives the same path.
"""

from libc.math cimport INFINITY, M_PI, cos, fmax, fmin, isinf, log, sqrt
from libc.stdint cimport uint64_t
from libc.stdlib cimport free, realloc
from libc.string cimport memcpy

import numpy as np

from cobot.arrays cimport MAX_DOF, doubles
from cobot.planners.monotonic cimport now_s
from cobot.planners.splitmix cimport uniform
from cobot.robot.clearance cimport Clearance

cdef enum:
    GROWTH = 256
    LOOK = 16    # number of draws between two checks of the time
    AHEAD = 16   # configurations that are drawn and checked together
    DRAWS = 50   # number of draws for each attempt, because most configurations are too far away
    TRAPPED = -1
    NO_MEMORY = -2

cdef struct Tree:
    double* nodes
    int* before
    int count
    int room


def connect(Clearance clearance, start, goals, low, high, uint64_t seed, double timeout_s, double range_rad,
            double shorter_than_rad=np.inf, long attempts=0):
    """The corners of a free polyline from the start to one of the goals, shape (n, dof); None if time runs
    out.

    Args:
        start, low, high: shape (dof,), rad.
        goals: shape (k, dof).
        range_rad: largest distance of a node from its parent.
        shorter_than_rad: only configurations that a path shorter than this can pass are used.
        attempts: maximum number of attempts to add a node; 0: no limit but the time.
    """
    cdef int dof = clearance.dof
    cdef Tree trees[2]
    cdef int met[2]
    cdef double bounds[2][MAX_DOF]
    cdef int i, found
    begin = np.array(start, dtype=np.float64).reshape(1, dof)
    ends = np.array(goals, dtype=np.float64).reshape(-1, dof)
    for i in range(dof):
        bounds[0][i], bounds[1][i] = low[i], high[i]
    for i in range(2):
        trees[i].nodes, trees[i].before, trees[i].count, trees[i].room = NULL, NULL, 0, 0
    cdef const double* first = doubles(begin, dof)
    cdef const double* last = doubles(ends, ends.size)
    cdef int count = len(ends)
    if not (np.isfinite(begin).all() and np.isfinite(ends).all()):
        raise ValueError("a joint is not finite")
    clearance.enclose()
    clearance.forget_hits()  # or the work, which callers limit, would depend on earlier searches
    try:
        with nogil:
            found = _grow(
                clearance, trees, first, last, count, bounds[0], bounds[1], seed, timeout_s, range_rad,
                shorter_than_rad, attempts, met,
            )
        if found == NO_MEMORY:
            raise MemoryError("no memory for the search trees")
        if not found:
            return None
        there = [_node(&trees[0], node, dof) for node in _branch(&trees[0], met[0])]
        back = [_node(&trees[1], node, dof) for node in _branch(&trees[1], met[1])]
        return np.array([*there[::-1], *(back[1:] if there[0] == back[0] else back)])
    finally:
        for i in range(2):
            free(trees[i].nodes)
            free(trees[i].before)


cdef int _grow(
    Clearance clearance, Tree* trees, const double* start, const double* goals, int goal_count,
    const double* low, const double* high, uint64_t seed, double timeout_s, double range_rad,
    double shorter_than_rad, long attempts, int* met,
) noexcept nogil:
    """Grow both trees until they meet. Returns whether they meet; `met` becomes the node of each. The first
    tree has the start as its root, the other one the goals.
    """
    cdef int dof = clearance.dof
    cdef uint64_t state = seed
    cdef double end_s = now_s() + timeout_s
    cdef double wanted[MAX_DOF]
    cdef double ahead[AHEAD * MAX_DOF]
    cdef unsigned blocked = 0
    cdef int filled = 0
    cdef int used = 0
    cdef long drawn = 0
    cdef long tried = 0
    cdef int side = 0
    cdef int index, added, other
    if _add(&trees[0], start, -1, dof) < 0:
        return NO_MEMORY
    for index in range(goal_count):
        if _add(&trees[1], &goals[index * dof], -1, dof) < 0:
            return NO_MEMORY
    if now_s() > end_s:
        return 0
    for index in range(goal_count):
        if clearance.c_is_edge_free(start, &goals[index * dof]):
            met[0], met[1] = 0, index
            return 1
    while True:
        if used == filled:
            filled = _draw(
                start, goals, goal_count, low, high, shorter_than_rad, dof, &state, end_s,
                DRAWS * attempts if attempts else 0, &drawn, ahead,
            )
            if not filled:
                return 0
            used, blocked = 0, clearance.c_are_blocked(ahead, filled)
        index, used = used, used + 1
        memcpy(wanted, &ahead[index * dof], dof * sizeof(double))
        tried += 1
        if attempts and tried > attempts:
            return 0
        side = 0 if trees[0].count <= trees[1].count else 1
        other = _nearest(&trees[side], wanted, dof)
        # An edge to a configuration that is not free needs no check of its own.
        if blocked >> index & 1 and _apart(&trees[side].nodes[other * dof], wanted, dof) <= range_rad:
            continue
        added = _extend(clearance, &trees[side], other, wanted, range_rad)
        if added == TRAPPED:
            continue
        if added == NO_MEMORY:
            return NO_MEMORY
        memcpy(wanted, &trees[side].nodes[added * dof], dof * sizeof(double))
        met[side] = added
        other = _nearest(&trees[1 - side], wanted, dof)
        while other >= 0:
            other = _extend(clearance, &trees[1 - side], other, wanted, range_rad)
            if other == NO_MEMORY:
                return NO_MEMORY
            if other >= 0 and _apart(&trees[1 - side].nodes[other * dof], wanted, dof) == 0.0:
                met[1 - side] = other
                return 1


cdef int _draw(
    const double* start, const double* goals, int goal_count, const double* low, const double* high,
    double shorter_than_rad, int dof, uint64_t* state, double end_s, long most, long* drawn, double* out,
) noexcept nogil:
    """Draw the next configurations to try, (AHEAD, dof). Returns their number, 0 once time or draws have run
    out."""
    cdef double* wanted
    cdef int count = 0
    cdef int index
    while count < AHEAD:
        drawn[0] += 1
        if drawn[0] % LOOK == 0 and (now_s() > end_s or (most and drawn[0] > most)):
            return 0
        wanted = &out[count * dof]
        if isinf(shorter_than_rad) or uniform(state) < 0.5:
            for index in range(dof):
                wanted[index] = low[index] + uniform(state) * (high[index] - low[index])
        else:
            index = <int>(uniform(state) * goal_count)
            _draw_between(start, &goals[index * dof], shorter_than_rad, dof, state, wanted)
        if _is_wanted(wanted, start, goals, goal_count, low, high, shorter_than_rad, dof):
            count += 1
    return count


cdef bint _is_wanted(
    const double* joints, const double* start, const double* goals, int goal_count, const double* low,
    const double* high, double shorter_than_rad, int dof,
) noexcept nogil:
    """Whether a configuration is within the limits, and on some path to a goal that is shorter than
    `shorter_than_rad`."""
    cdef double nearest_goal = INFINITY
    cdef int index
    for index in range(dof):
        if not low[index] <= joints[index] <= high[index]:
            return False
    for index in range(goal_count):
        nearest_goal = fmin(nearest_goal, _apart(joints, &goals[index * dof], dof))
    return _apart(joints, start, dof) + nearest_goal <= shorter_than_rad


cdef void _draw_between(
    const double* start, const double* goal, double length, int dof, uint64_t* state, double* out
) noexcept nogil:
    """Draw a configuration from the ellipsoid of all paths from `start` to `goal` that are no longer than
    `length` (J. Gammell, S. Srinivasa and T. Barfoot, "Informed RRT*", 2014, doi 10.1109/IROS.2014.6942976).
    It is a point of the unit ball, whose first axis a reflection aligns with the straight path.
    """
    cdef double apart = _apart(start, goal, dof)
    cdef double across = 0.5 * sqrt(fmax(0.0, length * length - apart * apart))
    cdef double mirror[MAX_DOF]
    cdef double square = 0.0
    cdef double along = 0.0
    cdef double radius
    cdef int i
    for i in range(dof):
        out[i] = _normal(state)
        square += out[i] * out[i]
    radius = uniform(state) ** (1.0 / dof) / sqrt(fmax(square, 1e-300))
    for i in range(dof):
        out[i] *= radius * (0.5 * length if i == 0 else across)
    if apart > 0.0:
        square = 0.0
        for i in range(dof):
            mirror[i] = (goal[i] - start[i]) / apart - (1.0 if i == 0 else 0.0)
            square += mirror[i] * mirror[i]
            along += mirror[i] * out[i]
        if square > 1e-12:
            for i in range(dof):
                out[i] -= 2.0 * along / square * mirror[i]
    for i in range(dof):
        out[i] += 0.5 * (start[i] + goal[i])


cdef double _normal(uint64_t* state) noexcept nogil:
    """A normally distributed number with mean 0 and variance 1, by Box and Muller."""
    cdef double u = uniform(state)
    return sqrt(-2.0 * log(1.0 - u)) * cos(2.0 * M_PI * uniform(state))


cdef int _extend(
    Clearance clearance, Tree* tree, int begin, const double* wanted, double range_rad
) noexcept nogil:
    """Add a node from the node `begin` towards `wanted`. Returns its index, or TRAPPED."""
    cdef double reached[MAX_DOF]
    cdef int dof = clearance.dof
    cdef const double* here = &tree.nodes[begin * dof]
    cdef double apart = _apart(here, wanted, dof)
    cdef int i
    if apart <= range_rad:
        memcpy(reached, wanted, dof * sizeof(double))
    else:
        for i in range(dof):
            reached[i] = here[i] + range_rad / apart * (wanted[i] - here[i])
    if not clearance.c_is_edge_free(here, reached):
        return TRAPPED
    return _add(tree, reached, begin, dof)


cdef int _add(Tree* tree, const double* joints, int before, int dof) noexcept nogil:
    cdef double* nodes
    cdef int* parents
    if tree.count == tree.room:
        nodes = <double*>realloc(tree.nodes, (2 * tree.room + GROWTH) * dof * sizeof(double))
        if nodes == NULL:
            return NO_MEMORY
        tree.nodes = nodes
        parents = <int*>realloc(tree.before, (2 * tree.room + GROWTH) * sizeof(int))
        if parents == NULL:
            return NO_MEMORY
        tree.before = parents
        tree.room = 2 * tree.room + GROWTH
    memcpy(&tree.nodes[tree.count * dof], joints, dof * sizeof(double))
    tree.before[tree.count] = before
    tree.count += 1
    return tree.count - 1


cdef int _nearest(const Tree* tree, const double* wanted, int dof) noexcept nogil:
    cdef double least = 1e300
    cdef double square, off
    cdef int best = 0
    cdef int node, i
    for node in range(tree.count):
        square = 0.0
        for i in range(dof):
            off = tree.nodes[node * dof + i] - wanted[i]
            square += off * off
        if square < least:
            least, best = square, node
    return best


cdef double _apart(const double* first, const double* second, int dof) noexcept nogil:
    cdef double square = 0.0
    cdef int i
    for i in range(dof):
        square += (first[i] - second[i]) * (first[i] - second[i])
    return sqrt(square)


cdef object _branch(const Tree* tree, int node):
    nodes = []
    while node >= 0:
        nodes.append(node)
        node = tree.before[node]
    return nodes


cdef object _node(const Tree* tree, int node, int dof):
    return [tree.nodes[node * dof + i] for i in range(dof)]
