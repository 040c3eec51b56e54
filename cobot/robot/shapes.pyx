"""Signed distances between two geoms at their positions in MuJoCo's data, for planners.

Planes, spheres, capsules, boxes and cylinders have short formulas, exact to rounding, also for the depth of a
capsule's axis in a box. MuJoCo's iteration computes two cylinders, a cylinder and a box, and all other
shapes. It is accurate to about a micrometre and takes fifty times as long, so it is used only if the spheres
or capsules around the geoms are not far enough apart.

A `line` has six numbers: the unit vector from the second geom to the first along which their distance grows
fastest, then a point on the line between their nearest points.

`gap` selects the formula for a pair of shapes.
"""

from libc.math cimport fabs, fmax, fmin, sqrt
from libc.string cimport memset

from cobot.robot.mujoco cimport (
    mj_geomDistance,
    mjGEOM_BOX,
    mjGEOM_CAPSULE,
    mjGEOM_CYLINDER,
    mjGEOM_PLANE,
    mjGEOM_SPHERE,
)

cdef enum:
    HALVINGS = 48


cdef Solid solid_of(const mjModel* model, int geom):
    cdef Solid solid
    cdef int kind = model.geom_type[geom]
    cdef int i
    solid.geom = geom
    solid.kind = OTHER
    solid.half_m, solid.radius_m, solid.bound_m = 0.0, model.geom_rbound[geom], model.geom_rbound[geom]
    for i in range(3):
        solid.size[i] = model.geom_size[3 * geom + i]
    if kind == mjGEOM_PLANE:
        solid.kind = PLANE
    elif kind == mjGEOM_BOX:
        solid.kind = BOX
    elif kind == mjGEOM_SPHERE:
        solid.kind = SEGMENT
    elif kind == mjGEOM_CAPSULE or kind == mjGEOM_CYLINDER:
        solid.kind = SEGMENT if kind == mjGEOM_CAPSULE else CYLINDER
        solid.half_m, solid.radius_m = solid.size[1], solid.size[0]
    return solid


cdef double far_bound(const mjData* data, const Solid* first, const Solid* second) noexcept nogil:
    """A lower bound of the distance: that of the spheres around both geoms. The first geom may be a plane."""
    cdef const double* middle = &data.geom_xpos[3 * first.geom]
    cdef const double* other = &data.geom_xpos[3 * second.geom]
    cdef const double* turn = &data.geom_xmat[9 * first.geom]
    cdef double x = other[0] - middle[0]
    cdef double y = other[1] - middle[1]
    cdef double z = other[2] - middle[2]
    if first.kind == PLANE:
        return turn[2] * x + turn[5] * y + turn[8] * z - second.bound_m
    return sqrt(x * x + y * y + z * z) - first.bound_m - second.bound_m


cdef double gap(
    const mjModel* model, mjData* data, const Solid* first, const Solid* second, double enough_m, double* line
) noexcept nogil:
    """The distance of two geoms, m; negative if they overlap. For a distance above `enough_m`, any value of
    at least `enough_m` may be returned. In the order of `Kind` the first geom must not come after the second.
    """
    cdef const double* middle = &data.geom_xpos[3 * first.geom]
    cdef const double* turn = &data.geom_xmat[9 * first.geom]
    cdef const double* other = &data.geom_xpos[3 * second.geom]
    cdef const double* other_turn = &data.geom_xmat[9 * second.geom]
    cdef double radii_m = first.radius_m + second.radius_m
    cdef double bound_m
    if first.kind == PLANE and second.kind != OTHER and second.kind != PLANE:
        return _from_plane(middle, turn, other, other_turn, second, line)
    if first.kind == SEGMENT and second.kind == SEGMENT:
        return _between_segments(middle, turn, first.half_m, other, other_turn, second.half_m, line) - radii_m
    if first.kind == SEGMENT and second.kind == BOX:
        bound_m = _segment_to_box(middle, turn, first.half_m, other, other_turn, second.size, line)
        return bound_m - first.radius_m
    if first.kind == SEGMENT and second.kind == CYLINDER:
        bound_m = _segment_to_cylinder(middle, turn, first.half_m, other, other_turn, second, line)
        if bound_m > 1e-6:
            return bound_m - first.radius_m
    elif first.kind == CYLINDER and second.kind != OTHER:
        if second.kind == BOX:
            bound_m = _segment_to_box(middle, turn, first.half_m, other, other_turn, second.size, NULL)
            bound_m = fmax(
                bound_m - first.radius_m,
                _segment_to_box(middle, turn, 0.0, other, other_turn, second.size, NULL) - first.bound_m,
            )
        else:
            bound_m = between_axes(
                middle, turn, first.half_m, other, other_turn, second.half_m, NULL, NULL
            ) - radii_m
        if bound_m >= enough_m:
            return bound_m
    return _by_mujoco(model, data, first, second, enough_m, line)


