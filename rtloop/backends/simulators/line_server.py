"""A TCP server for clients on this computer that send one JSON object per line."""

from __future__ import annotations

import json
import socket
from abc import ABC, abstractmethod
from typing import Annotated, Any

from pydantic import Field

from rtloop.backends.simulators.reflexes import MAX_WRENCH

Share = Annotated[float, Field(ge=0.0, le=1.0)]
Exerted = Annotated[float, Field(ge=-MAX_WRENCH, le=MAX_WRENCH)]
"""Type of one component of a wrench in a request, N or N·m."""

MAX_LINE = 65_536
MAX_CLIENTS = 8


class LineServer(ABC):
    """Serves the clients of the control interface between two periods."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_server(("127.0.0.1", port))
        self._socket.setblocking(False)
        self._clients: dict[socket.socket, bytes] = {}

    @property
    def port(self) -> int:
        port: int = self._socket.getsockname()[1]
        return port

    def serve(self) -> None:
        """Answer the requests that have arrived, without waiting for more."""
        try:
            while len(self._clients) < MAX_CLIENTS:
                client, _ = self._socket.accept()
                client.setblocking(False)
                self._clients[client] = b""
        except BlockingIOError:
            pass
        for client in list(self._clients):
            try:
                self._hear(client)
            except OSError:
                self._forget(client)

    def close(self) -> None:
        for client in list(self._clients):
            self._forget(client)
        self._socket.close()

    def _forget(self, client: socket.socket) -> None:
        del self._clients[client]
        client.close()

    def _hear(self, client: socket.socket) -> None:
        try:
            heard = client.recv(MAX_LINE)
        except BlockingIOError:
            return
        if not heard or len(self._clients[client]) > MAX_LINE:
            self._forget(client)
            return
        *lines, rest = (self._clients[client] + heard).split(b"\n")
        self._clients[client] = rest
        for line in lines:
            client.sendall(json.dumps(self.answer(line)).encode() + b"\n")

    @abstractmethod
    def answer(self, line: bytes) -> dict[str, Any]:
        """Execute the request in a line. Returns the state after it, or an error."""
