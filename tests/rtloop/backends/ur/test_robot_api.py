"""The client of PolyScope X's Robot API, over TCP. Oracle: Python's own HTTP server, and its record of the
requests; methods, paths and bodies are those of the API's published description.
"""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from rtloop.backends import BackendError
from rtloop.backends.ur.robot_api import RobotApi
from rtloop.backends.ur.transport import TcpTransport

HERE = "127.0.0.1"
Answer = tuple[int, bytes]
OK: Answer = (200, b'{"message": "Success"}')


@contextmanager
def serving(*answers: Answer) -> Iterator[tuple[RobotApi, list[tuple[str, str, Any]]]]:
    """A client, and the requests that a server has received. The last answer is given again."""
    asked: list[tuple[str, str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_PUT(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            asked.append((self.command, self.path, json.loads(body) if body else None))
            status, content = answers[min(len(asked), len(answers)) - 1]
            self.send_response(status)
            if len(asked) % 2:  # with a length, or until the connection ends
                self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        do_GET = do_PUT  # noqa: N815

        def log_message(self, *values: Any) -> None: ...

    with ThreadingHTTPServer((HERE, 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield RobotApi(TcpTransport(), HERE, server.server_port), asked
        finally:
            server.shutdown()


def answer(api: RobotApi, request: str) -> str:
    api.ask(request)
    while (found := api.poll()) is None:
        time.sleep(0.001)
    return found


def test_each_request_is_the_one_of_the_published_description() -> None:
    with serving((200, b'{"mode": "REMOTE"}'), OK) as (api, asked):
        assert answer(api, "is in remote control") == "true"
        assert answer(api, "close safety popup") == ""
        assert answer(api, "unlock protective stop") == "releasing"
        for request in ("power on", "brake release", "stop"):
            assert answer(api, request) == "done"
    root = "/universal-robots/robot-api"
    assert asked == [
        ("GET", f"{root}/system/v1/controlmode", None),
        ("PUT", f"{root}/robotstate/v1/state", {"action": "UNLOCK_PROTECTIVE_STOP"}),
        ("PUT", f"{root}/robotstate/v1/state", {"action": "POWER_ON"}),
        ("PUT", f"{root}/robotstate/v1/state", {"action": "BRAKE_RELEASE"}),
        ("PUT", f"{root}/program/v1/state", {"action": "stop"}),
    ]


def test_what_it_rejects_is_quoted() -> None:
    with serving((200, b'{"mode": "LOCAL"}'), (500, b"<html>"), (403, b"{}")) as (api, _):
        assert answer(api, "is in remote control") == "false"
        assert answer(api, "power on") == "status 500"
        with pytest.raises(BackendError, match="Local Control, in which it does not accept"):
            answer(api, "power on")


@pytest.mark.parametrize("content", [b'{"mode": "SOMETHING"}', b"[]", b"not JSON", b"[" * 10_000])
def test_an_unknown_control_mode_is_an_error(content: bytes) -> None:
    with serving((200, content)) as (api, _), pytest.raises(BackendError, match="its control mode is"):
        answer(api, "is in remote control")


@pytest.mark.parametrize(
    ("bytes_", "words"),
    [
        (b"SSH-2.0-stranger\r\n\r\n", "its answer is not valid"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\n{}", "its answer is not valid"),
        (b"HTTP/1.1 200 OK\r\n" + 10_000 * b"X-Header: filler\r\n", "its answer is not valid"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 100000\r\n\r\n" + 100_000 * b"x", "longer than 65536"),
        (b"", "closed|not valid"),
    ],
)
def test_a_stranger_at_the_port_is_named(bytes_: bytes, words: str) -> None:
    with socket.create_server((HERE, 0)) as listener:

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.recv(4096)
                connection.sendall(bytes_)

        thread = threading.Thread(target=serve)
        thread.start()
        api = RobotApi(TcpTransport(), HERE, listener.getsockname()[1])
        with pytest.raises(BackendError, match=words) as found:
            answer(api, "power on")
        api.close()
        thread.join()
    assert "It needs PolyScope X 10.11 or later" in str(found.value)


def test_silence_and_a_closed_port_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rtloop.backends.ur.robot_api.REPLY_S", 0.05)
    with socket.create_server((HERE, 0)) as listener:
        port = listener.getsockname()[1]
        with pytest.raises(BackendError, match=r"no answer to 'power on' within 0\.05 s"):
            answer(RobotApi(TcpTransport(), HERE, port), "power on")
    with pytest.raises(BackendError, match=r"ECONNREFUSED|no answer"):
        answer(RobotApi(TcpTransport(), HERE, port), "power on")
