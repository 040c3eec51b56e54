from libc.stdint cimport uint64_t

from cobot.arrays cimport MAX_DOF
from cobot.ipc.seqlock cimport Block, Mapped
from rtloop.inboxes.stream cimport Inbox

cdef struct ServoPoint:  # see `cobot.ipc.layout.point_dtype`
    double time_s
    double lookahead_s
    double gain
    double joints[MAX_DOF]  # rad


cdef class PointQueue:
    cdef Inbox _head
    cdef list _points
    cdef Block _point  # private copy of the last point read
    cdef Mapped* _places  # locations of the ring's points, all with `_point` as their private copy
    cdef int _dof
    cdef unsigned long long _session
    cdef readonly unsigned long long newest
    cdef readonly unsigned long long seen
    cdef readonly unsigned long long lost
    cdef long long _torn
    cdef int _unreadable
    cdef uint64_t* _head_session
    cdef uint64_t* _head_number
    cdef uint64_t* _number
    cdef double* _time_s
    cdef double* _lookahead_s
    cdef double* _gain
    cdef double* _joints

    cdef int _take_places(self) except -1
    cdef bint _next(self) noexcept nogil
    cdef bint c_poll(self) noexcept nogil
    cdef bint c_next(self, ServoPoint* out) noexcept nogil
    cdef long long c_waiting(self) noexcept nogil
    cdef long long c_torn_reads(self) noexcept nogil
