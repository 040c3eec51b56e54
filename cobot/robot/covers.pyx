"""Trees of spheres that enclose a convex body, for `lanes.h`.

The body is cut in halves across its longest edge, again and again. Each piece gets a small ball around its
corners, so all leaves together enclose the body by construction. The inner radius of a ball is the depth of
its centre in the body. The check loses the difference of both radii: where it is nearer than this, exact
distances decide. A piece with a small loss is not cut further.
"""

from libc.math cimport atan2, fmax, fmin, sqrt
from libc.stdlib cimport free, malloc, realloc

import numpy as np

from cobot.arrays cimport doubles

cdef enum:
    DEPTH = 24       # LANES_DEPTH of lanes.h is larger
    STEPS = 40
    COLUMNS = 7      # x, y, z, outer, inner, skip, depth

cdef double ROUNDING_M = 1e-9


cdef struct Body:
    double* points       # polygon by polygon, three coordinates each
    int* first           # of each polygon, and the end of the last one
    int polygons
    int count
    int room
    int polygon_room


cdef struct Tree:
    double* nodes
    int count
    int room
    double* planes       # of the whole body: normal, offset
    int plane_count
    double loss_m
    double floor_m


def cover(points, faces, double loss_m, double floor_m):
    """The tree of a convex polyhedron, shape (n, 7): centre, outer and inner radius, m, then the index of the
    next node that is not below this one, and the depth. The first node encloses the whole body.

    Args:
        points: corners, shape (k, 3), m.
        faces: corners of each face, as indices, in order around it.
        loss_m: a piece whose radii differ by no more is not cut.
        floor_m: a piece whose outer radius is no larger is not cut either.
    """
    cdef Body body
    cdef Tree tree
    cdef int index, corner
    given = np.array(points, dtype=np.float64).reshape(-1, 3)
    if not len(given) or not np.isfinite(given).all():
        raise ValueError("a body needs finite corners")
    planes = _planes(given, faces)
    tree.nodes, tree.count, tree.room = NULL, 0, 0
    tree.planes, tree.plane_count = doubles(planes, planes.size) if len(planes) else NULL, len(planes)
    tree.loss_m, tree.floor_m = loss_m, floor_m
    _init(&body)
    try:
        for face in faces:
            for corner in face:
                _put(&body, given[corner, 0], given[corner, 1], given[corner, 2])
            _close(&body)
        if _divide(&tree, &body, 0) < 0:
            raise MemoryError("no memory for the spheres around a body")
        out = np.empty((tree.count, COLUMNS))
        for index in range(tree.count):
            for corner in range(COLUMNS):
                out[index, corner] = tree.nodes[index * COLUMNS + corner]
        return out
    finally:
        _release(&body)
        free(tree.nodes)


def _planes(points, faces):
    """The planes of the faces, shape (k, 4): outward normal and offset. Faces without an area have none."""
    middle = points.mean(axis=0)
    rows = []
    for face in faces:
        corners = points[list(face)]
        normal = np.zeros(3)
        for index in range(1, len(corners) - 1):
            normal = normal + np.cross(corners[index] - corners[0], corners[index + 1] - corners[0])
        size = float(np.linalg.norm(normal))
        if size < 1e-14:
            continue
        normal = normal / size
        offset = float((corners @ normal).max())
        if normal @ middle > offset:
            normal, offset = -normal, float((corners @ -normal).max())
        rows.append([*normal, offset])
    return np.array(rows).reshape(-1, 4)


cdef void _init(Body* body) noexcept nogil:
    body.points, body.first = NULL, NULL
    body.polygons, body.count, body.room, body.polygon_room = 0, 0, 0, 0


cdef void _release(Body* body) noexcept nogil:
    free(body.points)
    free(body.first)


cdef int _put(Body* body, double x, double y, double z) except -1 nogil:
    if body.count == body.room:
        body.room = 2 * body.room + 64
        body.points = <double*>realloc(body.points, 3 * body.room * sizeof(double))
        if body.points == NULL:
            with gil:
                raise MemoryError("no memory for the spheres around a body")
    body.points[3 * body.count], body.points[3 * body.count + 1] = x, y
    body.points[3 * body.count + 2] = z
    body.count += 1
    return 0


cdef int _close(Body* body) except -1 nogil:
    """End a polygon with the points since the last one."""
    if body.polygons + 2 > body.polygon_room:
        body.polygon_room = 2 * body.polygon_room + 32
        body.first = <int*>realloc(body.first, body.polygon_room * sizeof(int))
        if body.first == NULL:
            with gil:
                raise MemoryError("no memory for the spheres around a body")
        if body.polygons == 0:
            body.first[0] = 0
    if body.count > body.first[body.polygons]:
        body.polygons += 1
        body.first[body.polygons] = body.count
    return 0


