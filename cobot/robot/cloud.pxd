"""Distances of a geom from the occupied cubes of a grid, for compiled code; see `cloud.pyx`."""

from cobot.robot.mujoco cimport mjData, mjModel
from cobot.robot.shapes cimport Solid


cdef struct CloudNode:       # a box around some cubes; its first half comes next
    double middle[3]         # from the middle of the whole cloud, m
    double half[3]
    int count                # of its cubes; 1: the node is a cube
    int central              # a cube near its middle, as a node


cdef struct Sphere:          # around a part of a body, a row of `cover`
    double place[3]
    double outer
    int skip


cdef class CloudTree:
    cdef readonly int count
    cdef readonly double voxel_m
    cdef readonly object cells
    cdef CloudNode* nodes
    cdef tuple _placed

    cdef void _fill(self, const int* cells, int index, int count) noexcept nogil
    cdef bint _is_within(self, int index, const double* boxes, int* near, int count) noexcept nogil


cdef double gap_to_cloud(
    const mjModel* model, mjData* data, const Solid* first, const Sphere* around, int spheres,
    const Solid* second, const Solid* cube, const CloudNode* nodes, double enough_m, double exact_m,
    double decided_m, double* line, int* nearest
) noexcept nogil
