"""Accepts connections: some at a time, as many as there are descriptors for."""

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
from cobot.config import ConnectionLimits

BACKLOG = 1024
"""So many connections may wait to be accepted."""
AT_ONCE = 32
"""So many are accepted in one iteration of the event loop, if there are places for `STAYS` times as many."""
STAYS = 8
"""A newcomer is read from some iterations later: so long at least nobody may come for its place."""
SPARE_DESCRIPTORS = 64
"""For files, planning workers and sequences that are opened later."""
LEAST_PLACES = 8
EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
PAUSE_S = 0.05
"""When the system has no room for another connection, it is asked again after this time."""
LOOK_S = 0.5
"""So often deadlines are looked at."""
UNREAD_S = 10.0
"""A connection whose client reads nothing for so long is closed."""
RECEIVE_BYTES = 65536
"""What the kernel keeps of a connection until it is read, which it is whole."""

log = logging.getLogger("cobot.service")


def crowd_for(limits: ConnectionLimits) -> Crowd:
    """As many places as the settings want, or as the system grants descriptors, which it is asked for."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
            soft = hard
    granted = soft - len(os.listdir("/proc/self/fd")) - SPARE_DESCRIPTORS - AT_ONCE - limits.reserve
    places = limits.connections if soft == resource.RLIM_INFINITY else min(limits.connections, granted)
    if places < limits.connections:
        places = max(places, LEAST_PLACES)
        log.warning(
            "room for %d connections, not %d (web.limits.connections): ulimit -n grants %d descriptors",
            places,
            limits.connections,
            soft,
        )
    return Crowd(places, limits.connections_per_address, limits.reserve)


class Acceptor:
    """A listening socket whose connections find their places in a crowd."""

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

    async def wait_closed(self) -> None:
        """Connections end by themselves."""

    def _look(self) -> None:
        self._crowd.expire(self._loop.time())
        self._timer = self._loop.call_later(LOOK_S, self._look)

    def _accept(self) -> None:
        for _ in range(max(1, min(AT_ONCE, self._crowd.per_address // STAYS))):
            try:
                connection, (address, *_) = self._listener.accept()
            except BlockingIOError:
                return
            except OSError as exc:
                if exc.errno in EXHAUSTED:
                    self._pause()
                    return
                continue  # it has gone again
            self._greet(connection, address)

    def _greet(self, connection: socket.socket, address: str) -> None:
        task: asyncio.Task[None]
        visit = self._crowd.enter(address, lambda: task.cancel())
        if visit is None:
            connection.close()
            return
        task = self._loop.create_task(self._connect(connection, visit))
        self._greeting.add(task)
        task.add_done_callback(self._greeting.discard)

    async def _connect(self, connection: socket.socket, visit: Visit) -> None:
        """Have the protocol take over, once TLS, if any, is agreed upon."""
        try:
            connection.setblocking(False)
            await self._loop.connect_accepted_socket(lambda: self._protocol(visit), connection, **self._tls)
        except BaseException as exc:
            self._crowd.leave(visit)
            connection.close()
            if not isinstance(exc, OSError):  # among them those of TLS
                raise

    def _pause(self) -> None:
        """Accept nothing for a moment: the socket would go on to say that somebody waits."""
        self._crowd.make_room()
        self._loop.remove_reader(self._listener)
        self._timer.cancel()
        self._timer = self._loop.call_later(PAUSE_S, self._resume)

    def _resume(self) -> None:
        self._loop.add_reader(self._listener, self._accept)
        self._look()
