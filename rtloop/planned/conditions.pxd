from cobot.robot.chain cimport Chain


cdef class CycleCondition:
    cdef readonly bint active
    cdef readonly double value  # value at the last evaluation
    cdef int _quantity, _joint, _dof
    cdef bint _edge, _in_tool, _directed, _zeroed, _outside
    cdef double _low, _high, _from_s, _to_s
    cdef double _direction[3]
    cdef double _zero[6]
    cdef Chain _chain
    cdef object _read, _name, _record

    cdef bint c_watches(self, double path_time_s) noexcept nogil
    cdef bint c_holds(self, const double* measured) except -1
    cdef void c_relative(self, const double* measured, double* wrench6) noexcept nogil
    cdef void _take_zero(self, const double* measured) noexcept nogil
    cdef double _amount(self, const double* measured) noexcept nogil
