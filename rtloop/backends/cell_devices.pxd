from cobot.robot.mujoco cimport mjContact, mjData, mjModel

cdef enum:
    MAX_POINTS = 64
    MAX_BELTS = 8
    MAX_SWITCHES = 16
    LIP_BALLS = 8
    MAX_WIDTHS = 64


cdef struct Ray:
    double origin[3]
    double direction[3]
    double length_m


cdef struct Switch:
    int kind
    int point
    int count  # index of the counter's point; negative: no counter
    int body
    double force
    Ray ray


cdef class CellDevices:
    cdef mjModel* _model
    cdef mjData* _data
    cdef object _owners, _points, _indices, _reported
    cdef double _values[MAX_POINTS]
    cdef int _drives  # drives of the hand: two slides, or one hinge
    cdef int _finger_position[2]
    cdef int _finger_dof[2]
    cdef double _travel[2]  # travel of each drive from closed to open, m or rad
    cdef double _inertia[2]
    cdef double _per_travel  # share of the opening per metre or radian of a drive
    cdef int _last_width
    cdef double _widths[MAX_WIDTHS]  # widths at evenly spaced openings, from closed to open
    cdef object _gripping_array
    cdef unsigned char* _gripping  # for each body: whether it is a gripping part of the hand
    cdef int _cup
    cdef double* _turning
    cdef object _turning_array
    cdef bint _has_hand, _has_cup
    cdef int _lip  # the first ball of the cup's lip; the others follow it
    cdef int _sucked  # the body under the cup; negative: none
    cdef double _holding_n, _full_kpa, _lip_m, _evacuate_s
    cdef double _reference, _stroke_m, _closed_m, _period_s
    cdef int _still_cycles, _cycles_to_rest
    cdef int _belt_geom[MAX_BELTS]
    cdef int _belt_point[MAX_BELTS]
    cdef int _belts, _switches
    cdef Switch _switch[MAX_SWITCHES]
    cdef _add_hand(self, object plant)
    cdef _add_switches(self, object plant)
    cdef void c_drive(self) noexcept nogil
    cdef void c_keep_grasp(self) noexcept nogil
    cdef void c_sense(self) noexcept nogil
    cdef void _drive_hand(self) noexcept nogil
    cdef double _opening(self) noexcept nogil
    cdef double _width(self) noexcept nogil
    cdef double _opening_at(self, double width) noexcept nogil
    cdef int _step_at(self, double opening) noexcept nogil
    cdef void _suck(self) noexcept nogil
    cdef int _covered(self, int* body) noexcept nogil
    cdef void _press(self, int body, double force_n) noexcept nogil
    cdef void _keep(self, const mjContact* contact) noexcept nogil
    cdef void _sense_hand(self) noexcept nogil
    cdef double _look(self, const Ray* ray) noexcept nogil
    cdef bint _is_pressed(self, const Switch* switch) noexcept nogil