cdef double _by_mujoco(
    const mjModel* model, mjData* data, const Solid* first, const Solid* second, double enough_m, double* line
) noexcept nogil:
    cdef double ends[6]
    cdef double distance = mj_geomDistance(model, data, first.geom, second.geom, enough_m, ends)
    cdef double length = 0.0
    cdef int i
    if line != NULL and distance < enough_m:
        for i in range(3):
            line[i] = (ends[i] - ends[3 + i]) * (1.0 if distance > 0.0 else -1.0)
            line[3 + i] = ends[i]
            length += line[i] * line[i]
        for i in range(3):
            line[i] = line[i] / sqrt(length) if length > 1e-18 else 0.0
    return distance


cdef double _from_plane(
    const double* origin, const double* plane, const double* middle, const double* turn, const Solid* solid,
    double* line,
) noexcept nogil:
    """The distance from a plane, whose normal is its z axis, to the deepest point of a geom."""
    cdef double height = 0.0
    cdef double slope = 0.0
    cdef double deep[3]
    cdef double along, depth
    cdef int i, k
    for i in range(3):
        height += plane[3 * i + 2] * (middle[i] - origin[i])
        slope += plane[3 * i + 2] * turn[3 * i + 2]
        deep[i] = middle[i]
    if solid.kind == BOX:
        depth = 0.0
        for k in range(3):
            along = plane[2] * turn[k] + plane[5] * turn[3 + k] + plane[8] * turn[6 + k]
            depth += solid.size[k] * fabs(along)
            for i in range(3):
                deep[i] -= (solid.size[k] if along > 0.0 else -solid.size[k]) * turn[3 * i + k]
    else:
        depth = solid.half_m * fabs(slope) + solid.radius_m
        for i in range(3):
            deep[i] -= (solid.half_m if slope > 0.0 else -solid.half_m) * turn[3 * i + 2]
        if solid.kind == CYLINDER:
            along = sqrt(fmax(0.0, 1.0 - slope * slope))
            depth = solid.half_m * fabs(slope) + solid.radius_m * along
            if along > 1e-9:
                for i in range(3):
                    deep[i] -= solid.radius_m / along * (plane[3 * i + 2] - slope * turn[3 * i + 2])
    if line != NULL:
        for i in range(3):
            line[i], line[3 + i] = -plane[3 * i + 2], deep[i]
    return height - depth


cdef double _between_segments(
    const double* middle, const double* turn, double half,
    const double* other, const double* other_turn, double other_half, double* line,
) noexcept nogil:
    cdef double s, t
    cdef double distance = between_axes(middle, turn, half, other, other_turn, other_half, &s, &t)
    cdef int i
    if line == NULL:
        return distance
    for i in range(3):
        line[3 + i] = middle[i] + s * turn[3 * i + 2]
        line[i] = line[3 + i] - other[i] - t * other_turn[3 * i + 2]
    _normalise_or_cross(line, turn, other_turn)
    return distance


cdef void _normalise_or_cross(double* normal, const double* turn, const double* other_turn) noexcept nogil:
    """Normalise the direction. If two axes meet, their distance grows fastest in the direction normal to
    both."""
    cdef double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
    cdef int i
    if length < 1e-9:
        normal[0] = turn[5] * other_turn[8] - turn[8] * other_turn[5]
        normal[1] = turn[8] * other_turn[2] - turn[2] * other_turn[8]
        normal[2] = turn[2] * other_turn[5] - turn[5] * other_turn[2]
        length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
    for i in range(3):
        normal[i] = normal[i] / length if length > 1e-12 else 0.0


