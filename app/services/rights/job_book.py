"""Keeps one robot's active jobs and its newest finished jobs.

The records are in a JSON Lines file of limited size, so they survive a restart of the service, although
motions do not. Each job is written when it begins and when it ends. A job without an end in the file was
interrupted by the end of the service.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections import OrderedDict
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from pydantic import TypeAdapter, ValidationError

from app.services.clients import CLIENT
from app.services.rights.job import ENDS, MAX_REQUEST, Job, JobError, JobKind, JobRecord, JobState, new_job_id
from app.services.state.link import RobotLink
from cobot.clock import utc_now
from cobot.errors import NotFoundError
from cobot.logs.files import RotatingFile, aside
from cobot.logs.lines import printable
from cobot.logs.outlet import Outlet
from cobot.strict import shown

KEPT = 1000
"""Maximum number of finished jobs that are kept."""
MAX_BYTES = 4_000_000
OLDER_FILES = 1
AGAIN_AFTER = 500
"""Number of lines after which unfinished jobs are written again, so that they are not dropped with the oldest
lines.
"""
END_S = 1.0

log = logging.getLogger("cobot.jobs")
_RECORD = TypeAdapter(JobRecord)


class _Piece(NamedTuple):
    """Lines to write to the file.

    Attributes:
        number: number of changes to the book when the lines were made.
        whole: whether the lines contain all jobs at that time.
    """

    number: int
    lines: bytes
    whole: bool = False


class JobBook:
    """The jobs of one robot; see the module.

    Args:
        file: file for the records; None to keep them only in memory.

    Attributes:
        ending: whether the service is shutting down. Jobs that end during shutdown are recorded as
            interrupted.
    """

    def __init__(self, link: RobotLink, file: Path | None = None) -> None:
        self._link = link
        self._live: dict[str, Job] = {}
        self._past: OrderedDict[str, JobRecord] = OrderedDict()
        self._lines: OrderedDict[str, bytes] = OrderedDict()
        self._written = 0
        self._whole = 0
        """Number of the change up to which the file is complete."""
        self._told = False
        self.ending = False
        self._path = file
        self._file: RotatingFile | None = None
        self._outlet: Outlet[_Piece] | None = None
        if file is not None:
            self._file = RotatingFile(file, MAX_BYTES, OLDER_FILES, strict=True)
            # Records that cannot be written stay in memory. Once the disk has space, the whole book is
            # written again.
            self._outlet = Outlet(self._append, self._everything, settle=self._file.sync)
            self._read(file)

    @property
    def problem(self) -> str:
        """Reason why jobs cannot be recorded now; "" if they can be recorded."""
        if self._outlet is None or not self._outlet.error:
            return ""
        reason = os.strerror(self._outlet.error) if self._outlet.error > 0 else "its log has the details"
        return f"jobs cannot be recorded: {self._path}: {reason}"

    def new(
        self, kind: JobKind, request: str = "", parent: str | None = None, number: str | None = None
    ) -> Job:
        """Create a new job for the client of the current task. It is added to the book when it begins.

        Args:
            number: job id; None to make a new id.
        """
        request, owner = printable(request, MAX_REQUEST), printable(str(CLIENT.get()), MAX_REQUEST)
        number, created_at = number or new_job_id(), utc_now(self._link.clock)
        return Job(self._link, kind, request, owner, self._note_change, number, created_at, parent)

    def records(self, count: int, states: frozenset[JobState] = frozenset(JobState)) -> list[JobRecord]:
        """Return the newest jobs in one of these states, newest first."""
        found = [job.record() for job in reversed(self._live.values()) if job.state in states]
        for record in reversed(self._past.values()):
            if len(found) >= count:
                break
            if record.state in states:
                found.append(record)
        return found[:count]

    def live(self, number: str) -> Job | None:
        """Return a job that has not ended; None if there is no such job."""
        return self._live.get(number)

    def find(self, number: str) -> JobRecord | None:
        """Return a record of a job's current state; None if the job is unknown or has expired."""
        job = self._live.get(number)
        return self._past.get(number) if job is None else job.record()

    def report_pause(self) -> None:
        """Report the beginning or the end of a pause, for all jobs that it affects."""
        for job in list(self._live.values()):
            if job.state is not JobState.QUEUED:
                self._publish(job.record())

    def close(self) -> None:
        """Write the pending lines. Lines that the disk does not accept in time are lost."""
        if self._outlet is not None and self._file is not None and self._outlet.close(END_S):
            self._file.close()

    def _note_change(self, job: Job) -> None:
        record = job.record()
        if record.state in ENDS:
            self._live.pop(job.id, None)
            self._keep(record)
        else:
            self._live[job.id] = job
        self._write(record)
        self._publish(record)

    def _publish(self, record: JobRecord) -> None:
        error = record.error
        self._link.events.publish(
            "job",
            job=record.id,
            kind=record.kind.value,
            state=record.state.value,
            owner=record.owner,
            parent=record.parent,
            motion=record.motion_id,
            error=None if error is None else error.detail,
            code=None if error is None else error.code,
            details=None if error is None else dict(error.details),
        )

    def _keep(self, record: JobRecord) -> None:
        self._past[record.id] = record
        while len(self._past) > KEPT:
            oldest, _ = self._past.popitem(last=False)
            self._lines.pop(oldest, None)

    def _write(self, record: JobRecord) -> None:
        if self._outlet is None:
            return
        line = self._lines[record.id] = _RECORD.dump_json(record, exclude_defaults=True) + b"\n"
        self._lines.move_to_end(record.id)
        self._written += 1
        self._outlet.put(_Piece(self._written, line))
        if self._written % AGAIN_AFTER == 0 and self._live:
            again = b"".join(self._lines[number] for number in self._live if number in self._lines)
            self._outlet.put(_Piece(self._written, again))
        if self.problem and not self._told:
            log.error("%s%s", self._link.label, self.problem)
        self._told = bool(self.problem)

    def _append(self, piece: _Piece) -> None:
        """Append a piece to the file. Called in the writing thread.

        A piece that waited while the whole book was rewritten is dropped, because it is out of date: it may
        list ended jobs as active.
        """
        assert self._file is not None
        if piece.number > self._whole or piece.whole:
            # line by line, because together they may exceed the size of one file
            for line in piece.lines.splitlines(keepends=True):
                self._file.append(line)
        if piece.whole:
            self._whole = piece.number

    def _everything(self, lost: int) -> _Piece:
        """Create lines for all records, because some lines were lost. Called in the writing thread."""
        del lost
        number = self._written  # read first, because later changes have their own lines
        lines = dict(self._lines)
        # active jobs last, because they are the newest
        live = [lines.pop(job) for job in list(self._live) if job in lines]
        return _Piece(number, b"".join([*lines.values(), *live]), whole=True)

    def _read(self, file: Path) -> None:
        found: OrderedDict[str, JobRecord] = OrderedDict()
        now = utc_now(self._link.clock)
        alive = now
        with contextlib.suppress(OSError):  # there is no file yet
            alive = min(datetime.fromtimestamp(file.stat().st_mtime, UTC), now)
        for path in reversed(aside(file, OLDER_FILES)):
            with contextlib.suppress(OSError), path.open("rb") as lines:
                for line in lines:
                    with contextlib.suppress(ValidationError):  # an incomplete line, or a different format
                        record = _RECORD.validate_json(line)
                        found[record.id] = record
                        found.move_to_end(record.id)
        for record in list(found.values())[-KEPT:]:
            if record.state not in ENDS:
                record = _interrupted(record, alive, now)
                log.warning("%sjob %s (%s) was interrupted", self._link.label, record.id, record.kind)
                self._write(record)
            self._keep(record)


def _interrupted(record: JobRecord, alive: datetime, found: datetime) -> JobRecord:
    """Create the last record of a job whose end was not written.

    Args:
        alive: time at which the service last wrote a record of any job.
        found: time at which the interruption was noticed: now.
    """
    ended_at = max(alive, record.started_at or record.created_at)
    sentence = (
        f"the service ended during this job, after {ended_at:%Y-%m-%d %H:%M:%S} UTC; its next start noticed "
        f"this at {found:%Y-%m-%d %H:%M:%S} UTC"
    )
    error = JobError(sentence, "interrupted")
    return replace(
        record,
        state=JobState.INTERRUPTED,
        remaining_s=None,
        error=error,
        ended_at=ended_at,
        actions=tuple(
            each if each.fired or each.problem or not record.started_at else replace(each, fired=None)
            for each in record.actions
        ),
        waits_for="",
    )


def unknown(number: str) -> NotFoundError:
    """Create the error for a job id that does not exist."""
    return NotFoundError(
        f"there is no job {shown(number)}; only the newest {KEPT} ended jobs are kept, and GET /jobs "
        "lists them"
    )
