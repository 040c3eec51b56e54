"""A running study: its process, and the reports from this process."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field, replace
from typing import Any

from app.services.programs.study_files import StudyStatus
from app.services.rights.job import Job
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    LimitError,
    MotionStopped,
    NotSupportedError,
    UnavailableError,
)
from cobot.launch.process import RUN_MODULE

LINE_BYTES = 4_000_000
PROCESS = "cobot.studies.served"
_ERRORS: dict[str, type[CobotError]] = {
    kind.code: kind
    for kind in (
        ConflictError,
        InputError,
        LimitError,
        NotSupportedError,
        UnavailableError,
    )
}
"""Errors that the process reports, by code. Any other code means that the study is not possible with this
robot.
"""
Keep = Callable[[StudyStatus], Awaitable[None]]


@dataclass(eq=False, slots=True)
class StudyRun:
    """A running study.

    Attributes:
        known: event that is set once the folder is known, or once the study has failed, so that the next
            study may start.
        error: reason for the failure; None unless the study has failed.
        cancelled: reason for a cancellation.
    """

    request: dict[str, Any]
    status: StudyStatus
    job: Job
    known: asyncio.Event = field(default_factory=asyncio.Event)
    error: CobotError | None = None
    ended: bool = False
    cancelled: MotionStopped | None = None
    process: asyncio.subprocess.Process | None = None

    async def compute(self, keep: Keep) -> None:
        """Start the process, and follow it to its end.

        Args:
            keep: function that is called with the status once the folder of the study is known.
        """
        self.process = await asyncio.create_subprocess_exec(
            *RUN_MODULE,
            PROCESS,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            start_new_session=True,
            limit=LINE_BYTES,
        )
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            # set while the process was being started
            if self.cancelled is not None or self.error is not None:
                return
            with contextlib.suppress(ConnectionError):
                self.process.stdin.write(json.dumps(self.request).encode())
                await self.process.stdin.drain()
                self.process.stdin.close()
            while (line := await self.process.stdout.readline()) and await self._take(json.loads(line), keep):
                pass
        except ValueError:  # a line longer than LINE_BYTES, or the last line of a killed process
            self.error = self.error or ExecutionError("the answer of the study is too large or incomplete")
        finally:
            self.kill()
            await self.process.wait()

    async def _take(self, line: dict[str, Any], keep: Keep) -> bool:
        """Handle a line from the process; see `cobot.studies.served`. Returns whether more lines may
        follow.
        """
        status = self.status
        if (error := line.get("error")) is not None:
            kind = _ERRORS.get(error["code"], ExecutionError if status.id else InputError)
            self.error = kind(error["detail"])
        elif (end := line.get("end")) is not None:
            whole = end["done"] == end["tasks"]
            reason = "" if whole else end["reason"] or "cancelled"
            self.ended = True
            self.status = replace(
                status,
                state="finished" if whole else "partial",
                reason=reason,
                answer=end["answer"],
                done=end["done"],
                placement=end["placement"],
            )
        else:
            known = {
                name: line[name]
                for name in ("id", "tasks", "done", "rate_hz", "left_s", "answer", "maps")
                if name in line
            }
            self.status = replace(status, **known)
            if "id" in line:
                await keep(self.status)
                self.known.set()
        self.job.at_waypoint(self.status.done, self.status.tasks)
        return error is None

    def kill(self) -> None:
        """Kill the process and its workers, which belong to the same process session."""
        if self.process is not None and self.process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
