"""Memory that is given back. Oracle: the kernel's account of a process of its own."""

from __future__ import annotations

import asyncio
import resource
import subprocess
import sys
from pathlib import Path

import psutil

from app import memory

ROOT = Path(__file__).parents[2]
BLOCK_BYTES, BLOCKS = 2000, 40_000
WAIT_S = 30.0


def test_what_has_been_freed_goes_back_even_when_there_are_no_descriptors() -> None:
    command = [sys.executable, "-m", "tests.app.test_memory"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=2 * WAIT_S)
    assert done.returncode == 0, done.stderr


async def _grow_and_wait() -> None:
    await asyncio.to_thread(int)  # what that needs is there
    resident = psutil.Process().memory_info
    task = asyncio.create_task(memory.give_back())
    await asyncio.sleep(0.02)
    before = resident().rss
    blocks = [bytes(BLOCK_BYTES) for _ in range(BLOCKS)]
    grown = resident().rss
    assert grown > before + 0.9 * BLOCK_BYTES * BLOCKS
    kept = blocks[::100]  # so that the C library would keep the others
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    await asyncio.sleep(0.2)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert not task.done()
    del blocks
    async with asyncio.timeout(WAIT_S):
        while resident().rss > grown - 0.7 * BLOCK_BYTES * BLOCKS:
            await asyncio.sleep(0.02)
    assert len(kept) == BLOCKS / 100
    task.cancel()


if __name__ == "__main__":
    memory.LOOK_S = memory.MOST_S = 0.01
    asyncio.run(_grow_and_wait())
