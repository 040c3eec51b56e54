"""The distances of an arm from itself and its surroundings, at many configurations and along whole motions.

A motion is proven free, not sampled. If no joint turns by more than r from a configuration, each point of a
geom moves by at most the sum of r times its lever over the joints. Its lever is its distance from the joint's
axis in this configuration, and grows at most by the turn of the outer joints times their greatest lever
(conservative advancement: B. Mirtich, "Impulse-based dynamic simulation", 1996; F. Schwarzer, M. Saha and
J.-C. Latombe, "Adaptive dynamic collision checking", 2005, doi 10.1109/TRO.2004.838012). A pair whose
distance is larger than the possible motion of both geoms is proven for the whole piece, and is not checked
again in its halves.

A piece of a motion is a Bezier curve of all joints, which stays within the hull of its control points. De
Casteljau's algorithm halves it.

Kinematics, distances, the proof and the gradient call each other without Python, in memory that each
`Clearance` allocates once.
"""

from libc.math cimport cos, fabs, fmax, fmin, sin, sqrt
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset

import mujoco
import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from cobot.robot.mujoco cimport kinematic_data_of, mj_deleteData, mj_kinematics, model_of
from cobot.robot.shapes cimport SEGMENT, far_bound, gap, solid_of


from cobot.robot.rotations import matrix_of, with_z_along

cdef enum:
    MAX_DEGREE = 5

MAX_SLIDE_M = 1e3
"""Largest position of a slide without a range, m."""


