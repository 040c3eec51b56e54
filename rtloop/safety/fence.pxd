from cobot.robot.chain cimport Chain


cdef class Watch:
    cdef readonly object fence  # cobot.motions.fence.Fence, or None
    cdef bint active
    cdef Chain _chain
    cdef double _low[3]
    cdef double _high[3]
    cdef double _speed_m_s

    cdef bint c_beyond(self, const double* rows, double* place4) noexcept nogil
