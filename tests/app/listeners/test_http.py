"""What a connection may send, and how slowly. Oracle: a bare socket, RFC 9110 and 9112, and the settings."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import resource
import socket
import ssl
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
import uvicorn
from certificates import certificate
from cobot_run import WAIT_S, until
from floods import PING, TEXT, UPGRADE, client_hello, frame

from app.listeners.acceptor import Acceptor, has_gone
from app.listeners.crowd import Crowd
from app.listeners.http import HttpProtocol
from app.listeners.websocket import StreamProtocol
from app.server import Server
from cobot.config import ConnectionLimits

LIMITS = ConnectionLimits(
    connections=40,
    connections_per_address=24,
    reserve=4,
    header_bytes=8192,
    header_timeout_s=1.0,
    body_timeout_s=1.0,
    body_bytes_per_s=1000,
    bodies_bytes=10**6,
    idle_timeout_s=2.0,
)
GET = b"GET /health HTTP/1.1\r\nHost: h\r\n"
STOP = b"POST /stop HTTP/1.1\r\nHost: h\r\n\r\n"


class Application:
    """Says how long a body was; /wait waits until it is told; a WebSocket counts what comes, at /late it is
    accepted when that is told, and gets a word when its client has gone."""

    def __init__(self) -> None:
        self.waiting = self.large = 0
        self.late: list[str] = []
        self.go_on = threading.Event()
        self.asked = ("", "")  # host and path of the newest request
        self.events: list[str] = []  # how each answer without an end has ended

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        hosts = [value.decode() for name, value in scope["headers"] if name == b"host"]
        query = scope["query_string"].decode()
        self.asked = ", ".join(hosts), scope["path"] + (f"?{query}" if query else "")
        if scope["type"] == "websocket":
            kinds = {"/late": self._late, "/refused": self._refused}
            await kinds.get(scope["path"], self._socket)(receive, send)
            return
        if scope["path"] == "/large":
            await self._large(send)
            return
        if scope["path"] == "/events":
            await self._events(send)
            return
        if scope["path"] in ("/wait", "/health/wait"):
            self.waiting += 1
            while not self.go_on.is_set():
                await asyncio.sleep(0.01)
            self.waiting -= 1
        size, more = 0, scope["method"] == "POST" and scope["path"] != "/stop"
        while more:
            message = await receive()
            if message["type"] == "http.disconnect":
                return
            size, more = size + len(message["body"]), message["more_body"]
        body = str(size).encode()
        headers = [(b"content-length", str(len(body)).encode())]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": body})

    async def _socket(self, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        count = 0
        while (await receive())["type"] == "websocket.receive":
            count += 1
            await send({"type": "websocket.send", "text": str(count)})

    async def _refused(self, receive: Any, send: Any) -> None:
        await receive()
        headers = [(b"content-length", b"4")]
        await send({"type": "websocket.http.response.start", "status": 503, "headers": headers})
        await send({"type": "websocket.http.response.body", "body": b"busy"})

    async def _large(self, send: Any) -> None:
        """200 MB, of which a client that does not read gets less."""
        self.large += 1
        try:
            await send({"type": "http.response.start", "status": 200, "headers": []})
            for _ in range(200):
                await send({"type": "http.response.body", "body": bytes(10**6), "more_body": True})
            await send({"type": "http.response.body", "body": b""})
        finally:
            self.large -= 1

    async def _events(self, send: Any) -> None:
        """Nothing until it is told, and then more than a client that does not read gets."""
        self.waiting += 1
        try:
            await send({"type": "http.response.start", "status": 200, "headers": []})
            while not self.go_on.is_set():
                await asyncio.sleep(0.01)
            await send({"type": "http.response.body", "body": bytes(10**7), "more_body": True})
            await send({"type": "http.response.body", "body": b""})
            self.events.append("over")
        except asyncio.CancelledError:
            self.events.append("cancelled")
            raise
        finally:
            self.waiting -= 1

    async def _late(self, receive: Any, send: Any) -> None:
        await receive()
        self.waiting += 1
        while not self.go_on.is_set():
            await asyncio.sleep(0.01)
        self.waiting -= 1
        try:
            await send({"type": "websocket.accept"})
            while (await receive())["type"] == "websocket.receive":
                pass
            await send({"type": "websocket.send", "text": "too late"})
        except OSError as exc:
            self.late.append(type(exc).__name__)
            raise


class Service:
    """The application behind the listener under test, in a thread."""

    def __init__(self, limits: ConnectionLimits, certificate: Path | None = None) -> None:
        self.application = Application()
        listener = socket.create_server(("127.0.0.1", 0))
        self.address = listener.getsockname()
        config = uvicorn.Config(
            self.application,
            loop="uvloop",
            ws=StreamProtocol,
            lifespan="off",
            log_config=None,
            timeout_keep_alive=int(limits.idle_timeout_s),
            timeout_graceful_shutdown=1,
            ssl_certfile=certificate,
            ssl_keyfile=certificate and certificate.with_suffix(".key"),
        )
        self.server = Server(config, limits, self._end_streams)
        self._thread = threading.Thread(target=self.server.run, args=([listener],))
        self._thread.start()
        until(lambda: self.server.started)

    def _end_streams(self) -> None:
        """Their last words come when the connections have been told to end."""
        asyncio.get_running_loop().call_soon(self.application.go_on.set)

    def close(self) -> None:
        self.server.should_exit = True
        self._thread.join(WAIT_S)

    def connect(self) -> socket.socket:
        return socket.create_connection(self.address, WAIT_S)

    def ask(self, request: bytes) -> tuple[int, bytes]:
        with self.connect() as connection:
            connection.sendall(request)
            return answer(connection)


def answer(connection: socket.socket) -> tuple[int, bytes]:
    """Status and body of the next answer; 0 if the connection was closed without one."""
    with contextlib.suppress(ConnectionError), connection.makefile("rb") as lines:
        first = lines.readline()
        if first:
            length = 0
            while (line := lines.readline().strip()) not in (b"",):
                name, _, value = line.partition(b":")
                length = int(value) if name.lower() == b"content-length" else length
            return int(first.split()[1]), lines.read(length)
    return 0, b""


def refusal(found: tuple[int, bytes]) -> tuple[int, str]:
    return found[0], json.loads(found[1])["code"]


def closed(connection: socket.socket) -> bool:
    """Whether the other side closes it, and says nothing more before."""
    try:
        return connection.recv(1) == b""
    except ConnectionError:
        return True


@pytest.fixture(scope="module")
def service() -> Iterator[Service]:
    started = Service(LIMITS)
    yield started
    started.close()


@pytest.fixture
def own() -> Iterator[Service]:
    """One that a test may fill up."""
    started = Service(LIMITS)
    yield started
    started.close()


def test_nothing_is_begun_for_a_small_body_before_it_is_there(service: Service) -> None:
    """A flood of slow bodies costs next to nothing; large ones, and who waits to be asked for one, begin."""
    post = b"POST /slow HTTP/1.1\r\nHost: h\r\nContent-Length: %d\r\n%s\r\n"
    with service.connect() as slow:
        slow.sendall(post % (2, b"") + b"a")
        assert service.ask(GET + b"\r\n")[0] == 200, "what was sent before has been read"
        assert service.application.asked[1] == "/health"
        slow.sendall(b"b")
        assert answer(slow) == (200, b"2")
    for first in (post % (200_000, b"") + bytes(100_000), post % (2, b"Expect: 100-continue\r\n")):
        service.application.asked = ("", "")
        with service.connect() as connection:
            connection.sendall(first)
            until(lambda: service.application.asked[1] == "/slow")


@pytest.mark.parametrize(
    "request_bytes",
    [
        GET + b"X: " + b"x" * 8192,
        GET + b"X: " + b"x" * 8192 + b"\r\n\r\n",
        GET + b"X: y\r\n" * 2000,
        b"GET /" + b"x" * 8192,
        b"\r\n" * 9000,
        b"POST /echo HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n" + b"X: y\r\n" * 2000,
        b"POST /echo HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: chunked\r\n\r\n1;" + b"x" * 13000,
        UPGRADE.format("/").encode()[:-2] + b"X: y\r\n" * 2000 + b"\r\n",
    ],
    ids=["value", "whole", "lines", "path", "blank lines", "trailer", "extension", "upgrade"],
)
def test_a_header_without_an_end_is_refused(service: Service, request_bytes: bytes) -> None:
    assert refusal(service.ask(request_bytes)) == (431, "header")


def test_a_header_just_below_the_limit_is_taken(service: Service) -> None:
    assert service.ask(GET + b"X: " + b"x" * 8000 + b"\r\n\r\n") == (200, b"0")


def test_a_header_that_comes_in_drops_is_given_up(service: Service) -> None:
    with service.connect() as connection:
        begun_s = time.monotonic()
        with contextlib.suppress(ConnectionError):
            for byte in (GET + b"X: " + b"x" * 200).decode():
                connection.sendall(byte.encode())
                time.sleep(0.05)
                if time.monotonic() - begun_s > 3.0:
                    break
        assert refusal(answer(connection)) == (408, "timeout")


@pytest.mark.parametrize("request_bytes", [b"", STOP], ids=["nothing", "no more"])
def test_who_says_nothing_is_told_and_let_go(service: Service, request_bytes: bytes) -> None:
    """A stop that comes just then is on a connection that has an answer: no reset in place of one."""
    with service.connect() as connection:
        connection.sendall(request_bytes)
        assert not request_bytes or answer(connection) == (200, b"0")
        assert refusal(answer(connection)) == ((503, "busy") if request_bytes else (408, "timeout"))
        assert closed(connection)


def test_who_says_nothing_of_tls_or_something_else_is_let_go(tmp_path: Path) -> None:
    """Oracle: openssl's side of a handshake, by Python's ssl."""
    trusted = certificate(tmp_path, "service")
    service = Service(LIMITS, trusted)
    try:
        for request in (GET, STOP):
            with service.connect() as connection:
                connection.sendall(request)
                status, body = answer(connection)
                assert status == 400
                assert json.loads(body) == {
                    "code": "header",
                    "detail": "this port speaks TLS: write https:// instead of http:// in the address",
                }
                assert closed(connection)
        for words in (b"", b"\x00\x01", b"\x16\x03\x01\x02\x00\x01"):  # nothing, no TLS, the beginning of one
            with service.connect() as connection:
                connection.sendall(words)
                while not closed(connection):
                    pass
        context = ssl.create_default_context(cafile=trusted)
        with (
            service.connect() as raw,
            context.wrap_socket(raw, server_hostname="robot.example") as connection,
        ):
            connection.sendall(STOP)
            assert answer(connection) == (200, b"0")
    finally:
        service.close()


def test_a_handshake_is_no_work_for_a_client_that_has_gone() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        client = socket.create_connection(listener.getsockname())
        accepted, _ = listener.accept()
        with accepted:
            client.sendall(client_hello())
            assert not has_gone(accepted)
            client.close()
            until(lambda: has_gone(accepted))


def test_a_body_that_does_not_come_is_given_up(service: Service) -> None:
    with service.connect() as connection:
        connection.sendall(b"POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: 100\r\n\r\nbegin")
        assert refusal(answer(connection)) == (408, "timeout")


def test_a_body_that_comes_at_the_least_rate_is_taken(service: Service) -> None:
    with service.connect() as connection:
        connection.sendall(b"POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: 12000\r\n\r\n")
        for _ in range(24):
            connection.sendall(b"x" * 500)
            time.sleep(0.1)
        assert answer(connection) == (200, b"12000")


def test_who_does_not_read_the_last_words_of_what_has_no_end_is_not_waited_for() -> None:
    service = Service(LIMITS)
    with service.connect() as connection:
        connection.sendall(b"GET /events HTTP/1.1\r\nHost: h\r\n\r\n")
        until(lambda: service.application.waiting)
        service.close()
    assert service.application.events == ["over"]


@pytest.mark.parametrize("size", [100_000, 5_000_000])
def test_a_large_body_arrives_whole(service: Service, size: int) -> None:
    head = f"POST /echo HTTP/1.1\r\nHost: h\r\nContent-Length: {size}\r\n\r\n".encode()
    assert service.ask(head + b"x" * size) == (200, str(size).encode())


def test_who_goes_on_sending_after_the_answer_is_not_listened_to_for_ever(service: Service) -> None:
    with service.connect() as connection:
        connection.sendall(b"POST /stop HTTP/1.1\r\nHost: h\r\nContent-Length: 99999999\r\n\r\n")
        assert answer(connection)[0] == 200

        def refuses() -> bool:
            try:
                connection.sendall(b"x" * 1000)
            except ConnectionError:
                return True
            return False

        until(refuses)


def test_requests_in_one_packet_are_all_answered(service: Service) -> None:
    with service.connect() as connection, connection.makefile("rb") as lines:
        connection.sendall((GET + b"\r\n") * 1000)
        for _ in range(1000):
            assert lines.readline().startswith(b"HTTP/1.1 200")
            while lines.readline().strip():
                pass
            assert lines.read(1) == b"0"


def test_requests_that_nobody_waits_for_the_answers_of_do_not_pile_up(service: Service) -> None:
    with service.connect() as connection:
        connection.settimeout(0.2)
        most = 0
        for _ in range(20):
            with contextlib.suppress(TimeoutError):
                connection.sendall((GET + b"\r\n") * 1000)
            connection.recv(2**20)
            here = tuple(service.server.server_state.connections)
            most = max([most, *(len(each.pipeline) for each in here if isinstance(each, HttpProtocol))])
        assert 0 < most <= 4096 // len(GET)


@pytest.mark.parametrize(
    ("codings", "version", "status"),
    [
        ("gzip, chunked", "1.1", 501),
        ("gzip", "1.1", 501),
        ("identity", "1.1", 501),
        ("identity, chunked", "1.1", 501),
        ("gzip\r\nTransfer-Encoding: chunked", "1.1", 501),
        ("chunked;q=1", "1.1", 501),
        ("xchunked", "1.1", 501),
        ("chunked", "1.0", 501),
        ("chunked, gzip", "1.1", 400),
        ("chunked, chunked", "1.1", 400),
        ("chunked\r\nTransfer-Encoding: chunked", "1.1", 400),
        ("", "1.1", 400),
        ("chunked\r\nContent-Length: 12", "1.1", 400),
    ],
)
def test_a_body_in_any_coding_but_chunked_is_refused(
    service: Service, codings: str, version: str, status: int
) -> None:
    """RFC 9112, 6.1: what is not known is 501, what makes the length uncertain 400."""
    head = f"POST /echo HTTP/{version}\r\nHost: h\r\nTransfer-Encoding: {codings}\r\n\r\n"
    with service.connect() as connection:
        connection.sendall(head.encode() + b"2\r\nab\r\n0\r\n\r\n" + STOP)
        found = answer(connection)
        assert found[0] == status
        assert status == 400 or refusal(found)[1] == "not_supported"
        assert closed(connection), "what follows is no request of anybody's"


@pytest.mark.parametrize("coding", ["chunked", "Chunked"])
def test_chunked_is_understood(service: Service, coding: str) -> None:
    head = f"POST /echo HTTP/1.1\r\nHost: h\r\nTransfer-Encoding: {coding}\r\n\r\n"
    assert service.ask(head.encode() + b"2\r\nab\r\n0\r\n\r\n") == (200, b"2")


@pytest.mark.parametrize(
    ("target", "host", "path"),
    [
        ("/a?b=c", "here", "/a?b=c"),
        ("http://evil/", "evil", "/"),
        ("HTTP://evil:80/a?b=c", "evil:80", "/a?b=c"),
        ("http://evil", "evil", "/"),
        ("http://evil?b", "evil", "/?b"),
        ("http://me:secret@evil/a", "me:secret@evil", "/a"),
        ("ftp://evil/a", "evil", "/a"),
        ("http://[::1]:80/a", "[::1]:80", "/a"),
    ],
)
@pytest.mark.parametrize("head", ["GET {} HTTP/1.1\r\nHost: here\r\n\r\n", None], ids=["http", "websocket"])
def test_the_host_of_a_target_counts_more_than_the_header(
    service: Service, head: str | None, target: str, host: str, path: str
) -> None:
    """RFC 9112, 3.2.2: what a proxy is sent, a server has to understand too."""
    asked = (head or UPGRADE.replace("Host: localhost\r\n", "Host: here\r\n")).format(target)
    with service.connect() as connection:
        connection.sendall(asked.encode())
        assert connection.recv(100).startswith(b"HTTP/1.1 " + (b"200" if head else b"101"))
        assert service.application.asked == (host, path)


def test_two_hosts_stay_two_and_none_stays_none(service: Service) -> None:
    """Both are refused by who looks at them, see tests/app/api/middleware/test_access.py."""
    for hosts, seen in (("", ""), ("Host: a\r\nHost: b\r\n", "ours, ours")):
        assert service.ask(f"GET http://ours/ HTTP/1.1\r\n{hosts}\r\n".encode())[0] == 200
        assert service.application.asked == (seen, "/")


def test_what_is_no_http_is_answered_as_before(service: Service) -> None:
    assert service.ask(b"\x16\x03\x01\x02\x00\x01\x00")[0] == 400


def test_when_all_places_are_taken_only_a_stop_and_health_are_answered(own: Service) -> None:
    busy = [own.connect() for _ in range(LIMITS.connections_per_address)]
    for connection in busy:
        connection.sendall(b"GET /wait HTTP/1.1\r\nHost: h\r\n\r\n")
    until(lambda: own.application.waiting == len(busy))
    assert own.ask(STOP) == (200, b"0")
    assert own.ask(b"POST /robots/left-1/stop HTTP/1.1\r\nHost: h\r\n\r\n") == (200, b"0")
    assert own.ask(GET + b"\r\n") == (200, b"0")
    assert refusal(own.ask(b"GET /robot/pose HTTP/1.1\r\nHost: h\r\n\r\n")) == (503, "busy")
    own.application.go_on.set()
    for connection in busy:
        assert answer(connection) == (200, b"0")
        connection.close()
    until(lambda: own.ask(b"GET /robot/pose HTTP/1.1\r\nHost: h\r\n\r\n")[0] == 200)


def test_half_open_connections_make_room(own: Service) -> None:
    silent = [own.connect() for _ in range(500)]
    assert own.ask(STOP) == (200, b"0")
    for connection in silent:
        connection.close()


@pytest.mark.parametrize(
    "request_bytes",
    [b"", GET, b"POST /slow HTTP/1.1\r\nHost: h\r\nContent-Length: 9\r\n\r\nx", STOP],
    ids=["nothing", "header", "body", "no more"],
)
def test_who_has_to_make_room_is_told_and_not_just_cut_off(own: Service, request_bytes: bytes) -> None:
    with contextlib.ExitStack() as stack:
        asking = [stack.enter_context(own.connect()) for _ in range(LIMITS.connections_per_address)]
        for connection in asking:
            connection.sendall(request_bytes)
            assert request_bytes != STOP or answer(connection) == (200, b"0")
        assert own.ask(STOP) == (200, b"0")
        assert refusal(answer(asking[0])) == (503, "busy")
        assert closed(asking[0])


def test_who_finds_the_reserve_taken_too_is_told(own: Service) -> None:
    with contextlib.ExitStack() as stack:
        paths = [b"GET /wait"] * LIMITS.connections_per_address + [b"GET /health/wait"] * LIMITS.reserve
        for count, path in enumerate(paths, start=1):
            stack.enter_context(own.connect()).sendall(path + b" HTTP/1.1\r\nHost: h\r\n\r\n")
            until(lambda count=count: own.application.waiting == count)
        assert refusal(own.ask(STOP)) == (503, "busy")


def test_who_has_to_make_room_before_anybody_has_read_a_word_is_told() -> None:
    """As when the event loop has much to do between accepting a connection and reading from it."""
    asyncio.run(_three_at_a_crowd_of_one())


async def _three_at_a_crowd_of_one() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener, contextlib.ExitStack() as stack:
        crowd = Crowd(places=1, per_address=1, reserve=1)
        acceptor = Acceptor(listener, crowd, lambda visit: asyncio.Protocol(), None, 1.0)
        asking = []
        for _ in range(3):
            connection = stack.enter_context(socket.create_connection(listener.getsockname(), WAIT_S))
            connection.sendall(STOP)
            asking.append(connection)
            acceptor._greet(*listener.accept()[:1], "127.0.0.1")
        assert [refusal(answer(each)) for each in asking[:2]] == [(503, "busy")] * 2
        acceptor.close()
        await asyncio.sleep(0)


def test_the_service_accepts_again_when_descriptors_had_run_out(own: Service) -> None:
    """All that the process has left are taken away for a moment."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    mine = socket.socket()
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (mine.fileno() + 1, hard))
        with contextlib.suppress(OSError):
            mine.settimeout(0.5)
            mine.connect(own.address)
            mine.sendall(STOP)
            mine.recv(1)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        mine.close()
    assert own.ask(STOP) == (200, b"0")


