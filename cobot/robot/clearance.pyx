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

import os

from libc.math cimport cos, fabs, fmax, fmin, sin, sqrt
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy, memset

import mujoco
import numpy as np

from cobot.arrays cimport MAX_DOF, bytes_of, checked_dof, doubles
from cobot.robot.cloud cimport CloudTree, Sphere, gap_to_cloud
from cobot.robot.mujoco cimport kinematic_data_of, mj_deleteData, mj_kinematics, model_of
from cobot.robot.shapes cimport BOX, CLOUD, CYLINDER, OTHER, PLANE, SEGMENT, far_bound, gap, solid_of

from cobot.errors import ConfigError
from cobot.robot.enclosing import nodes_around, tree_around
from cobot.robot.rotations import matrix_of, with_z_along

cdef extern from "lanes_check.h":
    LaneCheck lanes_with(const char* name) noexcept nogil

cdef enum:
    MAX_DEGREE = 5
    MAX_LANES = 16
    INTERVALS = 256      # maximum number of waiting intervals of an edge
    GENERATIONS = 12
    LIKELY = 16          # number of pairs of the last hits
    WEIGHT = 4           # number of evaluations to which one check with spheres is equivalent
    BATCH = 64           # number of pieces of a motion that are checked together
    MAX_STRETCHES = 1024
    MAX_PARTS = 256      # maximum number of parts of a piece

ROUNDING = 2e-6
"""Bound of the float32 rounding errors in `lanes.h`: this value times the distances in the computation, times
the number of joints between the bodies."""
INSTRUCTIONS = "COBOT_INSTRUCTIONS"
"""Environment variable that selects the instructions: "plain", "avx2" or "avx512"; "exact" uses no
spheres."""
MAX_SLIDE_M = 1e3
"""Largest position of a slide without a range, m."""

# Largest sum of the turns of all joints, rad, in a stretch that is first checked with spheres.
cdef double SHORT = 0.2
# Smaller than any distance: no bodies overlap as deeply.
cdef double DEEPEST = -1e300


