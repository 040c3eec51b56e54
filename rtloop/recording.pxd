from libc.stdint cimport int64_t, uint8_t, uint32_t, uint64_t

from cobot.ipc.ring cimport Ring
from rtloop.safety.limiter cimport Safety

cdef enum:
    PHASES = 4

    MAX_COPIES = 64

cdef enum CopyKind:
    COPY_WORDS  # 8 bytes each, unchanged
    COPY_SINGLES  # double to float
    COPY_UINT32  # of a uint64
    COPY_UINT8

cdef struct FieldCopy:  # a field of the state block that is recorded
    CopyKind kind
    Py_ssize_t source, target  # offsets in bytes
    int count


cdef class CycleRecorder:
    cdef Ring _fresh, _notes
    cdef int _kinds
    cdef object _record, _note, _counts
    cdef char* _c_record
    cdef FieldCopy _copies[MAX_COPIES]
    cdef int _copied
    cdef Py_ssize_t _cycle_at  # offset of the state's `cycle`
    cdef uint64_t* _number
    # Fields of the record that are not in the state block.
    cdef uint32_t* _note_number
    cdef uint32_t* _interventions
    cdef uint32_t* _phases_ns
    cdef uint8_t* _is_fresh
    cdef uint64_t* _counted_before  # last count of each kind of intervention
    cdef object _reason
    cdef long long _counted

    # Record changes of the mode's reason and of the safety layer's counts. Call this in each cycle.
    cdef void c_heed(self, Safety safety, object reason, int mode, uint64_t cycle, int64_t now_ns) except *
    # Write a cycle record. state: a record of `cobot.ipc.state_fields.state_dtype`
    cdef void c_record(self, const char* state, const long long* phases_ns, bint fresh) noexcept nogil
