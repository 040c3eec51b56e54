"""The occupied cubes of a grid, and exact distances of a geom from them.

The cubes are the leaves of a balanced tree of boxes. A search takes the nearer box first, and leaves out each
box that is no nearer than the nearest cube so far. The distance of a geom from a box around cubes is never
larger than that from one of them, also where they overlap.

For capsules and spheres the distance from a box is a short formula. Around any other geom there is a tree of
spheres, see `covers.pyx`: their distance from a box is at most that of the geom. The distance from a cube is
that of `gap`, for a geom of MuJoCo's model that is one cube and is moved from one place to the next.
"""

from libc.math cimport fabs, fmax, fmin, sqrt
from libc.stdint cimport uint64_t
from libc.stdlib cimport calloc, free

from heapq import heappop, heappush

import numpy as np

from cobot.arrays cimport bytes_of
from cobot.robot.mujoco cimport mjData, mjModel
from cobot.robot.shapes cimport SEGMENT, Solid, axis_to_box, gap, into

cdef enum:
    MAX_STACK = 64       # a balanced tree of 2^31 cubes has 32 levels
    MAX_INDEX = 1048576  # of a cube along an axis: a key has 21 bits for each


# Rounding of boxes around cubes.
cdef double SAME_M = 1e-8


cdef class CloudTree:
    """The cubes of a grid that begins at the origin. Read only, so all threads may use it.

    Attributes:
        cells: indices of the cubes, shape (count, 3), int32, in the order of `in_order`.
        count: the number of cubes.
        voxel_m: edge of a cube.
    """

    def __cinit__(self, cells, double voxel_m):
        given = np.ascontiguousarray(cells, dtype=np.int32)
        if given.ndim != 2 or given.shape[1] != 3 or not len(given) or not voxel_m > 0.0:
            raise ValueError(f"cells of shape (n, 3) and an edge are needed, not {given.shape} and {voxel_m}")
        self.cells, self.count, self.voxel_m = given, len(given), voxel_m
        self.nodes = <CloudNode*>calloc(2 * self.count, sizeof(CloudNode))
        if self.nodes == NULL:
            raise MemoryError("no memory for the cubes of a cloud")
        cdef const int* first = <const int*>bytes_of(given, given.nbytes)
        cdef int index, axis
        cdef double middle[3]
        with nogil:
            self._fill(first, 0, self.count)
            for axis in range(3):
                middle[axis] = self.nodes[0].middle[axis]
            for index in range(2 * self.count - 1):
                for axis in range(3):
                    self.nodes[index].middle[axis] -= middle[axis]

    def __dealloc__(self):
        free(self.nodes)

    cdef void _fill(self, const int* cells, int index, int count) noexcept nogil:
        """Fill in a node and all below it, with middles from the origin."""
        cdef CloudNode* node = &self.nodes[index]
        cdef CloudNode* left
        cdef CloudNode* right
        cdef double low, high
        cdef int axis
        cdef int half = count // 2
        node.count = count
        if count == 1:
            for axis in range(3):
                node.half[axis] = 0.5 * self.voxel_m
                node.middle[axis] = (cells[axis] + 0.5) * self.voxel_m
            node.central = index
            return
        left, right = &self.nodes[index + 1], &self.nodes[index + 2 * half]
        self._fill(cells, index + 1, half)
        self._fill(cells + 3 * half, index + 2 * half, count - half)
        for axis in range(3):
            low = fmin(left.middle[axis] - left.half[axis], right.middle[axis] - right.half[axis])
            high = fmax(left.middle[axis] + left.half[axis], right.middle[axis] + right.half[axis])
            node.middle[axis], node.half[axis] = 0.5 * (low + high), 0.5 * (high - low) + 1e-12
        node.central = left.central
        if _apart(node, &self.nodes[right.central]) < _apart(node, &self.nodes[left.central]):
            node.central = right.central

    @property
    def bounds(self):
        """Middle and edges of the box around all cubes, shape (6,), m."""
        low, high = self.cells.min(axis=0), self.cells.max(axis=0) + 1
        return self.voxel_m * np.concatenate([0.5 * (low + high), high - low])

    def boxes(self, int room):
        """At most `room` boxes that contain all cubes, and as little else as the tree permits: the box with
        the largest empty volume is divided first.

        Returns:
            Middle and edges of each box, shape (k, 6), m, along the grid's axes; and a bound of the distance
            by which they extend beyond the cubes, m. 0 means that they are exactly the cubes.
        """
        bounds = self.bounds
        cdef double edge
        cdef int index, axis, half
        waiting, full = [], []

        def add(int index):
            cdef CloudNode* node = &self.nodes[index]
            empty = 8.0 * node.half[0] * node.half[1] * node.half[2] - node.count * self.voxel_m**3
            if empty > 1e-3 * self.voxel_m**3:
                heappush(waiting, (-empty, index))
            else:
                full.append(index)

        add(0)
        while waiting and len(waiting) + len(full) < room:
            _, index = heappop(waiting)
            half = self.nodes[index].count // 2
            add(index + 1)
            add(index + 2 * half)
        found, beyond = np.empty((len(waiting) + len(full), 6)), 0.0
        for row, index in enumerate([*full, *(index for _, index in waiting)]):
            for axis in range(3):
                edge = 2.0 * self.nodes[index].half[axis]
                found[row, axis] = bounds[axis] + self.nodes[index].middle[axis]
                found[row, 3 + axis] = edge
            if row >= len(full):
                beyond = max(beyond, float(np.linalg.norm(found[row, 3:] - self.voxel_m)))
        return found, beyond

    def is_within(self, boxes):
        """Whether each cube is in one of these boxes, which have rows like those of `boxes`."""
        given = np.array(boxes, dtype=np.float64).reshape(-1, 6)
        given[:, :3] -= self.bounds[:3]
        cdef int count = len(given)
        if not count:
            return False
        near = np.tile(np.arange(count, dtype=np.int32), MAX_STACK)
        cdef const double* first = <const double*>bytes_of(given, given.nbytes)
        cdef int* listed = <int*>bytes_of(near, near.nbytes)
        cdef bint found
        with nogil:
            found = self._is_within(0, first, listed, count)
        return found

    cdef bint _is_within(self, int index, const double* boxes, int* near, int count) noexcept nogil:
        """Whether boxes contain a node. `near` lists those that may, with space for those of deeper nodes."""
        cdef CloudNode* node = &self.nodes[index]
        cdef int* nearer = near + count
        cdef const double* box
        cdef double away, room
        cdef int left = 0
        cdef int row, axis
        cdef bint inside, apart
        for row in range(count):
            box, inside, apart = boxes + 6 * near[row], True, False
            for axis in range(3):
                away, room = fabs(node.middle[axis] - box[axis]), 0.5 * box[3 + axis] + SAME_M
                inside = inside and away + node.half[axis] <= room
                apart = apart or away - node.half[axis] >= room
            if inside:
                return True
            if not apart:
                nearer[left] = near[row]
                left += 1
        if not left or node.count == 1:
            return False
        return (
            self._is_within(index + 1, boxes, nearer, left)
            and self._is_within(index + 2 * (node.count // 2), boxes, nearer, left)
        )

    def spheres(self):
        """A sphere around each node, in rows like those of `cover`, relative to the middle of the cloud."""
        found = np.empty((2 * self.count - 1, 7))
        cdef double[:, ::1] rows = found
        cdef CloudNode* node
        cdef int index, axis, end
        cdef int depth = 0
        cdef int ends[MAX_STACK]
        for index in range(2 * self.count - 1):
            node = &self.nodes[index]
            while depth and ends[depth - 1] <= index:
                depth -= 1
            end = index + 2 * node.count - 1
            for axis in range(3):
                rows[index, axis] = node.middle[axis]
            rows[index, 3] = 1e-9 + sqrt(
                node.half[0] * node.half[0] + node.half[1] * node.half[1] + node.half[2] * node.half[2]
            )
            # The depth of the middle; if it is negative, a cube is at most this far away.
            rows[index, 4] = 0.5 * self.voxel_m - _apart(node, &self.nodes[node.central]) - 1e-9
            rows[index, 5], rows[index, 6] = end, depth
            ends[depth] = end
            depth += 1
        return found

    def nodes_at(self, turn, offset):
        """The spheres of a cloud at this pose, as `lane_nodes`. Those of the last pose are kept, because all
        checks of a scene share them."""
        place = turn.tobytes(), offset.tobytes()
        placed = self._placed
        if placed is None or placed[0] != place:
            placed = self._placed = place, lane_nodes(self.spheres(), turn, offset)
        return placed[1]


def lane_nodes(tree, turn, offset):
    """Rotate and move spheres, given as rows of `cover`, and return them as rows of `LaneNode`."""
    nodes = np.empty((len(tree), 7), dtype=np.float32)
    nodes[:, :3] = tree[:, :3] @ turn.T + offset
    nodes[:, 3:5] = tree[:, 3:5]
    nodes[:, 5:].view(np.int32)[:] = tree[:, 5:]
    return nodes


cdef inline double _apart(const CloudNode* node, const CloudNode* other) noexcept nogil:
    """The distance between the middles of two nodes."""
    cdef double x = node.middle[0] - other.middle[0]
    cdef double y = node.middle[1] - other.middle[1]
    cdef double z = node.middle[2] - other.middle[2]
    return sqrt(x * x + y * y + z * z)


cdef double gap_to_cloud(
    const mjModel* model, mjData* data, const Solid* first, const Sphere* around, int spheres,
    const Solid* second, const Solid* cube, const CloudNode* nodes, double enough_m, double exact_m,
    double decided_m, double* line, int* nearest
) noexcept nogil:
    """Like `gap`, with the cubes of a cloud as the second geom.

    Args:
        exact_m: if the distance is at least this, the result may be too small, because it is the distance of
            the spheres. So few exact distances are needed to decide about this distance.
        decided_m: if the distance is below this, the result may be too large, but not above `decided_m`,
            because it is the distance of some cube. So the deepest cube need not be found.
        around: the spheres around the first geom in its own frame; not used for a capsule.
        cube: the geom with the size of a cube, which is left at the last cube that was looked at.
        line, nearest: need an exact distance. The nearest cube is given as a node; -1: none is nearer than
            `enough_m`.
    """
    cdef int stack[MAX_STACK]
    cdef double bounds[MAX_STACK]
    cdef const double* middle = &data.geom_xpos[3 * first.geom]
    cdef const double* turn = &data.geom_xmat[9 * first.geom]
    cdef const double* origin = &data.geom_xpos[3 * second.geom]
    cdef const double* frame = &data.geom_xmat[9 * second.geom]
    cdef double* place = &data.geom_xpos[3 * cube.geom]
    cdef double centre[3]
    cdef double axis[3]
    cdef double relative[9]
    cdef double found[6]
    cdef double best = enough_m
    cdef double distance, other, apart
    cdef double extent[12]
    cdef bint is_deep = False
    cdef const CloudNode* node
    cdef int size = 1
    cdef int index, near, far, i, k
    into(middle, turn, origin, frame, centre, axis)
    if first.kind != SEGMENT:
        for i in range(3):
            for k in range(3):
                relative[3 * i + k] = (
                    frame[i] * turn[k] + frame[3 + i] * turn[3 + k] + frame[6 + i] * turn[6 + k]
                )
    if nearest != NULL:
        nearest[0] = -1
    stack[0], bounds[0] = 0, -1e300
    while size:
        size -= 1
        if bounds[size] >= best:
            continue
        index = stack[size]
        node = &nodes[index]
        if node.count == 1:
            if bounds[size] >= exact_m:
                best = bounds[size]
                continue
            for i in range(3):
                place[i] = origin[i] + (
                    frame[3 * i] * node.middle[0] + frame[3 * i + 1] * node.middle[1]
                    + frame[3 * i + 2] * node.middle[2]
                )
            distance = gap(model, data, first, cube, best, found)
            if distance < best:
                best = distance
                if line != NULL:
                    for i in range(6):
                        line[i] = found[i]
                if nearest != NULL:
                    nearest[0] = index
            continue
        near, far = index + 1, index + 2 * (node.count // 2)
        apart = best if best < decided_m else fmax(best, 0.0)
        if best < 0.0 and apart == 0.0 and not is_deep and spheres:
            _extend(around, spheres, relative, extent)
            is_deep = True
        distance = _bound(
            first, around, spheres, centre, axis, relative, &nodes[near], best, apart,
            extent if is_deep else NULL
        )
        other = _bound(
            first, around, spheres, centre, axis, relative, &nodes[far], best, apart,
            extent if is_deep else NULL
        )
        if other < distance:
            near, far = far, near
            distance, other = other, distance
        if other < best:
            stack[size], bounds[size] = far, other
            size += 1
        if distance < best:
            stack[size], bounds[size] = near, distance
            size += 1
    return best


cdef inline double _from_box(const double* point, const double* half) noexcept nogil:
    """The distance of a point from a box; inside the box, its depth as a negative number."""
    cdef double x = fabs(point[0]) - half[0]
    cdef double y = fabs(point[1]) - half[1]
    cdef double z = fabs(point[2]) - half[2]
    cdef double square = (x * x if x > 0.0 else 0.0) + (y * y if y > 0.0 else 0.0)
    square += z * z if z > 0.0 else 0.0
    if square > 0.0:
        return sqrt(square)
    x = x if x > y else y
    return x if x > z else z


cdef inline double _square_beyond(double at, double half) noexcept nogil:
    """The square of the distance of a number from the range -half to half."""
    cdef double beyond = fabs(at) - half
    return beyond * beyond if beyond > 0.0 else 0.0


cdef double _bound(
    const Solid* first, const Sphere* around, int spheres, const double* centre, const double* axis,
    const double* relative, const CloudNode* node, double best, double apart, const double* extent
) noexcept nogil:
    """A lower bound of the distance between the first geom and the cubes of a node; `apart`: see
    `_from_spheres`; `extent`: see `_extend`, or NULL."""
    cdef double off[3]
    cdef double normal[3]
    cdef double bound, along
    cdef int i
    for i in range(3):
        off[i] = centre[i] - node.middle[i]
    bound = _from_box(off, node.half) - first.bound_m
    if bound >= best:
        return bound
    if first.kind == SEGMENT:
        return axis_to_box(off, axis, first.half_m, node.half, normal, &along) - first.radius_m
    if extent != NULL:
        bound = fmax(bound, _along_axes(off, relative, extent, node.half))
        if bound >= best:
            return bound
    return fmax(bound, _from_spheres(around, spheres, off, relative, node.half, apart))


cdef void _extend(
    const Sphere* around, int spheres, const double* relative, double* extent
) noexcept nogil:
    """The lowest and the highest value of a geom along the three axes of the cloud, then along its own three,
    from its middle."""
    cdef double at
    cdef int index, i
    for i in range(6):
        extent[2 * i], extent[2 * i + 1] = 1e300, -1e300
    for index in range(spheres):
        if around[index].skip != index + 1:
            continue
        for i in range(6):
            if i < 3:
                at = (
                    relative[3 * i] * around[index].place[0] + relative[3 * i + 1] * around[index].place[1]
                    + relative[3 * i + 2] * around[index].place[2]
                )
            else:
                at = around[index].place[i - 3]
            extent[2 * i] = fmin(extent[2 * i], at - around[index].outer)
            extent[2 * i + 1] = fmax(extent[2 * i + 1], at + around[index].outer)


cdef double _along_axes(
    const double* off, const double* relative, const double* extent, const double* half
) noexcept nogil:
    """The largest distance of a geom from a box along one of their axes: no way out is longer than the
    overlap along an axis."""
    cdef double found = -1e300
    cdef double at, reach
    cdef int i, k
    for i in range(6):
        if i < 3:
            at, reach = off[i], half[i]
        else:
            at, reach = 0.0, 0.0
            for k in range(3):
                at += off[k] * relative[3 * k + i - 3]
                reach += half[k] * fabs(relative[3 * k + i - 3])
        found = fmax(found, fmax(at + extent[2 * i], -at - extent[2 * i + 1]) - reach)
    return found


cdef double _from_spheres(
    const Sphere* around, int spheres, const double* off, const double* relative, const double* half,
    double best
) noexcept nogil:
    """The distance of the spheres around a geom from a box, at most `best`. If they overlap, it says nothing
    about the depth, because the whole may be deeper than its parts: with a negative `best` it is not a
    bound."""
    cdef const Sphere* sphere
    cdef double x, y, z, square, reach
    cdef int index = 0
    while index < spheres:
        sphere = &around[index]
        x, y, z = sphere.place[0], sphere.place[1], sphere.place[2]
        reach = best + sphere.outer
        square = (
            _square_beyond(off[0] + relative[0] * x + relative[1] * y + relative[2] * z, half[0])
            + _square_beyond(off[1] + relative[3] * x + relative[4] * y + relative[5] * z, half[1])
            + _square_beyond(off[2] + relative[6] * x + relative[7] * y + relative[8] * z, half[2])
        )
        if square >= reach * reach if reach > 0.0 else square > 0.0:
            index = sphere.skip
            continue
        index += 1
        if sphere.skip == index:
            if square <= sphere.outer * sphere.outer:
                return -1e300
            best = sqrt(square) - sphere.outer
    return best


def in_order(cells):
    """The distinct cells of a grid, shape (n, 3), int32, in the order of a balanced tree: the first half of
    each part is before the other one along the part's longest edge. The order depends on the set alone.
    """
    given = np.asarray(cells).astype(np.int64)
    if np.abs(given).max(initial=0) >= MAX_INDEX:
        raise ValueError(f"an index must be below {MAX_INDEX}")
    x, y, z = given.T + MAX_INDEX
    keys = np.unique(x << 42 | y << 21 | z)
    mask = (1 << 21) - 1
    distinct = np.stack([keys >> 42, keys >> 21 & mask, keys & mask], axis=1).astype(np.int32) - MAX_INDEX
    distinct = np.ascontiguousarray(distinct, dtype=np.int32)
    cdef int* first = <int*>bytes_of(distinct, distinct.nbytes) if len(distinct) else NULL
    cdef int count = len(distinct)
    with nogil:
        _sort(first, count)
    return distinct


cdef void _sort(int* cells, int count) noexcept nogil:
    cdef int low[3]
    cdef int high[3]
    cdef int axis, index
    cdef int longest = 0
    if count < 2:
        return
    for axis in range(3):
        low[axis] = high[axis] = cells[axis]
        for index in range(1, count):
            low[axis] = min(low[axis], cells[3 * index + axis])
            high[axis] = max(high[axis], cells[3 * index + axis])
        if high[axis] - low[axis] > high[longest] - low[longest]:
            longest = axis
    _select(cells, count, count // 2, longest)
    _sort(cells, count // 2)
    _sort(cells + 3 * (count // 2), count - count // 2)


cdef inline uint64_t _key(const int* cell, int axis) noexcept nogil:
    return (
        <uint64_t>(cell[axis] + MAX_INDEX) << 42
        | <uint64_t>(cell[(axis + 1) % 3] + MAX_INDEX) << 21
        | <uint64_t>(cell[(axis + 2) % 3] + MAX_INDEX)
    )


cdef void _select(int* cells, int count, int wanted, int axis) noexcept nogil:
    """Move the smallest `wanted` cells to the front (C. A. R. Hoare, "Algorithm 65: find", 1961). The pivots
    are pseudo-random, so no order of the cells is slow."""
    cdef int low = 0
    cdef int high = count - 1
    cdef int left, right
    cdef uint64_t pivot
    cdef uint64_t random = 88172645463325252
    while low < high:
        random ^= random << 13
        random ^= random >> 7
        random ^= random << 17
        pivot = _key(cells + 3 * (low + <int>(random % <uint64_t>(high - low + 1))), axis)
        left, right = low, high
        while left <= right:
            while _key(cells + 3 * left, axis) < pivot:
                left += 1
            while _key(cells + 3 * right, axis) > pivot:
                right -= 1
            if left <= right:
                _swap(cells + 3 * left, cells + 3 * right)
                left += 1
                right -= 1
        if wanted <= right:
            high = right
        elif wanted >= left:
            low = left
        else:
            return


cdef inline void _swap(int* one, int* other) noexcept nogil:
    cdef int axis, held
    for axis in range(3):
        held = one[axis]
        one[axis] = other[axis]
        other[axis] = held