cdef class Clearance:
    """The distances in a `mujoco.MjModel` with one coordinate per joint, hinges and slides. Not thread safe.

    Attributes:
        pairs: the checked pairs of geoms, by their indices; planes come first, boxes last.
        count: the number of pairs.
        evaluations: the number of configurations that have been checked so far.
        resolution_m: a motion that passes keeps at least the required distance less this. With a smaller
            value, more configurations are checked near obstacles.
    """

    def __cinit__(self, mj, pairs, double resolution_m):
        cdef int index
        self._mj = mj
        self.dof = checked_dof(mj.nv)
        self.resolution_m = resolution_m
        geoms = sorted({int(geom) for pair in pairs for geom in pair})
        self.pairs = tuple((int(first), int(second)) for first, second in pairs)
        self.count, self._parts = len(self.pairs), len(geoms)
        self._part = <Part*>calloc(max(1, self._parts), sizeof(Part))
        self._pair = <Pair*>calloc(max(1, self.count), sizeof(Pair))
        self._least = <double*>calloc(max(1, self.count), sizeof(double))
        self._order = <int*>calloc(max(1, self.count), sizeof(int))
        if self._part == NULL or self._pair == NULL or self._least == NULL or self._order == NULL:
            raise MemoryError("no memory for the pairs of geoms")
        self._model = model_of(mj)
        self._data = kinematic_data_of(self._model)
        mj_kinematics(self._model, self._data)  # at qpos0, all zero: what stands, stands there for ever
        frames = self._fold(mj)
        for index, geom in enumerate(geoms):
            self._set_part(mj, index, geom, frames)
        places = {geom: index for index, geom in enumerate(geoms)}
        for index, (first, second) in enumerate(self.pairs):
            self._set_pair(index, places[first], places[second])
            self._order[index] = index
        self.pairs = tuple(
            (self._part[self._pair[index].first].solid.geom, self._part[self._pair[index].second].solid.geom)
            for index in range(self.count)
        )

    def __dealloc__(self):
        free(self._part)
        free(self._pair)
        free(self._least)
        free(self._order)
        if self._data != NULL:
            mj_deleteData(self._data)

    def _fold(self, mj):
        """Fill in the links; for each body, the joint that moves it last, and its place in this joint's
        frame.
        """
        frames = [(-1, np.eye(3), np.zeros(3))]
        for body in range(1, mj.nbody):
            joint, turn, offset = frames[mj.body_parentid[body]]
            turn, offset = turn @ matrix_of(mj.body_quat[body]), offset + turn @ mj.body_pos[body]
            for each in range(mj.body_jntadr[body], mj.body_jntadr[body] + mj.body_jntnum[body]):
                aligned = with_z_along(mj.jnt_axis[each])
                self._set_link(mj, each, joint, turn @ aligned, offset + turn @ mj.jnt_pos[each])
                joint, turn, offset = each, aligned.T, -aligned.T @ mj.jnt_pos[each]
            frames.append((joint, turn, offset))
        return frames

    def _set_link(self, mj, int joint, int before, turn, offset):
        cdef Link* link = &self._link[joint]
        link.before, link.rest = before, mj.qpos0[joint]
        link.slides = mj.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        _copy(turn, offset, link.turn, link.offset)

    def _set_part(self, mj, int index, int geom, frames):
        cdef Part* part = &self._part[index]
        cdef int joint
        part.solid = solid_of(self._model, geom)
        part.joint, turn, offset = frames[mj.geom_bodyid[geom]]
        part.is_turned = part.solid.kind != SEGMENT
        local = turn @ matrix_of(mj.geom_quat[geom])
        offset = offset + turn @ mj.geom_pos[geom]
        _copy(local, offset, part.turn, part.offset)
        reach = float(np.linalg.norm(offset)) + part.solid.bound_m
        joint = part.joint
        while joint >= 0:
            part.reach[joint] = 1.0 if self._link[joint].slides else reach
            if self._link[joint].slides:
                ends = np.abs(mj.jnt_range[joint] - mj.qpos0[joint])
                reach += float(ends.max()) if mj.jnt_limited[joint] else MAX_SLIDE_M
            reach += float(np.linalg.norm([self._link[joint].offset[i] for i in range(3)]))
            joint = self._link[joint].before

    def _set_pair(self, int index, int first, int second):
        cdef Pair* pair = &self._pair[index]
        if self._part[first].solid.kind > self._part[second].solid.kind:
            first, second = second, first
        pair.first, pair.second = first, second
        ways = [self._way(self._part[part].joint) for part in (first, second)]
        both = set(ways[0]) & set(ways[1])
        pair.first_joint, pair.second_joint = (
            next((joint for joint in way if joint not in both), -1) for way in ways
        )

    def _way(self, int joint):
        """The joints that move what this one moves, from the world on."""
        way = []
        while joint >= 0:
            way.insert(0, joint)
            joint = self._link[joint].before
        return way

    cdef void _move_to(self, const double* joints) noexcept nogil:
        cdef Link* link
        cdef double* turn
        cdef double* place
        cdef const double* base
        cdef double x, y, c, s
        cdef int joint, i, k
        self.evaluations += 1
        self._stamp += 1
        for joint in range(self.dof):
            link, turn, place = &self._link[joint], self._turn[joint], self._place[joint]
            if link.before < 0:
                memcpy(turn, link.turn, sizeof(link.turn))
                memcpy(place, link.offset, sizeof(link.offset))
            else:
                base = self._turn[link.before]
                _place_point(base, self._place[link.before], link.offset, place)
                for i in range(0, 9, 3):
                    for k in range(3):
                        turn[i + k] = (
                            base[i] * link.turn[k]
                            + base[i + 1] * link.turn[3 + k]
                            + base[i + 2] * link.turn[6 + k]
                        )
            x = joints[joint] - link.rest
            if link.slides:
                for i in range(3):
                    place[i] += x * turn[3 * i + 2]
                continue
            c, s = cos(x), sin(x)
            for i in range(0, 9, 3):
                x, y = turn[i], turn[i + 1]
                turn[i] = c * x + s * y
                turn[i + 1] = c * y - s * x
        for i in range(self._parts):
            if self._part[i].joint >= 0:
                self._move_part(&self._part[i])

    cdef void _move_part(self, Part* part) noexcept nogil:
        cdef const double* base = self._turn[part.joint]
        cdef double* turn = &self._data.geom_xmat[9 * part.solid.geom]
        cdef int i, k
        _place_point(base, self._place[part.joint], part.offset, &self._data.geom_xpos[3 * part.solid.geom])
        for i in range(0, 9, 3):
            for k in range(0 if part.is_turned else 2, 3):
                turn[i + k] = (
                    base[i] * part.turn[k] + base[i + 1] * part.turn[3 + k] + base[i + 2] * part.turn[6 + k]
                )

    cdef void _sweep(self, Part* part, const double* turned) noexcept nogil:
        """How far a part can move if no joint turns further than `turned`: for each joint, by it and the
        inner joints."""
        cdef const double* middle = &self._data.geom_xpos[3 * part.solid.geom]
        cdef const double* turn = &self._data.geom_xmat[9 * part.solid.geom]
        cdef double total = 0.0
        cdef double growth = 0.0
        cdef double lever
        cdef int joint = part.joint
        part.stamp = self._stamp
        while joint >= 0:
            if self._link[joint].slides:
                total += turned[joint]
            elif turned[joint] > 0.0:
                lever = _lever(self._turn[joint], self._place[joint], middle, turn, &part.solid) + growth
                total += turned[joint] * fmin(lever, part.reach[joint])
            growth += turned[joint] * part.reach[joint]
            part.swept[joint] = total
            joint = self._link[joint].before

    cdef double _sweep_of(self, int part, int joint, const double* turned) noexcept nogil:
        if joint < 0:
            return 0.0
        if self._part[part].stamp != self._stamp:
            self._sweep(&self._part[part], turned)
        return self._part[part].swept[joint]

    cdef bint _is_proven(
        self, const double* control, int degree, double begin, double end, int count, bint ordered
    ) noexcept nogil:
        """Whether the first `count` pairs of the order are free along a curve. The place where one is not
        free is stored.

        With `ordered` the stored place is the first one, within the resolution; otherwise any.
        """
        cdef double halves[2][(MAX_DEGREE + 1) * MAX_DOF]
        cdef double turned[MAX_DOF]
        cdef const double* middle = halves[1]
        cdef Pair* pair
        cdef Solid* first
        cdef Solid* second
        cdef int left = 0
        cdef int touching = -1
        cdef int index, which
        cdef double needed, distance, touching_m
        _halve(control, degree, self.dof, halves[0], halves[1])
        for index in range(self.dof):
            turned[index] = 0.0
            for which in range(degree + 1):
                turned[index] = fmax(turned[index], fabs(control[which * self.dof + index] - middle[index]))
        self._move_to(middle)
        for index in range(count):
            which = self._order[index]
            pair = &self._pair[which]
            first, second = &self._part[pair.first].solid, &self._part[pair.second].solid
            needed = self._least[which] - self.resolution_m + (
                self._sweep_of(pair.first, pair.first_joint, turned)
                + self._sweep_of(pair.second, pair.second_joint, turned)
            )
            if far_bound(self._data, first, second) >= needed:
                continue
            distance = gap(self._model, self._data, first, second, fmax(needed, self._least[which]), NULL)
            if distance < self._least[which] and touching < 0:
                touching, touching_m = which, distance
                if not ordered:
                    break
            if distance < needed:
                self._order[index], self._order[left] = self._order[left], which
                left += 1
        if touching >= 0 and not ordered:
            self._hit_pair, self._hit_at, self._hit_m = touching, 0.5 * (begin + end), touching_m
            return False
        if left == 0 or end - begin < 1e-12:
            return True
        if not self._is_proven(halves[0], degree, begin, 0.5 * (begin + end), left, ordered):
            return False
        if touching >= 0:
            self._hit_pair, self._hit_at, self._hit_m = touching, 0.5 * (begin + end), touching_m
            return False
        return self._is_proven(halves[1], degree, 0.5 * (begin + end), end, left, ordered)

    cdef int _first_touching(self, double* distance) noexcept nogil:
        """A pair that violates its required distance in the present configuration, or -1."""
        cdef Pair* pair
        cdef Solid* first
        cdef Solid* second
        cdef int index, which
        for index in range(self.count):
            which = self._order[index]
            pair = &self._pair[which]
            first, second = &self._part[pair.first].solid, &self._part[pair.second].solid
            if far_bound(self._data, first, second) >= self._least[which]:
                continue
            distance[0] = gap(self._model, self._data, first, second, self._least[which], NULL)
            if distance[0] < self._least[which]:
                self._order[index], self._order[0] = self._order[0], which
                return which
        return -1

    cdef void _add_gradient(self, int index, double weight, const double* line, double* out) noexcept nogil:
        """Add the distance's derivative by each joint, times a weight."""
        cdef Pair* pair = &self._pair[index]
        cdef const double* axis
        cdef double arm[3]
        cdef double slope
        cdef int joint, first, i, side
        for side in range(2):
            joint = self._part[pair.first if side == 0 else pair.second].joint
            first = pair.first_joint if side == 0 else pair.second_joint
            while first >= 0 and joint >= 0:
                axis = self._turn[joint]
                if self._link[joint].slides:
                    slope = line[0] * axis[2] + line[1] * axis[5] + line[2] * axis[8]
                else:
                    for i in range(3):
                        arm[i] = line[3 + i] - self._place[joint][i]
                    slope = (
                        line[0] * (axis[5] * arm[2] - axis[8] * arm[1])
                        + line[1] * (axis[8] * arm[0] - axis[2] * arm[2])
                        + line[2] * (axis[2] * arm[1] - axis[5] * arm[0])
                    )
                out[joint] += weight * (slope if side == 0 else -slope)
                if joint == first:
                    break
                joint = self._link[joint].before

    cdef bint c_is_edge_free(self, const double* start, const double* goal) noexcept nogil:
        cdef double control[2 * MAX_DOF]
        cdef double distance
        memcpy(control, start, self.dof * sizeof(double))
        memcpy(control + self.dof, goal, self.dof * sizeof(double))
        self._move_to(goal)
        if self._first_touching(&distance) >= 0:
            return False
        return self._is_proven(control, 1, 0.0, 1.0, self.count, False)

    def require(self, least_m):
        """Set the required distance of each pair, m: one number for all, or shape (count,)."""
        cdef int index
        given = np.ascontiguousarray(np.broadcast_to(np.asarray(least_m, dtype=np.float64), (self.count,)))
        for index in range(self.count):
            self._least[index] = given[index]

    def is_free(self, joints):
        """Whether each pair keeps its required distance at joints of shape (dof,)."""
        cdef double given[MAX_DOF]
        cdef double distance
        _take(joints, self.dof, given)
        self._move_to(given)
        return self._first_touching(&distance) < 0

    def are_free(self, rows):
        """`is_free` for each row of joints, shape (n, dof). Returns shape (n,)."""
        cdef Py_ssize_t row
        cdef double distance
        given = _rows(rows, self.dof)
        out = np.zeros(len(given), dtype=bool)
        cdef const double* joints
        for row in range(len(given)):
            joints = doubles(given, given.size) + row * self.dof
            self._move_to(joints)
            out[row] = self._first_touching(&distance) < 0
        return out

    def is_edge_free(self, start, goal):
        """Whether the straight joint motion is free, including its goal. Both ends are arrays or states of
        OMPL."""
        cdef double ends[2][MAX_DOF]
        _take(start, self.dof, ends[0])
        _take(goal, self.dof, ends[1])
        return self.c_is_edge_free(ends[0], ends[1])

    def contact(self, pieces, bint first=False):
        """Find a place where a motion violates the required distance of a pair.

        Args:
            pieces: shape (n, degree + 1, dof), control points of Bezier curves, one after the other.
            first: find the first such place, within the resolution, instead of any.

        Returns:
            The piece, the share of its parameter, the index of the pair and its distance, m. None if the
            motion is free.
        """
        given = np.array(pieces, dtype=np.float64, order="C")
        if given.ndim != 3 or given.shape[2] != self.dof or not 2 <= given.shape[1] <= MAX_DEGREE + 1:
            raise ValueError(
                f"pieces of shape (n, 2 to {MAX_DEGREE + 1}, {self.dof}) are needed, not {given.shape}"
            )
        if not np.isfinite(given).all():
            raise ValueError("a joint is not finite")
        if given.size == 0:
            return None
        cdef const double* control = doubles(given, given.size)
        cdef int degree = given.shape[1] - 1
        cdef Py_ssize_t piece, pieces_count = len(given)
        cdef bint proven = True
        with nogil:
            for piece in range(pieces_count):
                proven = self._is_proven(
                    control + piece * (degree + 1) * self.dof, degree, 0.0, 1.0, self.count, first
                )
                if not proven:
                    break
        return None if proven else (piece, self._hit_at, self._hit_pair, self._hit_m)

    def distances(self, rows, double farthest_m):
        """The distances, shape (n, count), m, at joints (n, dof). Larger distances are given as
        `farthest_m`."""
        given = _rows(rows, self.dof)
        out = np.empty((len(given), self.count))
        cdef const double* joints = doubles(given, given.size) if given.size else NULL
        cdef double* found = doubles(out, out.size) if out.size else NULL
        cdef Py_ssize_t row, count = len(given)
        cdef int index
        with nogil:
            for row in range(count):
                self._move_to(joints + row * self.dof)
                for index in range(self.count):
                    found[row * self.count + index] = fmin(farthest_m, self._gap(index, farthest_m, NULL))
        return out

    cdef double _gap(self, int index, double enough_m, double* line) noexcept nogil:
        cdef Solid* first = &self._part[self._pair[index].first].solid
        cdef Solid* second = &self._part[self._pair[index].second].solid
        if far_bound(self._data, first, second) >= enough_m:
            return enough_m
        return gap(self._model, self._data, first, second, enough_m, line)

    def gradient(self, joints, int index):
        """A pair's distance, m, at joints (dof,), and its derivative by the joints, shape (dof,), m/rad."""
        cdef double given[MAX_DOF]
        cdef double line[6]
        cdef double distance
        if not 0 <= index < self.count:
            raise ValueError(f"no pair {index}")
        _take(joints, self.dof, given)
        out = np.zeros(self.dof)
        self._move_to(given)
        memset(line, 0, sizeof(line))
        distance = self._gap(index, 1e3, line)
        self._add_gradient(index, 1.0, line, doubles(out, self.dof))
        return distance, out

    def push(self, rows, velocities, double least_m, double width_m):
        """CHOMP's obstacle cost and its gradient (M. Zucker et al., 2013, equations 20 and 21).

        Every pair is a body point with the other geom as its obstacle. With d its distance beyond `least_m`,
        its cost c(d) is 0 from `width_m` on, then quadratic, and linear from 0 on. The cost is weighted by
        how fast the pair's distance changes along the path. The curvature term vanishes on nearly straight
        paths and is left out.

        Args:
            rows: the path's points, shape (n, dof).
            velocities: the derivative along the path, shape (n, dof).

        Returns:
            The gradient, shape (n, dof), the cost, and the smallest distance of each point, shape (n,), m,
            none larger than `least_m + width_m`.
        """
        given, speeds = _rows(rows, self.dof), _rows(velocities, self.dof)
        out, nearest = np.zeros_like(given), np.full(len(given), least_m + width_m)
        cdef const double* joints = doubles(given, given.size)
        cdef const double* velocity = doubles(speeds, given.size)
        cdef double* gradient = doubles(out, given.size)
        cdef double* smallest = doubles(nearest, len(given))
        cdef double slope_of[MAX_DOF]
        cdef double line[6]
        cdef double cost = 0.0
        cdef double distance, beyond, speed
        cdef Py_ssize_t row, count = len(given)
        cdef int index, i
        with nogil:
            for row in range(count):
                self._move_to(joints + row * self.dof)
                speed = 0.0
                for i in range(self.dof):
                    speed += velocity[row * self.dof + i] * velocity[row * self.dof + i]
                speed = sqrt(speed)
                for index in range(self.count):
                    distance = self._gap(index, least_m + width_m, line)
                    beyond = distance - least_m
                    if beyond >= width_m:
                        continue
                    smallest[row] = fmin(smallest[row], distance)
                    memset(slope_of, 0, sizeof(slope_of))
                    self._add_gradient(index, 1.0, line, slope_of)
                    if beyond < 0.0:
                        cost += speed * (0.5 * width_m - beyond)
                        beyond = 0.0
                    else:
                        cost += speed * (beyond - width_m) * (beyond - width_m) / (2.0 * width_m)
                    for i in range(self.dof):
                        gradient[row * self.dof + i] -= speed * (1.0 - beyond / width_m) * slope_of[i]
        return out, cost, nearest


