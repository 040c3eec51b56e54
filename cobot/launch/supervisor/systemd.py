"""What systemd is told of a service: sd_notify, one datagram a message (see sd_notify(3)).

Without systemd, nothing is told to anybody.
"""

from __future__ import annotations

import os
import socket
import time

SHARE = 0.3
"""Of the time that systemd waits for a sign of life: so often one is sent."""


class Systemd:
    """The service manager that has started this process, if one has.

    Its variables are taken out of the environment: they are not for the children.
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

    def ready(self, status: str) -> None:
        """The service has started. To be called again and again; told once."""
        if not self._is_ready:
            self._is_ready = self._tell(f"READY=1\nSTATUS={status}")

    def stopping(self) -> None:
        self._tell("STOPPING=1")

    def alive(self) -> None:
        """To be called again and again; sends as often as is needed."""
        now_s = time.monotonic()
        if self._period_s is not None and now_s >= self._next_s:
            self._next_s = now_s + self._period_s
            self._tell("WATCHDOG=1")

    def _tell(self, message: str) -> bool:
        """Whether it was told; nobody waits for a service manager that does not read."""
        if not self._address:
            return True
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as teller:
            teller.setblocking(False)
            try:
                teller.sendto(message.encode(), self._address)
            except OSError:
                return False
        return True
