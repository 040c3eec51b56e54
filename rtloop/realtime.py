"""What the operating system grants to a process that must be punctual."""

from __future__ import annotations

import ctypes
import gc
import os
from dataclasses import dataclass

_MCL_CURRENT = 1
_MCL_FUTURE = 2


@dataclass(frozen=True, slots=True)
class Permissions:
    """What was granted; `refused` says what not, and why."""

    sched_fifo: bool
    memory_locked: bool
    refused: str


def prepare(priority: int, cpu: int | None) -> Permissions:
    """Ask for SCHED_FIFO, locked memory and a core; switch the garbage collector off.

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
    libc = ctypes.CDLL(None, use_errno=True)
    memory_locked = libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0
    if not memory_locked:
        refused.append(f"locked memory: {os.strerror(ctypes.get_errno())}, needs CAP_IPC_LOCK")
    return Permissions(sched_fifo, memory_locked, "; ".join(refused))


def freeze_garbage() -> None:
    """Collect once and never again: what the cycle leaves behind is freed by reference counting."""
    gc.collect()
    gc.freeze()
    gc.disable()
