"""One line of a log: its content and its formats. No content can look like a different line."""

from __future__ import annotations

import json
import logging
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

MAX_MESSAGE = 2000
MAX_ID = 64
MAX_TRACEBACK_LINES = 60
MAX_TRACEBACK_LINE = 300
SHOWN_IDS = ("request", "motion", "session")
IDS = (*SHOWN_IDS, "client")

RECORD_SEPARATOR = b"\x1e"
"""First byte of each line that a process sends to the supervisor, as in RFC 7464. JSON text never contains
it. A line without it, or without valid JSON, is treated as printed text.
"""

log_context: ContextVar[dict[str, str]] = ContextVar("log_context", default={})  # noqa: B039  never changed
"""Ids that are added to each line of the current task, by their names in `IDS`."""


def printable(text: str, max_characters: int = MAX_MESSAGE) -> str:
    """The text in one line. Escapes replace characters that move the cursor, end the line, change its
    direction or are invisible. A longer text is cut off.
    """
    cut = text[: max_characters + 1]
    if not cut.isprintable():
        cut = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in cut)
    if len(cut) <= max_characters:
        return cut
    return f"{cut[:max_characters]}... ({len(text)} characters)"


def bind(**ids: object) -> None:
    """Add ids to the log lines of this task, and of the tasks that it starts later.

    Args:
        ids: values by names in `IDS`; None removes an id.
    """
    about = log_context.get() | {name: printable(str(each), MAX_ID) for name, each in ids.items()}
    log_context.set({name: each for name, each in about.items() if ids.get(name, each) is not None})


@contextmanager
def add_ids(**ids: object) -> Iterator[None]:
    """Context manager that adds ids to the log lines of this task."""
    before = log_context.get()
    bind(**ids)
    try:
        yield
    finally:
        log_context.set(before)


@dataclass(frozen=True, slots=True)
class Line:
    """A line of the log.

    Attributes:
        process: process that has logged the line; "" for the supervisor.
        ids: ids of the line's context, by their names in `IDS`.
        traceback: lines of the traceback, each in `printable` form.
    """

    time_s: float
    level: str
    process: str
    logger: str
    message: str
    ids: dict[str, str] = field(default_factory=dict)
    traceback: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, record: logging.LogRecord, process: str) -> Line:
        """The line for a log record, with the ids of the current context."""
        try:
            message = record.getMessage()
        except Exception as exc:  # noqa: BLE001  a wrong log call must not end its caller
            message = f"{record.msg!r} cannot be formatted with its arguments: {exc}"
        ids = log_context.get()
        return cls(
            record.created,
            record.levelname,
            process,
            record.name,
            printable(message),
            ids,
            _traceback(record),
        )

    @classmethod
    def parsed(cls, text: bytes, process: str) -> Line:
        """Convert a piece of a process's output to a line. The output may be a line of the process's log or
        any other text.
        """
        try:
            if text[:1] != RECORD_SEPARATOR:
                raise ValueError("not a line of a log")
            sent: dict[str, Any] = json.loads(text[1:])
            told = sent["process"]
            return cls(
                datetime.fromisoformat(sent["time"]).timestamp(),
                printable(sent["level"], MAX_ID),
                process if process.startswith(told) else f"{process}, {printable(told, MAX_ID)}",
                printable(sent["logger"], MAX_ID),
                printable(sent["message"], MAX_MESSAGE + MAX_ID),
                {name: printable(sent[name], MAX_ID) for name in IDS if name in sent},
                [printable(line, MAX_MESSAGE) for line in sent.get("traceback", ())],
            )
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            message = printable(text.decode("utf-8", "replace").strip("\r\n"))
            return cls(datetime.now(UTC).timestamp(), "INFO", process, "output", message)

    def json(self) -> bytes:
        """The line as one JSON object."""
        content: dict[str, object] = {
            "time": datetime.fromtimestamp(self.time_s, UTC).isoformat(timespec="milliseconds"),
            "level": self.level,
            "process": self.process,
            "logger": self.logger,
            "message": self.message,
            **self.ids,
        }
        if self.traceback:
            content["traceback"] = self.traceback
        return json.dumps(content, ensure_ascii=False).encode() + b"\n"

    def wire(self) -> bytes:
        """The line in the form that the supervisor reads."""
        return RECORD_SEPARATOR + self.json()

    def text(self, *, timed: bool = True) -> bytes:
        """The line as human-readable text. Lines begin in the first column; tracebacks are indented.

        Args:
            timed: whether the text contains a time and a level. On a terminal, the supervisor's lines contain
                neither.
        """
        about = " ".join(f"{name}={self.ids[name]}" for name in SHOWN_IDS if name in self.ids)
        said = f"{self.message} [{about}]" if about else self.message
        if self.process:
            said = f"{self.process}: {said}" if timed else f"{self.process}: {self.level} {said}"
        if timed:
            moment = datetime.fromtimestamp(self.time_s, UTC).astimezone()
            said = f"{moment.isoformat(timespec='milliseconds')} {self.level} {said}"
        return "\n    | ".join([said, *self.traceback]).encode() + b"\n"


def separated(text: bytes) -> list[bytes]:
    """Split a piece of output into its lines. A line may begin in the middle of another process's line."""
    first, *others = text.split(RECORD_SEPARATOR)
    return [*([first] if first.strip() else []), *(RECORD_SEPARATOR + other for other in others)]


def _traceback(record: logging.LogRecord) -> list[str]:
    if not record.exc_info or record.exc_info[1] is None:
        return []
    lines = "".join(traceback.format_exception(record.exc_info[1])).split("\n")
    return [printable(line, MAX_TRACEBACK_LINE) for line in lines[-MAX_TRACEBACK_LINES:] if line]
