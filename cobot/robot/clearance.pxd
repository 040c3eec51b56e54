"""The distances of an arm from itself and its surroundings, for compiled code; see `clearance.pyx`."""

from cobot.arrays cimport MAX_DOF
from cobot.robot.mujoco cimport mjData, mjModel
from cobot.robot.shapes cimport Solid


cdef struct Link:
    int before           # the joint before this one on the way from the world; -1: none
    bint slides
    double rest          # the joint's position at which the fixed part is as it is
    double turn[9]       # fixed part, from the frame of the joint before to this one's, whose z is its axis
    double offset[3]


cdef struct Part:
    Solid solid
    int joint            # that moves it; -1: it stands
    bint is_turned       # whether more of its orientation counts than its z axis
    double turn[9]       # in the joint's frame
    double offset[3]
    double reach[MAX_DOF]   # no point of it is ever further from a joint's axis, m; 1 for a slide
    double swept[MAX_DOF]   # how far it moves by a joint and those behind it, m; of the time of `stamp`
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
    cdef double _hit_at
    cdef double _hit_m

    cdef void _move_to(self, const double* joints) noexcept nogil
    cdef void _move_part(self, Part* part) noexcept nogil
    cdef void _sweep(self, Part* part, const double* turned) noexcept nogil
    cdef double _sweep_of(self, int part, int joint, const double* turned) noexcept nogil
    cdef bint _is_proven(
        self, const double* control, int degree, double begin, double end, int count, bint ordered
    ) noexcept nogil
    cdef int _first_touching(self, double* distance) noexcept nogil
    cdef double _gap(self, int index, double enough_m, double* line) noexcept nogil
    cdef void _add_gradient(self, int pair, double weight, const double* line, double* out) noexcept nogil
    cdef bint c_is_edge_free(self, const double* start, const double* goal) noexcept nogil
