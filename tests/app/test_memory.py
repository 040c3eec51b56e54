"""Memory that is given back. Oracle: the kernel's account."""

from __future__ import annotations

import asyncio
import resource

import psutil
import pytest
from running import WAIT_S

from app import memory
from app.memory import give_back

BLOCK_BYTES, BLOCKS = 2000, 40_000


def test_what_has_been_freed_goes_back_even_when_there_are_no_descriptors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(memory, "LOOK_S", 0.01)
    monkeypatch.setattr(memory, "MOST_S", 0.01)
    resident = psutil.Process().memory_info

    async def grow_and_wait() -> None:
        await asyncio.to_thread(int)  # what that needs is there
        task = asyncio.create_task(give_back())
        await asyncio.sleep(0.02)
        memory._libc.malloc_trim(0)  # what earlier tests have freed would be taken first
        before = resident().rss
        blocks = [bytes(BLOCK_BYTES) for _ in range(BLOCKS)]
        grown = resident().rss
        assert grown > before + 0.7 * BLOCK_BYTES * BLOCKS
        kept = blocks[::100]  # so that the C library would keep the others
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
        try:
            await asyncio.sleep(0.2)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        assert not task.done()
        del blocks
        async with asyncio.timeout(WAIT_S):
            while resident().rss > grown - 0.5 * BLOCK_BYTES * BLOCKS:
                await asyncio.sleep(0.02)
        assert len(kept) == BLOCKS / 100
        task.cancel()

    asyncio.run(grow_and_wait())
