from libc.stdint cimport uint64_t

from cobot.ipc.seqlock cimport Block


cdef class Inbox:
    cdef Block block
    cdef uint64_t _sequence  # sequence of the content of `data`
    cdef readonly bint readable
    cdef readonly long long torn_reads

    cdef int c_look(self) noexcept nogil  # 1: new data; 0: none; -1: it could not be read
    cdef bint c_take_news(self) noexcept nogil


cdef class StreamInbox:
    cdef readonly Inbox session
    cdef readonly Inbox setpoint
    cdef readonly Inbox chunk
    cdef Inbox _requests
    cdef Block _ack
    cdef readonly unsigned long long session_seen
    cdef uint64_t _estops
    cdef uint64_t* _number
    cdef uint64_t* _open
    cdef uint64_t* _counted_estops

    cdef bint c_asks(self) noexcept nogil
    cdef bint c_wants(self, unsigned long long number) noexcept nogil
    cdef bint c_finishes(self) noexcept nogil
    cdef bint c_take_estop(self) noexcept nogil
    cdef long long c_torn_reads(self) noexcept nogil
