from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from cobot.ipc.ring cimport Ring
from rtloop.publisher cimport StateScalars
from rtloop.safety.limiter cimport Safety

cdef enum:
    PHASES = 4

cdef struct RecordHead:  # `cobot.ipc.records.HEAD`, which says what they are
    uint64_t number
    int64_t monotonic_ns
    int64_t measured_monotonic_ns
    uint64_t motion_id
    double path_time_s
    double path_rate
    uint64_t session
    uint32_t overruns
    uint32_t note
    uint32_t interventions
    uint32_t phases_ns[PHASES]
    uint8_t mode
    uint8_t motion_result
    uint8_t settled
    uint8_t fresh


cdef class CycleRecorder:
    cdef Ring _fresh, _notes
    cdef int _dof, _kinds
    cdef object _record, _note, _counts
    cdef char* _c_record
    cdef RecordHead* _head
    cdef double* _exact  # measured position, commanded position
    cdef float* _single  # the rest of what is measured, commanded velocity, TCP
    cdef uint64_t* _counted_before  # a number for each kind of intervention
    cdef str _reason
    cdef long long _counted

    # Note why the mode is what it is, and what the safety layer counted; to be called in each cycle.
    cdef void c_heed(self, Safety safety, str reason, int mode, uint64_t cycle, int64_t now_ns) except *
    # Write the record of a cycle.
    #     measured_values: as `rtloop.backends.Measured.values`, 5 dof + 12 numbers
    #     command: 3 dof numbers: rad, rad/s, rad/s²
    #     tcp: 7 numbers
    cdef void c_record(
        self,
        const StateScalars* state,
        const double* measured_values,
        const double* command,
        const double* tcp,
        const long long* phases_ns,
        bint fresh,
    ) noexcept nogil
