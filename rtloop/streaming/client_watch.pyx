"""Watches whether the process of a streaming client is alive, according to the kernel."""

import os

from rtloop.results import ACCEPTED, Rejected

cdef extern from "<poll.h>" nogil:
    struct pollfd:
        int fd
        short events
        short revents
    int POLLIN
    int poll(pollfd* asked, unsigned long count, int timeout_ms)


cdef class ClientWatch:
    """Watches one process through a file descriptor for that process, which other processes cannot
    inherit.
    """

    def __init__(self):
        self.descriptor = -1

    def begin(self, pid):
        """Watch a process, or reject one that cannot be watched."""
        try:
            self.descriptor = os.pidfd_open(pid)
        except (OSError, OverflowError) as exc:
            return Rejected(f"the streaming client, process {pid}, cannot be watched: {exc}")
        return ACCEPTED

    def end(self):
        """Stop watching the process."""
        if self.descriptor >= 0:
            os.close(self.descriptor)
            self.descriptor = -1

    def gone(self):
        """Return whether the process has ended. Real-time safe, because the kernel answers at once."""
        return self.c_gone()

    cdef bint c_gone(self) noexcept nogil:
        """Like `gone`, for compiled code."""
        cdef pollfd asked
        asked.fd = self.descriptor
        asked.events = POLLIN
        asked.revents = 0
        return poll(&asked, 1, 0) > 0
