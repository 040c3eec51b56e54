cdef enum:
    MEASURED_ROWS = 5


cdef class Measured:
    cdef int dof
    cdef double* c_values  # 5 dof + 12
    cdef readonly object values, joints
    cdef readonly object position, velocity, effort, desired_effort, external_effort
    cdef readonly object wrench, external, sensor


cdef class CompiledBackend:
    cdef int _dof
    cdef bint read_in_python, write_in_python
    cdef double* _values_of(self, Measured measured) except NULL
    cdef int c_read(self, double* values) noexcept nogil
    cdef int c_write(self, const double* command) noexcept nogil