cdef double between_axes(
    const double* middle, const double* turn, double half,
    const double* other, const double* other_turn, double other_half, double* along, double* other_along,
) noexcept nogil:
    """The distance between two segments along z axes (C. Ericson, "Real-Time Collision Detection", 2005,
    section 5.1.9). Their nearest points are also given, unless their arguments are NULL.
    """
    cdef double between[3]
    cdef double cosine = 0.0
    cdef double ahead = 0.0
    cdef double other_ahead = 0.0
    cdef double s = 0.0
    cdef double square = 0.0
    cdef double t, wanted
    cdef int i
    for i in range(3):
        between[i] = other[i] - middle[i]
        cosine += turn[3 * i + 2] * other_turn[3 * i + 2]
        ahead += turn[3 * i + 2] * between[i]
        other_ahead += other_turn[3 * i + 2] * between[i]
    if cosine * cosine < 1.0:
        s = fmax(-half, fmin(half, (ahead - cosine * other_ahead) / (1.0 - cosine * cosine)))
    wanted = cosine * s - other_ahead
    t = fmax(-other_half, fmin(other_half, wanted))
    if t != wanted:
        s = fmax(-half, fmin(half, ahead + cosine * t))
    for i in range(3):
        wanted = between[i] + t * other_turn[3 * i + 2] - s * turn[3 * i + 2]
        square += wanted * wanted
    if along != NULL:
        along[0], other_along[0] = s, t
    return sqrt(square)


cdef void into(
    const double* middle, const double* turn, const double* other, const double* other_turn,
    double* centre, double* axis,
) noexcept nogil:
    """The middle and the z axis of one geom in the frame of another one."""
    cdef int i, k
    memset(centre, 0, 3 * sizeof(double))
    memset(axis, 0, 3 * sizeof(double))
    for k in range(3):
        for i in range(3):
            centre[k] += other_turn[3 * i + k] * (middle[i] - other[i])
            axis[k] += other_turn[3 * i + k] * turn[3 * i + 2]


cdef inline double _beyond(double value, double limit) noexcept nogil:
    return value - limit if value > limit else value + limit if value < -limit else 0.0


cdef inline double _slope(
    const double* centre, const double* axis, const double* box, double t
) noexcept nogil:
    """Half the derivative of the squared distance of a point of the axis from the box."""
    cdef double total = 0.0
    cdef int i
    for i in range(3):
        total += axis[i] * _beyond(centre[i] + t * axis[i], box[i])
    return total


cdef double _segment_to_box(
    const double* middle, const double* turn, double half,
    const double* other, const double* other_turn, const double* box, double* line,
) noexcept nogil:
    cdef double centre[3]
    cdef double axis[3]
    cdef double normal[3]
    cdef double t, distance
    cdef int i, k
    into(middle, turn, other, other_turn, centre, axis)
    distance = axis_to_box(centre, axis, half, box, normal, &t)
    if line != NULL:
        for i in range(3):
            line[i], line[3 + i] = 0.0, middle[i] + t * turn[3 * i + 2]
            for k in range(3):
                line[i] += other_turn[3 * i + k] * normal[k]
    return distance


