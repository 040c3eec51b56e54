from libc.stdint cimport int64_t, uint32_t, uint64_t

from cobot.arrays cimport MAX_DOF
from cobot.ipc.seqlock cimport Block
from cobot.ipc.state_block cimport StateScalars
from cobot.robot.chain cimport Chain
from rtloop.safety.limiter cimport Safety

cdef class StatePublisher:
    cdef Block block
    cdef Chain _chain
    cdef int _dof
    cdef double _smoothing
    cdef double _per_period
    cdef double _effort_before[MAX_DOF]
    # Fields of the block's private copy.
    cdef StateScalars* scalars
    cdef double* _measured
    cdef double* _velocity
    cdef double* _effort
    cdef double* _commanded
    cdef double* _tcp
    cdef double* _tcp_velocity
    cdef double* _effort_rate
    cdef uint64_t* _interventions
    cdef int64_t* _intervened_ns
    cdef Block _gripper  # the gripper's block, written by the service
    cdef double* _gripper_values  # the gripper's values in the block's private copy
    cdef uint64_t _gripper_seen  # sequence of the reading that is published
    # Used by `publish`, which uses Python objects.
    cdef object _reason
    cdef long long _counted

    # Publish a cycle. `monotonic_ns` is filled in here.
    #     measured: as `rtloop.backends.Measured.values`
    #     command: 3 dof numbers: rad, rad/s, rad/s²
    cdef void c_publish(
        self, const StateScalars* scalars, const double* measured, const double* command
    ) noexcept nogil
    # Copy the newest reading of the gripper into the numbers of the state.
    cdef void c_heed_gripper(self, StateScalars* scalars) noexcept nogil
    # Copy the counts of the safety layer, one for each kind of intervention. Call this when they change.
    cdef void c_heed(self, Safety safety, object reason) except *
    cdef void _find_tcp(self) noexcept nogil
    cdef void _smooth_effort_rate(self) noexcept nogil


cdef class Statistics:
    cdef Block _block
    cdef Block _info, _device
    cdef uint32_t* _counts  # a row of HISTOGRAM_BUCKETS for each phase
    cdef double* _max_us
    cdef uint64_t _cycles
    cdef uint64_t* _published_cycles

    cdef void c_count(self, int phase, long long duration_ns) noexcept nogil
    cdef void c_end_cycle(self) noexcept nogil