def upgraded(service: Service) -> socket.socket:
    connection = service.connect()
    connection.sendall(UPGRADE.format("/").encode())
    assert answer(connection)[0] == 101
    return connection


@pytest.mark.parametrize(
    ("find", "put"),
    [
        ("\r\n\r\n", "\r\nContent-Length: 2\r\n\r\n{}"),
        ("\r\n\r\n", "\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"),
        ("HTTP/1.1", "HTTP/1.0"),
    ],
    ids=["length", "chunks", "old"],
)
def test_a_websocket_is_not_asked_for_with_a_body_or_in_an_old_http(
    service: Service, find: str, put: str
) -> None:
    """With a body it got no answer, and its connection stayed for ever. Oracle: RFC 6455, 4.2.1."""
    with service.connect() as connection:
        connection.sendall(UPGRADE.format("/").replace(find, put).encode())
        assert refusal(answer(connection)) == (400, "input")
        assert closed(connection)


def test_a_websocket_does_not_overtake_the_answer_before_it(own: Service) -> None:
    """The answer would stand among its frames. Oracle: RFC 9112, 9.3.2: answers come in order."""
    with own.connect() as connection:
        connection.sendall(b"GET /wait HTTP/1.1\r\nHost: h\r\n\r\n" + UPGRADE.format("/").encode())
        assert closed(connection)
    own.application.go_on.set()
    assert own.ask(STOP) == (200, b"0")


