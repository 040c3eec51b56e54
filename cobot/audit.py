"""The audit log: an append-only file with one line of JSON per action. It contains the action, the client and
its address, the time and the result.

A thread writes the entries, so that no request waits for a disk. While the disk cannot be written, up to
`CAPACITY` entries wait. Further entries are dropped, and the file reports their number once there is room. A
client that repeats an action more than `BURST` times in a second causes one entry with the number of
repetitions. When all waiting entries have been written, the file is flushed (fdatasync). A power cut loses
only the entries that were waiting for the disk. This module is long because the guarantee covers both
recording an action and storing the record.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import pwd
import sys
import threading
import time
import zlib
from collections.abc import Callable, Hashable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cobot.access import roles
from cobot.access.roles import Identity, Role
from cobot.clock import SYSTEM, Clock
from cobot.config import Settings
from cobot.errors import AuthenticationError, InputError, PermissionDenied
from cobot.logs.files import RotatingFile, aside
from cobot.logs.lines import printable
from cobot.logs.outlet import Outlet
from cobot.logs.repeats import Repeats
from cobot.strict import shown

MAX_BYTES = 10_000_000
OLDER_FILES = 9
CAPACITY = 10_000
BURST = 20
RETRY_S = 1.0
END_S = 1.0
READ_WAIT_S = 0.3
BLOCK_BYTES = 2**16
MAX_TEXT = 300
MAX_ITEMS = 50

Entry = dict[str, Any]
log = logging.getLogger("cobot.audit")


class Audit:
    """The audit file of one service.

    Attributes:
        problem: reason why the file cannot be written now; "" if it can be written.
    """

    def __init__(self, path: Path, clock: Clock = SYSTEM) -> None:
        self._path = path
        self._clock = clock
        self._file = RotatingFile(path, MAX_BYTES, OLDER_FILES, strict=True)
        self._ending = threading.Event()
        self.problem = ""
        self._outlet = Outlet[Entry](
            self._write,
            lambda count: self._entry("cobot", "", "audit", f"{count} entries were lost", {}),
            settle=self._file.sync,
            repeats=Repeats(BURST, 1.0, time.monotonic),
            repeated=lambda last, count: {**last, "repeated": count},
            capacity=CAPACITY,
        )

    @property
    def dropped(self) -> int:
        """Number of entries lost so far."""
        return self._outlet.dropped

    def record(
        self,
        who: str,
        from_: str,
        what: str,
        outcome: str = "ok",
        *,
        request: str = "",
        kind: Hashable = None,
        **details: object,
    ) -> None:
        """Add an entry without waiting.

        Args:
            who: name of an identity.
            from_: address of the identity, or "cli".
            request: id of the request.
            kind: key that repetitions by the same client share; None means `what`.
            details: further facts: texts, numbers or lists of these.
        """
        before = self.dropped
        entry = self._entry(who, from_, what, outcome, details, request)
        self._outlet.put(entry, (who, from_.rpartition(":")[0], kind or what, outcome))
        if self.dropped != before:
            log.error("entries of the audit are lost: %s", self.problem or "the disk is too slow")

    def newest(self, limit: int, since: datetime | None = None, after: str | None = None) -> list[Entry]:
        """The newest entries, newest first. Call this in a thread, because it reads files.

        Args:
            limit: maximum number of entries.
            since: earliest time of an entry; in UTC if it contains no time zone.
            after: `id` of an entry. Only older entries are returned.

        Returns:
            The entries, each with its `id`.

        Raises:
            InputError: the time cannot be expressed in UTC, or the entry `after` does not exist.
        """
        self._outlet.wait(READ_WAIT_S)
        earliest = _earliest(since)
        found: list[Entry] = []
        for path in aside(self._path, OLDER_FILES):
            for entry in _backwards(path):
                if len(found) == limit or entry["time"] < earliest:
                    return found
                if after is None:
                    found.append({"id": _id_of(entry), **entry})
                elif after.startswith(entry["time"]) and _id_of(entry) == after:
                    after = None
        if after is not None:
            raise InputError(
                f"after: the audit has no entry {shown(after)}, which may have been removed; omit `after` "
                "for the newest"
            )
        return found

    def close(self) -> None:
        """Write the waiting entries, if the disk can be written."""
        self._ending.set()
        if self._outlet.close(END_S):
            self._file.close()

    def _write(self, entry: Entry) -> None:
        while True:
            try:
                self._file.append(_line(entry))
            except OSError as exc:
                if not self.problem:
                    log.error("the audit file cannot be written; its entries wait: %s", exc)
                self.problem = f"{self._path} cannot be written: {exc.strerror}"
                if self._ending.wait(RETRY_S):
                    raise
            else:
                self.problem = ""
                return

    def _entry(
        self, who: str, from_: str, what: str, outcome: str, details: dict[str, object], request: str = ""
    ) -> Entry:
        return _entry(self._clock.wall_ns() * 1e-9, who, from_, what, outcome, details, request)


@dataclass(slots=True)
class Trail:
    """The request or connection that the current task belongs to.

    Attributes:
        who: returns the name of the identity, which is unknown until the request is authenticated.
        tell_refused: function that reports a rejected request to other clients, with the action, a code and a
            sentence.
        changes: whether the request would move or change something.
        left_out: whether the request needs no entry because there is an entry for its effect.
    """

    audit: Audit
    who: Callable[[], str]
    from_: str
    request: str
    tell_refused: Callable[[str, str, str], None] = lambda what, code, sentence: None
    changes: bool = False
    details: dict[str, object] = field(default_factory=dict)
    left_out: bool = False


trail: ContextVar[Trail | None] = ContextVar("trail", default=None)


def note(what: str, outcome: str = "ok", **details: object) -> None:
    """Add an entry for the client whose request the current task serves.

    If there is no request, this does nothing.
    """
    on = trail.get()
    if on is not None:
        on.audit.record(on.who(), on.from_, what, outcome, request=on.request, **details)


def report_refusal(what: str, code: str, sentence: str) -> None:
    """Report to other clients that the current request, which would have moved or changed something, was
    rejected.
    """
    on = trail.get()
    if on is not None:
        on.tell_refused(what, code, sentence)


def require(identity: Identity, role: Role, *what: str) -> None:
    """Check a role like `cobot.access.roles.require`, and add an entry if the check fails.

    This is meant for messages on a connection. A single request always has an entry.
    """
    try:
        roles.require(identity, role)
    except (AuthenticationError, PermissionDenied) as exc:
        note(" ".join(what), exc.code)
        if role >= Role.OPERATOR:
            report_refusal(" ".join(what), exc.code, str(exc))
        raise


def add_details(**details: object) -> None:
    """Add details to the entry of the current request."""
    on = trail.get()
    if on is not None:
        on.details |= details


def would_change() -> None:
    """Mark the current request as one that moves or changes something, so that a refusal is reported."""
    on = trail.get()
    if on is not None:
        on.changes = True


def leave_out() -> None:
    """Suppress the entry of the current request, because the request changed nothing or there is an entry for
    its effect.
    """
    on = trail.get()
    if on is not None:
        on.left_out = True


def record_from_cli(settings: Settings, what: str, outcome: str = "ok", **details: object) -> None:
    """Add an entry for a command, under the name of the operating system user. If the entry cannot be
    written, the error is printed on stderr.
    """
    user = str(os.getuid())
    with contextlib.suppress(KeyError):
        user = pwd.getpwuid(os.getuid()).pw_name
    record_beside(settings, user, "cli", what, outcome, **details)


def record_beside(
    settings: Settings, who: str, from_: str, what: str, outcome: str = "ok", **details: object
) -> None:
    """Add an entry from a process other than the service. If the entry cannot be written, the error is
    printed on stderr.
    """
    entry = _entry(time.time(), who, from_, what, outcome, details, "")
    file = RotatingFile(settings.audit_file, sys.maxsize, 0, strict=True)  # only the service rotates files
    try:
        file.append(_line(entry))
        file.sync()
    except OSError as exc:
        print(f"cobot: {settings.audit_file} cannot be written: {exc.strerror}", file=sys.stderr)
    finally:
        file.close()


def _entry(
    time_s: float, who: str, from_: str, what: str, outcome: str, details: dict[str, object], request: str
) -> Entry:
    entry: Entry = {
        "time": _time(time_s),
        "who": printable(who, MAX_TEXT),
        "from": printable(from_, MAX_TEXT),
        "what": printable(what, MAX_TEXT),
        "outcome": printable(outcome, MAX_TEXT),
    }
    if request:
        entry["request"] = printable(request, MAX_TEXT)
    if details:
        entry["details"] = {name: _plain(value) for name, value in details.items()}
    return entry


def _plain(value: object) -> object:
    if value is None or isinstance(value, bool | int | float):
        return value
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value[:MAX_ITEMS]]
    return printable(str(value), MAX_TEXT)


def _earliest(since: datetime | None) -> str:
    if since is None:
        return ""
    try:
        aware = since if since.tzinfo else since.replace(tzinfo=UTC)
        return aware.astimezone(UTC).isoformat(timespec="milliseconds")
    except OverflowError as exc:
        raise InputError(f"since: {since.isoformat()} cannot be expressed in UTC") from exc


def _time(time_s: float) -> str:
    return datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds")


def _line(entry: Entry) -> bytes:
    return json.dumps(entry).encode() + b"\n"


def _id_of(entry: Entry) -> str:
    """The id of an entry. It consists of the time and a checksum, because several entries may have the same
    time.
    """
    return f"{entry['time']}-{zlib.crc32(json.dumps(entry, sort_keys=True).encode()):08x}"


def _backwards(path: Path) -> Iterator[Entry]:
    """The entries of a file, last first. Invalid lines are skipped."""
    try:
        file = path.open("rb")
    except OSError:
        return
    with file:
        position = file.seek(0, os.SEEK_END)
        rest = b""
        while position or rest:
            start = max(position - BLOCK_BYTES, 0)
            file.seek(start)
            first, *lines = (file.read(position - start) + rest).split(b"\n")
            position, rest = start, first
            if not position:
                lines, rest = [first, *lines], b""
            for line in reversed(lines):
                with contextlib.suppress(ValueError):
                    entry = json.loads(line)
                    if isinstance(entry, dict) and isinstance(entry.get("time"), str):
                        yield entry
