"""Signed distances between geoms of the arm and its surroundings, for the real-time cycle.

For spheres, capsules and planes, and for a plane and a cylinder, they are short formulas. For other shapes a
capsule or a sphere around each gives a first lower bound, and a box around each a better one. MuJoCo's
iteration is used only if these are not enough. It takes fifty times as long, and longer if its code is not in
the cache.
"""

from libc.math cimport INFINITY, fabs, fmax, fmin, isfinite, sqrt
from libc.stdlib cimport free, malloc
from libc.string cimport memcpy

import numpy as np

from cobot.arrays cimport checked_dof, doubles
from cobot.robot.mujoco cimport (
    kinematic_data_of,
    mj_deleteData,
    mj_geomDistance,
    mj_kinematics,
    mjGEOM_BOX,
    mjGEOM_CAPSULE,
    mjGEOM_CYLINDER,
    mjGEOM_ELLIPSOID,
    mjGEOM_MESH,
    mjGEOM_PLANE,
    mjGEOM_SPHERE,
    model_of,
)
from cobot.robot.shapes cimport between_axes

cdef enum:
    CAPSULES            # both geoms are capsules; a sphere is a capsule of length 0
    PLANE_AND_CAPSULE   # the first one is the plane
    PLANE_AND_CYLINDER
    BOUNDED_BY_CAPSULES
    ITERATED


cdef class GeomDistances:
    """The distances in a `mujoco.MjModel` with one coordinate per joint. Not thread safe.

    Attributes:
        count: the number of pairs that are watched.
    """

    def __cinit__(self, mj, int capacity, double farthest_m):
        """Allocate memory for `capacity` pairs. Distances above `farthest_m` are given as `farthest_m`."""
        self._mj = mj
        self._dof = checked_dof(mj.nv)
        self._farthest_m = farthest_m
        self._capacity = capacity
        self._pairs = <GeomPair*>malloc(max(1, capacity) * sizeof(GeomPair))
        if self._pairs == NULL:
            raise MemoryError("no memory for the pairs of geoms")
        self._model = model_of(mj)
        self._data = kinematic_data_of(self._model)

    def __dealloc__(self):
        free(self._pairs)
        if self._data != NULL:
            mj_deleteData(self._data)

    def watch(self, pairs, farthest_m=None):
        """Watch these pairs of geoms, given by their indices, from now on.

        Args:
            farthest_m: largest distance for each pair; by default that of the constructor for all.
        """
        cdef int index
        if len(pairs) > self._capacity:
            raise ValueError(f"{len(pairs)} pairs of geoms, allowed: up to {self._capacity}")
        self.count = 0
        for index, (first, second) in enumerate(pairs):
            if not (0 <= first < self._mj.ngeom and 0 <= second < self._mj.ngeom):
                raise ValueError(f"no geoms {first} and {second}")
            if self._mj.geom_type[second] == mjGEOM_PLANE:
                first, second = second, first
            own_m = self._farthest_m if farthest_m is None else farthest_m[index]
            self._pairs[index] = _pair(self._model, first, second, own_m)
        self.count = len(pairs)

    cdef bint c_find(self, const double* joints, double* out) noexcept nogil:
        """The distances, m, in the pairs' order. False, with nothing changed, if a joint is not finite."""
        cdef int index
        if not self._place(joints):
            return False
        for index in range(self.count):
            out[index] = self._between(&self._pairs[index], self._pairs[index].farthest_m)
        return True

    cdef bint c_find_near(self, const double* joints, const double* last, double near_m,
                          double* out) noexcept nogil:
        """The distances of the pairs whose last distance is below `near_m`, with the same largest distance
        for all; infinity for the others.
        """
        cdef int index
        if not self._place(joints):
            return False
        for index in range(self.count):
            out[index] = INFINITY
            if last[index] < near_m:
                out[index] = self._between(&self._pairs[index], self._farthest_m)
        return True

    cdef bint _place(self, const double* joints) noexcept nogil:
        cdef int index
        for index in range(self._dof):
            if not isfinite(joints[index]):
                return False
        memcpy(self._data.qpos, joints, self._dof * sizeof(double))
        mj_kinematics(self._model, self._data)
        return True

    cdef double _between(self, const GeomPair* pair, double farthest_m) noexcept nogil:
        cdef const double* middle = &self._data.geom_xpos[3 * pair.first]
        cdef const double* turn = &self._data.geom_xmat[9 * pair.first]
        cdef const double* other = &self._data.geom_xpos[3 * pair.second]
        cdef const double* other_turn = &self._data.geom_xmat[9 * pair.second]
        cdef double distance
        if pair.rule == PLANE_AND_CAPSULE or pair.rule == PLANE_AND_CYLINDER:
            distance = _from_plane(middle, turn, other, other_turn, pair)
            return fmin(distance, farthest_m)
        if pair.rule != ITERATED:
            distance = between_axes(
                middle, turn, pair.first_half_m, other, other_turn, pair.second_half_m, NULL, NULL
            ) - pair.radii_m
            if pair.rule == CAPSULES or distance >= farthest_m:
                return fmin(distance, farthest_m)
            if _between_boxes(self._model, self._data, pair) >= farthest_m:
                return farthest_m
        return mj_geomDistance(self._model, self._data, pair.first, pair.second, farthest_m, NULL)

    def find(self, joints):
        """The distances, shape (count,), m, at joints of shape (dof,), which must be finite."""
        given = np.array(joints, dtype=np.float64).reshape(self._dof)
        out = np.zeros(max(1, self.count))
        if not self.c_find(doubles(given, self._dof), doubles(out, self.count)):
            raise ValueError("a joint is not finite")
        return out[: self.count]


