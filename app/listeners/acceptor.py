"""Accepts connections: a few at a time, and no more than the available file descriptors permit."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import os
import resource
import socket
import ssl
from collections.abc import Callable
from typing import Any

from app.listeners.crowd import Crowd, Visit
from app.listeners.refusals import PLAIN, RECEIVE_BYTES, turn_away
from cobot.config import ConnectionLimits

BACKLOG = 1024
"""Maximum number of connections that wait to be accepted."""
AT_ONCE = 32
"""Maximum number of connections that are accepted in one iteration of the event loop."""
SHARE = 1 / 8
"""Maximum number of connections per iteration, as a share of the connections that one address may have."""
HANDSHAKES_AT_ONCE = 4
"""Maximum number of TLS connections that are accepted in one iteration. Each requires a signature, which
takes about a millisecond.
"""
GRACE_S = 0.02
"""Time for a new connection to send its request when few places are free, s. It also limits the rate at which
connections are accepted; the others wait in the kernel's queue.
"""
SPARE_DESCRIPTORS = 64
"""Number of file descriptors that stay free for files, planning processes and sequences that are opened
later.
"""
MIN_PLACES = 8
EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
PAUSE_S = 0.05
"""Time until the next attempt to accept if the system has no resources for another connection, s."""
LOOK_S, LOOK_AGAIN_S = 0.5, 0.02
"""Interval between checks of deadlines, s, and the shorter interval if a check has left expired connections
open.
"""
UNREAD_S = 10.0
"""Time after which a connection whose client reads nothing is closed, s."""
TCP_CLOSE, TCP_CLOSE_WAIT = 7, 8
"""Linux's numbers for two states of a connection, in the first byte of its TCP_INFO."""

log = logging.getLogger("cobot.service")


def crowd_for(limits: ConnectionLimits) -> Crowd:
    """Create a crowd with as many places as configured, or fewer if the system grants fewer file
    descriptors.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
            soft = hard
    granted = soft - len(os.listdir("/proc/self/fd")) - SPARE_DESCRIPTORS - AT_ONCE - limits.reserve
    places = limits.connections if soft == resource.RLIM_INFINITY else min(limits.connections, granted)
    if places < limits.connections:
        places = max(places, MIN_PLACES)
        log.warning(
            "at most %d connections, not %d (web.limits.connections): ulimit -n allows %d file descriptors",
            places,
            limits.connections,
            soft,
        )
    return Crowd(places, limits.connections_per_address, limits.reserve)


class Acceptor:
    """A listening socket. Each accepted connection gets a place in a `Crowd`."""

    def __init__(
        self,
        listener: socket.socket,
        crowd: Crowd,
        protocol: Callable[[Visit], asyncio.Protocol],
        context: ssl.SSLContext | None,
        handshake_timeout_s: float,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._listener = listener
        self._crowd = crowd
        self._protocol = protocol
        self._tls: dict[str, Any] = {}
        if context is not None:
            self._tls = {"ssl": context, "ssl_handshake_timeout": handshake_timeout_s}
        self._credit, self._credited_s = 0.0, self._loop.time()
        self._pausing: asyncio.TimerHandle | None = None
        self._greeting: set[asyncio.Task[None]] = set()
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(1000 * UNREAD_S))
        listener.listen(BACKLOG)
        self._timer = self._loop.call_later(LOOK_S, self._look)
        self._loop.add_reader(listener, self._accept)

    def close(self) -> None:
        self._loop.remove_reader(self._listener)
        self._timer.cancel()
        if self._pausing is not None:
            self._pausing.cancel()

    async def wait_closed(self) -> None:
        """Return at once. asyncio's server interface requires this method, but connections end on their
        own.
        """

    def _look(self) -> None:
        more = self._crowd.expire(self._loop.time())
        self._timer = self._loop.call_later(LOOK_AGAIN_S if more else LOOK_S, self._look)

    def _accept(self) -> None:
        now_s = self._loop.time()
        for _ in range(self._admit()):
            if self._crowd.would_evict_recent(now_s, GRACE_S):
                self._pause(GRACE_S * SHARE)
                return
            try:
                connection, (address, *_) = self._listener.accept()
            except BlockingIOError:
                return
            except OSError as exc:
                if exc.errno in EXHAUSTED:
                    self._crowd.make_room(now_s)
                    self._pause(PAUSE_S)
                    return
                continue  # the client has disconnected again
            self._greet(connection, address)

    def _greet(self, connection: socket.socket, address: str) -> None:
        task: asyncio.Task[None]

        def close() -> None:
            """Close a new connection that has no protocol yet, without an answer if it uses TLS, because
            there was no handshake.
            """
            if not self._tls:
                turn_away(connection)
            task.cancel()

        visit = self._crowd.enter(address, close, self._loop.time())
        if visit is None:
            if not self._tls:
                turn_away(connection)
            connection.close()
            return
        task = self._loop.create_task(self._connect(connection, visit))
        self._greeting.add(task)

        def end_greeting(done: asyncio.Task[None]) -> None:
            self._greeting.discard(done)
            if done.cancelled():  # cancelled, possibly before `_connect` has begun
                self._crowd.leave(visit)
                connection.close()

        task.add_done_callback(end_greeting)

    async def _connect(self, connection: socket.socket, visit: Visit) -> None:
        """Pass a connection to the protocol, after the TLS handshake if TLS is used."""
        try:
            connection.setblocking(False)
            if self._tls:
                await self._await_handshake(connection)
            await self._loop.connect_accepted_socket(lambda: self._protocol(visit), connection, **self._tls)
        except BaseException as exc:
            self._crowd.leave(visit)
            connection.close()
            if not isinstance(exc, OSError):  # including errors of TLS
                raise

    async def _await_handshake(self, connection: socket.socket) -> None:
        """Wait for the first byte. A client that speaks HTTP without TLS gets an answer.

        Raises:
            OSError: the client does not begin a handshake.
        """
        ready = asyncio.Event()
        self._loop.add_reader(connection, ready.set)
        try:
            await asyncio.wait_for(ready.wait(), self._tls["ssl_handshake_timeout"])
        finally:
            self._loop.remove_reader(connection)
        if connection.recv(1, socket.MSG_PEEK).isalpha():  # the first letter of a method
            turn_away(connection, PLAIN)
            raise ConnectionAbortedError
        if has_gone(connection):
            raise ConnectionResetError

    def _admit(self) -> int:
        """Return the number of connections that may be accepted now."""
        most = max(1.0, min(HANDSHAKES_AT_ONCE if self._tls else AT_ONCE, SHARE * self._crowd.per_address))
        now_s = self._loop.time()
        self._credit += (now_s - self._credited_s) * self._crowd.per_address / GRACE_S
        self._credit, self._credited_s = min(self._credit, most), now_s
        if len(self._crowd) < self._crowd.per_address:
            return int(most)
        admitted = int(self._credit)
        self._credit -= admitted
        if not admitted:
            self._pause(GRACE_S * SHARE)
        return admitted

    def _pause(self, duration_s: float) -> None:
        """Stop accepting connections for a time. Otherwise the waiting clients would keep the socket
        readable, and the event loop busy.
        """
        self._loop.remove_reader(self._listener)
        self._pausing = self._loop.call_later(duration_s, self._loop.add_reader, self._listener, self._accept)


def has_gone(connection: socket.socket) -> bool:
    """Whether the client has already closed the connection, which makes a handshake useless."""
    return connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0] in (TCP_CLOSE, TCP_CLOSE_WAIT)
