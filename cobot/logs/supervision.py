"""The supervisor's log. It writes the lines of all processes to a file and to the terminal of `cobot run`.
The file and the terminal do not wait for each other, and no process waits for either of them.
"""

from __future__ import annotations

import logging
import mmap
import os
import signal
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from cobot.config import LoggingSection
from cobot.errors import ConfigError
from cobot.logs.files import RotatingFile
from cobot.logs.lines import Line, separated
from cobot.logs.outlet import Outlet, write_all

LOG_BYTES = 10_000_000
LOG_FILES = 3
END_S = 1.0
LINE_BYTES = 2**17
LOSSES = struct.Struct("3q")
"""Memory layout of the losses that the service reports in its health: number of lines that the file has lost,
number of lines that the terminal has lost, and errno of the file.
"""


class SupervisorLog(logging.Handler):
    """Writes the lines of the child processes and of the supervisor itself."""

    def __init__(self, settings: LoggingSection, file: RotatingFile) -> None:
        super().__init__()
        as_json = settings.format == "json"
        self._descriptor = os.memfd_create("cobot-losses")
        os.ftruncate(self._descriptor, LOSSES.size)
        self._losses = mmap.mmap(self._descriptor, LOSSES.size)
        self._file = Outlet[Line](
            lambda line: file.append(line.json() if as_json else line.text()),
            lambda count: _lost(count, "log file"),
            settle=self._publish,
        )
        self._terminal = Outlet[Line](
            lambda line: write_all(1, line.json() if as_json else line.text(timed=False)),
            lambda count: _lost(count, "output"),
        )

    @property
    def losses(self) -> int:
        """Descriptor of the memory that contains the losses. The service inherits this descriptor."""
        return self._descriptor

    def emit(self, record: logging.LogRecord) -> None:
        self._put(Line.of(record, ""))

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Do nothing, because there is nowhere left to report the error."""

    def follow(self, name: str, output: BinaryIO, heard: Callable[[str], None]) -> threading.Thread:
        """Read the lines of a child until its output ends. A thread reads them, so that the child never
        waits.

        Args:
            heard: called with the message of each line.
        """

        def read() -> None:
            with output:
                while text := output.readline(LINE_BYTES):
                    for piece in separated(text):
                        line = Line.parsed(piece, name)
                        heard(line.message)
                        self._put(line)

        thread = threading.Thread(target=read, name=f"output of {name}", daemon=True)
        thread.start()
        return thread

    def close(self) -> None:
        self._file.close(END_S)
        self._terminal.close(END_S)
        super().close()

    def _put(self, line: Line) -> None:
        self._file.put(line)
        self._terminal.put(line)
        self._publish()

    def _publish(self) -> None:
        LOSSES.pack_into(self._losses, 0, self._file.dropped, self._terminal.dropped, self._file.error)


class SupervisorLosses:
    """Reads the supervisor's losses in another process."""

    def __init__(self, descriptor: int | None) -> None:
        self._memory = None if descriptor is None else mmap.mmap(descriptor, LOSSES.size, prot=mmap.PROT_READ)

    def read(self) -> tuple[int, int, int]:
        """Return three numbers: the lines that the log file has lost, the lines that the terminal has lost,
        and the errno of the last failure to write the file. All are 0 if there is no supervisor.
        """
        if self._memory is None:
            return 0, 0, 0
        file, terminal, error = LOSSES.unpack_from(self._memory)
        return file, terminal, error


@contextmanager
def supervising(settings: LoggingSection, path: Path) -> Iterator[SupervisorLog]:
    """Context manager that installs the supervisor's log.

    Raises:
        ConfigError: the log file cannot be written.
    """
    file = RotatingFile(path, LOG_BYTES, LOG_FILES)
    try:
        file.open()
    except OSError as exc:
        raise ConfigError(f"logs: cannot write to {path.parent}: {exc.strerror}") from exc
    made = SupervisorLog(settings, file)
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)  # else a terminal may stop a background process that writes
    log = logging.getLogger("cobot")
    log.setLevel(settings.level.upper())
    log.handlers[:] = [made]
    try:
        yield made
    finally:
        made.close()


def _lost(count: int, where: str) -> Line:
    return Line(time.time(), "WARNING", "", "cobot.logs", f"{count} lines did not reach the {where}")
