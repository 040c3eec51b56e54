"""The signals that a supervisor is sent, and its sleep, which they end."""

from __future__ import annotations

import contextlib
import selectors
import signal
import socket
from collections.abc import Iterator
from types import FrameType


class ProcessSignals:
    """SIGTERM and SIGINT end the supervisor, SIGHUP is for its service.

    What a handler sets is no `threading.Event`: the next signal may interrupt it in the middle of that, and
    would wait for itself, for ever.

    Attributes:
        stopping: it is time to stop.
        hangup: SIGHUP has come.
    """

    def __init__(self) -> None:
        self.stopping = False
        self.hangup = False
        self._wake: socket.socket | None = None

    @contextlib.contextmanager
    def catch(self) -> Iterator[None]:
        """They end a sleep while the context lasts. The handlers stay: nothing interrupts the end."""
        wake, written = socket.socketpair()
        with wake, written:
            written.setblocking(False)
            self._wake = wake
            signal.set_wakeup_fd(written.fileno())
            for number in (signal.SIGTERM, signal.SIGINT):
                signal.signal(number, self._stop)
            signal.signal(signal.SIGHUP, self._hang_up)
            signal.signal(signal.SIGCHLD, lambda number, frame: None)  # only to wake the loop
            try:
                yield
            finally:
                signal.set_wakeup_fd(-1)
                self._wake = None

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.stopping = True

    def _hang_up(self, number: int, frame: FrameType | None) -> None:
        self.hangup = True

    def sleep(self, seconds: float) -> None:
        """Wait until a signal comes, a child ends, or the time is over."""
        assert self._wake is not None
        with selectors.PollSelector() as selector:  # it needs no descriptor, of which there may be none
            selector.register(self._wake, selectors.EVENT_READ)
            if selector.select(seconds):
                self._wake.recv(4096)
