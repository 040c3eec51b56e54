"""Returns memory to the system after requests that used a lot of it.

Python and the C library keep freed memory for reuse. After a flood of large messages they keep four times as
much as the service needs.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import gc
import os
from collections.abc import Callable
from pathlib import Path

LOOK_S, MAX_S = 2.0, 15.0
"""Shortest and longest interval between two memory checks, s. The interval grows as long as freeing has no
effect.
"""
GROWTH = 1.05
"""Growth of the memory above which it is freed. Freeing takes a few milliseconds."""
ARENAS = 2
_M_ARENA_MAX = -8
_libc = ctypes.CDLL(None)
_page_bytes = os.sysconf("SC_PAGE_SIZE")


def share_arenas() -> None:
    """Make all threads of this process share two memory arenas. Call it before the first thread starts.

    By default glibc makes one arena for each thread, up to eight per core. After a flood of requests, free
    memory is scattered over these arenas and cannot be returned.
    """
    with contextlib.suppress(AttributeError):
        _libc.mallopt(_M_ARENA_MAX, ARENAS)


async def give_back() -> None:
    """Return unused memory to the operating system while the service is running. With a C library other than
    glibc, only Python's own memory is returned.
    """
    # opened now, because later there may be no free file descriptor
    with Path("/proc/self/statm").open("rb", buffering=0) as statm:
        await _give_back(lambda: int(os.pread(statm.fileno(), 99, 0).split()[1]) * _page_bytes)


async def _give_back(resident_bytes: Callable[[], int]) -> None:
    least, wait_s = resident_bytes(), LOOK_S
    while True:
        await asyncio.sleep(wait_s)
        now = resident_bytes()
        least = min(least, now)
        if now <= GROWTH * least:
            wait_s = LOOK_S
            continue
        wait_s = min(2.0 * wait_s, MAX_S)
        gc.collect()  # also clears the lists of free objects; one free object is enough to retain a megabyte
        with contextlib.suppress(AttributeError):
            await asyncio.to_thread(_libc.malloc_trim, 0)
