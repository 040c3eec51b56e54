"""A TCP proxy on this computer whose connections can be cut, without a change to the network."""

from __future__ import annotations

import contextlib
import socket
import threading


class TcpProxy:
    """Passes bytes between its own port and a target.

    Attributes:
        port: where it listens, chosen by the system.
    """

    def __init__(self, target_port: int) -> None:
        self._target = ("127.0.0.1", target_port)
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._threads: list[threading.Thread] = []
        self._cut = False
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        self._start(self._accept)

    def cut(self) -> None:
        """Break all connections, and accept no other one."""
        self._cut = True
        for pair in self._pairs:
            _break(pair)

    def mend(self) -> None:
        self._cut = False

    def close(self) -> None:
        self.cut()
        self._server.shutdown(socket.SHUT_RDWR)  # wakes its thread
        for thread in self._threads:
            thread.join(10.0)
        for pair in self._pairs:
            for each in pair:
                each.close()
        self._server.close()

    def _start(self, run: object, *arguments: object) -> None:
        thread = threading.Thread(target=run, args=arguments, daemon=True)  # type: ignore[arg-type]
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._server.accept()
            except OSError:  # it was closed
                return
            try:
                target = None if self._cut else socket.create_connection(self._target)
            except OSError:
                target = None
            if target is None:
                client.close()
                continue
            pair = client, target
            self._pairs.append(pair)
            self._start(_pass, client, target)
            self._start(_pass, target, client)


def _pass(source: socket.socket, drain: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while content := source.recv(65536):
            drain.sendall(content)
    _break((source, drain))


def _break(pair: tuple[socket.socket, socket.socket]) -> None:
    for each in pair:
        with contextlib.suppress(OSError):
            each.shutdown(socket.SHUT_RDWR)