cdef double axis_to_box(
    const double* centre, const double* axis, double half, const double* box, double* normal, double* along
) noexcept nogil:
    """The distance of a segment from a box, negative if they meet, with the direction in which it grows
    fastest and the point on the segment. All are in the frame of the box.

    The squared distance along the segment is convex and piecewise quadratic: its derivative is linear
    between the planes of the box's faces, and where it vanishes is the nearest point.
    """
    cdef double low = -half
    cdef double high = half
    cdef double square = 0.0
    cdef double below, above, t, at, slope, distance
    cdef int i
    below, above = _slope(centre, axis, box, low), _slope(centre, axis, box, high)
    if below >= 0.0:
        t = low
    elif above <= 0.0:
        t = high
    else:
        for i in range(6):
            if axis[i // 2] == 0.0:
                continue
            at = ((box[i // 2] if i % 2 else -box[i // 2]) - centre[i // 2]) / axis[i // 2]
            if low < at < high:
                slope = _slope(centre, axis, box, at)
                if slope < 0.0:
                    low, below = at, slope
                else:
                    high, above = at, slope
        t = low - below * (high - low) / (above - below)
    for i in range(3):
        normal[i] = _beyond(centre[i] + t * axis[i], box[i])
        square += normal[i] * normal[i]
    distance = sqrt(square)
    if distance > 1e-12:
        for i in range(3):
            normal[i] /= distance
    else:
        distance = _axis_in_box(centre, axis, half, box, normal, &t)
    along[0] = t
    return distance


cdef double _axis_in_box(
    const double* centre, const double* axis, double half, const double* box, double* normal, double* t
) noexcept nogil:
    """The depth of a segment in a box that it meets, as a negative number. The shortest way out is along the
    normal of a face, or normal to an edge and the segment (the faces of the Minkowski difference).
    """
    cdef double least = 1e300
    cdef double across[3]
    cdef double length, depth, place
    cdef int i, k, first, second
    for i in range(3):
        depth = box[i] + half * fabs(axis[i]) - fabs(centre[i])
        if depth < least:
            least = depth
            memset(normal, 0, 3 * sizeof(double))
            normal[i] = 1.0 if centre[i] >= 0.0 else -1.0
            t[0] = -half if axis[i] * normal[i] > 0.0 else half
    for i in range(3):
        first, second = (i + 1) % 3, (i + 2) % 3
        across[i], across[first], across[second] = 0.0, -axis[second], axis[first]
        length = sqrt(across[first] * across[first] + across[second] * across[second])
        if length < 1e-6 or half == 0.0:
            continue
        depth, place = 0.0, 0.0
        for k in range(3):
            across[k] /= length
            depth += box[k] * fabs(across[k])
            place += centre[k] * across[k]
        depth -= fabs(place)
        if depth < least:
            least = depth
            for k in range(3):
                normal[k] = across[k] if place >= 0.0 else -across[k]
            t[0] = fmax(-half, fmin(half, -(
                centre[0] * axis[0] + centre[1] * axis[1] + centre[2] * axis[2]
            )))
    return -least


cdef double _segment_to_cylinder(
    const double* middle, const double* turn, double half,
    const double* other, const double* other_turn, const Solid* cylinder, double* line,
) noexcept nogil:
    """The distance between a segment and a cylinder; 0 if they meet. The distance along the segment is
    convex, so bisection finds where its derivative vanishes.
    """
    cdef double centre[3]
    cdef double axis[3]
    cdef double away[3]
    cdef double low = -half
    cdef double high = half
    cdef double t, distance
    cdef int _step, i, k
    into(middle, turn, other, other_turn, centre, axis)
    t = low
    if _from_cylinder(centre, axis, low, cylinder, away, &distance) < 0.0:
        t = high
        if _from_cylinder(centre, axis, high, cylinder, away, &distance) > 0.0:
            for _step in range(HALVINGS):
                t = 0.5 * (low + high)
                if _from_cylinder(centre, axis, t, cylinder, away, &distance) > 0.0:
                    high = t
                else:
                    low = t
    _from_cylinder(centre, axis, t, cylinder, away, &distance)
    if line != NULL:
        for i in range(3):
            line[i], line[3 + i] = 0.0, middle[i] + t * turn[3 * i + 2]
            for k in range(3):
                line[i] += other_turn[3 * i + k] * away[k] / fmax(distance, 1e-12)
    return distance


cdef double _from_cylinder(
    const double* centre, const double* axis, double t, const Solid* cylinder, double* away, double* distance
) noexcept nogil:
    """The vector from a cylinder to a point of the segment, its length, and half the derivative of the
    length's square."""
    cdef double x = centre[0] + t * axis[0]
    cdef double y = centre[1] + t * axis[1]
    cdef double out = sqrt(x * x + y * y)
    cdef double share = (out - cylinder.radius_m) / out if out > cylinder.radius_m else 0.0
    away[0], away[1] = share * x, share * y
    away[2] = _beyond(centre[2] + t * axis[2], cylinder.half_m)
    distance[0] = sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2])
    return away[0] * axis[0] + away[1] * axis[1] + away[2] * axis[2]
