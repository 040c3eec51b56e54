"""Studies that clients request. Each runs in a separate process with the lowest priority, and writes to a
folder.

The folder's name is a hash of the question, the robot, its tool and its scene. If the same study is requested
again, it continues where it ended, regardless of why it ended.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from app.services.programs.study_files import MAP, StudyFiles, StudyStatus
from app.services.programs.study_run import StudyRun
from app.services.rights.job import Job, JobKind
from app.services.rights.ownership import Ownership
from cobot.cell.surroundings import tool_file
from cobot.config import Settings
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    MotionStopped,
    NotFoundError,
    UnavailableError,
)
from cobot.launch.process import Niceness
from cobot.logs.lines import printable
from cobot.robot.kept import read_kept

MAX_STUDIES = 30
MAX_TASKS = 300_000
MAX_TOTAL_BYTES = 1_000_000_000
"""Maximum total size of a robot's studies, in bytes."""
MIN_BYTES = 10_000_000
"""Part of `MAX_TOTAL_BYTES` that must be free when a study starts, in bytes."""
MAX_STARTS = 3
"""Maximum number of times that a study's process is started, if it is repeatedly killed."""
END_S = 5.0
"""Timeout for a cancelled study to write its partial answer, in seconds."""
ENDED = "the service ended before the study did"
log = logging.getLogger("cobot.studies")


