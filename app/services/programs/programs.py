"""Programs: sequences and Lua files in one folder. Only one of them can be loaded and run at a time."""

from __future__ import annotations

import asyncio
from enum import StrEnum
from pathlib import Path

from app.services.programs.sequences import SequenceOrder, SequenceService
from app.services.rights.ownership import Ownership
from app.services.rights.stopping import StopService
from cobot.errors import ConflictError, ExecutionError, InputError, NotFoundError
from cobot.folders import below
from cobot.launch.process import RUN_MODULE

SUFFIXES = (".json", ".lua")
CHECK_TIMEOUT_S = 20.0
STOP_TIMEOUT_S = 4.0


class RunState(StrEnum):
    """Program state."""

    RUNNING = "Running"
    PAUSING = "Pausing"
    PAUSED = "Paused"
    STOPPING = "Stopping"
    STOPPED = "Stopped"


class ProgramService:
    """Loads, runs, pauses and ends programs.

    Args:
        folder: folder of the programs. Files outside it are never run.

    Attributes:
        loaded: path of the loaded program below the folder; "" if none is loaded.
    """

    def __init__(
        self, folder: Path, ownership: Ownership, sequences: SequenceService, stopping: StopService
    ) -> None:
        self._folder = folder
        self._ownership = ownership
        self._sequences = sequences
        self._stopping = stopping
        self._underway: RunState | None = None
        self._checking = asyncio.Lock()
        self.loaded = ""

    @property
    def state(self) -> RunState:
        if self._underway is not None:
            return self._underway
        if not self.running:
            return RunState.STOPPED
        return RunState.PAUSED if self._ownership.speed_override.paused else RunState.RUNNING

    @property
    def running(self) -> bool:
        return self._sequences.status.status == "running"

    def names(self) -> list[str]:
        """List all programs in the folder, by path below it."""
        folder = self._folder.resolve()
        found = (path for path in folder.rglob("*") if path.suffix in SUFFIXES and path.is_file())
        return sorted(str(path.relative_to(folder)) for path in found)

    async def load(self, name: str) -> None:
        """Check a program and select it for `run`.

        Args:
            name: path below the folder, with the suffix.

        Raises:
            InputError: the path leads out of the folder, or the program contains an error. The message states
                where.
            NotFoundError: there is no such program.
            ConflictError: a program is running.
        """
        if self.running:
            raise ConflictError(f"a program is running ({self.loaded or 'a sequence'}); stop it first")
        path = self._path(name)
        async with self._checking:  # each check starts a process
            await _check(path, self._folder)
        self.loaded = name

    async def run(self, stops: int) -> None:
        """Run the loaded program once. Returns when its process has started.

        Args:
            stops: `Ownership.stops` when the request arrived.

        Raises:
            ConflictError: no program is loaded, a program is already running, or another client is moving the
                arm.
            MotionStopped, UnavailableError: see `SequenceService.start`.
        """
        if not self.loaded:
            raise ConflictError("no program is loaded; load one first")
        try:
            content = await asyncio.to_thread(self._path(self.loaded).read_bytes)
        except OSError as exc:
            raise InputError(f"program: {self.loaded!r} cannot be read: {exc.strerror}") from exc
        await self._sequences.start(SequenceOrder(config=content, name=self.loaded), stops)

    async def pause(self) -> None:
        """Pause the program. The arm stops on its path, and the program waits at its next motion.

        Raises:
            ConflictError: no program is running, or the program has a streaming session.
            ExecutionError, UnavailableError: see `SpeedOverride.pause`.
        """
        self._require_running()
        self._underway = RunState.PAUSING
        try:
            await self._ownership.speed_override.pause()
        finally:
            self._underway = None

    async def resume(self) -> None:
        """Resume the paused program.

        Raises:
            ConflictError: nothing is paused, or another client has control.
            UnavailableError: see `SpeedOverride.resume`.
        """
        self._require_running()
        self._ownership.require_control()
        if not self._ownership.speed_override.paused:
            raise ConflictError("the program is not paused")
        await self._ownership.speed_override.resume()

    async def stop(self) -> None:
        """End the program and the motion. Returns when the arm is at rest, or at once if nothing is running.

        Raises:
            ExecutionError: the arm is not known to be at rest; the error gives the reason.
        """
        self._underway = RunState.STOPPING
        try:
            stopped = await self._stopping.stop(STOP_TIMEOUT_S)
        finally:
            self._underway = None
        if not stopped.success:
            raise ExecutionError(stopped.message)

    def _require_running(self) -> None:
        if not self.running:
            raise ConflictError("no program is running")

    def _path(self, name: str) -> Path:
        folder = self._folder.resolve()
        path = below(folder, name, "program", "programs folder")
        if path.suffix not in SUFFIXES:
            raise InputError(f"program: {name!r} must end in {' or '.join(SUFFIXES)}")
        if not path.is_file():
            raise NotFoundError(f"program: there is no {name!r} in {folder}")
        return path


async def _check(path: Path, folder: Path) -> None:
    """Make the runner check a program in a separate process, with the arguments of a run."""
    process = await asyncio.create_subprocess_exec(
        *RUN_MODULE,
        "cobot.runner",
        "check",
        str(path),
        "--folder",
        str(folder),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        _, errors = await asyncio.wait_for(process.communicate(), CHECK_TIMEOUT_S)
    except TimeoutError as exc:
        process.kill()
        await process.wait()
        raise InputError(f"{path.name}: could not be checked within {CHECK_TIMEOUT_S:g} s") from exc
    if process.returncode != 0:
        raise InputError(errors.decode("utf-8", "replace").strip().removeprefix(f"{path.parent}/"))
