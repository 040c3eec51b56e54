"""Floods of a service on this computer, from a process of its own, bounded in number and time.

python -m floods URL KIND SECONDS

Prints a line when all its connections have been tried once. A connection that is closed is opened again.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import ssl
import struct
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from urllib.parse import urlsplit

from cobot_run import HELPER_ENVIRONMENT

UPGRADE = (
    "GET {} HTTP/1.1\r\nHost: localhost\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
JSON = "POST {} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
TEXT, PING = 0x81, 0x89


def frame(kind: int, content: bytes) -> bytes:
    """A frame from a client, its mask all zeros."""
    size = len(content)
    if size < 126:
        head = struct.pack("!BB", kind, 0x80 | size)
    elif size < 65536:
        head = struct.pack("!BBH", kind, 0x80 | 126, size)
    else:
        head = struct.pack("!BBQ", kind, 0x80 | 127, size)
    return head + bytes(4) + content


@dataclass(frozen=True)
class Flood:
    """What each of its connections does.

    Attributes:
        first: what it sends at once.
        again: what it sends after that, every `period_s` or as fast as it is taken.
        answered: whether it waits for an answer before it sends more; `each`: for one to each.
        reads: whether it reads what it is sent.
        closes: whether it closes its connections at once.
        again_s: after this time a closed connection is opened again.
    """

    connections: int
    first: bytes
    again: bytes = b""
    period_s: float = 0.0
    answered: bool = False
    each: bool = False
    reads: bool = True
    closes: bool = False
    again_s: float = 0.05


GET = b"GET /robot/joint_states HTTP/1.1\r\nHost: localhost\r\n"
SUBSCRIBE = frame(TEXT, json.dumps({"type": "subscribe", "rate_hz": 1000}).encode())
NUMBERS = {"data": [0.1234567890123] * 190_000}
AGENT = json.dumps(
    {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": {"name": "get_state", "arguments": {}}}
).encode()
ASKED_BY_AGENT = JSON.format("/mcp/mcp").encode() + (
    b"Accept: application/json, text/event-stream\r\nContent-Length: %d\r\n\r\n" % len(AGENT) + AGENT
)
FOXGLOVE = UPGRADE.replace("Upgrade\r\n", "Upgrade\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n", 1)
CHANNELS = [{"id": number, "channelId": number % 8 + 1} for number in range(64)]
SUBSCRIBE_CHANNELS = frame(TEXT, json.dumps({"op": "subscribe", "subscriptions": CHANNELS}).encode())
STOP = b"POST /stop HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0\r\n\r\n"
STOPS, HANDSHAKES = "stops", "TLS handshakes"
GIANT = json.dumps({"op": "publish", "topic": "/giant", "msg": NUMBERS}).encode()


def client_hello() -> bytes:
    """With which TLS begins: a server has a key exchange and a signature to compute for it."""
    sent = ssl.MemoryBIO()
    try:
        ssl.create_default_context().wrap_bio(
            ssl.MemoryBIO(), sent, server_hostname="localhost"
        ).do_handshake()
    except ssl.SSLWantReadError:
        return sent.read()
    raise AssertionError("unreachable")


FLOODS = {
    "endless header": Flood(32, GET + b"X: ", b"x" * 65536),
    "endless headers": Flood(32, GET, b"X:\r\n" * 16384),
    "endless trailer": Flood(
        32,
        JSON.format("/trajectory/send").encode() + b"Transfer-Encoding: chunked\r\n\r\n0\r\n",
        b"X:\r\n" * 999,
    ),
    "slow header": Flood(300, GET, b"X: y\r\n", 0.3),
    "slow body": Flood(
        300, JSON.format("/robot/move/joints").encode() + b"Content-Length: 99999\r\n\r\n", b" ", 0.3
    ),
    "endless chunks": Flood(
        32,
        JSON.format("/trajectory/send").encode() + b"Transfer-Encoding: chunked\r\n\r\n",
        b"1\r\n \r\n" * 10_000,
    ),
    "half-open connections": Flood(600, b"", period_s=math.inf, again_s=0.5),
    "connections that come and go": Flood(300, b"", closes=True),
    "valid requests": Flood(200, GET + b"\r\n", GET + b"\r\n", each=True),
    "pipelined requests": Flood(100, GET + b"\r\n", (GET + b"\r\n") * 1000),
    "200 WebSockets": Flood(200, UPGRADE.format("/robot/stream").encode(), SUBSCRIBE * 500, answered=True),
    "giant frames": Flood(24, UPGRADE.format("/rosbridge").encode(), frame(TEXT, GIANT), answered=True),
    "tiny frames": Flood(32, UPGRADE.format("/rosbridge").encode(), frame(TEXT, b"") * 10_000, answered=True),
    "unread WebSockets": Flood(
        60,
        UPGRADE.format("/robot/stream").encode(),
        SUBSCRIBE + frame(PING, b"x" * 99) * 999,
        answered=True,
        reads=False,
    ),
    "agents": Flood(100, ASKED_BY_AGENT, ASKED_BY_AGENT, each=True),
    "Foxglove clients": Flood(
        100, FOXGLOVE.format("/foxglove?rate_hz=100").encode(), SUBSCRIBE_CHANNELS * 100, answered=True
    ),
    "unread events": Flood(
        200, b"GET /events?types=state HTTP/1.1\r\nHost: localhost\r\n\r\n", answered=True, reads=False
    ),
    STOPS: Flood(200, STOP, STOP, each=True),
    HANDSHAKES: Flood(300, client_hello(), closes=True, again_s=0.02),
}


class Attacker(asyncio.Protocol):
    """One connection."""

    def __init__(self, flood: Flood, ended: asyncio.Event) -> None:
        self._flood = flood
        self._ended = ended
        self._loop = asyncio.get_running_loop()
        self._writable = self._begun = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.set_write_buffer_limits(high=0)
        self._writable = True
        transport.write(self._flood.first)
        if self._flood.closes:
            transport.close()
        elif not (self._flood.answered or self._flood.each):
            self._send_again()

    def data_received(self, data: bytes) -> None:
        if self._flood.each:
            self._transport.write(self._flood.again)
        elif self._flood.answered and not self._begun:
            self._begun = True
            if not self._flood.reads:
                self._transport.pause_reading()
            self._send_again()

    def connection_lost(self, exc: Exception | None) -> None:
        self._writable = False
        self._ended.set()

    def pause_writing(self) -> None:
        self._writable = False

    def resume_writing(self) -> None:
        self._writable = True
        if not self._flood.period_s:
            self._send_again()

    def _send_again(self) -> None:
        if self._writable and not self._transport.is_closing() and self._flood.again:
            self._transport.write(self._flood.again)
            if self._flood.period_s:
                self._loop.call_later(self._flood.period_s, self._send_again)
            elif self._writable:
                self._loop.call_soon(self._send_again)


async def attack(where: tuple[str, int], flood: Flood, begun: asyncio.Event) -> None:
    """One connection after the other."""
    while True:
        ended = asyncio.Event()
        try:
            await asyncio.get_running_loop().create_connection(partial(Attacker, flood, ended), *where)
            begun.set()
            await ended.wait()
        except OSError:
            begun.set()
        await asyncio.sleep(flood.again_s)


async def main(url: str, kind: str, duration_s: float) -> None:
    address = urlsplit(url)
    assert address.hostname in ("localhost", "127.0.0.1")
    assert address.port
    flood = FLOODS[kind]
    events = [asyncio.Event() for _ in range(flood.connections)]
    tasks = [asyncio.create_task(attack(("127.0.0.1", address.port), flood, event)) for event in events]
    for event in events:
        await event.wait()
    print("begun", flush=True)
    await asyncio.sleep(duration_s)
    for task in tasks:
        task.cancel()


@contextlib.contextmanager
def flooding(url: str, kind: str) -> Iterator[subprocess.Popen[str]]:
    """Until the context ends, which begins when all connections have been tried."""
    command = [sys.executable, "-m", "floods", url, kind, "3600"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=HELPER_ENVIRONMENT)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        yield process
    finally:
        process.kill()
        process.communicate()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1], sys.argv[2], float(sys.argv[3])))
