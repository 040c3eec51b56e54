"""Functions that change properties of the calling process through Linux, or read the state of other
processes.
"""

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

INTERRUPTED = 130
"""Exit status of a command after Ctrl-C, the same as in a shell."""
RUN_MODULE = (sys.executable, "-P", "-m")
"""The command that starts an installed module. -P excludes modules in the current folder."""

AUTOGROUP = Path("/proc/self/autogroup")
"""The file that sets the niceness of this process's session relative to other sessions."""
AUTOGROUP_TRIES, AUTOGROUP_PAUSE_S = 10, 0.1

MIN_DESCRIPTORS = 64
MIN_ADDRESS_SPACE = 1 << 30
"""Minimum address space of a process, in bytes. The largest process uses 0.8 GB on two cores, most of it
reserved by libraries.
"""


class Niceness(IntEnum):
    """Niceness of threads. If there are more threads than cores, planning must not delay a stop."""

    PROMPT = -10  # threads that answer people
    ORDINARY = 0
    BACKGROUND = 10  # uses only the time that nothing else needs
    STUDY = 19  # has an even lower priority than BACKGROUND


def is_gone(pid: int) -> bool:
    """Whether a process no longer exists."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except PermissionError:  # the process exists, but belongs to another user
        pass
    return False


def is_stopped(pid: int) -> bool:
    """Whether SIGSTOP has suspended a process; False if that is unknown."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] == "T"


def is_traced(pid: int) -> bool:
    """Whether a debugger is attached to a process; False if that is unknown."""
    try:
        status = Path(f"/proc/{pid}/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return re.search(r"^TracerPid:\s*[1-9]", status, re.MULTILINE) is not None


def require_limits() -> None:
    """Check the limits of this process before large imports, because libraries that run out of memory give no
    clear error.

    Raises:
        UnavailableError: a limit of this process is lower than a robot needs.
    """
    descriptors, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if descriptors < MIN_DESCRIPTORS:
        raise UnavailableError(
            f"a process may have {descriptors} file descriptors here, but cobot needs "
            f"{MIN_DESCRIPTORS}: raise the limit (ulimit -n)"
        )
    space, _ = resource.getrlimit(resource.RLIMIT_AS)
    if space != resource.RLIM_INFINITY and space < MIN_ADDRESS_SPACE:
        raise UnavailableError(
            f"a process may have {space // 1024} kB of address space here, but cobot needs "
            f"{MIN_ADDRESS_SPACE // 1024}: raise the memory limit (ulimit -v)"
        )


def in_words(main: Callable[[], int]) -> int:
    """Run `main` and return its exit status. If the computer runs out of a resource, print a message and
    return 2.
    """
    try:
        return main()
    except (OSError, MemoryError, ImportError, RuntimeError) as exc:
        error = exhausted(exc)
        if error is None:
            raise
        print(f"{error} ({exc})", file=sys.stderr, flush=True)
        return 2


def as_command(main: Callable[[], int]) -> int:
    """Run `main` like `in_words`, as a command in a terminal.

    Two events end it without a traceback: Ctrl-C, and a reader of its output that ends first, such as `head`.
    """
    try:
        return in_words(main)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("cobot: interrupted", file=sys.stderr)
        return INTERRUPTED


def set_niceness(niceness: Niceness, *, session: bool = False) -> None:
    """Set the niceness of this thread, and of all threads and processes that it starts.

    A lower niceness needs root or CAP_SYS_NICE, as SCHED_FIFO does; without it nothing changes.

    Args:
        session: niceness of the session, if this process has started one. By default Linux first shares the
            processor among sessions, and niceness applies only within a session (sched(7), the autogroup
            feature). Control groups can change that. Use this argument for processes that wait most of the
            time.
    """
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, niceness)
    if session and os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):  # not permitted, or the feature does not exist
            _write_again(AUTOGROUP, str(int(niceness)))


def leave_real_time() -> None:
    """Give up the real-time priority and the core that this thread or process inherits from rtloop.

    Otherwise the cycle, and everything else on its core, would wait while this thread computes. The thread
    still reacts promptly, because the cycle may wait for it while it holds the interpreter.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
    set_niceness(Niceness.PROMPT)


def _write_again(file: Path, text: str) -> None:
    """Write to the file repeatedly until Linux accepts it. From processes without CAP_SYS_ADMIN, as in a
    container, Linux accepts only ten writes per second.
    """
    for _ in range(AUTOGROUP_TRIES):
        try:
            file.write_text(text, encoding="ascii")
        except BlockingIOError:
            time.sleep(AUTOGROUP_PAUSE_S)
        else:
            return


def has_terminal() -> bool:
    """Whether this process has a terminal that is still open."""
    try:
        os.close(os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY))
    except OSError:
        return False
    return True


def die_with_parent(number: signal.Signals) -> None:
    """Make the kernel send this process a signal when its parent ends for any reason.

    Call this early, because the end of a parent before the call is not noticed. For Linux, the parent is the
    thread that has started this process.

    Raises:
        OSError: the kernel rejects the request.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
