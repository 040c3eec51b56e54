from cobot.robot.mujoco cimport mjContact, mjData, mjModel

cdef enum:
    MAX_POINTS = 64
    MAX_BELTS = 8
    MAX_SWITCHES = 16
    LIP_BALLS = 8


cdef struct Ray:
    double origin[3]
    double direction[3]
    double length_m


cdef struct Switch:
    int kind
    int point
    int count  # the point that counts; negative: none
    int body
    double force
    Ray ray


cdef class CellDevices:
    cdef mjModel* _model
    cdef mjData* _data
    cdef object _owners, _points, _indices, _reported
    cdef double _values[MAX_POINTS]
    cdef int _finger_position[2]
    cdef int _finger_dof[2]
    cdef double _finger_share[2]  # of the width that each finger makes
    cdef int _finger_body[2]  # of a cup both are the cup
    cdef double* _turning
    cdef object _turning_array
    cdef bint _has_hand, _has_cup
    cdef int _lip  # the first ball of the cup's lip; the others follow it
    cdef int _sucked  # the body that the cup presses against; negative: none
    cdef double _holding_n, _full_kpa, _lip_m, _evacuate_s
    cdef double _reference, _stroke_m, _period_s, _stiffness, _damping
    cdef int _still_cycles, _cycles_to_rest
    cdef int _belt_geom[MAX_BELTS]
    cdef int _belt_point[MAX_BELTS]
    cdef int _belts, _switches
    cdef Switch _switch[MAX_SWITCHES]
    cdef _add_switches(self, object plant)
    cdef void c_drive(self) noexcept nogil
    cdef void c_keep_grasp(self) noexcept nogil
    cdef void c_sense(self) noexcept nogil
    cdef void _drive_hand(self) noexcept nogil
    cdef void _suck(self) noexcept nogil
    cdef int _covered(self, int* body) noexcept nogil
    cdef void _press(self, int body, double force_n) noexcept nogil
    cdef void _keep(self, const mjContact* contact) noexcept nogil
    cdef void _sense_hand(self) noexcept nogil
    cdef double _look(self, const Ray* ray) noexcept nogil
    cdef bint _is_pressed(self, const Switch* switch) noexcept nogil
