"""Signed distances between two geoms, for compiled code; see `shapes.pyx`."""

from cobot.robot.mujoco cimport mjData, mjModel

cdef enum Kind:
    PLANE
    SEGMENT     # a capsule, or a sphere, which is one without a length
    CYLINDER
    BOX
    OTHER
    CLOUD       # cubes of a grid; see `cloud.pyx`, `gap` does not know them


cdef struct Solid:
    int geom
    Kind kind
    double half_m      # of the capsule around it, along z: from its middle to the end of its axis
    double radius_m
    double bound_m     # of the sphere around it
    double size[3]     # MuJoCo's


cdef Solid solid_of(const mjModel* model, int geom)
cdef double far_bound(const mjData* data, const Solid* first, const Solid* second) noexcept nogil
cdef double gap(
    const mjModel* model, mjData* data, const Solid* first, const Solid* second, double enough_m, double* line
) noexcept nogil
cdef double between_axes(
    const double* middle, const double* turn, double half,
    const double* other, const double* other_turn, double other_half, double* along, double* other_along,
) noexcept nogil
cdef double axis_to_box(
    const double* centre, const double* axis, double half, const double* box, double* normal, double* along
) noexcept nogil
cdef void into(
    const double* middle, const double* turn, const double* other, const double* other_turn,
    double* centre, double* axis,
) noexcept nogil