cdef void _halve(const double* control, int degree, int dof, double* left, double* right) noexcept nogil:
    """Split a curve in the middle by de Casteljau's algorithm. Gives the control points of both halves, row
    by row."""
    cdef int level, k, j
    memcpy(right, control, (degree + 1) * dof * sizeof(double))
    memcpy(left, control, dof * sizeof(double))
    for level in range(1, degree + 1):
        for k in range(degree + 1 - level):
            for j in range(dof):
                right[k * dof + j] = 0.5 * (right[k * dof + j] + right[(k + 1) * dof + j])
        memcpy(left + level * dof, right, dof * sizeof(double))


cdef double _lever(
    const double* joint_turn, const double* place,
    const double* middle, const double* turn, const Solid* solid,
) noexcept nogil:
    """An upper bound of the distance between a joint's axis and the farthest point of a geom."""
    cdef double half[3]
    cdef double arm[3]
    cdef double ends = 0.0
    cdef double along
    cdef int i
    for i in range(3):
        arm[i] = middle[i] - place[i]
        half[i] = solid.half_m * turn[3 * i + 2]
    along = _off_axis(joint_turn, arm) + solid.bound_m
    if solid.half_m == 0.0:
        return along
    for i in range(3):
        arm[i] += half[i]
    ends = _off_axis(joint_turn, arm)
    for i in range(3):
        arm[i] -= 2.0 * half[i]
    return fmin(along, fmax(ends, _off_axis(joint_turn, arm)) + solid.radius_m)