def test_frames_in_one_packet_all_arrive_in_their_order(service: Service) -> None:
    with upgraded(service) as connection:
        connection.sendall(frame(TEXT, b"{}") * 2000)
        with connection.makefile("rb") as frames:
            for count in range(2000):
                _, size = frames.read(2)
                assert frames.read(size) == str(count + 1).encode()


@pytest.mark.parametrize("before_it_was_accepted", [True, False])
def test_who_is_told_something_after_it_has_gone_is_no_error_of_the_service(
    own: Service, caplog: pytest.LogCaptureFixture, before_it_was_accepted: bool
) -> None:
    """Oracle: ASGI, by which `send` raises an OSError then, which no application has to catch."""
    with own.connect() as connection:
        connection.sendall(UPGRADE.format("/late").encode())
        until(lambda: own.application.waiting)
        if before_it_was_accepted:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        else:  # which makes the service close it
            connection.sendall(frame(TEXT & 0x0F, b"") + frame(0, b"") * 3000)
    if before_it_was_accepted:
        time.sleep(0.1)  # until the reset has arrived; else it finds the connection closed a word later
    own.application.go_on.set()
    until(lambda: own.application.late == ["ClientDisconnected"])
    own.close()
    assert not caplog.records


def test_a_refused_handshake_is_no_error_of_the_service(
    own: Service, caplog: pytest.LogCaptureFixture
) -> None:
    with own.connect() as connection:
        connection.sendall(UPGRADE.format("/refused").encode())
        assert answer(connection) == (503, b"busy")
    own.close()
    assert not caplog.records


