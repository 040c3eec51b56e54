"""Requests of a streaming client to rtloop, through shared memory."""

from libc.stdint cimport uint64_t

from cobot.ipc.seqlock cimport Block

from cobot.ipc.layout import Ack
from cobot.ipc.shm import encoded
from rtloop.results import Rejected


cdef class Inbox:
    """A block that another process writes, and that is read when it has changed. Real-time safe.

    Attributes:
        readable: whether `data` is complete; if not, the next cycle tries again.
        torn_reads: number of inconsistent reads.
    """

    def __init__(self, Block block not None):
        self.block = block
        self._sequence = 1  # not yet read, because no complete read has an odd counter
        self.readable = True

    @property
    def data(self):
        return self.block.data

    def take_news(self):
        """Read the block into `data` if it has changed. Returns whether there is new data."""
        return self.c_take_news()

    cdef int c_look(self) noexcept nogil:
        cdef uint64_t sequence = self.block.c_sequence()
        if sequence == self._sequence and not sequence & 1:
            return 0
        self.readable = self.block.c_try_read()
        if not self.readable:
            self.torn_reads += 1
            return -1
        self._sequence = sequence
        return 1

    cdef bint c_take_news(self) noexcept nogil:
        return self.c_look() > 0


cdef class StreamInbox:
    """The blocks of the streaming client. Real-time safe.

    Attributes:
        session, setpoint, chunk: its requests, see `cobot.ipc.layout`.
        session_seen: number of the session that was answered last.
    """

    def __init__(self, memory):
        self.session = Inbox(memory.session)
        self.setpoint = Inbox(memory.setpoint)
        self.chunk = Inbox(memory.chunk)
        self._requests = Inbox(memory.stream_requests)
        self._ack = memory.session_ack
        self._number = self.session.block.c_unsigned("number")
        self._open = self.session.block.c_unsigned("open")
        self._counted_estops = self._requests.block.c_unsigned("estops")
        self._estops = int(memory.stream_requests.salvage()["estops"])
        # A session that is already open was requested from an earlier rtloop, which has died.
        self.session_seen = int(memory.session.salvage()["number"])

    @property
    def torn_reads(self):
        return self.c_torn_reads()

    @property
    def finishes(self):
        """Whether the session must end after its last point."""
        return self.c_finishes()

    def asks(self):
        """Whether a client is requesting a new session, which `session` describes."""
        return self.c_asks()

    def wants(self, unsigned long long number):
        """Whether the client still wants this session. True if its request cannot be read."""
        return self.c_wants(number)

    def take_estop(self):
        """Return whether an e-stop has been requested since the last call."""
        return self.c_take_estop()

    def answer(self, result):
        """Answer the request for a session."""
        self.session_seen = self._number[0]
        self._ack.data["session"] = self.session_seen
        rejected = isinstance(result, Rejected)
        self._ack.data["result"] = Ack.REJECTED if rejected else Ack.ACCEPTED
        self._ack.data["message"] = encoded(result.reason if rejected else "")
        self._ack.publish()

    cdef bint c_asks(self) noexcept nogil:
        return self.session.c_take_news() and self._open[0] == 1 and self._number[0] != self.session_seen

    cdef bint c_wants(self, unsigned long long number) noexcept nogil:
        cdef bint is_open = self._open[0] == 1 or self._open[0] == 2
        return not self.session.readable or (is_open and self._number[0] == number)

    cdef bint c_finishes(self) noexcept nogil:
        return self.session.readable and self._open[0] == 2

    cdef bint c_take_estop(self) noexcept nogil:
        cdef bint asked
        if not self._requests.c_take_news():
            return False
        asked = self._counted_estops[0] != self._estops
        self._estops = self._counted_estops[0]
        return asked

    cdef long long c_torn_reads(self) noexcept nogil:
        return (
            self.session.torn_reads
            + self.setpoint.torn_reads
            + self.chunk.torn_reads
            + self._requests.torn_reads
        )
