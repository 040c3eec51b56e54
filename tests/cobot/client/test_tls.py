"""A TLS connection that two threads share.

Oracles: OpenSSL's rule that a connection is read and written by one thread at a time, and a server that keeps
it, as the other side.
"""

from __future__ import annotations

import contextlib
import hashlib
import random
import socket
import ssl
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from certificates import certificate
from cobot_run import WAIT_S

from cobot.client import Client
from cobot.client.tls import tls_context
from cobot.errors import UnavailableError

BYTES = 8 << 20


@dataclass(frozen=True)
class Echo:
    """A TLS server that sends back whatever comes on its one connection."""

    trusted: Path
    port: int

    def connect(self) -> ssl.SSLSocket:
        plain = socket.create_connection(("127.0.0.1", self.port), WAIT_S)
        return tls_context(self.trusted).wrap_socket(plain)


@pytest.fixture
def echo(tmp_path: Path) -> Iterator[Echo]:
    trusted = certificate(tmp_path, "service")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "service.pem", tmp_path / "service.key")
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def answer() -> None:
            plain, _ = listener.accept()
            with context.wrap_socket(plain, server_side=True) as connection:
                while data := connection.recv(65536):
                    connection.sendall(data)

        server = threading.Thread(target=answer)
        server.start()
        yield Echo(trusted, listener.getsockname()[1])
        server.join(WAIT_S)
        assert not server.is_alive()


class Watched:
    """OpenSSL's connection, and how many have been using it at once."""

    def __init__(self, connection: Any) -> None:
        self._connection = connection
        self.using, self.most = 0, 0

    def __getattr__(self, name: str) -> Any:
        used = getattr(self._connection, name)
        if name not in ("read", "write"):
            return used

        def use(*args: Any) -> Any:
            self.using += 1
            self.most = max(self.most, self.using)
            try:
                return used(*args)
            finally:
                self.using -= 1

        return use


def test_what_one_thread_writes_another_one_reads_and_never_both_at_once(echo: Echo) -> None:
    connection = echo.connect()
    connection.settimeout(None)
    watched = connection._sslobj = Watched(connection._sslobj)  # type: ignore[attr-defined]
    sent, got = hashlib.sha256(), hashlib.sha256()

    def read() -> None:
        left = BYTES
        while left:
            data = connection.recv(min(left, 65536))
            got.update(data)
            left -= len(data) or left

    reader = threading.Thread(target=read)
    reader.start()
    pieces = random.Random(3)
    left = BYTES
    while left:
        piece = pieces.randbytes(min(left, pieces.randrange(1, 40_000)))
        sent.update(piece)
        connection.sendall(piece)
        left -= len(piece)
    reader.join(WAIT_S)
    assert got.digest() == sent.digest()
    assert watched.most == 1
    connection.close()


def test_a_reader_finds_the_end_when_another_thread_shuts_down(echo: Echo) -> None:
    connection = echo.connect()
    connection.settimeout(None)
    read: list[bytes] = []

    def read_on() -> None:
        try:
            read.append(connection.recv(100))
        except ConnectionResetError:  # as it ends where the peer was quicker
            read.append(b"")

    reader = threading.Thread(target=read_on)
    reader.start()
    connection.shutdown(socket.SHUT_RDWR)
    reader.join(WAIT_S)
    assert read == [b""]
    connection.close()


def test_time_is_up_when_it_is_up(echo: Echo) -> None:
    connection = echo.connect()
    connection.settimeout(0.01)
    with pytest.raises(TimeoutError, match=r"no answer for 0\.01 s"):
        connection.recv(100)
    connection.setblocking(False)
    with pytest.raises(ssl.SSLWantReadError):
        connection.recv(100)
    connection.setblocking(True)
    connection.sendall(b"still there")
    assert connection.recv(100) == b"still there"
    connection.close()


def test_a_context_of_the_callers_own_keeps_its_own_class_of_sockets() -> None:
    class Own(ssl.SSLSocket): ...

    context = ssl.create_default_context()
    assert tls_context(context) is context
    assert context.sslsocket_class is tls_context(True).sslsocket_class
    context.sslsocket_class = Own
    assert tls_context(context).sslsocket_class is Own


def test_a_certificate_that_is_not_trusted_is_named_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: OpenSSL's refusal of a certificate that the client does not know."""
    monkeypatch.delenv("COBOT_CERTIFICATE", raising=False)
    certificate(tmp_path, "service")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "service.pem", tmp_path / "service.key")
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def refuse() -> None:
            plain, _ = listener.accept()
            with plain, contextlib.suppress(OSError):
                context.wrap_socket(plain, server_side=True).close()

        server = threading.Thread(target=refuse)
        server.start()
        url = f"https://127.0.0.1:{listener.getsockname()[1]}"
        remedy = "certificate.*COBOT_CERTIFICATE=FILE or verify=FILE"
        with Client(url) as robot, pytest.raises(UnavailableError, match=remedy):
            robot.health()
        server.join(WAIT_S)
        assert not server.is_alive()