def test_who_goes_before_its_pipelined_answers_is_no_error_of_the_service(
    own: Service, caplog: pytest.LogCaptureFixture
) -> None:
    """Large ones, of which the first is being written when the connection breaks."""
    with own.connect() as connection:
        connection.sendall(b"GET /large HTTP/1.1\r\nHost: h\r\n\r\n" * 20)
        connection.recv(1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    assert own.ask(STOP) == (200, b"0")
    until(lambda: own.application.large == 0)
    own.close()
    assert not caplog.records


def test_a_message_in_too_many_fragments_closes_its_connection(service: Service) -> None:
    with upgraded(service) as connection:
        connection.sendall(frame(TEXT & 0x0F, b"") + frame(0, b"") * 3000)
        head = connection.recv(4)
        assert (head[0] & 0x0F, int.from_bytes(head[2:4])) == (8, 1009)


def test_pings_of_who_reads_nothing_are_not_remembered(service: Service) -> None:
    """Some 47 MB of pongs would have to be: the kernel takes some 4 MB of them."""
    with upgraded(service) as connection:
        before = psutil.Process().memory_info().rss
        connection.settimeout(0.5)
        with contextlib.suppress(OSError):
            for _ in range(450):
                connection.sendall(frame(PING, b"x" * 125) * 800)
        assert psutil.Process().memory_info().rss - before < 30e6


def test_an_upgrade_that_is_no_handshake_is_given_up(service: Service) -> None:
    with service.connect() as connection:
        broken = UPGRADE.format("/").replace("Sec-WebSocket-Version: 13", "X: y\r\n" * 200 + "Y: z")
        connection.sendall(broken.encode())
        while not closed(connection):
            pass


@pytest.mark.parametrize(
    "request_bytes",
    [
        GET + b"\r\n",
        GET,
        b"POST /slow HTTP/1.1\r\nHost: h\r\nContent-Length: 99\r\n\r\nx",
        b"POST /large HTTP/1.1\r\nHost: h\r\nContent-Length: 999999\r\n\r\n" + bytes(70_000),
        (GET + b"\r\n") * 20,
        GET + b"X: " + b"x" * 9000,
        UPGRADE.format("/").encode() + frame(TEXT, b"x") * 3,
        UPGRADE.format("/refused").encode(),
    ],
    ids=["answered", "header", "body", "large", "pipelined", "refused", "WebSocket", "no WebSocket"],
)
@pytest.mark.parametrize("reset", [False, True], ids=["closed", "reset"])
def test_a_connection_leaves_nothing_to_the_garbage_collector(request_bytes: bytes, reset: bool) -> None:
    """It would hold the loop for a tenth of a second after a flood, and who is reset after an answer was kept
    for as long as it might have idled. Oracle: all objects that Python has.
    """
    own = Service(LIMITS.model_copy(update={"idle_timeout_s": 3600.0}))
    gc.collect()
    gc.disable()
    try:
        for _ in range(3):
            with own.connect() as connection:
                connection.sendall(request_bytes)
                if request_bytes.endswith(b"\r\n\r\n"):
                    answer(connection)
                if reset:
                    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        until(lambda: not any(isinstance(each, HttpProtocol | StreamProtocol) for each in gc.get_objects()))
    finally:
        gc.enable()
        own.close()