cdef int _divide(Tree* tree, Body* body, int depth) except -2 nogil:
    """Add the node of a piece, and those of its halves."""
    cdef double ball[4]
    cdef double low[3]
    cdef double high[3]
    cdef double inner = -1.0
    cdef int node = tree.count
    cdef int axis = 0
    cdef int k, half
    cdef Body part
    if tree.count == tree.room:
        tree.room = 2 * tree.room + 64
        tree.nodes = <double*>realloc(tree.nodes, tree.room * COLUMNS * sizeof(double))
        if tree.nodes == NULL:
            return -1
    tree.count += 1
    _enclose(body, ball, low, high)
    if tree.plane_count:
        inner = 1e300
        for k in range(tree.plane_count):
            inner = fmin(inner, tree.planes[4 * k + 3] - (
                tree.planes[4 * k] * ball[0] + tree.planes[4 * k + 1] * ball[1]
                + tree.planes[4 * k + 2] * ball[2]
            ))
    for k in range(3):
        tree.nodes[node * COLUMNS + k] = ball[k]
        if high[k] - low[k] > high[axis] - low[axis]:
            axis = k
    tree.nodes[node * COLUMNS + 3], tree.nodes[node * COLUMNS + 4] = ball[3] + ROUNDING_M, inner
    tree.nodes[node * COLUMNS + 6] = depth
    if depth < DEPTH and ball[3] > tree.floor_m and ball[3] - inner > tree.loss_m:
        for half in range(2):
            _init(&part)
            try:
                _cut(body, axis, 0.5 * (low[axis] + high[axis]), half == 1, &part)
                if part.count and _divide(tree, &part, depth + 1) < 0:
                    return -1
            finally:
                _release(&part)
    tree.nodes[node * COLUMNS + 5] = tree.count
    return 0


cdef void _enclose(const Body* body, double* ball, double* low, double* high) noexcept nogil:
    """A ball around all points, at most a few per cent larger than the smallest one (M. Badoiu and K.
    Clarkson, "Smaller core-sets for balls", 2003), and the box around them."""
    cdef double far, square, off
    cdef int step, index, k, farthest
    for k in range(3):
        low[k], high[k] = 1e300, -1e300
        for index in range(body.count):
            low[k] = fmin(low[k], body.points[3 * index + k])
            high[k] = fmax(high[k], body.points[3 * index + k])
        ball[k] = 0.5 * (low[k] + high[k])
    for step in range(STEPS + 1):
        far, farthest = -1.0, 0
        for index in range(body.count):
            square = 0.0
            for k in range(3):
                off = body.points[3 * index + k] - ball[k]
                square += off * off
            if square > far:
                far, farthest = square, index
        if step == STEPS:
            break
        for k in range(3):
            ball[k] += (body.points[3 * farthest + k] - ball[k]) / (step + 2.0) * 0.5
    ball[3] = sqrt(far)


cdef int _cut(const Body* body, int axis, double place, bint above, Body* out) except -1 nogil:
    """The half of a convex body on one side of a plane across an axis. Its new face is closed."""
    cdef double* crossing = <double*>malloc(3 * (body.count + 1) * sizeof(double))
    cdef int crossings = 0
    cdef int polygon, index, k
    cdef const double* here
    cdef const double* there
    cdef double side, other, share
    cdef double sign = 1.0 if above else -1.0
    if crossing == NULL:
        with gil:
            raise MemoryError("no memory for the spheres around a body")
    try:
        for polygon in range(body.polygons):
            for index in range(body.first[polygon], body.first[polygon + 1]):
                here = &body.points[3 * index]
                there = &body.points[
                    3 * (index + 1 if index + 1 < body.first[polygon + 1] else body.first[polygon])
                ]
                side, other = sign * (here[axis] - place), sign * (there[axis] - place)
                if side >= 0.0:
                    _put(out, here[0], here[1], here[2])
                if (side >= 0.0) != (other >= 0.0):
                    share = side / (side - other)
                    for k in range(3):
                        crossing[3 * crossings + k] = here[k] + share * (there[k] - here[k])
                    crossing[3 * crossings + axis] = place
                    _put(
                        out, crossing[3 * crossings], crossing[3 * crossings + 1], crossing[3 * crossings + 2]
                    )
                    crossings += 1
            _close(out)
        if crossings > 2:
            _sort_around(crossing, crossings, (axis + 1) % 3, (axis + 2) % 3)
            for index in range(crossings):
                _put(out, crossing[3 * index], crossing[3 * index + 1], crossing[3 * index + 2])
            _close(out)
    finally:
        free(crossing)
    return 0


cdef void _sort_around(double* points, int count, int first, int second) noexcept nogil:
    """Sort points of a plane by their angle around their middle."""
    cdef double x = 0.0
    cdef double y = 0.0
    cdef double angle, other
    cdef double held[3]
    cdef int index, place, k
    for index in range(count):
        x += points[3 * index + first] / count
        y += points[3 * index + second] / count
    for index in range(1, count):
        for k in range(3):
            held[k] = points[3 * index + k]
        angle = atan2(held[second] - y, held[first] - x)
        place = index
        while place > 0:
            other = atan2(points[3 * place - 3 + second] - y, points[3 * place - 3 + first] - x)
            if other <= angle:
                break
            for k in range(3):
                points[3 * place + k] = points[3 * place - 3 + k]
            place -= 1
        for k in range(3):
            points[3 * place + k] = held[k]
