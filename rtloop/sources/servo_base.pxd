"""The common base of all servo modes: a source that fetches its points itself."""

from cobot.arrays cimport MAX_DOF
from rtloop.inboxes.point_queue cimport PointQueue, ServoPoint
from rtloop.sources.source cimport Source

cdef enum:
    MAX_POINTS = 8  # Maximum number of points that a cycle reads.


cdef class ServoSource(Source):
    cdef readonly long long taken
    cdef readonly long long dropped
    cdef readonly long long underruns
    cdef double period_s, time_s
    cdef double lowest[MAX_DOF]
    cdef double highest[MAX_DOF]
    cdef double safe_velocity[MAX_DOF]
    cdef double last[MAX_DOF]
    cdef double target[MAX_DOF]
    cdef bint waits

    cdef int c_fetch(self, PointQueue queue) noexcept nogil
    cdef long long c_buffered(self) noexcept nogil
    cdef bint c_read(self, const ServoPoint* point) noexcept nogil
    cdef bint c_jumps(self, double interval_s) noexcept nogil
