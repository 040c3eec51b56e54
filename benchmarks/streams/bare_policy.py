"""The least server of openpi's protocol: a chunk that swings the first joint a little, and when it was sent.

python -m benchmarks.streams.bare_policy
"""

from __future__ import annotations

import asyncio
import itertools
import time

import numpy as np
import websockets.asyncio.server

from cobot.learning.openpi import pack, unpack

LENGTH = 5
STEP_RAD = 2e-4
HORIZON = 32
"""Columns of an action as published policies have them; those behind the joints are left out."""


async def _serve(socket: websockets.asyncio.server.ServerConnection) -> None:
    await socket.send(pack({"model": "bare"}))
    signs = itertools.cycle((1.0, -1.0))
    async for content in socket:
        assert isinstance(content, bytes)
        state = unpack(content)["observation/state"].astype(float)
        actions = np.zeros((LENGTH, HORIZON))
        actions[:, : len(state)] = state
        actions[:, 0] += next(signs) * STEP_RAD * np.arange(1, LENGTH + 1)
        await socket.send(pack({"actions": actions, "sent_ns": time.monotonic_ns()}))


async def _run() -> None:
    async with websockets.asyncio.server.serve(_serve, "127.0.0.1", 0, compression=None) as server:
        print(next(iter(server.sockets)).getsockname()[1], flush=True)
        await server.serve_forever()


if __name__ == "__main__":
    asyncio.run(_run())