class StudyService:
    """The studies of one robot.

    Args:
        config: settings file; None for the file that ships with cobot.
        turn: lock that is held while a study for any robot is running.

    Attributes:
        niceness: niceness of the computing processes.
    """

    def __init__(
        self, settings: Settings, config: Path | None, ownership: Ownership, turn: asyncio.Lock
    ) -> None:
        self._settings = settings
        self._config = config
        self._ownership = ownership
        self._turn = turn
        self._run: StudyRun | None = None
        self._task: asyncio.Task[None] | None = None
        self.files = StudyFiles(settings.studies_folder)
        self.niceness = Niceness.STUDY

    async def start(
        self, document: dict[str, Any], stored: tuple[str, str] | None, max_s: float, timeout_s: float
    ) -> StudyStatus:
        """Start or continue a study. Returns once its tasks are known.

        Args:
            document: the study as in a study file, without references to files.
            stored: text and file name of the stored program that the study refers to.
            max_s: maximum duration of this run, s.

        Raises:
            ConflictError: another study is running, or there are too many studies.
            CobotError: the study is invalid.
            UnavailableError: the process of the study cannot be started, or does not answer in time.
        """
        if self._turn.locked():
            raise ConflictError(
                "another study is running; wait for it, or cancel its job", details={"cause": "runs"}
            )
        await self._turn.acquire()  # `_follow` releases the lock
        try:
            request = await asyncio.to_thread(self._request, document, stored, max_s)
        except BaseException:
            self._turn.release()
            raise
        question = printable(str(document["question"]), 500)
        job = self._ownership.new_job(JobKind.STUDY, question)
        began = job.record().created_at.isoformat()
        status = StudyStatus("", question, str(document["kind"]), document, job.owner, began, job=job.id)
        run = self._run = StudyRun(request, status, job)
        job.begin(self._ownership.speed_override)
        job.start()
        self._task = asyncio.create_task(self._follow(run), name="study")
        try:
            await asyncio.wait_for(run.known.wait(), timeout_s)
        except TimeoutError:
            run.error = UnavailableError(f"the study did not begin within {timeout_s:g} s; try again later")
            run.kill()
            raise run.error from None
        if run.error is not None and not run.status.id:
            raise run.error
        return run.status

    async def all(self) -> list[StudyStatus]:
        """List all studies, newest first."""
        found = await asyncio.to_thread(self.files.all)
        return [self._with_run(each) for each in found]

    async def read(self, study: str) -> StudyStatus:
        """Return one study.

        Raises:
            NotFoundError: there is no such study.
        """
        return self._with_run(await asyncio.to_thread(self.files.read, study))

    async def file(self, study: str, *names: str) -> Path:
        """Return the first of the given files that exists for the study.

        Raises:
            NotFoundError: there is no such study, or none of these files exists yet.
        """
        status = await self.read(study)
        for name in names:
            if (path := self.files.folder / status.id / name).is_file():
                return path
        raise NotFoundError(
            f"study {study} has no such results yet: {status.done} of {status.tasks} tasks are done"
        )

    async def delete(self, study: str) -> None:
        """Delete a study with its results.

        Raises:
            NotFoundError: there is no such study.
            ConflictError: the study is running.
            UnavailableError: the files cannot be deleted.
        """
        if (await self.read(study)).state == "running":
            raise ConflictError(f"study {study} is running: cancel its job first", details={"cause": "runs"})
        await asyncio.to_thread(self.files.delete, study)

    def cancel(self, job: Job, cause: MotionStopped) -> bool:
        """End the study of this job with a partial answer. Return whether the job belongs to a study."""
        run = self._run
        if run is None or run.job is not job:
            return False
        run.cancelled = run.cancelled or cause
        if run.process is not None:
            with contextlib.suppress(ProcessLookupError):
                run.process.terminate()
            asyncio.get_running_loop().call_later(END_S, run.kill)
        return True

    async def close(self) -> None:
        """End the running study at once; it can be continued later."""
        if self._run is not None:
            self._run.kill()
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait({self._task})

    def _request(
        self, document: dict[str, Any], stored: tuple[str, str] | None, max_s: float
    ) -> dict[str, Any]:
        used = self.files.total_bytes
        if used > MAX_TOTAL_BYTES - MIN_BYTES:
            raise ConflictError(
                f"studies take {used} bytes, allowed: {MAX_TOTAL_BYTES}; delete some with DELETE /studies/ID",
                details={"cause": "full"},
            )
        copies = {"tool_file": json.dumps(asdict(tool_file(self._settings).read()))}
        for key, path in (("scene", self._settings.scene_file), ("positions", self._settings.positions_file)):
            with contextlib.suppress(FileNotFoundError):
                copies[key] = read_kept(path).decode()
        return {
            "parent": os.getpid(),
            "document": document,
            "stored": stored,
            "base": str(self.files.folder),
            "copies": copies,
            "settings": None if self._config is None else str(self._config),
            "robot": self._settings.robot.name,
            "map": MAP,
            "niceness": self.niceness,
            "workers": max(1, len(os.sched_getaffinity(0)) - 1),
            "may_create": len(self.files.ids()) < MAX_STUDIES,
            "max_tasks": MAX_TASKS,
            "max_bytes": MAX_TOTAL_BYTES - used,
            "max_s": max_s,
        }

    async def _follow(self, run: StudyRun) -> None:
        """Follow a study to its end. If its process is killed, start the process again."""
        error: BaseException | None = None
        try:
            for _ in range(MAX_STARTS):
                await run.compute(self._keep)
                if run.ended or run.error is not None or run.cancelled is not None:
                    break
            else:
                run.error = ExecutionError(
                    f"the process of the study died {MAX_STARTS} times, perhaps for lack of memory; "
                    "start the same study again to continue"
                )
            error = run.cancelled or run.error
            if error is None and run.status.state != "finished":
                error = ExecutionError(run.status.reason)
        except OSError as exc:
            error = run.error = UnavailableError(
                f"the process of the study cannot be started: {exc.strerror}"
            )
        except BaseException as exc:
            error = exc
            run.kill()
            raise
        finally:
            try:
                await self._settle(run, error)
            finally:
                self._run = None
                self._turn.release()
            self._ownership.end(run.job, error, stopped=error is not None and error is run.cancelled)
            run.known.set()

    async def _settle(self, run: StudyRun, error: BaseException | None) -> None:
        """Store the result of an ended study."""
        status = run.status
        if not status.id:
            return
        if status.state == "running" or run.error is not None:
            state = "failed" if run.error is not None else "partial"
            status = replace(
                status, state=state, reason=str(error) if isinstance(error, CobotError) else ENDED
            )
        elif run.cancelled is not None and status.state != "finished":
            status = replace(status, reason=str(run.cancelled))
        run.status = replace(status, rate_hz=0.0, left_s=None)
        await self._keep(run.status)

    async def _keep(self, status: StudyStatus) -> None:
        try:
            await asyncio.to_thread(self.files.keep, status)
        except UnavailableError as exc:
            log.error("%s", exc)

    def _with_run(self, status: StudyStatus) -> StudyStatus:
        """Return the current status of a study. The file of a running study is out of date.

        A study is reported as running until the next one can be started.
        """
        run = self._run
        if run is not None and run.status.id == status.id:
            return replace(run.status, state="running", reason="")
        if status.state == "running":
            return replace(status, state="partial", reason=ENDED, rate_hz=0.0, left_s=None)
        return status
