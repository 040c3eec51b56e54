"""`cobot run` from a process that has imported it already: `warm_process.py`.

A start from nothing takes 1.5 s of a processor, most of them imports, and the tests start some hundred times.
From a warm process it takes 0.7 s, and what runs after the imports is the same. Processes still start from
nothing where the command, the environment or the network is another: with limits of resources, from a wheel,
with a backend of the tests, on a second computer; and where the supervisor restarts one.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import os
import socket
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from typing import TextIO

from folders import SUPPORT

from cobot.__main__ import BLAS_THREADS

COMMAND = [sys.executable, "-m", "cobot"]
POLL_S = 0.005
PR_SET_CHILD_SUBREAPER = 36


class Warm:
    """A started process, with what tests use of `subprocess.Popen`. It is a child of this process.

    Attributes:
        stdout: what it prints, errors too.
    """

    def __init__(self, pid: int, stdout: TextIO) -> None:
        self.pid = pid
        self.stdout = stdout
        self.returncode: int | None = None

    def poll(self) -> int | None:
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        deadline_s = None if timeout is None else time.monotonic() + timeout
        while (status := self.poll()) is None:
            if timeout is not None and deadline_s is not None and time.monotonic() > deadline_s:
                raise subprocess.TimeoutExpired(str(self.pid), timeout)
            time.sleep(POLL_S)
        return status

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(15)

    def kill(self) -> None:
        self.send_signal(9)


class Starter:
    """A warm process, which ends with this one."""

    def __init__(self) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, str(SUPPORT / "warm_process.py"), str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env=os.environ | {BLAS_THREADS: "1"},  # with more threads it could not be forked
            )
        atexit.register(self.close)

    def close(self) -> None:
        self._channel.close()
        self._process.wait()

    def start(self, command: list[str]) -> Warm:
        reading, writing = os.pipe()
        task = {
            "arguments": command[len(COMMAND) :],
            "command": command,
            "environment": dict(os.environ),
            "folder": str(Path.cwd()),
        }
        # The process that has forked it ends at once, and this one adopts it.
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        try:
            socket.send_fds(self._channel, [json.dumps(task).encode()], [writing])
            pid = int(self._channel.recv(100))
        finally:
            ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)
            os.close(writing)
        return Warm(pid, os.fdopen(reading, encoding="utf-8"))


@cache
def _starter(pid: int, path: str | None) -> Starter:
    """The one of this process and this path of modules."""
    return Starter()


def _network() -> str:
    return os.readlink("/proc/thread-self/ns/net")


NETWORK = _network()
"""That of this computer. Tests of several computers enter others."""


def started(command: list[str]) -> Warm | None:
    """The started process; None where only a start from nothing does the same."""
    if command[: len(COMMAND)] != COMMAND or _network() != NETWORK:
        return None
    return _starter(os.getpid(), os.environ.get("PYTHONPATH")).start(command)
