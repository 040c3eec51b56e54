"""What the tests of learning share: the extra's packages, and a policy's server in a thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import websockets.asyncio.server

WAIT_S = 60.0


def need(module: str, extra: str = "learning") -> Any:
    """The module; where it is not installed the tests are skipped, saying so."""
    return pytest.importorskip(module, reason=f"{module} is not installed: pip install 'cobot[{extra}]'")


@contextmanager
def in_a_loop(begin: Callable[[], Any]) -> Iterator[tuple[asyncio.AbstractEventLoop, Any]]:
    """An event loop in a thread, and what a coroutine function has made in it."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    try:
        yield loop, asyncio.run_coroutine_threadsafe(begin(), loop).result(WAIT_S)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join(WAIT_S)
        loop.close()


@contextmanager
def answering(handler: Callable[[Any], Any]) -> Iterator[str]:
    """The address of a WebSocket server whose connections this coroutine function serves."""

    async def begin() -> Any:
        return await websockets.asyncio.server.serve(handler, "127.0.0.1", 0, compression=None, max_size=None)

    with in_a_loop(begin) as (loop, server):
        yield f"127.0.0.1:{server.sockets[0].getsockname()[1]}"

        async def end() -> None:
            server.close()
            await server.wait_closed()

        asyncio.run_coroutine_threadsafe(end(), loop).result(WAIT_S)
