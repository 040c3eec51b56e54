cdef double* doubles(object array, Py_ssize_t size) except NULL
cdef char* bytes_of(object buffer, Py_ssize_t size) except NULL
