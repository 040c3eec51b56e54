"""Memory that is given back. Oracle: the kernel's account of a process of its own."""

from __future__ import annotations

import asyncio
import ctypes
import resource
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from app import memory

ROOT = Path(__file__).parents[2]
BLOCK_BYTES, BLOCKS = 2000, 40_000
WAIT_S = 60.0
THREADS = """
import ctypes, threading
from app import memory
{before}
libc = ctypes.CDLL(None)
libc.malloc.restype = ctypes.c_void_p
together = threading.Barrier(6)
def take():
    together.wait()
    libc.malloc(5000)
    together.wait()
threads = [threading.Thread(target=take) for _ in range(6)]
for each in threads: each.start()
for each in threads: each.join()
libc.malloc_info(0, ctypes.c_void_p.in_dll(libc, "stdout"))
libc.fflush(None)
"""


def test_what_has_been_freed_goes_back_even_when_there_are_no_descriptors() -> None:
    command = [sys.executable, "-m", "tests.app.test_memory"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=2 * WAIT_S)
    assert done.returncode == 0, done.stderr


def test_threads_share_two_places_to_take_memory_from() -> None:
    """Oracle: what glibc says of itself."""
    if not hasattr(ctypes.CDLL(None), "malloc_info"):
        pytest.skip("another C library than glibc")
    counts = [arenas_of_threads(how) for how in ("", "memory.share_arenas()")]
    assert counts[0] > 2 >= counts[1]


def arenas_of_threads(before: str) -> int:
    """After as many threads have taken memory at the same time, in a process of its own."""
    text = THREADS.format(before=before)
    command = [sys.executable, "-c", text]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=WAIT_S)
    return done.stdout.count("<heap nr=")


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
    memory.LOOK_S = memory.MAX_S = 0.01
    asyncio.run(_grow_and_wait())
