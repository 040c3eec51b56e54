"""Reads the points of a servo session, in the order in which the service has written them to shared
memory.
"""

from libc.stdint cimport uint64_t
from libc.stdlib cimport calloc, free
from libc.string cimport memcpy

from cobot.arrays cimport checked_dof
from cobot.ipc.seqlock cimport Block, try_read
from rtloop.inboxes.stream cimport Inbox

from cobot.ipc import layout

UNREADABLE_CYCLES = 100
"""Number of attempts to read a point after which it is dropped. Its writer must have died while writing it,
or another writer is out of control.
"""

cdef int _unreadable_cycles = UNREADABLE_CYCLES
cdef uint64_t POINTS = layout.POINTS


cdef class PointQueue:
    """Reads the ring of points. Real-time safe.

    Attributes:
        newest: number of the newest point.
        seen: number of the last read point.
        lost: number of points that could not be read.
        torn_reads: number of inconsistent reads.
    """

    def __init__(self, memory):
        """
        Raises:
            InputError: the robot has more joints than a `ServoPoint`.
        """
        self._dof = checked_dof(memory.dof)
        self._head = Inbox(memory.point_head)
        self._head_session = self._head.block.c_unsigned("session")
        self._head_number = self._head.block.c_unsigned("number")
        self._points = memory.points
        self._take_places()

    def __dealloc__(self):
        free(self._places)

    @property
    def torn_reads(self):
        return self.c_torn_reads()

    @property
    def waiting(self):
        return self.c_waiting()

    def begin(self, unsigned long long session):
        """From now on, read only points of this session."""
        self._session = session
        self.newest = self.seen = self.lost = 0
        self._unreadable = 0

    def poll(self):
        """Return whether there are new points."""
        return self.c_poll()

    def next(self):
        """Return the next point, valid until the next call; None if there is none or it cannot be read
        now.
        """
        return self._point.data if self._next() else None

    cdef bint c_poll(self) noexcept nogil:
        cdef uint64_t newest, room
        cdef bint arrived
        if not self._head.c_take_news() or self._head_session[0] != self._session:
            return False
        newest = self._head_number[0]
        room = self.seen + POINTS
        if newest > room:  # a number beyond the ring's size is from a faulty writer
            newest = room
        arrived = newest > self.newest
        if arrived:
            self.newest = newest
        return arrived

    cdef bint c_next(self, ServoPoint* out) noexcept nogil:
        if not self._next():
            return False
        out.time_s, out.lookahead_s, out.gain = self._time_s[0], self._lookahead_s[0], self._gain[0]
        memcpy(out.joints, self._joints, self._dof * sizeof(double))
        return True

    cdef long long c_waiting(self) noexcept nogil:
        return <long long>(self.newest - self.seen)

    cdef long long c_torn_reads(self) noexcept nogil:
        return self._torn + self._head.torn_reads

    cdef bint _next(self) noexcept nogil:
        """Read the next point into the private copy."""
        cdef uint64_t number = self.seen + 1
        if self.seen >= self.newest:
            return False
        if try_read(&self._places[number % POINTS]) and self._number[0] == number:
            self._unreadable = 0
            self.seen = number
            return True
        self._torn += 1
        self._unreadable += 1
        if self._unreadable > _unreadable_cycles:
            self._unreadable = 0
            self.seen = number
            self.lost += 1
        return False

    cdef int _take_places(self) except -1:
        """Find the locations of the points. All points share one private copy, which stays in the caches."""
        cdef Block first = self._points[0], each
        self._point = Block(bytearray(Block.size(first.data.dtype)), 0, first.data.dtype, "servo point")
        cdef Block own = self._point
        self._number = own.c_unsigned("number")
        self._time_s, self._lookahead_s = own.c_doubles("time_s"), own.c_doubles("lookahead_s")
        self._gain, self._joints = own.c_doubles("gain"), own.c_doubles("joints")
        free(self._places)
        self._places = <Mapped*>calloc(POINTS, sizeof(Mapped))
        if self._places == NULL:
            raise MemoryError("no room for the ring of servo points")
        for index in range(POINTS):
            each = self._points[index]
            self._places[index] = each.mapped
            self._places[index].copy = own.c_data
        return 0
