"""Notifications to systemd about a service: sd_notify, one datagram per message (see sd_notify(3)).

Without systemd, no message is sent.
"""

from __future__ import annotations

import os
import socket
import time

SHARE = 0.3
"""Interval between heartbeats, as a fraction of systemd's timeout."""


class Systemd:
    """The service manager that has started this process, if there is one.

    The variables from the service manager are removed from the environment, because they are not meant for
    the children.
    """

    def __init__(self) -> None:
        address = os.environ.pop("NOTIFY_SOCKET", "")
        microseconds = os.environ.pop("WATCHDOG_USEC", "")
        pid = os.environ.pop("WATCHDOG_PID", "") or str(os.getpid())
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        watched = bool(self._address) and microseconds.isdecimal() and pid == str(os.getpid())
        self._period_s = SHARE * 1e-6 * int(microseconds) if watched else None
        self._next_s = 0.0
        self._is_ready = False

    def report_ready(self, status: str) -> None:
        """Report that the service has started. This may be called again, but the message is sent only
        once.
        """
        if not self._is_ready:
            self._is_ready = self._tell(f"READY=1\nSTATUS={status}")

    def report_stopping(self) -> None:
        self._tell("STOPPING=1")

    def send_heartbeat(self) -> None:
        """Send a heartbeat if one is due. Call this periodically."""
        now_s = time.monotonic()
        if self._period_s is not None and now_s >= self._next_s:
            self._next_s = now_s + self._period_s
            self._tell("WATCHDOG=1")

    def _tell(self, message: str) -> bool:
        """Send a message without waiting for the service manager. Returns whether it was sent."""
        if not self._address:
            return True
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as teller:
            teller.setblocking(False)
            try:
                teller.sendto(message.encode(), self._address)
            except OSError:
                return False
        return True
