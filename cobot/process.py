"""What a process asks of Linux about itself."""

from __future__ import annotations

import ctypes
import os
import signal

_PR_SET_PDEATHSIG = 1


BACKGROUND_NICENESS = 10


def yield_to_others() -> None:
    """Take the processor's time that nobody else wants: planning shall not delay a stop."""
    os.nice(BACKGROUND_NICENESS)


def die_with_parent(number: signal.Signals) -> None:
    """Have the kernel send this process a signal when its parent ends, however it ends.

    To be called early: a parent that has already gone is not noticed. By Linux's rule the parent is
    the thread that started this process.

    Raises:
        OSError: the kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
