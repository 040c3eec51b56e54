"""What all servo modes share: a source that fetches its points itself."""

from rtloop.inboxes.point_queue cimport PointQueue
from rtloop.sources.source cimport Source


cdef class ServoSource(Source):
    cdef readonly long long taken
    cdef readonly long long dropped
    cdef readonly long long underruns

    cdef int c_fetch(self, PointQueue queue) noexcept nogil
    cdef long long c_buffered(self) noexcept nogil
