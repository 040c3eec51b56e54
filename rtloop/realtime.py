"""Requests real-time permissions from the operating system."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from dataclasses import dataclass
from pathlib import Path

_PM_QOS = "/dev/cpu_dma_latency"
_MCL_CURRENT = 1
_MCL_FUTURE = 2
_MCL_ONFAULT = 4
_NEEDED = ("libmujoco", "libpython", "libc.so", "libc-", "libm.so", "libm-", "/bin/python", "_umath")
"""Parts of the names of libraries whose code a cycle may need at any time, in addition to cobot's own
modules.
"""


@dataclass(frozen=True, slots=True)
class Permissions:
    """The permissions that Linux has granted. `refused` lists the permissions that it has denied, with
    reasons.
    """

    sched_fifo: bool
    memory_locked: bool
    refused: str


def prepare(priority: int, cpu: int | None, cpu_latency_us: int | None) -> Permissions:
    """Request SCHED_FIFO, locked memory, and cores that do not sleep deeply.

    A refusal is not an error.
    """
    refused = []
    try:
        if cpu is not None:
            os.sched_setaffinity(0, {cpu})
    except OSError as exc:
        refused.append(f"rt.cpu {cpu}: {exc.strerror}")
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        sched_fifo = True
    except OSError as exc:
        sched_fifo = False
        refused.append(f"SCHED_FIFO {priority}: {exc.strerror}, needs CAP_SYS_NICE")
    try:
        if cpu_latency_us is not None:
            _keep_awake(cpu_latency_us)
    except OSError as exc:
        refused.append(f"rt.cpu_latency_us {cpu_latency_us}: {_PM_QOS}: {exc.strerror}")
    try:
        _lock_memory()
        memory_locked = True
    except OSError as exc:
        memory_locked = False
        refused.append(f"locked memory: {exc.strerror}, needs CAP_IPC_LOCK")
    return Permissions(sched_fifo, memory_locked, "; ".join(refused))


def _keep_awake(latency_us: int) -> None:
    """Prevent all cores from entering sleep states with a longer wake-up latency.

    A core that sleeps more deeply between cycles starts some of them a millisecond late. The limit applies as
    long as the file is open, which is until this process ends.
    """
    file = os.open(_PM_QOS, os.O_WRONLY | os.O_CLOEXEC)
    os.write(file, latency_us.to_bytes(4, sys.byteorder))


def _lock_memory() -> None:
    """Lock each memory page in RAM as soon as it has been touched. The code that a cycle may need is locked
    at once.

    MCL_FUTURE alone would also load memory that is only reserved, five times as much.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    everything = _MCL_CURRENT | _MCL_FUTURE
    if libc.mlockall(everything | _MCL_ONFAULT) != 0 and libc.mlockall(everything) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    for address, size in _code():
        libc.mlock(ctypes.c_void_p(address), ctypes.c_size_t(size))


def _code() -> list[tuple[int, int]]:
    """Return the address and the size of each mapping of cobot's compiled modules and of the libraries in
    `_NEEDED`.
    """
    ours = [str(Path(__file__).parents[1] / package) + os.sep for package in ("cobot", "rtloop")]
    found = []
    for line in Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace").splitlines():
        span, permissions, _, _, _, *path = line.split(maxsplit=5)
        name = path[0] if path else ""
        if permissions.startswith("r") and any(part in name for part in (*_NEEDED, *ours)):
            begin, end = (int(edge, 16) for edge in span.split("-"))
            found.append((begin, end - begin))
    return found


def freeze_garbage() -> None:
    """Collect garbage once, and disable the collector. Reference counting frees the objects that the cycle
    creates.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
