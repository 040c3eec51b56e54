from libc.stdint cimport int64_t, uint64_t


cdef struct Mapped:
    # The location of a record in shared memory, and the private copy of its reader or writer.
    uint64_t* counter
    uint64_t* checksum
    char* shared
    char* copy
    size_t size  # bytes of the record

cdef uint64_t sequence_of(const Mapped* record) noexcept nogil
cdef bint try_read(const Mapped* record) noexcept nogil
cdef void publish(const Mapped* record) noexcept nogil
cdef uint64_t xxh64(const char* at, size_t size) noexcept nogil


cdef class Block:
    cdef readonly str name
    cdef readonly str writer
    cdef readonly object data
    cdef readonly object buffer
    cdef readonly object _head
    cdef readonly object _shared
    cdef Mapped mapped
    cdef char* c_data  # the private copy

    cdef unsigned long long c_sequence(self) noexcept nogil
    cdef bint c_try_read(self) noexcept nogil
    cdef void c_publish(self) noexcept nogil
    # The address of a field in the private copy. The other three also check the field's kind.
    cdef char* c_field(self, str name) except NULL
    cdef uint64_t* c_unsigned(self, str name) except NULL
    cdef int64_t* c_signed(self, str name) except NULL
    cdef double* c_doubles(self, str name) except NULL


cdef class SharedCounter:
    cdef readonly object _shared
    cdef uint64_t* place

    cdef uint64_t c_value(self) noexcept nogil
