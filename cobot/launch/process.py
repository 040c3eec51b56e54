"""What a process asks of Linux about itself."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import resource
import signal
import sys
import time
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path

from cobot.errors import UnavailableError, exhausted

_PR_SET_PDEATHSIG = 1

RUN_MODULE = (sys.executable, "-P", "-m")
"""The command that starts an installed module; -P: not one that happens to lie in the current folder."""

AUTOGROUP = Path("/proc/self/autogroup")
"""How its session stands among the others."""
AUTOGROUP_TRIES, AUTOGROUP_PAUSE_S = 10, 0.1

MIN_DESCRIPTORS = 64
MIN_ADDRESS_SPACE = 1 << 30
"""[bytes] of one process: the largest takes 0.8 GB on two cores, most of it never touched by libraries."""


class Niceness(IntEnum):
    """Whose turn it is when there are more threads than cores: planning shall not delay a stop."""

    PROMPT = -10  # what answers people
    ORDINARY = 0
    BACKGROUND = 10  # takes the time that nobody else wants


def is_stopped(pid: int) -> bool:
    """Whether SIGSTOP keeps a process from running; not, if that cannot be known."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] == "T"


def is_traced(pid: int) -> bool:
    """Whether a debugger has a process in its hand; not, if that cannot be known."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return re.search(r"^TracerPid:\s*[1-9]", status, re.MULTILINE) is not None


def require_limits() -> None:
    """Before anything large is imported: libraries without memory fail in words of their own, or none.

    Raises:
        UnavailableError: a limit of this process is below what a robot needs.
    """
    descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if descriptors < MIN_DESCRIPTORS:
        raise UnavailableError(
            f"a process may have {descriptors} file descriptors here, cobot needs {MIN_DESCRIPTORS}: "
            "raise the limit (ulimit -n)"
        )
    space, _ = resource.getrlimit(resource.RLIMIT_AS)
    if space != resource.RLIM_INFINITY and space < MIN_ADDRESS_SPACE:
        raise UnavailableError(
            f"a process may have {space // 1024} kB of address space here, cobot needs "
            f"{MIN_ADDRESS_SPACE // 1024}: raise the limit of memory (ulimit -v)"
        )


def in_words(main: Callable[[], int]) -> int:
    """The exit status of a process: 2 when the computer has nothing left for it; then it says of what."""
    try:
        return main()
    except (OSError, MemoryError, ImportError, RuntimeError) as exc:
        error = exhausted(exc)
        if error is None:
            raise
        print(f"{error} ({exc})", file=sys.stderr, flush=True)
        return 2


def be(niceness: Niceness, *, session: bool = False) -> None:
    """Set this thread's niceness, and that of all that it starts.

    To go below one's own takes root or CAP_SYS_NICE, as SCHED_FIFO does; without it nothing changes.

    Args:
        session: the same among sessions, if one begins with this process. Where Linux shares the processor
            among those first, as it does unless control groups say otherwise, niceness counts only within a
            session (sched(7), the autogroup feature). For what waits most of the time: others get what it
            leaves.
    """
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    if session and os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):  # not permitted, or there is no such feature
            _write_again(AUTOGROUP, str(int(niceness)))


def _write_again(file: Path, text: str) -> None:
    """Linux takes ten of these a second from all who are not CAP_SYS_ADMIN, as in a container."""
    for _ in range(AUTOGROUP_TRIES):
        try:
            file.write_text(text, encoding="ascii")
        except BlockingIOError:
            time.sleep(AUTOGROUP_PAUSE_S)
        else:
            return


def has_terminal() -> bool:
    """Whether this process has a terminal that is still there."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY))
    except OSError:
        return False
    return True


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
