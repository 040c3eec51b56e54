"""Cheap clients: GET requests over open connections, from a separate process.

    python -m benchmarks.web.load URL CLIENTS RATE SECONDS [TOKEN]

RATE is requests a second of each client, 0 for as fast as the answers come. Prints how many were answered,
and how long each answer took, in ms.
"""

from __future__ import annotations

import asyncio
import sys
import time
from urllib.parse import urlsplit


class Poller(asyncio.Protocol):
    """Sends the next request when the answer to the last one is complete."""

    def __init__(self, request: bytes, period_s: float) -> None:
        self.took_ms: list[float] = []
        self._request = request
        self._period_s = period_s
        self._received = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport
        self._send()

    def data_received(self, data: bytes) -> None:
        self._received += data
        head, separator, body = self._received.partition(b"\r\n\r\n")
        if not separator:
            return
        assert head.startswith(b"HTTP/1.1 200 "), head
        length = int(head.lower().partition(b"content-length:")[2].split(b"\r\n", 1)[0])
        if len(body) < length:
            return
        self.took_ms.append(1e3 * (time.perf_counter() - self._asked_s))
        self._received = b""
        if self._period_s:
            asyncio.get_running_loop().call_later(self._period_s, self._send)
        else:
            self._send()

    def _send(self) -> None:
        self._asked_s = time.perf_counter()
        self._transport.write(self._request)


async def _run(url: str, clients: int, rate: float, duration_s: float, token: str = "") -> list[float]:
    where = urlsplit(url)
    shown = f"Authorization: Bearer {token}\r\n" if token else ""
    request = f"GET {where.path} HTTP/1.1\r\nHost: {where.netloc}\r\n{shown}\r\n".encode()
    loop = asyncio.get_running_loop()
    pollers = [Poller(request, 1.0 / rate if rate else 0.0) for _ in range(clients)]
    for poller in pollers:
        await loop.create_connection(lambda poller=poller: poller, where.hostname, where.port)
    await asyncio.sleep(duration_s)
    return [took for poller in pollers for took in poller.took_ms]


if __name__ == "__main__":
    url, clients, rate, duration_s, *token = sys.argv[1:]
    took_ms = asyncio.run(_run(url, int(clients), float(rate), float(duration_s), *token))
    print(len(took_ms), *(f"{took:.4g}" for took in took_ms))
