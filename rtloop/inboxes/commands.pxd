from libc.stdint cimport int64_t, uint64_t

from cobot.ipc.seqlock cimport SharedCounter
from rtloop.inboxes.stream cimport Inbox

cdef enum Request:  # bits of the result of `c_poll_requests`
    STOP = 1
    ESTOP = 2
    FAST = 4


cdef class CommandInbox:
    cdef Inbox _requests
    cdef Inbox _heartbeat
    cdef Inbox _head
    cdef SharedCounter _outside_stops
    cdef SharedCounter _outside_estops
    cdef list _commands
    cdef list _acks
    cdef readonly unsigned long long stops
    cdef readonly unsigned long long estops
    cdef readonly unsigned long long command_seen
    # number of torn reads of commands, including those counted by an earlier rtloop
    cdef unsigned long long _torn
    cdef long long _beat_ns
    cdef unsigned long long _newest
    cdef int _unreadable
    cdef uint64_t _service_stops  # the service's count of stops, from its last readable block
    cdef uint64_t _service_estops
    cdef uint64_t* _counted_stops
    cdef uint64_t* _counted_estops
    cdef uint64_t* _counted_fast
    cdef uint64_t _fast  # number of stops of category 1
    cdef int64_t* _beat
    cdef uint64_t* _newest_id

    cdef int c_poll_requests(self) noexcept nogil
    cdef double c_service_silence_s(self, long long now_ns) noexcept nogil
    cdef bint c_has_command(self) noexcept nogil
    cdef unsigned long long c_torn_reads(self) noexcept nogil
