"""Requests and commands from the service to rtloop, through shared memory."""

from libc.stdint cimport uint64_t

from cobot.ipc.seqlock cimport Block
from rtloop.inboxes.stream cimport Inbox

from cobot.ipc.layout import RING, Ack
from cobot.ipc.shm import encoded
from rtloop.results import Accepted, Rejected

UNREADABLE_CYCLES = 100
"""Number of attempts to read a command after which it is dropped. Its writer must have died while writing
it.
"""

# No clock reaches this value, and differences of smaller values cannot overflow.
cdef long long FAR_NS = 1LL << 62


cdef class CommandInbox:
    """Reads requests, the heartbeat and commands. Takes almost no time while they do not change.

    Real-time safe. An inconsistent (torn) read is counted and repeated in the next cycle.

    Attributes:
        stops, estops: numbers of requested stops and e-stops read so far, from the service and from outside.
        command_seen: number of the last command that was read.
        torn_reads: number of inconsistent reads.
    """

    def __init__(self, memory):
        self._requests = Inbox(memory.requests)
        self._heartbeat = Inbox(memory.heartbeat)
        self._head = Inbox(memory.head)
        self._commands = memory.commands
        self._acks = memory.acks
        self._counted_stops = self._requests.block.c_unsigned("stops")
        self._counted_estops = self._requests.block.c_unsigned("estops")
        self._counted_fast = self._requests.block.c_unsigned("fast_stops")
        self._beat = self._heartbeat.block.c_signed("monotonic_ns")
        self._newest_id = self._head.block.c_unsigned("id")
        last = memory.state.data
        self.stops = int(last["stops_seen"])
        self.estops = int(last["estops_seen"])
        self.command_seen = int(last["command_seen"])
        self._torn = int(last["torn_reads"])
        self._fast = self._counted_fast[0] if self._requests.block.c_try_read() else 0
        self._outside_stops, self._outside_estops = memory.outside_stops, memory.outside_estops
        # Until the service's counters can be read, they are assumed to be unchanged.
        self._service_stops = self.stops - self._outside_stops.c_value()
        self._service_estops = self.estops - self._outside_estops.c_value()

    @property
    def torn_reads(self):
        return self.c_torn_reads()

    def poll_requests(self):
        """Return whether a stop and whether an e-stop has been requested since the last call."""
        cdef int asked = self.c_poll_requests()
        return bool(asked & STOP), bool(asked & ESTOP)

    def service_silence_s(self, long long now_ns):
        """Return the time since the service's last heartbeat, s."""
        return self.c_service_silence_s(now_ns)

    def next_command(self):
        """Return the next command, or None. The same command is returned until it is acknowledged."""
        if not self.c_has_command():
            return None
        number = max(self.command_seen + 1, int(self._newest) - RING + 1)
        cdef Block block = self._commands[number % RING]
        if block.c_try_read() and int(block.data["id"]) == number:
            self._unreadable = 0
            return block.data
        self._torn += 1
        self._unreadable += 1
        if self._unreadable > UNREADABLE_CYCLES:
            self._unreadable = 0
            self.acknowledge(number, Ack.REJECTED, "the command could not be read")
        return None

    def refuse_pending(self, reason):
        """Reject a command that was sent to an earlier rtloop, which has died, because it was based on the
        arm's position at that time.
        """
        if self._head.block.c_try_read():
            newest = int(self._newest_id[0])
            for number in range(max(self.command_seen + 1, newest - RING + 1), newest + 1):
                self.acknowledge(number, Ack.REJECTED, reason)

    def acknowledge(self, number, result, message=""):
        """Answer a command."""
        self.command_seen = number
        cdef Block ack = self._acks[number % RING]
        ack.data["id"] = number
        ack.data["result"] = result
        ack.data["message"] = encoded(message)
        ack.c_publish()

    def answer(self, number, result):
        """Acknowledge a command with its result. If the result is `Later`, no acknowledgement is sent yet."""
        if isinstance(result, Rejected):
            self.acknowledge(number, Ack.REJECTED, result.reason)
        elif isinstance(result, Accepted):
            self.acknowledge(number, Ack.ACCEPTED)

    cdef int c_poll_requests(self) noexcept nogil:
        cdef int asked = 0
        cdef uint64_t stops, estops, fast
        if self._requests.c_take_news():
            # If its counters were damaged, a service counts fast stops from 0 again. These are not new stops.
            fast = self._counted_fast[0] - self._fast
            if 0 < fast <= self._counted_stops[0] - self._service_stops:
                asked |= FAST
            self._fast = self._counted_fast[0]
            self._service_stops, self._service_estops = self._counted_stops[0], self._counted_estops[0]
        stops = self._service_stops + self._outside_stops.c_value()
        estops = self._service_estops + self._outside_estops.c_value()
        if stops != self.stops:
            asked |= STOP
        if estops != self.estops:
            asked |= ESTOP
        self.stops, self.estops = stops, estops
        return asked

    cdef double c_service_silence_s(self, long long now_ns) noexcept nogil:
        if self._heartbeat.c_take_news():
            self._beat_ns = self._beat[0]
        if -FAR_NS < self._beat_ns < FAR_NS:
            return <double>(now_ns - self._beat_ns) * 1e-9
        return (<double>now_ns - <double>self._beat_ns) * 1e-9  # a faulty writer's value may be anything

    cdef bint c_has_command(self) noexcept nogil:
        cdef int news = self._head.c_look()
        if news < 0:
            return False
        if news:
            self._newest = self._newest_id[0]
        return self._newest > self.command_seen

    cdef unsigned long long c_torn_reads(self) noexcept nogil:
        return (
            self._torn
            + <unsigned long long>self._requests.torn_reads
            + <unsigned long long>self._heartbeat.torn_reads
            + <unsigned long long>self._head.torn_reads
        )
