"""The shortest path through a cloud of configurations: A* with lazy collision checks.

An edge is assumed to be free, and is checked only when a shortest path uses it (R. Bohlin and L. Kavraki,
"Path planning using lazy PRM", 2000, doi 10.1109/ROBOT.2000.844107). So only some dozens of many thousand
edges are checked.
"""

from libc.math cimport INFINITY, fabs, fmin, sqrt
from libc.stdlib cimport free, malloc

import numpy as np

from cobot.arrays cimport doubles
from cobot.robot.clearance cimport Clearance

cdef enum:
    NONE = -1

cdef struct Cloud:
    const double* nodes
    int count
    int dof
    int goals           # the last ones
    # their lengths; negative for an edge that is proven free, infinite for one that is not free
    double* edges
    double* reached     # the length of the way to each node
    double* left        # a lower bound of the way from the node to a goal
    int* before         # the previous node on that way
    char* settled


def shortest(Clearance clearance, nodes, int goals, double shorter_than_rad, long work):
    """See roadmap.pyi."""
    cdef Cloud cloud
    cdef int found
    rows = np.array(nodes, dtype=np.float64).reshape(-1, clearance.dof)
    if len(rows) <= goals or goals < 1 or not np.isfinite(rows).all():
        raise ValueError("a start and goals are needed, all of them finite")
    cloud.nodes, cloud.count = doubles(rows, rows.size), len(rows)
    cloud.dof, cloud.goals = clearance.dof, goals
    cloud.edges = <double*>malloc(<size_t>cloud.count * cloud.count * sizeof(double))
    cloud.reached = <double*>malloc(cloud.count * sizeof(double))
    cloud.left = <double*>malloc(cloud.count * sizeof(double))
    cloud.before = <int*>malloc(cloud.count * sizeof(int))
    cloud.settled = <char*>malloc(cloud.count)
    try:
        if not (cloud.edges and cloud.reached and cloud.left and cloud.before and cloud.settled):
            raise MemoryError("no memory for a roadmap")
        clearance.enclose()
        with nogil:
            found = _search(clearance, &cloud, shorter_than_rad, work)
        if found == NONE:
            return None
        way = []
        while found != NONE:
            way.append(found)
            found = cloud.before[found]
        return rows[way[::-1]]
    finally:
        free(cloud.edges)
        free(cloud.reached)
        free(cloud.left)
        free(cloud.before)
        free(cloud.settled)


cdef int _search(Clearance clearance, Cloud* cloud, double shorter_than_rad, long work) noexcept nogil:
    """The goal that a free path reaches, or NONE."""
    cdef long begun = clearance.evaluations
    cdef int goal
    _measure(cloud)
    while clearance.evaluations - begun <= work:
        goal = _nearest_goal(cloud, shorter_than_rad)
        if goal == NONE or _is_free(clearance, cloud, goal):
            return goal
    return NONE


cdef void _measure(Cloud* cloud) noexcept nogil:
    cdef const double* first
    cdef const double* second
    cdef double square
    cdef int i, k, joint
    for i in range(cloud.count):
        for k in range(i + 1):
            first, second = &cloud.nodes[i * cloud.dof], &cloud.nodes[k * cloud.dof]
            square = 0.0
            for joint in range(cloud.dof):
                square += (first[joint] - second[joint]) * (first[joint] - second[joint])
            cloud.edges[i * cloud.count + k] = cloud.edges[k * cloud.count + i] = sqrt(square)
    for i in range(cloud.count):
        cloud.left[i] = INFINITY
        for k in range(cloud.count - cloud.goals, cloud.count):
            cloud.left[i] = fmin(cloud.left[i], cloud.edges[i * cloud.count + k])


cdef int _nearest_goal(Cloud* cloud, double shorter_than_rad) noexcept nogil:
    """The goal with the shortest path over edges that are not known to be blocked; NONE if all are longer
    than `shorter_than_rad`."""
    cdef int count = cloud.count
    cdef int i, node
    cdef double least, length
    cdef const double* edges
    for i in range(count):
        cloud.reached[i], cloud.before[i], cloud.settled[i] = INFINITY, NONE, 0
    cloud.reached[0] = 0.0
    while True:
        node = NONE
        least = shorter_than_rad
        for i in range(count):
            if not cloud.settled[i] and cloud.reached[i] + cloud.left[i] < least:
                node, least = i, cloud.reached[i] + cloud.left[i]
        if node == NONE or node >= count - cloud.goals:
            return node
        cloud.settled[node] = 1
        edges = &cloud.edges[node * count]
        for i in range(count):
            length = cloud.reached[node] + fabs(edges[i])
            if not cloud.settled[i] and length < cloud.reached[i]:
                cloud.reached[i], cloud.before[i] = length, node


cdef bint _is_free(Clearance clearance, Cloud* cloud, int goal) noexcept nogil:
    """Check all edges of a path that have not been checked yet, and record the result of each."""
    cdef bint free_ = True
    cdef int node = goal
    cdef int other
    cdef double length
    while node > 0:
        other = cloud.before[node]
        length = cloud.edges[node * cloud.count + other]
        if length > 0.0:
            if clearance.c_is_edge_free(&cloud.nodes[other * cloud.dof], &cloud.nodes[node * cloud.dof]):
                length = -length
            else:
                length = INFINITY
                free_ = False
            cloud.edges[node * cloud.count + other] = cloud.edges[other * cloud.count + node] = length
        node = other
    return free_
