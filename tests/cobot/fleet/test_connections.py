"""When a hub closes a connection whose request does not come.

Oracle: RFC 9110, 15.5.9: 408 is the status for a request that is not complete in time; raw TCP connections.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest
import uvicorn
from cobot_run import until

from cobot.fleet.connections import HubConnection

REQUEST = b"GET / HTTP/1.1\r\nHost: hub\r\n\r\n"


async def _empty(scope: Any, receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 204, "headers": []})
    await send({"type": "http.response.body"})


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    config = uvicorn.Config(
        _empty, http=HubConnection, lifespan="off", log_config=None, timeout_keep_alive=1, access_log=False
    )
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=server.run, args=([listener],))
        thread.start()
        until(lambda: server.started)
        yield listener.getsockname()
        server.should_exit = True
        thread.join()


def rest(connection: socket.socket) -> bytes:
    """Everything until the hub closes the connection."""
    received = b""
    while piece := connection.recv(65536):
        received += piece
    return received


@pytest.mark.parametrize("begin", [b"", b"G", b"\r\n", REQUEST[:-2]])
def test_a_client_that_owes_a_request_gets_an_error_and_loses_the_connection(
    address: tuple[str, int], begin: bytes
) -> None:
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(begin)
        answer = rest(connection)
    assert answer.startswith(b"HTTP/1.1 408 Request Timeout\r\n")
    assert answer.endswith(b"\r\n\r\nno complete request for 1 s: send it again\n")


def test_the_beginning_of_a_second_request_does_not_keep_the_connection(address: tuple[str, int]) -> None:
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(REQUEST)
        assert connection.recv(65536).startswith(b"HTTP/1.1 204")
        connection.sendall(REQUEST[:-2])
        assert rest(connection).startswith(b"HTTP/1.1 408")


def test_a_connection_that_is_idle_after_an_answer_closes_without_another_answer(
    address: tuple[str, int],
) -> None:
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(REQUEST)
        assert connection.recv(65536).startswith(b"HTTP/1.1 204")
        assert rest(connection) == b""
