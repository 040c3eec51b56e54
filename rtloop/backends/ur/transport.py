"""Byte streams to and from the controller. Only `wait` waits."""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import struct
from collections.abc import Sequence
from typing import Protocol

READ_BYTES = 65_536
RESET_AT_CLOSE = struct.pack("ii", 1, 0)
"""`linger` of socket(7): on, 0 s."""
STARTED = (0, errno.EINPROGRESS)


class ByteStream(Protocol):
    """A connection.

    Attributes:
        local: address of this end.
    """

    @property
    def local(self) -> str: ...

    def is_connected(self) -> bool:
        """Whether the connection is established. Raises OSError if it was refused."""
        ...

    def receive(self) -> bytes:
        """Return the bytes that have arrived; b"" if there are none. Raises ConnectionError if the other end
        has closed the connection.
        """
        ...

    def send(self, data: bytes) -> None:
        """Send bytes. Raises ConnectionError if the connection is closed or the other end does not read."""
        ...

    def close(self) -> None: ...

    def abort(self) -> None:
        """Close a lost connection. Data that has not arrived yet will not be delivered."""
        ...


class ByteListener(Protocol):
    """Attributes: port: the port that it listens on."""

    @property
    def port(self) -> int: ...

    def accept(self) -> ByteStream | None:
        """Return the next connection; None if there is none."""
        ...

    def close(self) -> None: ...


class UrTransport(Protocol):
    """The network to a controller, and the clock of this connection."""

    def clock(self) -> float: ...

    def connect(self, host: str, port: int) -> ByteStream:
        """Begin to connect. Raises OSError if there is no such host or no route to it."""
        ...

    def listen(self, port: int) -> ByteListener:
        """Listen on a port. Raises OSError if another program is using it."""
        ...

    def wait(self, streams: Sequence[ByteStream], timeout_s: float) -> None:
        """Wait until one of the streams has data to receive, or the timeout has passed."""
        ...


class TcpStream:
    def __init__(self, made: socket.socket, connected: bool) -> None:
        self.socket, self._connected = made, connected
        made.setblocking(False)
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def local(self) -> str:
        address: str = self.socket.getsockname()[0]
        return address

    def is_connected(self) -> bool:
        if not self._connected:
            poll = select.poll()
            poll.register(self.socket, select.POLLOUT)
            if not poll.poll(0):
                return False
            error = self.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if error:
                raise OSError(error, errno.errorcode.get(error, ""))
            self._connected = True
        return True

    def receive(self) -> bytes:
        try:
            received = self.socket.recv(READ_BYTES)
        except BlockingIOError:
            return b""
        if not received:
            raise ConnectionResetError("the other end has closed the connection")
        return received

    def send(self, data: bytes) -> None:
        try:
            sent = self.socket.send(data)
        except BlockingIOError:
            sent = 0
        if sent < len(data):
            raise ConnectionAbortedError("the other end does not read the data")

    def close(self) -> None:
        self.socket.close()

    def abort(self) -> None:
        with contextlib.suppress(OSError):
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET_AT_CLOSE)
        self.socket.close()


class TcpListener:
    def __init__(self, port: int) -> None:
        self._socket = socket.create_server(("0.0.0.0", port))
        self._socket.setblocking(False)

    @property
    def port(self) -> int:
        port: int = self._socket.getsockname()[1]
        return port

    def accept(self) -> ByteStream | None:
        try:
            made, _ = self._socket.accept()
        except BlockingIOError:
            return None
        return TcpStream(made, True)

    def close(self) -> None:
        self._socket.close()


class TcpTransport:
    """TCP connections of this computer."""

    def __init__(self) -> None:
        import time

        self.clock = time.monotonic
        self._hosts: dict[str, tuple[socket.AddressFamily, str]] = {}

    def connect(self, host: str, port: int) -> ByteStream:
        if host not in self._hosts:  # only once, because it can take seconds and is called in the cycle
            ((found, _, _, _, place), *_) = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            self._hosts[host] = found, str(place[0])
        family, address = self._hosts[host]
        made = socket.socket(family, socket.SOCK_STREAM)
        stream = TcpStream(made, False)
        error = made.connect_ex((address, port))
        if error not in STARTED:
            made.close()
            raise OSError(error, errno.errorcode.get(error, ""))
        return stream

    def listen(self, port: int) -> ByteListener:
        return TcpListener(port)

    def wait(self, streams: Sequence[ByteStream], timeout_s: float) -> None:
        poll = select.poll()
        for stream in streams:
            if isinstance(stream, TcpStream):
                with contextlib.suppress(ValueError):  # the stream is closed
                    poll.register(stream.socket, select.POLLIN)
        poll.poll(max(1e3 * timeout_s, 0.0))
