"""One line of a log: what is in it, how it is written, and that nothing in it can look like another line."""

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
"""Begins each line that a process sends to the supervisor, as in RFC 7464. JSON has it nowhere else; what
does not begin with it, or is no JSON, is taken for text that somebody has printed."""

log_context: ContextVar[dict[str, str]] = ContextVar("log_context", default={})  # noqa: B039  never changed
"""What the lines of this task are about: of `IDS` those that are known."""


def printable(text: str, max_characters: int = MAX_MESSAGE) -> str:
    """The text in one line: whatever moves a cursor, ends a line, turns its direction or is invisible is
    written as an escape, and what is longer is cut.
    """
    cut = text[: max_characters + 1]
    if not cut.isprintable():
        cut = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in cut)
    if len(cut) <= max_characters:
        return cut
    return f"{cut[:max_characters]}... ({len(text)} characters)"


def bind(**ids: object) -> None:
    """Say what this task, and those that it starts from now on, are about.

    Args:
        ids: some of `IDS`; None for no longer.
    """
    about = log_context.get() | {name: printable(str(each), MAX_ID) for name, each in ids.items()}
    log_context.set({name: each for name, each in about.items() if ids.get(name, each) is not None})


@contextmanager
def bound(**ids: object) -> Iterator[None]:
    """The same, for as long as the context lasts."""
    before = log_context.get()
    bind(**ids)
    try:
        yield
    finally:
        log_context.set(before)


@dataclass(frozen=True, slots=True)
class Line:
    """A line.

    Attributes:
        process: who says it; "" for the supervisor.
        ids: of what it is about, by their names in `IDS`.
        traceback: its lines, each in `printable` form.
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
        """Of a record, in the context of the one who logs."""
        try:
            message = record.getMessage()
        except Exception as exc:  # noqa: BLE001  a mistake in a line of a log ends nothing
            message = f"{record.msg!r} with arguments that do not fit it: {exc}"
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
        """What a process has written to its output: a line of its log, or anything."""
        try:
            if text[:1] != RECORD_SEPARATOR:
                raise ValueError("a line of somebody else's")
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
        """As one JSON object."""
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
        """For the supervisor."""
        return RECORD_SEPARATOR + self.json()

    def text(self, *, timed: bool = True) -> bytes:
        """For people. Only what begins in the first column is a line: tracebacks are indented below theirs.

        Args:
            timed: with time and level; a terminal shows the supervisor's lines without.
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
    """The pieces of a line into whose middle a process has written another."""
    first, *others = text.split(RECORD_SEPARATOR)
    return [*([first] if first.strip() else []), *(RECORD_SEPARATOR + other for other in others)]


def _traceback(record: logging.LogRecord) -> list[str]:
    if not record.exc_info or record.exc_info[1] is None:
        return []
    lines = "".join(traceback.format_exception(record.exc_info[1])).split("\n")
    return [printable(line, MAX_TRACEBACK_LINE) for line in lines[-MAX_TRACEBACK_LINES:] if line]
