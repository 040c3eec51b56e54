"""The distances of an arm from itself and its surroundings, for compiled code; see `clearance.pyx`."""

from cobot.arrays cimport MAX_DOF
from cobot.robot.cloud cimport CloudNode, Sphere
from cobot.robot.mujoco cimport mjData, mjModel
from cobot.robot.shapes cimport Solid


cdef extern from "lanes.h":
    enum:
        LANES_NEAR
        LANES_TREE
        LANES_CLOUD
        LANES_BOX
        LANES_CYLINDER
        LANES_SEGMENT
        LANES_PLANE

    ctypedef struct LaneNode:
        float x, y, z, outer, inner
        int skip, depth

    ctypedef struct LaneLink:
        int before, slides
        double rest
        float turn[9]
        float offset[3]

    ctypedef struct LanePart:
        int joint, kind, count
        const LaneNode* nodes
        float turn[9]
        float origin[3]
        float size[3]
        float round, slack

    ctypedef struct LanePair:
        int first, second, common, first_joint, second_joint

    ctypedef struct LaneModel:
        int dof
        const LaneLink* links
        const LanePart* parts
        int part_count
        const LanePair* pairs
        const float* least
        float slack

    ctypedef struct LaneQuery:
        const double* joints
        const float* rates
        const float* half
        const float* bend
        const int* pairs
        int pair_count
        unsigned active
        int all

    ctypedef struct LaneAnswer:
        unsigned hit, open, unsure
        int hit_pair, failing_count
        int* failing
        unsigned* lanes
        float* places

    ctypedef void (*LaneCheck)(const LaneModel*, const LaneQuery*, LaneAnswer*) noexcept nogil


cdef struct Stretch:       # a part of a piece of a motion
    int piece
    int number           # in units of its own length


cdef struct Link:
    int before           # the joint before this one on the way from the world; -1: none
    bint slides
    double rest          # position of the joint for which the fixed part is given
    double turn[9]       # fixed part, from the frame of the joint before to this one's, whose z is its axis
    double offset[3]


cdef struct Part:
    Solid solid
    Solid cube           # of a cloud: the geom that is moved to one cube after the other
    const CloudNode* nodes
    Sphere* spheres      # around it, in its own frame, if there are clouds
    int sphere_count
    int joint            # joint that moves it; -1: it is fixed
    bint is_turned       # whether more of its orientation matters than its z axis
    double turn[9]       # in the joint's frame
    double offset[3]
    double reach[MAX_DOF]   # largest distance of its points from a joint's axis, m; 1 for a slide
    double swept[MAX_DOF]   # how far a joint and those behind it can move it, m; valid for `stamp`
    long stamp


cdef struct Pair:
    int first
    int second
    int first_joint      # the first joint on the way to it that does not move the other one too; -1: none
    int second_joint


cdef class Clearance:
    cdef readonly int count
    cdef readonly int dof
    cdef readonly long evaluations
    cdef readonly tuple pairs
    cdef public double resolution_m
    cdef readonly dict clouds
    cdef object _mj
    cdef const mjModel* _model
    cdef mjData* _data
    cdef int _parts
    cdef long _stamp
    cdef Link _link[MAX_DOF]
    cdef double _turn[MAX_DOF][9]
    cdef double _place[MAX_DOF][3]
    cdef Part* _part
    cdef Pair* _pair
    cdef double* _least
    cdef int* _order
    cdef int _hit_pair
    cdef bint _is_enclosed
    cdef LaneCheck _check          # NULL: exact distances alone decide
    cdef LaneModel _lanes
    cdef LaneLink* _lane_links
    cdef LanePart* _lane_parts
    cdef LanePair* _lane_pairs
    cdef list _lane_nodes
    cdef float* _lane_least
    cdef float* _bend
    cdef int* _lane_order          # pairs; the one of the last hit comes first
    cdef int* _failing             # four lists of pairs
    cdef unsigned* _failing_lanes  # two for each pair of the first list
    cdef long* _listed             # of the pairs in a list: its number
    cdef long _lists
    cdef double _hit_at
    cdef double _hit_m

    cdef double _between(
        self, const Part* first, const Part* second, double enough_m, double exact_m, double decided_m,
        double* line
    ) noexcept nogil
    cdef int _set_spheres(self, Part* part) except -1
    cdef int _common(self, int joint, int other) noexcept
    cdef int _after(self, int common, int joint) noexcept
    cdef void find_near(
        self, const double* joints, Py_ssize_t count, double within_m, char* near
    ) noexcept nogil
    cdef Py_ssize_t _look_along(
        self, const double* control, int degree, Py_ssize_t count, bint first, char* unproven
    ) noexcept nogil
    cdef int _parts_to_start_with(self, const double* control, int degree, int count) noexcept nogil
    cdef bint _touches(
        self, const double* control, int degree, const Stretch* stretch, int parts
    ) noexcept nogil
    cdef void _look_at_stretches(
        self, const double* control, int degree, const Stretch* stretches, int count, int parts,
        LaneQuery* query, LaneAnswer* answer
    ) noexcept nogil
    cdef void move_to(self, const double* joints) noexcept nogil
    cdef void _move_part(self, Part* part) noexcept nogil
    cdef void _sweep(self, Part* part, const double* turned) noexcept nogil
    cdef double _sweep_of(self, int part, int joint, const double* turned) noexcept nogil
    cdef bint _is_proven(
        self, const double* control, int degree, double begin, double end, int* order, int count, bint ordered
    ) noexcept nogil
    cdef int _first_touching(self, int* order, int count, double* distance) noexcept nogil
    cdef void _look_at_rows(
        self, const double* rows, int count, LaneQuery* query, LaneAnswer* answer
    ) noexcept nogil
    cdef unsigned c_are_blocked(self, const double* rows, int count) noexcept nogil
    cdef void _bound_bends(self, const double* rates, const double* stray) noexcept nogil
    cdef void _look(
        self, const double* start, const double* rates, const double* at, int count, LaneQuery* query,
        LaneAnswer* answer
    ) noexcept nogil
    cdef int _set_lane_part(self, int index, object tree) except -1
    cdef void _raise(self, int pair) noexcept nogil
    cdef int _list(self, const LaneAnswer* answer, long number, int* pairs, int count) noexcept nogil
    cdef bint _is_edge_exactly_free(self, const double* start, const double* goal) noexcept nogil
    cdef double gap_of(self, int index, double enough_m, double* line) noexcept nogil
    cdef void add_gradient(self, int pair, double weight, const double* line, double* out) noexcept nogil
    cdef bint c_is_edge_free(self, const double* start, const double* goal) noexcept nogil
