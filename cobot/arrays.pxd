cdef enum:
    # Maximum number of joints of a robot. Code that runs in a cycle keeps them in arrays of this fixed size.
    MAX_DOF = 16

cdef double* doubles(object array, Py_ssize_t size) except NULL
cdef char* bytes_of(object buffer, Py_ssize_t size) except NULL
cdef int checked_dof(Py_ssize_t dof) except -1