cdef inline double _off_axis(const double* turn, const double* arm) noexcept nogil:
    cdef double x = turn[5] * arm[2] - turn[8] * arm[1]
    cdef double y = turn[8] * arm[0] - turn[2] * arm[2]
    cdef double z = turn[2] * arm[1] - turn[5] * arm[0]
    return sqrt(x * x + y * y + z * z)


cdef inline void _place_point(
    const double* turn, const double* place, const double* offset, double* out
) noexcept nogil:
    cdef int i
    for i in range(3):
        out[i] = place[i] + (
            turn[3 * i] * offset[0] + turn[3 * i + 1] * offset[1] + turn[3 * i + 2] * offset[2]
        )


cdef int _take(object joints, int dof, double* out) except -1:
    """Copy the first numbers of an array, a list, or a state of OMPL."""
    cdef int index
    for index in range(dof):
        out[index] = joints[index]
        if not out[index] - out[index] == 0.0:
            raise ValueError("a joint is not finite")
    return 0


cdef object _rows(object rows, int dof):
    given = np.array(rows, dtype=np.float64, order="C").reshape(-1, dof)
    if not np.isfinite(given).all():
        raise ValueError("a joint is not finite")
    return given


cdef int _copy(object turn, object offset, double* into_turn, double* into_offset) except -1:
    cdef int i
    for i in range(9):
        into_turn[i] = turn[i // 3, i % 3]
    for i in range(3):
        into_offset[i] = offset[i]
    return 0
