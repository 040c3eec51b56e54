"""What the operating system grants to a process that must be punctual."""

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
"""Parts of the names of what a cycle may run for the first time at a bad moment, beside our own modules."""


@dataclass(frozen=True, slots=True)
class Permissions:
    """What was granted; `refused` says what not, and why."""

    sched_fifo: bool
    memory_locked: bool
    refused: str


def prepare(priority: int, cpu: int | None, cpu_latency_us: int | None) -> Permissions:
    """Ask for a core that stays awake, SCHED_FIFO and locked memory.

    Everything is tried, nothing is required.
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
    problem = _keep_awake(cpu_latency_us) if cpu_latency_us is not None else ""
    if problem:
        refused.append(f"rt.cpu_latency_us {cpu_latency_us}: {_PM_QOS}: {problem}")
    problem = _lock_memory()
    if problem:
        refused.append(f"locked memory: {problem}, needs CAP_IPC_LOCK")
    return Permissions(sched_fifo, not problem, "; ".join(refused))


def _keep_awake(latency_us: int) -> str:
    """Let no core sleep so deeply that it takes longer to wake; "" or why not.

    A core that wakes a thousand times a second from such a sleep begins some cycles a millisecond late. The
    kernel keeps the promise for as long as the file is open: until this process ends, however it ends.
    """
    try:
        file = os.open(_PM_QOS, os.O_WRONLY | os.O_CLOEXEC)
        os.write(file, latency_us.to_bytes(4, sys.byteorder))
    except OSError as exc:
        return str(exc.strerror)
    return ""


def _lock_memory() -> str:
    """Lock every page once it has been touched, and the code that a cycle may need at once; "" or why not.

    To populate what is only reserved, as MCL_FUTURE alone does, would take five times the memory.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    everything = _MCL_CURRENT | _MCL_FUTURE
    if libc.mlockall(everything | _MCL_ONFAULT) != 0 and libc.mlockall(everything) != 0:
        return os.strerror(ctypes.get_errno())
    for address, size in _code():
        libc.mlock(ctypes.c_void_p(address), ctypes.c_size_t(size))
    return ""


def _code() -> list[tuple[int, int]]:
    """Address and size of the mappings of compiled modules of ours and of `_NEEDED`."""
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
    """Collect once and never again: what the cycle leaves behind is freed by reference counting."""
    gc.collect()
    gc.freeze()
    gc.disable()