cdef GeomPair _pair(const mjModel* model, int first, int second, double farthest_m):
    cdef GeomPair pair
    cdef double half_m, radius_m
    pair.first, pair.second, pair.farthest_m = first, second, farthest_m
    pair.rule = _rule(model.geom_type[first], model.geom_type[second])
    _find_capsule(model, first, &pair.first_half_m, &pair.radii_m)
    _find_capsule(model, second, &half_m, &radius_m)
    pair.second_half_m = half_m
    pair.radii_m = radius_m if model.geom_type[first] == mjGEOM_PLANE else pair.radii_m + radius_m
    return pair


cdef int _rule(int first, int second):
    if first == mjGEOM_PLANE:
        if second == mjGEOM_CYLINDER:
            return PLANE_AND_CYLINDER
        return PLANE_AND_CAPSULE if _is_capsule(second) else ITERATED
    if _is_capsule(first) and _is_capsule(second):
        return CAPSULES
    return BOUNDED_BY_CAPSULES if _is_bounded(first) and _is_bounded(second) else ITERATED


cdef bint _is_capsule(int kind):
    return kind == mjGEOM_SPHERE or kind == mjGEOM_CAPSULE


cdef bint _is_bounded(int kind):
    return kind in (
        mjGEOM_SPHERE, mjGEOM_CAPSULE, mjGEOM_CYLINDER, mjGEOM_ELLIPSOID, mjGEOM_BOX, mjGEOM_MESH
    )


cdef void _find_capsule(const mjModel* model, int geom, double* half_m, double* radius_m):
    """The capsule around a geom, along its z axis. For most shapes it is a sphere."""
    cdef const double* size = &model.geom_size[3 * geom]
    half_m[0], radius_m[0] = 0.0, model.geom_rbound[geom]
    if model.geom_type[geom] in (mjGEOM_CAPSULE, mjGEOM_CYLINDER):
        half_m[0], radius_m[0] = size[1], size[0]


cdef double _between_boxes(const mjModel* model, const mjData* data, const GeomPair* pair) noexcept nogil:
    """The widest gap between the boxes around two geoms along one of their axes: a lower bound of the
    distance.
    """
    cdef const double* first_turn = &data.geom_xmat[9 * pair.first]
    cdef const double* second_turn = &data.geom_xmat[9 * pair.second]
    cdef const double* first = &model.geom_aabb[6 * pair.first]
    cdef const double* second = &model.geom_aabb[6 * pair.second]
    cdef double way[3]
    cdef double cosine[3][3]  # between the axes of the first and those of the second
    cdef double along, other, widest = -INFINITY
    cdef int i, j
    for i in range(3):
        way[i] = data.geom_xpos[3 * pair.second + i] - data.geom_xpos[3 * pair.first + i]
        for j in range(3):
            way[i] += second_turn[3 * i + j] * second[j] - first_turn[3 * i + j] * first[j]
    for i in range(3):
        for j in range(3):
            cosine[i][j] = (
                first_turn[i] * second_turn[j]
                + first_turn[3 + i] * second_turn[3 + j]
                + first_turn[6 + i] * second_turn[6 + j]
            )
    for i in range(3):
        along = first_turn[i] * way[0] + first_turn[3 + i] * way[1] + first_turn[6 + i] * way[2]
        other = second_turn[i] * way[0] + second_turn[3 + i] * way[1] + second_turn[6 + i] * way[2]
        along = fabs(along) - first[3 + i]
        other = fabs(other) - second[3 + i]
        for j in range(3):
            along -= fabs(cosine[i][j]) * second[3 + j]
            other -= fabs(cosine[j][i]) * first[3 + j]
        widest = fmax(widest, fmax(along, other))
    return widest


cdef double _from_plane(
    const double* origin, const double* plane, const double* middle, const double* turn, const GeomPair* pair
) noexcept nogil:
    """The distance from a plane, whose normal is its z axis, to the deepest point of a capsule or a
    cylinder."""
    cdef double height = 0.0
    cdef double slope = 0.0
    cdef double radius = pair.radii_m
    cdef int i
    for i in range(3):
        height += plane[3 * i + 2] * (middle[i] - origin[i])
        slope += plane[3 * i + 2] * turn[3 * i + 2]
    if pair.rule == PLANE_AND_CYLINDER:
        radius *= sqrt(fmax(0.0, 1.0 - slope * slope))
    return height - pair.second_half_m * fabs(slope) - radius
