"""A process that reads possibly hostile files, meshes and MJCF, with bounded memory and time.

A request and its answer are one line of JSON each. A worker that takes too long is killed. A worker that
needs too much memory or crashes ends. The next request starts a new worker.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from cobot.errors import ConfigError

MODULE = "cobot.launch.robot_file.worker_main"
MAX_MEMORY_GB = 4
TIMEOUT_S = 120.0
"""Timeout of one request, in seconds."""


class Worker:
    """A worker process. Use it as a context; the process ends with the context."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def ask(self, task: str, timeout_s: float = TIMEOUT_S, **arguments: Any) -> dict[str, Any]:
        """Send a task of `worker_main` and return its answer.

        Raises:
            ConfigError: the task failed. The message gives the reason without the file's name.
        """
        process = self._process or self._start()
        stdin, stdout = process.stdin, process.stdout
        assert stdin is not None
        assert stdout is not None
        try:
            stdin.write(json.dumps({"task": task, **arguments}).encode() + b"\n")
            stdin.flush()
            answer = json.loads(_line(stdout, timeout_s))
        except TimeoutError as exc:
            self._end()
            raise ConfigError(f"takes longer than {timeout_s:g} s; simplify it") from exc
        except (OSError, ValueError) as exc:
            self._end()
            raise ConfigError(
                f"cannot be loaded with {MAX_MEMORY_GB} GB of memory, or is damaged; simplify or repair it"
            ) from exc
        if error := answer.get("error"):
            raise ConfigError(error)
        return dict(answer)

    def _start(self) -> subprocess.Popen[bytes]:
        self._folder = tempfile.TemporaryDirectory()  # MuJoCo writes its log to the current folder
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-m", MODULE, str(MAX_MEMORY_GB)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            cwd=self._folder.name,
            env=environment | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        return self._process

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None


def _line(stream: IO[bytes], timeout_s: float) -> bytes:
    """Read a line before the deadline. The line is incomplete if the process has ended."""
    end, content = time.monotonic() + timeout_s, b""
    while not content.endswith(b"\n"):
        ready, _, _ = select.select([stream], [], [], max(0.0, end - time.monotonic()))
        if not ready:
            raise TimeoutError
        read = os.read(stream.fileno(), 1 << 16)
        if not read:
            break
        content += read
    return content


def absolute(file: Path) -> str:
    """Make a path absolute for a worker, which runs in a different folder."""
    return str(file.absolute())