cdef class Clearance:
    """The distances in a `mujoco.MjModel` with one coordinate per joint, hinges and slides. Not thread safe.

    Attributes:
        pairs: the checked pairs of geoms, by their indices; planes come first, boxes last.
        count: the number of pairs.
        clouds: for each fixed geom that is a box, by its index, the cubes in it, which are checked instead of
            the box. The next geom must be one cube; it belongs to no pair.
        evaluations: the number of configurations that have been checked so far.
        resolution_m: a motion that passes keeps at least the required distance minus this value. With a
            smaller value, more configurations are checked near obstacles.
    """

    def __cinit__(self, mj, pairs, double resolution_m, clouds=None):
        cdef int index
        self._mj, self.clouds = mj, dict(clouds or {})
        self.dof = checked_dof(mj.nv)
        self.resolution_m = resolution_m
        geoms = sorted({int(geom) for pair in pairs for geom in pair})
        self.pairs = tuple((int(first), int(second)) for first, second in pairs)
        self.count, self._parts = len(self.pairs), len(geoms)
        self._part = <Part*>calloc(max(1, self._parts), sizeof(Part))
        self._pair = <Pair*>calloc(max(1, self.count), sizeof(Pair))
        self._least = <double*>calloc(max(1, self.count), sizeof(double))
        self._order = <int*>calloc(max(1, self.count), sizeof(int))
        self._lane_least = <float*>calloc(max(1, self.count), sizeof(float))
        if (
            self._part == NULL or self._pair == NULL or self._least == NULL or self._order == NULL
            or self._lane_least == NULL
        ):
            raise MemoryError("no memory for the pairs of geoms")
        self._model = model_of(mj)
        self._data = kinematic_data_of(self._model)
        mj_kinematics(self._model, self._data)  # at qpos0, all zero: fixed bodies are at their final poses
        frames = self._fold(mj)
        for index, geom in enumerate(geoms):
            self._set_part(mj, index, geom, frames)
            if self.clouds:
                self._set_spheres(&self._part[index])
        places = {geom: index for index, geom in enumerate(geoms)}
        for index, (first, second) in enumerate(self.pairs):
            self._set_pair(index, places[first], places[second])
            self._order[index] = index
        self.pairs = tuple(
            (self._part[self._pair[index].first].solid.geom, self._part[self._pair[index].second].solid.geom)
            for index in range(self.count)
        )

    def __dealloc__(self):
        cdef int index
        if self._part != NULL:
            for index in range(self._parts):
                free(self._part[index].spheres)
        free(self._part)
        free(self._pair)
        free(self._least)
        free(self._order)
        free(self._lane_links)
        free(self._lane_parts)
        free(self._lane_pairs)
        free(self._lane_least)
        free(self._lane_order)
        free(self._bend)
        free(self._failing)
        free(self._failing_lanes)
        free(self._listed)
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
        cdef CloudTree cloud = self.clouds.get(geom)
        cdef int joint
        part.solid = solid_of(self._model, geom)
        part.joint, turn, offset = frames[mj.geom_bodyid[geom]]
        if cloud is not None:
            part.solid.kind, part.nodes = CLOUD, cloud.nodes
            if geom + 1 == mj.ngeom:
                raise ValueError(f"geom {geom} is a cloud: the next geom must be its cube")
            part.cube = solid_of(self._model, geom + 1)
            if part.joint >= 0 or part.cube.kind != BOX or part.cube.size[0] != 0.5 * cloud.voxel_m:
                raise ValueError(
                    f"geom {geom} is a cloud: it must be fixed, and the next geom must be its cube"
                )
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

    cdef int _set_spheres(self, Part* part) except -1:
        """Keep the spheres around a moving geom, which bound its distance from the cubes of a cloud. For
        fixed geoms, such as a large floor, computing them could take seconds, and no pair needs them."""
        cdef int row, i
        if part.joint < 0 or part.solid.kind == SEGMENT:
            return 0
        tree = tree_around(self._mj, part.solid.geom)
        part.spheres, part.sphere_count = <Sphere*>calloc(len(tree), sizeof(Sphere)), len(tree)
        if part.spheres == NULL:
            raise MemoryError("no memory for the spheres around the arm")
        for row in range(part.sphere_count):
            for i in range(3):
                part.spheres[row].place[i] = tree[row, i]
            part.spheres[row].outer, part.spheres[row].skip = tree[row, 3], <int>tree[row, 5]
        return 0

    def _set_pair(self, int index, int first, int second):
        cdef Pair* pair = &self._pair[index]
        if self._part[first].solid.kind > self._part[second].solid.kind:
            first, second = second, first
        if self._part[second].solid.kind == CLOUD and self._part[first].joint < 0:
            raise ValueError(f"pair {index} is a cloud and a fixed geom: only moving geoms are checked")
        pair.first, pair.second = first, second
        common = self._common(self._part[first].joint, self._part[second].joint)
        pair.first_joint = self._after(common, self._part[first].joint)
        pair.second_joint = self._after(common, self._part[second].joint)

    cdef int _common(self, int joint, int other) noexcept:
        """The last joint that moves everything that either of these joints moves, or -1."""
        cdef int each
        while joint >= 0:
            each = other
            while each >= 0:
                if each == joint:
                    return joint
                each = self._link[each].before
            joint = self._link[joint].before
        return -1

    cdef int _after(self, int common, int joint) noexcept:
        """The first joint after a common one on the way to a joint, or -1."""
        cdef int first = -1
        while joint != common:
            first, joint = joint, self._link[joint].before
        return first

    def enclose(self):
        """Prepare the checks with spheres. Searches call this, because it takes 3 ms, and 50 ms for an arm
        whose spheres this process has not fitted yet. Without it, exact distances alone decide.

        Raises:
            ConfigError: the environment variable `INSTRUCTIONS` has no valid value.
        """
        if self._is_enclosed:
            return
        chosen = os.environ.get(INSTRUCTIONS, "")
        check = lanes_with(chosen.encode())
        if check == NULL and chosen != "exact":
            raise ConfigError(
                f"{INSTRUCTIONS} is '{chosen}', allowed: plain, exact, and if the processor has them "
                "avx2 and avx512; without it the fastest ones are used"
            )
        if chosen != "exact":
            self._give_lanes()
            self._check = check
        self._is_enclosed = True

    def forget_hits(self):
        """Check the pairs in their first order again, as a new object would. The order decides which edges
        `c_are_blocked` spares, and so the number of evaluations."""
        cdef int index
        for index in range(self.count if self._lane_order != NULL else 0):
            self._lane_order[index] = index

    def _give_lanes(self):
        """Give `lanes_check.h` the kinematics, the spheres around each moving part, and the pairs."""
        cdef int index, i, joint
        cdef LaneLink* link
        cdef LanePair* pair
        count = max(1, self.count)
        self._lane_nodes = [self._tree(index) for index in range(self._parts)]
        self._lane_links = <LaneLink*>calloc(MAX_DOF, sizeof(LaneLink))
        self._lane_parts = <LanePart*>calloc(max(1, self._parts), sizeof(LanePart))
        self._lane_pairs = <LanePair*>calloc(count, sizeof(LanePair))
        self._lane_order = <int*>calloc(count, sizeof(int))
        self._bend = <float*>calloc(max(1, self._parts) * MAX_DOF, sizeof(float))
        self._failing = <int*>calloc(4 * count, sizeof(int))
        self._failing_lanes = <unsigned*>calloc(2 * count, sizeof(unsigned))
        self._listed = <long*>calloc(2 * count, sizeof(long))
        if (
            self._lane_links == NULL or self._lane_parts == NULL or self._lane_pairs == NULL
            or self._lane_order == NULL or self._bend == NULL or self._failing == NULL
            or self._failing_lanes == NULL or self._listed == NULL
        ):
            raise MemoryError("no memory for the spheres around the arm")
        for joint in range(self.dof):
            link = &self._lane_links[joint]
            link.before, link.slides, link.rest = (
                self._link[joint].before, self._link[joint].slides, self._link[joint].rest
            )
            for i in range(9):
                link.turn[i] = self._link[joint].turn[i]
            for i in range(3):
                link.offset[i] = self._link[joint].offset[i]
        extent = 0.0
        for index in range(self._parts):
            self._set_lane_part(index, self._lane_nodes[index])
            for joint in range(self.dof):
                extent = max(extent, self._part[index].reach[joint])
        for joint in range(self.dof):
            if self._link[joint].before < 0:
                extent += float(np.linalg.norm([self._link[joint].offset[i] for i in range(3)]))
        for index in range(self.count):
            pair = &self._lane_pairs[index]
            pair.first, pair.second = self._pair[index].first, self._pair[index].second
            pair.first_joint = self._pair[index].first_joint
            pair.second_joint = self._pair[index].second_joint
            pair.common = self._common(self._part[pair.first].joint, self._part[pair.second].joint)
            if self._part[pair.first].joint < 0:
                pair.first, pair.second = pair.second, pair.first
                pair.first_joint, pair.second_joint = pair.second_joint, pair.first_joint
            self._lane_order[index] = index
        self._lanes.dof, self._lanes.links, self._lanes.parts = self.dof, self._lane_links, self._lane_parts
        self._lanes.part_count, self._lanes.pairs = self._parts, self._lane_pairs
        self._lanes.least, self._lanes.slack = self._lane_least, ROUNDING * (self.dof + 4) * extent

    def _tree(self, int index):
        """The nodes around a part, as `LaneNode`, in its joint's frame, or in the world's if no joint moves
        it."""
        cdef Part* part = &self._part[index]
        if part.joint < 0 and part.solid.kind != OTHER and part.solid.kind != CLOUD:
            return np.empty((0, 7), dtype=np.float32)
        cloud = self.clouds.get(part.solid.geom)
        turn = np.array([part.turn[i] for i in range(9)]).reshape(3, 3)
        offset = np.array([part.offset[i] for i in range(3)])
        if cloud is not None:
            return cloud.nodes_at(turn, offset)
        return nodes_around(self._mj, part.solid.geom, turn, offset)

    cdef int _set_lane_part(self, int index, object tree) except -1:
        cdef LanePart* part = &self._lane_parts[index]
        cdef Part* solid = &self._part[index]
        cdef int i
        cdef double far = 0.0
        part.joint, part.kind, part.count = solid.joint, LANES_TREE, len(tree)
        part.nodes = <const LaneNode*>bytes_of(tree, part.count * sizeof(LaneNode)) if part.count else NULL
        for i in range(9):
            part.turn[i] = solid.turn[i]
        for i in range(3):
            part.origin[i] = solid.offset[i]
            far += fabs(solid.offset[i]) + fabs(solid.solid.size[i])
        part.slack = ROUNDING * (1.0 + far)
        if solid.joint >= 0:
            return 0
        if solid.solid.kind == PLANE:
            part.kind = LANES_PLANE
        elif solid.solid.kind == CLOUD:
            part.kind = LANES_CLOUD
        elif solid.solid.kind == BOX:
            part.kind = LANES_BOX
            for i in range(3):
                part.size[i] = solid.solid.size[i]
        elif solid.solid.kind == CYLINDER:
            part.kind, part.size[0], part.size[2] = LANES_CYLINDER, solid.solid.radius_m, solid.solid.half_m
        elif solid.solid.kind == SEGMENT:
            part.kind, part.size[2], part.round = LANES_SEGMENT, solid.solid.half_m, solid.solid.radius_m
        return 0

    cdef void move_to(self, const double* joints) noexcept nogil:
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
        """For each joint: how far this joint and the inner joints can move a part if no joint turns further
        than `turned`."""
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
        self, const double* control, int degree, double begin, double end, int* order, int count, bint ordered
    ) noexcept nogil:
        """Whether the first `count` pairs of an order are free along a curve. The point at which a pair is
        not free is stored.

        With `ordered` the stored place is the first one, within the resolution; otherwise any.
        """
        cdef double halves[2][(MAX_DEGREE + 1) * MAX_DOF]
        cdef double turned[MAX_DOF]
        cdef const double* middle = halves[1]
        cdef Pair* pair
        cdef Part* first
        cdef Part* second
        cdef int left = 0
        cdef int touching = -1
        cdef int index, which
        cdef double needed, distance, touching_m
        _halve(control, degree, self.dof, halves[0], halves[1])
        for index in range(self.dof):
            turned[index] = 0.0
            for which in range(degree + 1):
                turned[index] = fmax(turned[index], fabs(control[which * self.dof + index] - middle[index]))
        self.move_to(middle)
        for index in range(count):
            which = order[index]
            pair = &self._pair[which]
            first, second = &self._part[pair.first], &self._part[pair.second]
            needed = self._least[which] - self.resolution_m + (
                self._sweep_of(pair.first, pair.first_joint, turned)
                + self._sweep_of(pair.second, pair.second_joint, turned)
            )
            if far_bound(self._data, &first.solid, &second.solid) >= needed:
                continue
            distance = self._between(
                first, second, fmax(needed, self._least[which]), self._least[which], self._least[which], NULL
            )
            if distance < self._least[which] and touching < 0:
                touching, touching_m = which, distance
                if not ordered:
                    break
            if distance < needed:
                order[index], order[left] = order[left], which
                left += 1
        if touching >= 0 and not ordered:
            self._hit_pair, self._hit_at, self._hit_m = touching, 0.5 * (begin + end), touching_m
            return False
        if left == 0 or end - begin < 1e-12:
            return True
        if not self._is_proven(halves[0], degree, begin, 0.5 * (begin + end), order, left, ordered):
            return False
        if touching >= 0:
            self._hit_pair, self._hit_at, self._hit_m = touching, 0.5 * (begin + end), touching_m
            return False
        return self._is_proven(halves[1], degree, 0.5 * (begin + end), end, order, left, ordered)

    cdef int _first_touching(self, int* order, int count, double* distance) noexcept nogil:
        """A pair of an order that violates its required distance in the current configuration, or -1."""
        cdef Pair* pair
        cdef Part* first
        cdef Part* second
        cdef int index, which
        for index in range(count):
            which = order[index]
            pair = &self._pair[which]
            first, second = &self._part[pair.first], &self._part[pair.second]
            if far_bound(self._data, &first.solid, &second.solid) >= self._least[which]:
                continue
            distance[0] = self._between(
                first, second, self._least[which], self._least[which], self._least[which], NULL
            )
            if distance[0] < self._least[which]:
                order[index], order[0] = order[0], which
                return which
        return -1

    cdef void add_gradient(self, int index, double weight, const double* line, double* out) noexcept nogil:
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
        """Whether a straight joint motion is free. The spheres are checked first; see `lanes.h`.

        Most edges that are not free have a hit at one of a few places. These places are checked first,
        without motion, because that is cheapest. Then the edge is divided into intervals. An interval that
        the spheres do not prove free is divided further. If the spheres touch even in its middle, exact
        distances decide about the pairs in question.
        """
        cdef double at[2][INTERVALS]
        cdef double later[INTERVALS]
        cdef double later_half[INTERVALS]
        cdef double rates[MAX_DOF]
        cdef double still[MAX_DOF]
        cdef float rounded[MAX_DOF * MAX_LANES]
        cdef float half[MAX_LANES]
        cdef double control[2 * MAX_DOF]
        cdef LaneQuery query
        cdef LaneAnswer answer
        cdef int* pairs[2]
        cdef int* late_pairs = self._failing + 3 * self.count
        cdef double width = 1.0 / MAX_LANES
        cdef int count = MAX_LANES
        cdef int delayed = 0
        cdef int late_count = 0
        cdef int generation, chunk, begin, lanes, lane, opened, factor, side, failing, i, k
        cdef long number, late_number
        if self._check == NULL:
            return self._is_edge_exactly_free(start, goal)
        for i in range(self.dof):
            rates[i] = goal[i] - start[i]
            for lane in range(MAX_LANES):
                rounded[i * MAX_LANES + lane] = rates[i]
        memset(still, 0, sizeof(still))
        self._bound_bends(rates, still)
        query.rates, query.half, query.bend, query.all = rounded, half, self._bend, False
        query.pairs, query.pair_count = self._lane_order, self.count
        answer.failing, answer.lanes, answer.places = self._failing, self._failing_lanes, NULL
        pairs[0], pairs[1] = self._failing + self.count, self._failing + 2 * self.count
        self._lists += 1
        late_number = self._lists
        for i in range(count):
            at[0][i] = (i + 0.5) * width
        memset(half, 0, sizeof(half))
        self._look(start, rates, at[0], count, &query, &answer)
        if answer.hit:
            self._raise(answer.hit_pair)
            return False
        self.evaluations -= WEIGHT  # the next check repeats this one
        for generation in range(GENERATIONS):
            side = generation % 2
            self._lists += 1
            number = self._lists
            opened, failing = 0, 0
            for lane in range(MAX_LANES):
                half[lane] = 0.5 * width
            for chunk in range((count + MAX_LANES - 1) // MAX_LANES):
                begin = chunk * MAX_LANES
                lanes = min(count - begin, MAX_LANES)
                self._look(start, rates, &at[side][begin], lanes, &query, &answer)
                if answer.hit:
                    self._raise(answer.hit_pair)
                    return False
                if not answer.open:
                    continue
                failing = self._list(&answer, number, pairs[side], failing)
                if generation == 0:
                    answer.unsure = 0
                elif answer.unsure:
                    late_count = self._list(&answer, -late_number, late_pairs, late_count)
                for lane in range(lanes):
                    if answer.unsure >> lane & 1:
                        if delayed == INTERVALS:
                            return self._is_edge_exactly_free(start, goal)
                        later[delayed], later_half[delayed] = at[side][begin + lane], 0.5 * width
                        delayed += 1
                    elif answer.open >> lane & 1:
                        at[1 - side][opened] = at[side][begin + lane]
                        opened += 1
            if not opened:
                break
            factor = 4 if opened <= 4 else 2
            if opened * factor > INTERVALS or generation == GENERATIONS - 1:
                return self._is_edge_exactly_free(start, goal)
            count = opened * factor
            for i in range(opened - 1, -1, -1):
                for k in range(factor - 1, -1, -1):
                    at[1 - side][i * factor + k] = at[1 - side][i] + width * ((k + 0.5) / factor - 0.5)
            width /= factor
            query.pairs, query.pair_count = pairs[side], failing
        for i in range(delayed):
            for k in range(self.dof):
                control[k] = start[k] + (later[i] - later_half[i]) * rates[k]
                control[self.dof + k] = start[k] + (later[i] + later_half[i]) * rates[k]
            if not self._is_proven(control, 1, 0.0, 1.0, late_pairs, late_count, False):
                return False
        return True

    cdef bint _is_edge_exactly_free(self, const double* start, const double* goal) noexcept nogil:
        cdef double control[2 * MAX_DOF]
        cdef double distance
        memcpy(control, start, self.dof * sizeof(double))
        memcpy(control + self.dof, goal, self.dof * sizeof(double))
        self.move_to(goal)
        if self._first_touching(self._order, self.count, &distance) >= 0:
            return False
        return self._is_proven(control, 1, 0.0, 1.0, self._order, self.count, False)

    cdef void _look(
        self, const double* start, const double* rates, const double* at, int count, LaneQuery* query,
        LaneAnswer* answer
    ) noexcept nogil:
        """The result of the spheres at `count` points of an edge. Lanes without a point repeat the last
        one."""
        cdef double joints[MAX_DOF * MAX_LANES]
        cdef int lane, joint
        cdef double place
        self.evaluations += WEIGHT
        for lane in range(MAX_LANES):
            place = at[min(lane, count - 1)]
            for joint in range(self.dof):
                joints[joint * MAX_LANES + lane] = start[joint] + place * rates[joint]
        query.joints, query.active = joints, (1 << count) - 1
        self._check(&self._lanes, query, answer)

    cdef void _look_at_rows(
        self, const double* rows, int count, LaneQuery* query, LaneAnswer* answer
    ) noexcept nogil:
        """The result of the spheres for `count` rows of joints, without motion. Lanes without a row repeat
        the last one."""
        cdef double joints[MAX_DOF * MAX_LANES]
        cdef float rates[MAX_DOF * MAX_LANES]
        cdef float half[MAX_LANES]
        cdef double still[MAX_DOF]
        cdef int lane, joint
        memset(rates, 0, sizeof(rates))
        memset(half, 0, sizeof(half))
        memset(still, 0, sizeof(still))
        for lane in range(MAX_LANES):
            for joint in range(self.dof):
                joints[joint * MAX_LANES + lane] = rows[min(lane, count - 1) * self.dof + joint]
        self._bound_bends(still, still)
        query.joints, query.rates, query.half, query.bend = joints, rates, half, self._bend
        query.active = (1 << count) - 1
        self._check(&self._lanes, query, answer)

    cdef unsigned c_are_blocked(self, const double* rows, int count) noexcept nogil:
        """A bit for each of at most MAX_LANES rows of joints, set only if spheres show a hit of one of the
        pairs that were hit last."""
        cdef LaneQuery query
        cdef LaneAnswer answer
        if self._check == NULL:
            return 0
        self.evaluations += WEIGHT
        query.pairs, query.pair_count, query.all = self._lane_order, min(self.count, LIKELY), True
        answer.failing, answer.lanes, answer.places = self._failing, self._failing_lanes, NULL
        self._look_at_rows(rows, count, &query, &answer)
        if answer.hit:
            self._raise(answer.hit_pair)
        return answer.hit

    cdef void _bound_bends(self, const double* rates, const double* stray) noexcept nogil:
        """For each part and joint: a bound of the second derivative of any point of the part along the edge
        if the joints before this one do not move. It is the sum, over pairs of joints, of |a| |b| times the
        reach from the outer joint.

        If half an interval is 0.5, the bound includes eight times the distance that a point moves if each
        joint leaves the straight motion by `stray`.
        """
        cdef int index, joint
        cdef double total, outer, rate
        for index in range(self._parts):
            total, outer = 0.0, 0.0
            joint = self._part[index].joint
            while joint >= 0:
                rate = fabs(rates[joint])
                total += rate * (rate * self._part[index].reach[joint] + 2.0 * outer)
                total += 8.0 * stray[joint] * self._part[index].reach[joint]
                outer += rate * self._part[index].reach[joint]
                self._bend[index * MAX_DOF + joint] = 1.0001 * total
                joint = self._link[joint].before

    cdef int _list(self, const LaneAnswer* answer, long number, int* pairs, int count) noexcept nogil:
        """Add the answer's failing pairs to a list that has a number, each once."""
        cdef long* listed = self._listed if number > 0 else self._listed + self.count
        cdef int index, pair
        for index in range(answer.failing_count):
            pair = answer.failing[index]
            if listed[pair] != number:
                listed[pair] = number
                pairs[count] = pair
                count += 1
        return count

    cdef void _raise(self, int pair) noexcept nogil:
        """Put a pair first in the order of the spheres' checks."""
        cdef int index = 0
        while self._lane_order[index] != pair:
            index += 1
        while index > 0:
            self._lane_order[index] = self._lane_order[index - 1]
            index -= 1
        self._lane_order[0] = pair

    def require(self, least_m):
        """Set the required distance of each pair, m: one number for all, or shape (count,)."""
        cdef int index
        given = np.empty(self.count)
        given[...] = least_m
        cdef const double* least = doubles(given, self.count) if self.count else NULL
        for index in range(self.count):
            self._least[index] = self._lane_least[index] = least[index]

    def is_free(self, joints):
        """Whether each pair keeps its required distance at joints of shape (dof,)."""
        cdef double given[MAX_DOF]
        cdef double distance
        _take(joints, self.dof, given)
        self.move_to(given)
        return self._first_touching(self._order, self.count, &distance) < 0

    def are_free(self, rows):
        """`is_free` for each row of joints, shape (n, dof). Returns shape (n,)."""
        cdef double distance
        cdef LaneQuery query
        cdef LaneAnswer answer
        cdef Py_ssize_t begin, lane, lanes
        cdef int* order
        given = _rows(rows, self.dof)
        out = np.zeros(len(given), dtype=bool)
        cdef const double* row = doubles(given, given.size) if given.size else NULL
        self.enclose()
        answer.hit, answer.open, answer.failing_count = 0, (1 << MAX_LANES) - 1, self.count
        answer.failing, answer.lanes, answer.places = self._failing, self._failing_lanes, NULL
        query.pairs, query.pair_count, query.all = self._lane_order, self.count, True
        for begin in range(0, len(given), <Py_ssize_t>MAX_LANES):
            lanes = min(<Py_ssize_t>MAX_LANES, len(given) - begin)
            if self._check != NULL:
                self.evaluations += WEIGHT
                self._look_at_rows(row, lanes, &query, &answer)
            for lane in range(lanes):
                if answer.hit >> lane & 1:
                    out[begin + lane] = False
                elif answer.open >> lane & 1:
                    order = answer.failing if self._check != NULL else self._order
                    self.move_to(row + lane * self.dof)
                    out[begin + lane] = self._first_touching(order, answer.failing_count, &distance) < 0
                else:
                    out[begin + lane] = True
            row += lanes * self.dof
        return out

    def sphere_verdicts(self, rows, str instructions="", rates=None, double half=0.0):
        """The result of the spheres alone for each row of joints, shape (n, dof), for tests.

        Args:
            instructions: "plain", "avx2" or "avx512"; "" for those in use.
            rates, half: shape (dof,), and half of an interval of an edge with these rates around each row.

        Returns:
            Three arrays of shape (n,): whether a hit is certain, whether the row is not proven free, and
            whether it is not proven free even without the interval. Then the centres of the parts and how far
            they move, shape (n, parts, 4), m. None if the processor does not have the instructions.
        """
        cdef LaneCheck check
        cdef LaneQuery query
        cdef LaneAnswer answer
        cdef double joints[MAX_DOF * MAX_LANES]
        cdef double exact_rates[MAX_DOF]
        cdef double still[MAX_DOF]
        cdef float rounded[MAX_DOF * MAX_LANES]
        cdef float halves[MAX_LANES]
        cdef Py_ssize_t begin, lanes, lane
        cdef int joint
        self.enclose()
        check = lanes_with(instructions.encode()) if instructions else self._check
        if check == NULL or self._check == NULL:
            return None
        given = _rows(rows, self.dof)
        moves = np.zeros(self.dof) if rates is None else np.array(rates, dtype=np.float64)
        memset(still, 0, sizeof(still))
        for joint in range(self.dof):
            exact_rates[joint] = moves[joint]
            for lane in range(MAX_LANES):
                rounded[joint * MAX_LANES + lane] = moves[joint]
        self._bound_bends(exact_rates, still)
        out = np.zeros((3, len(given)), dtype=bool)
        places = np.zeros((self._parts, 4, MAX_LANES), dtype=np.float32)
        found = np.zeros((len(given), self._parts, 4), dtype=np.float32)
        query.rates, query.half, query.bend, query.all = rounded, halves, self._bend, True
        query.pairs, query.pair_count, query.joints = self._lane_order, self.count, joints
        answer.failing, answer.lanes = self._failing, self._failing_lanes
        answer.places = <float*>bytes_of(places, places.nbytes) if places.size else NULL
        for lane in range(MAX_LANES):
            halves[lane] = half
        for begin in range(0, len(given), <Py_ssize_t>MAX_LANES):
            lanes = min(<Py_ssize_t>MAX_LANES, len(given) - begin)
            for lane in range(MAX_LANES):
                for joint in range(self.dof):
                    joints[joint * MAX_LANES + lane] = given[begin + min(lane, lanes - 1), joint]
            query.active = (1 << lanes) - 1
            check(&self._lanes, &query, &answer)
            for lane in range(lanes):
                out[0, begin + lane] = answer.hit >> lane & 1
                out[1, begin + lane] = (answer.open | answer.hit) >> lane & 1
                out[2, begin + lane] = (answer.unsure | answer.hit) >> lane & 1
                found[begin + lane] = places[:, :, lane]
        return out[0], out[1], out[2], found

    def is_edge_free(self, start, goal):
        """Whether the straight joint motion is free, including its goal. Both ends are arrays or states of
        OMPL."""
        cdef double ends[2][MAX_DOF]
        self.enclose()
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
        self.enclose()
        cdef const double* control = doubles(given, given.size)
        cdef int degree = given.shape[1] - 1
        cdef int size = (degree + 1) * self.dof
        cdef Py_ssize_t piece, pieces_count = len(given)
        cdef bint by_spheres = self._check != NULL
        unproven = np.zeros(pieces_count * self.count + 1, dtype=np.uint8)
        cdef char* row = bytes_of(unproven, len(unproven))
        cdef int* order = self._failing if by_spheres else self._order
        cdef int index, count = self.count
        with nogil:
            piece = self._look_along(control, degree, pieces_count, first, row) if by_spheres else -1
            if piece < 0:
                for piece in range(pieces_count):
                    if by_spheres:
                        count = 0
                        for index in range(self.count):
                            if row[piece * self.count + index]:
                                order[count] = index
                                count += 1
                    if count and not self._is_proven(
                        control + piece * size, degree, 0.0, 1.0, order, count, first
                    ):
                        break
                else:
                    piece = -1
        return None if piece < 0 else (piece, self._hit_at, self._hit_pair, self._hit_m)

    cdef Py_ssize_t _look_along(
        self, const double* control, int degree, Py_ssize_t count, bint first, char* unproven
    ) noexcept nogil:
        """Mark the pairs of each piece of a motion that the spheres do not prove free, (count, pairs).

        A stretch of a piece is represented by a straight motion and a bound of its distance from it. A
        stretch that is undecided because of its motion is divided into four.

        Returns:
            Unless `first`, a piece in which exact distances have found a contact, with the place stored. -1
            if there is none.
        """
        cdef Stretch waiting[2][MAX_STRETCHES]
        cdef float half[MAX_LANES]
        cdef LaneQuery query
        cdef LaneAnswer answer
        cdef int* pairs[2]
        cdef Py_ssize_t batch, begin, piece
        cdef int left, parts, side, opened, failing, look, chunk, lanes, lane, index, pair, k
        cdef unsigned moving, bit
        cdef bint is_last
        cdef Py_ssize_t size = (degree + 1) * self.dof
        for lane in range(MAX_LANES):
            half[lane] = 0.5
        query.half, query.bend, query.all = half, self._bend, True
        answer.failing, answer.lanes, answer.places = self._failing, self._failing_lanes, NULL
        pairs[0], pairs[1] = self._failing + self.count, self._failing + 2 * self.count
        for batch in range((count + BATCH - 1) // BATCH):
            begin = batch * BATCH
            left = min(count - begin, <Py_ssize_t>BATCH)
            parts = self._parts_to_start_with(control + begin * size, degree, left)
            for index in range(left * parts):
                waiting[0][index].piece, waiting[0][index].number = begin + index // parts, index % parts
            query.pairs, query.pair_count, left, side = self._lane_order, self.count, left * parts, 0
            while left:
                self._lists += 1
                opened, failing = 0, 0
                for look in range((left + MAX_LANES - 1) // MAX_LANES):
                    chunk = look * MAX_LANES
                    lanes = min(left - chunk, MAX_LANES)
                    is_last = parts >= MAX_PARTS or opened > MAX_STRETCHES - 4 * MAX_LANES
                    self._look_at_stretches(
                        control, degree, &waiting[side][chunk], lanes, parts, &query, &answer
                    )
                    moving = 0
                    for index in range(answer.failing_count):
                        pair = answer.failing[index]
                        bit = answer.lanes[2 * index] & ~answer.lanes[2 * index + 1]
                        if bit and not is_last:
                            moving |= bit
                            if failing < self.count and self._listed[pair] != self._lists:
                                self._listed[pair] = self._lists
                                pairs[side][failing] = pair
                                failing += 1
                        for lane in range(lanes):
                            if answer.lanes[2 * index + (0 if is_last else 1)] >> lane & 1:
                                unproven[waiting[side][chunk + lane].piece * self.count + pair] = 1
                    for lane in range(lanes):
                        piece = waiting[side][chunk + lane].piece
                        if answer.hit >> lane & 1:
                            if not first and self._touches(
                                control, degree, &waiting[side][chunk + lane], parts
                            ):
                                return piece
                            if is_last:
                                memset(unproven + piece * self.count, 1, self.count)
                                continue
                            failing = self.count
                        elif not moving >> lane & 1:
                            continue
                        for k in range(4):
                            waiting[1 - side][opened].piece = piece
                            waiting[1 - side][opened].number = 4 * waiting[side][chunk + lane].number + k
                            opened += 1
                left, parts = opened, 4 * parts
                if failing < self.count:
                    query.pairs, query.pair_count = pairs[side], failing
                else:
                    query.pairs, query.pair_count = self._lane_order, self.count
                side = 1 - side
        return -1

    cdef void find_near(
        self, const double* joints, Py_ssize_t count, double within_m, char* near
    ) noexcept nogil:
        """Whether each pair may be nearer than this distance, (count, pairs). Spheres alone decide; without
        them every pair may be."""
        cdef LaneQuery query
        cdef LaneAnswer answer
        cdef Py_ssize_t begin = 0
        cdef int lanes, lane, index
        memset(near, self._check == NULL, count * self.count)
        if self._check == NULL:
            return
        for index in range(self.count):
            self._lane_least[index] = within_m
        query.pairs, query.pair_count, query.all = self._lane_order, self.count, LANES_NEAR
        answer.failing, answer.lanes, answer.places = self._failing, self._failing_lanes, NULL
        while begin < count:
            lanes = min(count - begin, <Py_ssize_t>MAX_LANES)
            self._look_at_rows(joints + begin * self.dof, lanes, &query, &answer)
            for index in range(answer.failing_count):
                for lane in range(lanes):
                    if answer.lanes[2 * index] >> lane & 1:
                        near[(begin + lane) * self.count + answer.failing[index]] = 1
            begin += lanes
        for index in range(self.count):
            self._lane_least[index] = self._least[index]

    cdef int _parts_to_start_with(self, const double* control, int degree, int count) noexcept nogil:
        """Number of parts into which each of these pieces is divided, so that the parts are short enough for
        spheres, within the limits of the memory."""
        cdef double longest = 0.0
        cdef double travel
        cdef int _piece, i
        cdef int parts = 1
        for _piece in range(count):
            travel = 0.0
            for i in range(degree * self.dof):
                travel += fabs(control[self.dof + i] - control[i])
            longest = fmax(longest, travel)
            control += (degree + 1) * self.dof
        while longest > SHORT * parts and parts < MAX_PARTS and 4 * parts * count <= MAX_STRETCHES:
            parts *= 4
        return parts

    cdef bint _touches(
        self, const double* control, int degree, const Stretch* stretch, int parts
    ) noexcept nogil:
        """Whether exact distances find a contact in the middle of a stretch. Its place is stored."""
        cdef double joints[MAX_DOF]
        cdef double weights[MAX_DEGREE + 1]
        cdef const double* points = control + <Py_ssize_t>stretch.piece * (degree + 1) * self.dof
        cdef int joint, i
        self._hit_at = (stretch.number + 0.5) / parts
        _bernstein(degree, self._hit_at, weights)
        for joint in range(self.dof):
            joints[joint] = 0.0
            for i in range(degree + 1):
                joints[joint] += weights[i] * points[i * self.dof + joint]
        self.move_to(joints)
        self._hit_pair = self._first_touching(self._order, self.count, &self._hit_m)
        return self._hit_pair >= 0

    cdef void _look_at_stretches(
        self, const double* control, int degree, const Stretch* stretches, int count, int parts,
        LaneQuery* query, LaneAnswer* answer
    ) noexcept nogil:
        """The result of the spheres for stretches, each of which is one of `parts` equal parts of its piece.
        Lanes without a stretch repeat the last one."""
        cdef double joints[MAX_DOF * MAX_LANES]
        cdef float rates[MAX_DOF * MAX_LANES]
        cdef double fastest[MAX_DOF]
        cdef double stray[MAX_DOF]
        cdef double weights[2][MAX_DEGREE + 1]
        cdef double begin, end, bend
        cdef const double* points
        cdef int lane, joint, i
        cdef double length = 1.0 / parts
        memset(fastest, 0, sizeof(fastest))
        memset(stray, 0, sizeof(stray))
        for lane in range(MAX_LANES):
            points = control + <Py_ssize_t>stretches[min(lane, count - 1)].piece * (degree + 1) * self.dof
            i = stretches[min(lane, count - 1)].number
            _bernstein(degree, i * length, weights[0])
            _bernstein(degree, (i + 1) * length, weights[1])
            for joint in range(self.dof):
                begin, end, bend = 0.0, 0.0, 0.0
                for i in range(degree + 1):
                    begin += weights[0][i] * points[i * self.dof + joint]
                    end += weights[1][i] * points[i * self.dof + joint]
                for i in range(degree - 1):
                    bend = fmax(bend, fabs(
                        points[i * self.dof + joint] - 2.0 * points[(i + 1) * self.dof + joint]
                        + points[(i + 2) * self.dof + joint]
                    ))
                joints[joint * MAX_LANES + lane] = 0.5 * (begin + end)
                rates[joint * MAX_LANES + lane] = end - begin
                fastest[joint] = fmax(fastest[joint], fabs(end - begin))
                # A curve leaves its chord by an eighth of its largest second derivative.
                stray[joint] = fmax(stray[joint], 0.125 * length * length * degree * (degree - 1) * bend)
        self._bound_bends(fastest, stray)
        self.evaluations += WEIGHT
        query.joints, query.rates, query.active = joints, rates, (1 << count) - 1
        self._check(&self._lanes, query, answer)

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
                self.move_to(joints + row * self.dof)
                for index in range(self.count):
                    found[row * self.count + index] = fmin(farthest_m, self.gap_of(index, farthest_m, NULL))
        return out

    def nearest(self, rows, chosen, double farthest_m):
        """The smallest distance of the chosen pairs at joints (n, dof).

        Args:
            chosen: indices of pairs.

        Returns:
            The row, the index of the pair and the distance, m; None if all are at least `farthest_m` apart.
        """
        given = _rows(rows, self.dof)
        numbers = np.ascontiguousarray(chosen, dtype=np.intc)
        cdef Py_ssize_t row, found_row = -1, count = len(given), pairs = len(numbers)
        cdef Py_ssize_t index, found = -1
        if not count or not pairs:
            return None
        if numbers.min() < 0 or numbers.max() >= self.count:
            raise ValueError(f"pairs 0 to {self.count - 1} can be chosen")
        cdef const double* joints = doubles(given, given.size)
        cdef const int* pair = <const int*>bytes_of(numbers, numbers.nbytes)
        cdef double distance
        with nogil:
            for row in range(count):
                self.move_to(joints + row * self.dof)
                for index in range(pairs):
                    distance = self.gap_of(pair[index], farthest_m, NULL)
                    if distance < farthest_m:
                        found_row, found, farthest_m = row, pair[index], distance
        return None if found < 0 else (found_row, found, farthest_m)

    cdef double gap_of(self, int index, double enough_m, double* line) noexcept nogil:
        cdef Part* first = &self._part[self._pair[index].first]
        cdef Part* second = &self._part[self._pair[index].second]
        if far_bound(self._data, &first.solid, &second.solid) >= enough_m:
            return enough_m
        return self._between(first, second, enough_m, enough_m, DEEPEST, line)

    cdef double _between(
        self, const Part* first, const Part* second, double enough_m, double exact_m, double decided_m,
        double* line
    ) noexcept nogil:
        """Like `gap`. If the distance is at least `exact_m`, the result may be too small, but is not below
        `exact_m`. If it is below `decided_m`, the result may be too large, but is not above `decided_m`.
        """
        if second.solid.kind != CLOUD:
            return gap(self._model, self._data, &first.solid, &second.solid, enough_m, line)
        return gap_to_cloud(
            self._model, self._data, &first.solid, first.spheres, first.sphere_count, &second.solid,
            &second.cube, second.nodes, enough_m, exact_m, decided_m, line, NULL
        )

    def nearest_cube(self, joints, int index, double enough_m):
        """The middle of the cube of a cloud that is nearest to the other geom of a pair at joints (dof,), in
        the world's frame, shape (3,), m; None if the pair has no cloud, or no cube is nearer than
        `enough_m`."""
        cdef double given[MAX_DOF]
        cdef int nearest = -1
        cdef int i
        if not 0 <= index < self.count:
            raise ValueError(f"no pair {index}")
        cdef Part* first = &self._part[self._pair[index].first]
        cdef Part* second = &self._part[self._pair[index].second]
        if second.solid.kind != CLOUD:
            return None
        _take(joints, self.dof, given)
        self.move_to(given)
        gap_to_cloud(
            self._model, self._data, &first.solid, first.spheres, first.sphere_count, &second.solid,
            &second.cube, second.nodes, enough_m, enough_m, DEEPEST, NULL, &nearest
        )
        if nearest < 0:
            return None
        turn = np.array([self._data.geom_xmat[9 * second.solid.geom + i] for i in range(9)]).reshape(3, 3)
        origin = np.array([self._data.geom_xpos[3 * second.solid.geom + i] for i in range(3)])
        return origin + turn @ [second.nodes[nearest].middle[i] for i in range(3)]

    def gradient(self, joints, int index):
        """A pair's distance, m, at joints (dof,), and its derivative by the joints, shape (dof,), m/rad."""
        cdef double given[MAX_DOF]
        cdef double line[6]
        cdef double distance
        if not 0 <= index < self.count:
            raise ValueError(f"no pair {index}")
        _take(joints, self.dof, given)
        out = np.zeros(self.dof)
        self.move_to(given)
        memset(line, 0, sizeof(line))
        distance = self.gap_of(index, 1e3, line)
        self.add_gradient(index, 1.0, line, doubles(out, self.dof))
        return distance, out


cdef void _bernstein(int degree, double at, double* out) noexcept nogil:
    """The weights of the control points of a Bezier curve at a place."""
    cdef int order, i
    out[0] = 1.0
    for order in range(1, degree + 1):
        out[order] = at * out[order - 1]
        for i in range(order - 1, 0, -1):
            out[i] = (1.0 - at) * out[i] + at * out[i - 1]
        out[0] *= 1.0 - at


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
