"""When a hub closes a connection whose request does not come.

Oracle: RFC 9110, 15.5.9: 408 is the status for a request that is not complete in time; raw TCP connections.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import uvicorn
from certificates import certificate
from cobot_run import until
from websockets.sync.client import connect

from cobot.fleet import connections
from cobot.fleet.connections import MAX_HEADER_BYTES, MAX_WAITING_REQUESTS, HubServer

REQUEST = b"GET / HTTP/1.1\r\nHost: hub\r\n\r\n"


LARGE = b"x" * 2**20
SLOW_S = 1.5


async def _app(scope: Any, receive: Any, send: Any) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        message = await receive()
        await send({"type": "websocket.send", "text": message["text"]})
        await receive()
        return
    path, content, status = scope["path"], b"", 200
    if path == "/slow":
        await asyncio.sleep(SLOW_S)
    if path == "/body":
        while (message := await receive()).get("more_body"):
            content += message["body"]
        content += message.get("body", b"")
    if path == "/forbidden":
        status = 401
    length = (b"content-length", str(len(LARGE) * 100 if path == "/large" else len(content)).encode())
    await send({"type": "http.response.start", "status": status, "headers": [length]})
    for _ in range(100 if path == "/large" else 0):
        await send({"type": "http.response.body", "body": LARGE, "more_body": True})
        SENT.append(len(LARGE))
    await send({"type": "http.response.body", "body": content})


SENT: list[int] = []


@contextmanager
def serving(**more: Any) -> Iterator[tuple[str, int]]:
    config = uvicorn.Config(
        _app, lifespan="off", log_config=None, timeout_keep_alive=1, access_log=False, **more
    )
    server = HubServer(config)
    with pytest.MonkeyPatch.context() as patched, socket.create_server(("127.0.0.1", 0)) as listener:
        patched.setattr(connections, "BODY_S", 1.0)
        patched.setattr(connections, "UNREAD_S", 1.0)
        thread = threading.Thread(target=server.run, args=([listener],))
        thread.start()
        until(lambda: server.started)
        try:
            yield listener.getsockname()
        finally:
            server.should_exit = True
            thread.join()


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    with serving() as found:
        yield found


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
        assert connection.recv(65536).startswith(b"HTTP/1.1 200")
        connection.sendall(REQUEST[:-2])
        assert rest(connection).startswith(b"HTTP/1.1 408")


def test_a_connection_that_is_idle_after_an_answer_closes_without_another_answer(
    address: tuple[str, int],
) -> None:
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(REQUEST)
        assert connection.recv(65536).startswith(b"HTTP/1.1 200")
        assert rest(connection) == b""


def asked(path: str, more: str = "") -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: hub\r\n{more}\r\n".encode()


def posted(path: str, size: int) -> bytes:
    return f"POST {path} HTTP/1.1\r\nHost: hub\r\nContent-Length: {size}\r\n\r\n".encode()


def test_a_request_that_takes_long_is_answered_also_with_the_beginning_of_another_behind_it(
    address: tuple[str, int],
) -> None:
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(asked("/slow"))
        time.sleep(0.2)
        connection.sendall(REQUEST[:5])
        answers = rest(connection)
    assert answers.startswith(b"HTTP/1.1 200")
    assert answers.count(b"HTTP/1.1 408") == 1


def test_requests_in_advance_are_answered_in_turn(address: tuple[str, int]) -> None:
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(asked("/slow") + asked("/slow") + REQUEST)
        assert rest(connection).count(b"HTTP/1.1 200") == 3


def test_too_many_requests_in_advance_end_the_connection(address: tuple[str, int]) -> None:
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(asked("/slow") + (MAX_WAITING_REQUESTS + 1) * REQUEST)
        assert rest(connection).startswith(b"HTTP/1.1 400")


def test_a_slow_body_is_read_and_a_body_that_does_not_come_is_not_waited_for(
    address: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(posted("/body", 5000))
        for _ in range(5):
            connection.sendall(1000 * b"x")
            time.sleep(0.5)
        answer = connection.recv(65536)
    assert answer.startswith(b"HTTP/1.1 200")
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(posted("/body", 5000) + b"x")
        assert rest(connection).startswith(b"HTTP/1.1 408")


def test_the_rest_of_a_body_that_nobody_reads_costs_no_error_and_no_connection(
    address: tuple[str, int],
) -> None:
    """The response comes before the end of the body. The next request is answered."""
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(posted("/forbidden", 10) + b"xxxxx")
        assert connection.recv(65536).startswith(b"HTTP/1.1 401")
        connection.sendall(b"xxxxx")
        time.sleep(0.1)
        connection.sendall(asked("/slow"))
        assert connection.recv(65536).startswith(b"HTTP/1.1 200")
        assert rest(connection) == b"", "idle, and owes nothing"
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(posted("/forbidden", 10) + b"xxxxx")
        assert connection.recv(65536).startswith(b"HTTP/1.1 401")
        connection.sendall(b"xxxxx")
        assert rest(connection) == b"", "idle, and owes nothing"


@pytest.mark.parametrize(
    "begin",
    [b"GET /", b"GET / HTTP/1.1\r\nX: ", b"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n0\r\nX: "],
)
def test_a_header_without_an_end_is_rejected(address: tuple[str, int], begin: bytes) -> None:
    """In the address, in a header, and in a trailer."""
    with socket.create_connection(address, 20.0) as connection:
        connection.sendall(begin)
        time.sleep(0.1)
        with contextlib.suppress(ConnectionError):
            for _ in range(MAX_HEADER_BYTES // 1024 + 1):
                connection.sendall(1024 * b"x")
        answer = b""
        with contextlib.suppress(ConnectionError):
            answer = rest(connection)
    assert b"HTTP/1.1 431" in answer or answer == b""


def test_a_client_that_does_not_read_loses_its_connection(address: tuple[str, int]) -> None:
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(address)
        SENT.clear()
        connection.sendall(asked("/large"))
        until(lambda: len(SENT) == 100)  # to nobody, once the connection is closed


def test_a_websocket_outlives_all_limits(address: tuple[str, int]) -> None:
    host, port = address
    with connect(f"ws://{host}:{port}/", ping_interval=None) as socket_:
        time.sleep(SLOW_S)
        socket_.send("still here")
        assert socket_.recv(20.0) == "still here"


def test_a_client_that_does_not_complete_the_handshake_of_tls_loses_the_connection(tmp_path: Path) -> None:
    file = certificate(tmp_path, "hub")
    with serving(ssl_certfile=file, ssl_keyfile=file.with_suffix(".key")) as address:
        with socket.create_connection(address, 20.0) as silent:
            assert rest(silent) == b""
        context = ssl.create_default_context(cafile=file)
        with (
            socket.create_connection(address, 20.0) as raw,
            context.wrap_socket(raw, server_hostname="robot.example") as secure,
        ):
            secure.sendall(REQUEST)
            assert secure.recv(65536).startswith(b"HTTP/1.1 200")
