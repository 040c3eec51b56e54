cdef class Measured:
    cdef int dof
    cdef double* c_values  # `count_measured(dof)` numbers, in the order of `cobot.ipc.state_fields.MEASURED`
    cdef dict __dict__  # the fields as arrays, by name
    cdef readonly object values, joints, external


cdef class CompiledBackend:
    cdef int _dof
    cdef bint read_in_python, write_in_python
    cdef double* _values_of(self, Measured measured) except NULL
    cdef int c_read(self, double* values) noexcept nogil
    cdef int c_write(self, const double* command) noexcept nogil
