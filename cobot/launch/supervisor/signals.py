"""Signals to the supervisor, and a sleep that a signal interrupts."""

from __future__ import annotations

import contextlib
import selectors
import signal
import socket
from collections.abc import Iterator
from types import FrameType


class ProcessSignals:
    """Handlers: SIGTERM and SIGINT end the supervisor, SIGHUP makes the service read its configuration again.

    The handlers set plain attributes and no `threading.Event`. Otherwise a second signal could interrupt the
    event's `set`, and then wait for ever for the lock of that event.

    Attributes:
        stopping: whether the supervisor must stop.
        hangup: whether SIGHUP has been received.
    """

    def __init__(self) -> None:
        self.stopping = False
        self.hangup = False
        self._wake: socket.socket | None = None

    @contextlib.contextmanager
    def catch(self) -> Iterator[None]:
        """Context manager that installs the signal handlers. Inside the context, a signal ends a sleep. The
        handlers stay installed after the context ends, so that no signal interrupts the shutdown.
        """
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
        """Wait until a signal arrives, a child ends, or the time has elapsed."""
        assert self._wake is not None
        with selectors.PollSelector() as selector:  # this needs no descriptor; there may be none left
            selector.register(self._wake, selectors.EVENT_READ)
            if selector.select(seconds):
                self._wake.recv(4096)
