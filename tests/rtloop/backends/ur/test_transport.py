"""The network of a controller. Oracle: the calls of the operating system."""

from __future__ import annotations

import socket
from typing import Any

import pytest

from rtloop.backends.ur.transport import TcpTransport


def test_a_name_is_looked_up_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lookup can take seconds when the name server is gone, and the cycle connects again by itself."""
    look_up, asked = socket.getaddrinfo, list[str]()

    def asking(host: str, *rest: Any, **more: Any) -> Any:
        asked.append(host)
        return look_up(host, *rest, **more)

    monkeypatch.setattr(socket, "getaddrinfo", asking)
    transport = TcpTransport()
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        for _ in range(2):
            stream = transport.connect("127.0.0.1", port)
            transport.wait([stream], 0.1)
            assert stream.is_connected()
            stream.close()
    assert asked == ["127.0.0.1"]
