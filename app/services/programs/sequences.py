"""Runs sequences in a runner process, which uses this service like any other client.

The arm is claimed before the runner starts, and released once the runner has ended and its output has been
read.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import secrets
import signal
import tempfile
from collections import deque
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from app.services.programs.steps import RunnerInstructions
from app.services.rights.job import JobKind
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from app.services.state.link import RobotLink
from cobot.access.authentication import Authenticator
from cobot.access.roles import acting
from cobot.config import SequencesSection
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    UnavailableError,
)
from cobot.findings import Finding
from cobot.folders import below
from cobot.launch.process import RUN_MODULE
from cobot.logs import printable

LINE_BYTES = 65536
LINE_CHARACTERS = 2000
"""Maximum length to which log lines are cut, in characters. Thousands of lines are kept, and each client may
read hundreds of them at once.
"""
PROGRESS = ("iteration", "waypoint", "n_waypoints", "step")
ERRORS: dict[int, type[CobotError]] = {2: InputError, 4: UnavailableError}
"""Errors by the return code of the runner. All other codes mean that a motion has failed."""
ERROR_LINE = " error: "
FINDING = [each.name for each in fields(Finding)]


@dataclass(frozen=True, slots=True)
class SequenceOrder:
    """A sequence or program to run.

    Attributes:
        config: the JSON document or the Lua program as uploaded; the runner validates it.
        bag_path: folder of the recording, below the recordings folder; "" for no recording.
        topics: names of the data to record, separated by commas; "" for all.
        joints_action, pose_action: values that are accepted for compatibility and only written to the log.
        name: name of the uploaded file. If it ends in .lua, the file is a Lua program.
        from_waypoint: first waypoint of the first iteration; None to begin at home.
        hold: whether the sequence waits before its first motion until its job is resumed or stepped.
    """

    config: bytes
    n_iterations: int = 1
    delay_between_iterations_s: float = 0.0
    bag_path: str = ""
    topics: str = ""
    joints_action: str = ""
    pose_action: str = ""
    name: str = ""
    from_waypoint: int | None = None
    hold: bool = False


@dataclass(frozen=True, slots=True)
class SequenceStatus:
    """State of the newest sequence."""

    status: str = "idle"
    sequence_id: int | None = None
    pid: int | None = None
    iteration: int | None = None
    n_iterations: int | None = None
    waypoint: int | None = None
    n_waypoints: int | None = None
    step: str | None = None
    started_at: datetime | None = None
    finished_at: datetime | None = None
    returncode: int | None = None
    bag_path: str | None = None


class SequenceService:
    """Starts, monitors and ends the runner. It holds the claim on the arm as long as the runner is
    running.
    """

    def __init__(
        self,
        ownership: Ownership,
        link: RobotLink,
        settings: SequencesSection,
        base_url: str,
        motion_timeout_s: float,
        tokens: Authenticator,
    ) -> None:
        self._ownership = ownership
        self._link = link
        self._settings = settings
        self._base_url = base_url
        self._motion_timeout_s = motion_timeout_s
        self._tokens = tokens
        self._lines: deque[str] = deque(maxlen=settings.log_lines)
        self._starting = False
        self._steps: RunnerInstructions | None = None
        self._stopped: StopReason | None = None  # reason why the runner was ended; None if it was not
        self._error_line = ""  # the newest error that the current runner has printed
        self._failure: dict[str, Any] | None = None  # the same error, as reported by `Progress.fail`
        self._process: asyncio.subprocess.Process | None = None
        self._watcher: asyncio.Task[None] | None = None
        self.status = SequenceStatus()

    def lines(self, count: int) -> list[str]:
        """Return the newest lines that runners have printed, in order of time."""
        return list(self._lines)[-count:]

    async def start(self, order: SequenceOrder, stops: int) -> SequenceStatus:
        """Start the runner. The status and the log later report whether the file is valid.

        Args:
            stops: `Ownership.stops` when the request arrived.

        Raises:
            ConflictError: a sequence is running, or another client is moving the arm.
            MotionStopped: a stop was requested in the meantime.
            InputError: the recording would be outside the recordings folder.
            UnavailableError: the process cannot be started.
        """
        if self.status.status == "running":
            raise ConflictError(
                f"sequence {self.status.sequence_id} (pid {self.status.pid}) is running; POST /stop ends it",
                details={"cause": "runs"},
            )
        program = order.name.endswith(".lua")
        if program and order.from_waypoint is not None:
            raise InputError(f"from_waypoint: {order.name} is a program, which has no waypoints")
        bag = self._recording(order.bag_path)
        number = (self.status.sequence_id or 0) + 1
        token = secrets.token_urlsafe(32)
        kind = JobKind.PROGRAM if program else JobKind.SEQUENCE
        self._ownership.claim_for_sequence(f"sequence {number}", token, kind)
        # while it is running, the program has the rights of the client that started it
        starter = acting.get()
        self._tokens.grant(starter.name, starter.role, token)
        self._starting = True
        try:
            process, progress, answers = await self._spawn(order, bag, token)
        except OSError as exc:
            error = UnavailableError(f"the sequence runner cannot be started: {exc}")
            self._release(token, error)
            raise error from exc
        except BaseException as exc:
            self._release(token, exc)
            raise
        finally:
            self._starting = False
        self._process, self._stopped, self._error_line, self._failure = process, None, "", None
        self._steps = RunnerInstructions(answers, order.from_waypoint, self._hold_job, hold=order.hold)
        self.status = SequenceStatus(
            status="running",
            sequence_id=number,
            pid=process.pid,
            n_iterations=order.n_iterations,
            started_at=datetime.now(UTC),
            bag_path=str(bag) if bag else None,
        )
        job = self._ownership.sequence_job
        if job is not None:
            job.start()
        actions = f"joints_action {order.joints_action}, pose_action {order.pose_action}"
        self._note(f"sequence {number} started, pid {process.pid}, {actions}")
        self._tell("started", name=_printable(order.name), iterations=order.n_iterations)
        self._watcher = asyncio.create_task(self._watch(process, progress, number, token))
        if self._ownership.stops != stops:
            await self.stop()
            raise StopReason(f"a stop was requested while sequence {number} was being started", by="").error
        return self.status

    async def stop(self, reason: StopReason | None = None) -> str | None:
        """End the runner, and kill it if it does not exit. Returns a description of the stopped sequence, or
        None if nothing was running.

        Args:
            reason: the reason that is reported; None if a client has requested the stop.
        """
        if self._starting:  # `start` notices the stop, and ends the process that it has begun
            return "the start of a sequence"
        process, watcher = self._process, self._watcher
        if process is None or watcher is None or watcher.done():
            return None
        described = f"sequence {self.status.sequence_id} (pid {process.pid})"
        self._stopped = self._stopped or reason or StopReason("stopped")
        _signal(process, signal.SIGTERM)
        try:
            await asyncio.wait_for(asyncio.shield(watcher), self._settings.stop_timeout_s)
        except TimeoutError:
            self._note(f"sequence {self.status.sequence_id} does not end on SIGTERM and is killed")
            _signal(process, signal.SIGKILL)
            await watcher
        return described

    def _recording(self, bag_path: str) -> Path | None:
        if not bag_path:
            return None
        folder = self._settings.recordings.resolve()
        path = below(folder, bag_path, "bag_path", "recordings folder")
        if path.exists():
            raise InputError(f"bag_path: {path} already exists; choose another name")
        return path

    async def _spawn(
        self, order: SequenceOrder, bag: Path | None, token: str
    ) -> tuple[asyncio.subprocess.Process, asyncio.StreamReader, int]:
        """Start the runner process. Returns the process, the pipe for its progress reports and the pipe for
        answers to it.
        """
        arguments = ["run", "-", "--url", self._base_url, "--folder", str(self._settings.programs)]
        if order.name:
            arguments.append(f"--name={_printable(order.name)}")
        arguments += ["--motion-timeout", repr(self._motion_timeout_s)]
        arguments += ["--iterations", str(order.n_iterations)]
        arguments += ["--delay", repr(order.delay_between_iterations_s)]
        if bag is not None:
            try:
                bag.parent.mkdir(parents=True, exist_ok=True)
            except OSError as exc:
                raise InputError(f"bag_path: {bag.parent} cannot be made: {exc.strerror}") from exc
            arguments += ["--bag", str(bag), "--topics", order.topics]
        config = await asyncio.to_thread(_unnamed_file, order.config)
        read_end, write_end = os.pipe()
        answers_end, answering_end = os.pipe()
        try:
            process = await asyncio.create_subprocess_exec(
                *RUN_MODULE,
                "cobot.runner",
                *arguments,
                "--progress-fd",
                str(write_end),
                "--answers-fd",
                str(answers_end),
                stdin=config,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.STDOUT,
                env={**os.environ, "COBOT_MOTION_TOKEN": token, "COBOT_TOKEN": token},
                pass_fds=(write_end, answers_end),
                start_new_session=True,
                limit=LINE_BYTES,
            )
        except BaseException:
            os.close(read_end)
            os.close(answering_end)
            raise
        finally:
            os.close(write_end)
            os.close(answers_end)
            config.close()
        progress = asyncio.StreamReader(limit=LINE_BYTES)
        await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(progress), os.fdopen(read_end, "rb")
        )
        return process, progress, answering_end

    async def _watch(
        self, process: asyncio.subprocess.Process, progress: asyncio.StreamReader, number: int, token: str
    ) -> None:
        """Follow the runner until it ends for any reason, and then release the claim on the arm."""
        assert process.stdout is not None
        readers = [
            asyncio.create_task(self._read_log(process.stdout)),
            asyncio.create_task(self._read_progress(progress)),
        ]
        returncode = await process.wait()
        # A grandchild may keep the pipes open, so only data that has already arrived is read.
        await asyncio.wait(readers, timeout=0.5)
        for reader in readers:
            reader.cancel()
        if returncode != 0:
            self._link.request_stop()
        self.status = replace(
            self.status, status="finished", returncode=returncode, finished_at=datetime.now(UTC)
        )
        self._tell("ended", returncode=returncode)
        if self._steps is not None:
            self._steps.close()
            self._steps = None
        self._release(token, self._error(returncode))
        self._note(f"sequence {number} finished, return code {returncode}")

    def _error(self, returncode: int) -> CobotError | None:
        """Return the error for a return code of the runner."""
        if returncode == 0:
            return None
        if self._stopped is not None:
            return self._stopped.error
        said = self._error_line.partition(ERROR_LINE)[2]
        detail = said or f"the runner ended with return code {returncode}"
        failure = self._failure or {"failed": {}, "checks": []}
        findings = [
            Finding(**{**{name: each[name] for name in FINDING}, "of": tuple(each["of"])})
            for each in failure["checks"]
        ]
        return ERRORS.get(returncode, ExecutionError)(detail, findings=findings, details=failure["failed"])

    async def _read_log(self, stream: asyncio.StreamReader) -> None:
        while True:
            try:
                line = await stream.readline()
            except ValueError:  # a line longer than LINE_BYTES, of which the part read so far is lost
                line = b"(a line too long to keep)"
            if not line:
                return
            text = printable(line.decode("utf-8", "replace").rstrip(), LINE_CHARACTERS)
            self._lines.append(text)
            if ERROR_LINE in text:
                self._error_line = text

    async def _read_progress(self, stream: asyncio.StreamReader) -> None:
        while line := await stream.readline():
            with contextlib.suppress(json.JSONDecodeError):  # an incomplete last line of a killed runner
                event = json.loads(line)
                if "failed" in event:
                    self._failure = event
                    continue
                self.status = replace(
                    self.status,
                    iteration=event["iteration"],
                    waypoint=event["waypoint"],
                    n_waypoints=event["n_waypoints"],
                    step=event.get("step"),
                )
                if not event["within"]:
                    self._tell("waypoint", **{name: event.get(name) for name in PROGRESS})
                    self._count(event)
                if event["asking"] and self._steps is not None:
                    await self._answer_runner(self._steps, event)

    async def _answer_runner(self, steps: RunnerInstructions, event: dict[str, Any]) -> None:
        """Answer a request from the runner. The answer waits while anything is paused, so outputs and gripper
        commands wait like motions.
        """
        override = self._ownership.speed_override
        if event["within"]:
            await override.opened.wait()
            steps.answer_time(override.paused_s)
        elif steps.ask(event["behind"], event["n_waypoints"]):
            await override.opened.wait()
            steps.answer()

    def _tell(self, what: str, **data: Any) -> None:
        self._link.events.publish("sequence", what=what, sequence=self.status.sequence_id, **data)

    @property
    def steps(self) -> RunnerInstructions:
        """Return the object that tells the runner at each waypoint whether to continue.

        Raises:
            ConflictError: no sequence is running.
        """
        if self._steps is None:
            raise ConflictError("no sequence is running")
        return self._steps

    def _hold_job(self, held: bool) -> None:
        job = self._ownership.sequence_job
        if job is not None:
            job.hold(held)

    def _count(self, event: dict[str, Any]) -> None:
        """Update the progress of the job when the sequence begins the step of `event`."""
        job, rounds, steps = self._ownership.sequence_job, self.status.n_iterations or 1, event["n_waypoints"]
        if job is not None and steps:
            job.at_waypoint((event["iteration"] - 1 + event["share"]) * steps, rounds * steps)

    def _release(self, token: str, error: BaseException | None) -> None:
        self._tokens.withdraw(token)
        self._ownership.release_sequence(error)

    def _note(self, text: str) -> None:
        moment = datetime.now().astimezone().isoformat(timespec="milliseconds")
        self._lines.append(f"{moment} {printable(text)}")


def _printable(name: str) -> str:
    """Return the last part of a file's name, reduced to characters that are allowed on a command line."""
    return "".join(character for character in Path(name).name[-100:] if character.isprintable())


def _unnamed_file(content: bytes) -> IO[bytes]:
    """Create a temporary file with this content but without a name. It is deleted when its last reader closes
    it.
    """
    file = tempfile.TemporaryFile()  # noqa: SIM115 - the caller closes it
    file.write(content)
    file.seek(0)
    return file


def _signal(process: asyncio.subprocess.Process, number: signal.Signals) -> None:
    """Send a signal to the process group of the runner, which runs in its own process session."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, number)
