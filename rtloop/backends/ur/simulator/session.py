"""The interface of a session with one client of a simulated controller: it processes received bytes and
provides bytes to send.
"""

from __future__ import annotations

from typing import Protocol


class UrSession(Protocol):
    """
    Attributes:
        out: bytes to send to the client; the network removes them.
        is_over: whether to close the connection after sending them.
    """

    out: bytearray
    is_over: bool

    def feed(self, received: bytes) -> None:
        """Process bytes from the client, valid or not."""
        ...

    def tick(self) -> None:
        """Handle the end of a control period."""
        ...

    def close(self) -> None:
        """End the session after the client has disconnected."""
        ...
