"""Cheap observers: GET /events on many connections, from a separate process.

    python -m benchmarks.web.observers URL CLIENTS STATE_HZ SECONDS

Says "all there" when all hear something; on SIGTERM, or when the time is up, how many states a second each of
them has heard, as JSON.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import sys
import time
from urllib.parse import urlsplit


class Observer(asyncio.Protocol):
    """Counts the states that it receives."""

    def __init__(self, request: bytes) -> None:
        self.count = 0
        self._request = request

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.write(self._request)

    def data_received(self, data: bytes) -> None:
        self.count += data.count(b"event: state\n")


async def _run(url: str, clients: int, state_hz: float, duration_s: float) -> None:
    where = urlsplit(url)
    path = f"/events?state_hz={state_hz}"
    request = f"GET {path} HTTP/1.1\r\nHost: {where.netloc}\r\n\r\n".encode()
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, ended.set)
    observers = [Observer(request) for _ in range(clients)]
    for each in observers:
        await loop.create_connection(lambda each=each: each, where.hostname, where.port)
        await asyncio.sleep(1.0 / state_hz / clients)  # as people come: not all at the same moment
    while not all(each.count for each in observers):
        await asyncio.sleep(0.1)
    print("all there", flush=True)
    begun_s, before = time.monotonic(), sum(each.count for each in observers)
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(ended.wait(), duration_s)
    heard = sum(each.count for each in observers) - before
    print(json.dumps({"hz": heard / clients / (time.monotonic() - begun_s)}), flush=True)


if __name__ == "__main__":
    url, clients, state_hz, duration_s = sys.argv[1:]
    asyncio.run(_run(url, int(clients), float(state_hz), float(duration_s)))
