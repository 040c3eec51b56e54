"""The log of a process. Log lines, warnings and printed text, including those of libraries, never block the
process.
"""

from __future__ import annotations

import atexit
import contextlib
import faulthandler
import io
import logging
import os
import sys
import threading
import time
from dataclasses import replace
from types import TracebackType
from typing import TYPE_CHECKING

from cobot.logs.lines import Line
from cobot.logs.outlet import Outlet, write_all
from cobot.logs.repeats import Repeats

if TYPE_CHECKING:
    from cobot.config import LoggingSection

SUPERVISED = "COBOT_SUPERVISED"
"""Environment variable that tells a process to write `Line.wire`, because the supervisor reads its output."""
BURST = 50
INTERVAL_S = 10.0
"""Interval in which one client may cause at most `BURST` lines from one place in the source, in seconds."""
END_S = 1.0
"""Timeout for writing the last lines when a process ends, in seconds."""
MAX_PRINTED = 4000

log = logging.getLogger("cobot")


class ProcessLog(logging.Handler):
    """Passes log lines to a thread that writes them to a descriptor."""

    def __init__(self, process: str, form: str, descriptor: int) -> None:
        """Create the log.

        Args:
            form: a form of `Line`: "text", "json" or "wire".
        """
        super().__init__()
        self._process = process
        self._outlet = Outlet[Line](
            lambda line: write_all(descriptor, getattr(line, form)()),
            lambda count: self._own(f"{count} lines of this log were lost: its reader is too slow"),
            repeats=Repeats(BURST, INTERVAL_S, time.monotonic),
            repeated=lambda line, count: replace(
                line, message=f"{count} more lines like this were suppressed: {line.message}", traceback=[]
            ),
        )

    @property
    def dropped(self) -> int:
        """Number of lines lost so far."""
        return self._outlet.dropped

    def emit(self, record: logging.LogRecord) -> None:
        line = Line.of(record, self._process)
        self._outlet.put(line, (record.name, record.pathname, record.lineno, line.ids.get("client")))

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802
        """Print nothing, because printed text would become a log line again."""

    def close(self) -> None:
        self._outlet.close(END_S)
        super().close()

    def _own(self, message: str) -> Line:
        return Line(time.time(), "WARNING", self._process, "cobot.logs", message)


class _Printed(io.TextIOBase):
    """Converts printed text to log lines, so that printing never waits for the process's own streams."""

    def __init__(self, name: str, level: int, descriptor: int) -> None:
        self._log = logging.getLogger(name)
        self._level = level
        self._descriptor = descriptor
        self._begun = ""

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return "utf-8"

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def write(self, text: str) -> int:
        *lines, rest = (self._begun + text).split("\n")
        if len(rest) > MAX_PRINTED:
            lines, rest = [*lines, rest], ""
        self._begun = rest
        for line in lines:
            if line:
                self._log.log(self._level, "%s", line)
        return len(text)


_installed: list[ProcessLog] = []


def start_logging(process: str, settings: LoggingSection | None = None) -> None:
    """Let a thread write all log lines and printed text of this process. Call it once, early.

    Args:
        process: display name of the process.
        settings: the settings, or None if they are not known yet. A later call with settings sets the level.
    """
    root = logging.getLogger()
    root.setLevel(settings.level.upper() if settings else logging.INFO)
    if _installed:
        return
    form = "wire" if SUPERVISED in os.environ else settings.format if settings else "text"
    made = ProcessLog(process, form, os.dup(1))
    _installed.append(made)
    root.handlers[:] = [made]
    logging.captureWarnings(True)
    with contextlib.suppress(OSError, ValueError):
        faulthandler.enable(2)  # does not use Python's streams and never blocks: see `Child.start`
    sys.stdout, sys.stderr = _Printed("stdout", logging.INFO, 1), _Printed("stderr", logging.WARNING, 2)
    sys.excepthook = _uncaught
    threading.excepthook = _uncaught_in_thread
    atexit.register(made.close)


def dropped() -> int:
    """Number of lines that this process has lost."""
    return sum(each.dropped for each in _installed)


def _uncaught(kind: type[BaseException], exc: BaseException, where: TracebackType | None) -> None:
    if not issubclass(kind, KeyboardInterrupt):
        log.critical("this process ends because of an error", exc_info=(kind, exc, where))


def _uncaught_in_thread(found: threading.ExceptHookArgs) -> None:
    if found.exc_value is not None and not isinstance(found.exc_value, SystemExit):
        name = found.thread.name if found.thread else "?"
        log.critical("thread %s ends because of an error", name, exc_info=found.exc_value)
