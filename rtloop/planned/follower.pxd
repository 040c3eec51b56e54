from rtloop.planned.path cimport Path
from rtloop.planned.path_clock cimport PathClock
from rtloop.safety.fence cimport Watch


cdef enum Way:
    # The progress on the path.
    UNDER_WAY = 0
    DONE = 1  # At the end, or at rest after a stop.
    NO_ROOM = 2  # The path has no room left to stop on it.


cdef class PathFollower:
    cdef readonly Path path
    cdef readonly PathClock clock
    cdef readonly Watch watch
    cdef bint left
    cdef bint by_itself
    cdef object _mover, _rows
    cdef double* _desired
    cdef int _dof

    cdef Way c_follow(self, bint stopping) noexcept nogil
    cdef Way follow_device(self) except *
    cdef bint c_leaves_fence(self, double* place4) noexcept nogil
