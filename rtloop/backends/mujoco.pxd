from cobot.arrays cimport MAX_DOF
from cobot.robot.mujoco cimport mjData, mjModel
from rtloop.backends.compiled cimport CompiledBackend, Measured
from rtloop.backends.observer cimport Observer
from rtloop.backends.springs cimport Springs


cdef class MujocoBackend(CompiledBackend):
    cdef int _tcp, _tcp_body
    cdef const mjModel* _c_model
    cdef mjData* _c_data
    cdef mjData* _sensed  # the data whose sensors are read
    cdef object _robot, _base
    cdef readonly object _model, _data, _position
    cdef readonly object nominal_stiffness, nominal_cartesian_stiffness
    cdef double _base_rotation[9]
    cdef bint _base_turned
    cdef object _jacobian
    cdef double* _c_jacobian
    cdef Observer _observer
    cdef Springs _springs
    cdef object _losses  # damping and dry friction from the model's file, each of shape (dof,)
    cdef double _command[3 * MAX_DOF]
    cdef double _pull[MAX_DOF]
    cdef bint _yielding  # whether an impedance is set
    cdef bint _changing  # whether a different impedance takes effect with the next command
    cdef readonly object _transition
    cdef double* _c_transition
    cdef double _transition_from[MAX_DOF]
    cdef int _transition_cycles, _transition_left
    cdef Measured _reported
    # index in MuJoCo's sensor readings; negative: the model has no such sensor
    cdef int _force_address, _torque_address
    cdef double _from_sensors[36]
    cdef str _fail_read, _fail_write, _drive_fault
    cdef bint _read_fails, _write_fails
    cdef object _push, _jump
    cdef double* _c_push
    cdef double* _c_jump
    cdef bint _pushing
    # body of the stepped model; remaining and total number of cycles
    cdef int _pull_body, _pull_left, _pull_cycles
    cdef double _pull_point[3]
    cdef double _pull_target[3]
    cdef double _pull_last[3]
    cdef bint _pull_begins
    cdef object _pull_effort
    cdef double* _c_pull_effort           # efforts of all joints of the stepped model
    cdef object _max_effort
    cdef double* _c_max_effort
    cdef public bint stale, not_finite
    cdef void _take(self, double* values) noexcept nogil
    cdef void _step(self, const double* command) noexcept nogil
    cdef void _find_torques(self, const double* command) noexcept nogil
    cdef void _find_jacobian(self) noexcept nogil
    cdef void _find_pull(self) noexcept nogil
    cdef void _pull_stiffly(self) noexcept nogil
    cdef void _begin_transition(self) noexcept nogil
    cdef void _fade_transition(self) noexcept nogil
    cdef void _push_on(self, mjData* data, int body) noexcept nogil
    cdef void _pull_on(self, const mjModel* model, mjData* data) noexcept nogil
    cdef void _report(self) noexcept nogil
    cdef void _read_sensors(self, double* wrench) noexcept nogil
    cdef _make_up_for_losses(self)
    cdef _find_sensors(self)
    cdef int _body_of(self, str link) except -1
