"""Fast first start of each process, which reuses the modules that its parent has imported.

Imports take most of the time of a start, and the parent has already done half of them. So the supervisor
forks its children before it starts threads. In the same way, the service forks its planning processes before
it starts threads. Each fork waits for the command that it will run. A handler ends the threads of OpenBLAS
before each fork; OpenBLAS starts them again when it needs them. A process that starts later, to replace one
that has died, starts from scratch, as `python -m` does.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import gc
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NoReturn

from cobot.launch.process import RUN_MODULE

TASK_BYTES = 65536
MAX_DESCRIPTORS = 16
POLL_S = 0.01
_first_path: list[str] = [] if sys.flags.safe_path else sys.path[:1]
"""First folder of the module path of `python -m`: the current folder. Forked processes do not have it."""


class Forked:
    """A forked process. It provides those parts of the interface of `subprocess.Popen` that its parent needs.

    Attributes:
        returncode: exit status; None while the process is running.
    """

    def __init__(self, pid: int, channel: socket.socket) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self.channel = channel

    def become(
        self, command: Sequence[str], output: int, descriptors: Sequence[int], environment: Mapping[str, str]
    ) -> bool:
        """Make the process run a command. The command must begin with `RUN_MODULE`. Returns False if the
        process has ended.

        Args:
            output: descriptor of the command's output.
            descriptors: descriptors that the command inherits, under the same numbers.
        """
        task = {"command": list(command), "descriptors": list(descriptors), "environment": dict(environment)}
        try:
            with self.channel:
                socket.send_fds(self.channel, [json.dumps(task).encode()], [output, *descriptors])
        except OSError:
            self.kill()
            self.wait()
            return False
        return True

    def poll(self) -> int | None:
        """The exit status, or the negative number of the signal that ended the process; None while it is
        running.
        """
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout_s: float | None = None) -> int:
        """Wait until the process has ended, and return its exit status.

        Raises:
            subprocess.TimeoutExpired: the process is still running.
        """
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        while (status := self.poll()) is None:
            if deadline_s is not None and timeout_s is not None and time.monotonic() > deadline_s:
                raise subprocess.TimeoutExpired(str(self.pid), timeout_s)
            time.sleep(POLL_S)
        return status

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def dismiss(self) -> None:
        """End the process if it is still waiting for a command."""
        if self.channel.fileno() >= 0:
            self.channel.close()
            self.wait()


def fork_processes(count: int) -> list[Forked]:
    """Fork processes that wait for a command. In the forked processes, this function never returns.

    The calling process must not have started threads.
    """
    # The caller may have set SIGCHLD to ignored. Then the parent could not learn how a child has ended.
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    gc.freeze()  # so that the children's garbage collection does not touch the shared objects
    made: list[Forked] = []
    for _ in range(count):
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        if pid := os.fork():
            theirs.close()
            made.append(Forked(pid, ours))
            continue
        for each in (ours, *(other.channel for other in made)):
            each.close()  # a waiting process must notice when its parent is gone
        _serve(theirs)
    return made


def _serve(channel: socket.socket) -> NoReturn:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.setsid()  # Ctrl-C reaches only the supervisor, which stops the arm first
    message, received, _, _ = socket.recv_fds(channel, TASK_BYTES, MAX_DESCRIPTORS)
    if not message:
        os._exit(0)
    task = json.loads(message)
    os.environ.update(task["environment"])
    _take_descriptors(channel.detach(), received, [1, *task["descriptors"]])
    _set_title(task["command"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    module, *arguments = task["command"][len(RUN_MODULE) :]
    if _first_path:  # false in a forked process that forks again
        sys.path.remove(_first_path.pop())
    sys.argv[1:] = arguments
    status: object = 0
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as exc:
        status = exc.code
    except BaseException:  # noqa: BLE001 - as the interpreter does it
        sys.excepthook(*sys.exc_info())
        status = 1
    # End as the interpreter does, but without returning to the caller of the supervisor.
    ctypes.pythonapi.Py_Exit(status if isinstance(status, int) else int(status is not None))
    raise AssertionError("unreachable")


def _take_descriptors(channel: int, received: list[int], numbers: list[int]) -> None:
    """Give the received descriptors their numbers. Output and errors go to the same file, the input is empty,
    and all other descriptors are closed.
    """
    above = max(*numbers, *received, channel) + 1
    high = [fcntl.fcntl(each, fcntl.F_DUPFD_CLOEXEC, above) for each in received]
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    for source, number in zip([high[0], *high], [2, *numbers], strict=True):
        os.dup2(source, number)
    for each in os.listdir("/proc/self/fd"):  # close each number that was open at the time of the fork
        if int(each) not in (0, 1, 2, *numbers):
            with contextlib.suppress(OSError):  # the descriptor with which the folder was read
                os.close(int(each))


def _set_title(command: Sequence[str]) -> None:
    """Make `ps` show the command.

    This overwrites the arguments and the environment, which the kernel stores next to each other. Before
    that, the C library gets its own copy of the environment.
    """
    for name, value in os.environ.items():
        os.putenv(name, value)
    fields = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
    begin, arguments_end, end = (int(fields[index]) for index in (45, 46, 48))
    line = " ".join(command).encode()[: end - begin - 1]
    if 0 < begin < arguments_end <= end:
        # If the last byte is not NUL, the kernel reads on to the first NUL after it.
        line = line.ljust(arguments_end - begin)
        ctypes.memmove(begin, line.ljust(end - begin, b"\0"), end - begin)
