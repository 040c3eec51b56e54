from rtloop.planned.path cimport Path


cdef enum Load:
    NO_LOAD = 0
    START = 1  # Begin a motion.
    REPLACEMENT = 2  # Continue the current motion on it.


cdef class Handover:
    cdef readonly unsigned long long motion_id, number
    cdef readonly int slot
    cdef readonly double offset_s
    cdef Path path
    cdef Load load
    cdef object _slots, _model, _loader
