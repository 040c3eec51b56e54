from cobot.arrays cimport MAX_DOF
from cobot.robot.chain cimport Chain
from cobot.robot.mujoco cimport mjData, mjModel


cdef class Springs:
    cdef const mjModel* _model
    cdef mjData* _data
    cdef Chain _chain
    cdef object _owners  # the objects that own the memory of these pointers
    cdef int _dof
    cdef const double* _jacobian
    cdef object _unit
    cdef const double* _identity
    cdef readonly object joint_stiffness, tcp_stiffness
    cdef bint _cartesian
    cdef double _stiffness[MAX_DOF]  # stiffness of the springs on the joints, N·m/rad
    cdef double _stiffness_roots[MAX_DOF]
    cdef double _damping_roots[MAX_DOF]
    cdef double _tcp_stiffness[6]
    cdef double _tcp_stiffness_roots[6]
    cdef double _tcp_damping_roots[6]
    cdef double _response[6 * MAX_DOF]  # J M⁻¹
    cdef double _min_mobility[6]
    cdef double _mobility[36]  # J M⁻¹ J'
    cdef void c_torques(self, const double* command, double* torques) noexcept nogil
    cdef void _pull_tcp(
        self, const double* position, const double* velocity_error, double* torques
    ) noexcept nogil
    cdef void _find_mobility(self) noexcept nogil
    cdef void _add_pull(self, const double* position, double* force) noexcept nogil
    cdef void _take_from_null_space(self, const double* torques, double* force) noexcept nogil
    cdef _use_on_tcp(self, stiffness, damping_ratio)


cdef void damp(
    int n,
    const double* mobility,
    const double* stiffness_roots,
    const double* damping_roots,
    const double* velocity_error,
    double* force,
) noexcept nogil
