"""A TCP relay with the faults of a bad network: delay, a limited rate, and stalls.

The kernel of a test computer may not have netem. Over TCP, loss is not seen as missing bytes, but as stalls:
all bytes wait until the lost packet has been sent again, and then arrive at once.
"""

from __future__ import annotations

import contextlib
import random
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass

CHUNK = 1400
"""Number of bytes that are passed on at once, about a packet."""


@dataclass(frozen=True)
class Faults:
    """The faults of each direction.

    Attributes:
        delay_s: time from the arrival of bytes to their departure.
        rate: bytes per second; 0 for no limit.
        loss: share of packets that are lost, each of which stalls all that follows.
        stall_s: time until a lost packet has been sent again.
    """

    delay_s: float = 0.0
    rate: float = 0.0
    loss: float = 0.0
    stall_s: float = 0.2


class SlowRelay:
    """Passes bytes between its own port and a target, with faults that may be changed at any time.

    Attributes:
        port: where it listens, chosen by the system.
        faults: of both directions.
        stalls: number of packets that were lost.
    """

    def __init__(self, target_port: int, faults: Faults = Faults(), seed: int = 1) -> None:
        self.faults, self.stalls = faults, 0
        self._target = ("127.0.0.1", target_port)
        self._random = random.Random(seed)
        self._sockets: list[socket.socket] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        for each in (self._server, *self._sockets):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # it was closed
            while True:
                client, _ = self._server.accept()
                try:
                    target = socket.create_connection(self._target)
                except OSError:
                    client.close()
                    continue
                for each in (client, target):
                    # As little as a router has: what does not fit waits at the sender.
                    each.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 32 * 1024)
                    each.setsockopt(socket.SOL_TCP, socket.TCP_NODELAY, 1)
                self._sockets += [client, target]
                _Direction(self, client, target)
                _Direction(self, target, client)

    def hold_s(self) -> float:
        """How long the next packet is stalled."""
        if self._random.random() >= self.faults.loss:
            return 0.0
        self.stalls += 1
        return self.faults.stall_s


class _Direction:
    """Bytes one way: read at once, sent when they are due."""

    def __init__(self, relay: SlowRelay, source: socket.socket, drain: socket.socket) -> None:
        self._relay, self._source, self._drain = relay, source, drain
        self._due: deque[tuple[float, bytes]] = deque()
        self._changed = threading.Condition()
        for work in (self._read, self._send):
            threading.Thread(target=work, daemon=True).start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while content := self._source.recv(CHUNK):
                with self._changed:
                    # A queue of a second at most: then the sender waits, as at a router without bufferbloat.
                    rate = self._relay.faults.rate
                    room = max(8, int(rate / CHUNK)) if rate else 10_000
                    self._changed.wait_for(lambda room=room: len(self._due) < room)  # type: ignore[misc]
                    self._due.append((time.monotonic() + self._relay.faults.delay_s, content))
                    self._changed.notify_all()
        with self._changed:
            self._due.append((0.0, b""))
            self._changed.notify_all()

    def _send(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                with self._changed:
                    self._changed.wait_for(lambda: self._due)
                    due_s, content = self._due.popleft()
                    self._changed.notify_all()
                if not content:
                    break
                time.sleep(max(0.0, due_s - time.monotonic()) + self._relay.hold_s())
                self._drain.sendall(content)
                if self._relay.faults.rate:
                    time.sleep(len(content) / self._relay.faults.rate)
        for each in (self._source, self._drain):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
