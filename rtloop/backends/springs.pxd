from cobot.arrays cimport MAX_DOF
from cobot.robot.chain cimport Chain
from cobot.robot.mujoco cimport mjData, mjModel


cdef class Springs:
    cdef const mjModel* _model
    cdef mjData* _data
    cdef Chain _chain
    cdef object _owners  # of what the addresses lead to
    cdef int _dof
    cdef const double* _jacobian
    cdef readonly object joint_stiffness, tcp_stiffness
    cdef bint _cartesian
    cdef double _stiffness[MAX_DOF]  # of the springs on the joints, N·m/rad
    cdef double _damping_squared[MAX_DOF]  # of theirs, for each kg·m²
    cdef double _tcp_stiffness[6]
    cdef double _stiffness_roots[6]
    cdef double _damping_roots[6]
    cdef double _response[6 * MAX_DOF]  # J M⁻¹
    cdef double _mobility[36]  # J M⁻¹ J'
    cdef void c_torques(self, const double* command, double* torques) noexcept nogil
    cdef void _pull_tcp(
        self, const double* position, const double* velocity_error, double* torques
    ) noexcept nogil
    cdef void _find_mobility(self) noexcept nogil
    cdef void _damp(self, const double* velocity_error, double* force) noexcept nogil
    cdef void _add_pull(self, const double* position, double* force) noexcept nogil
    cdef void _take_from_null_space(self, const double* torques, double* force) noexcept nogil
    cdef _use_on_tcp(self, stiffness, damping_ratio)
