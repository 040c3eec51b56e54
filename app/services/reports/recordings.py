"""Lists the recordings for clients, and sends requests to the recorder."""

from __future__ import annotations

import asyncio
import contextlib
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cobot.config import Settings
from cobot.errors import CobotError, TornReadError, UnavailableError
from cobot.ipc.layout import text
from cobot.ipc.recording_memory import RecordingMemory
from cobot.recording.control import HANG_S, SILENT_S, ask, socket_path
from cobot.recording.store import Recording, RecordingStore

START_S = 30.0
"""Maximum time that the first recorder of a `cobot run` takes to start, s. It need not answer before that."""
LOOK_S = 0.2
"""Interval between checks that the recorder is alive, s."""


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """The status of a robot's recorder.

    Attributes:
        alive: whether the recorder has updated its heartbeat in the last few seconds.
        recording: name of the current continuous recording; "" if there is none.
        lost: number of cycles that are missing in the recordings, because the recorder was too slow.
        files, bytes: number and total size of all recordings.
        problem: reason why nothing can be recorded; "" if recording is possible.
    """

    alive: bool
    pid: int
    recording: str
    lost: int
    files: int
    bytes: int
    problem: str


class RecordingService:
    """One robot's recordings.

    Args:
        settings: the robot's settings.
        default_robot: name of the default robot, from which the name of the recorder's socket is derived.

    Attributes:
        reading: lock that makes sure that only one recording is read at a time.
    """

    def __init__(self, settings: Settings, default_robot: str) -> None:
        self._robot = settings.robot.name
        self.reading = asyncio.Lock()
        self._store = RecordingStore(settings.recording_folder, settings.recording.max_mb * 1_000_000)
        self._socket = socket_path(default_robot)
        self._memory: RecordingMemory | None = None

    @property
    def max_bytes(self) -> int:
        """The maximum size of all recordings together, in bytes."""
        return self._store.max_bytes

    def all(self) -> list[Recording]:
        """List all recordings, newest first."""
        return self._store.all()

    def path(self, name: str) -> Path:
        """Return the path of a finished recording.

        Raises:
            InputError: the name is invalid.
            NotFoundError: there is no recording with this name.
        """
        return self._store.path(name)

    def remove(self, name: str) -> None:
        """Delete a recording. Raises the same errors as `path`."""
        self._store.remove(name)

    async def ask(self, action: str, seconds: float | None, timeout_s: float) -> list[str]:
        """Make the recorder `dump` the last seconds, or `start` or `stop` a continuous recording.

        Waits for the recorder if `cobot run` has just started it.

        Returns:
            The file names; for a recording that has been started, the prefix of its file names.

        Raises:
            UnavailableError: the recorder is not running or hangs, or the file cannot be written.
            ConflictError: a continuous recording is already running, or there is none to stop.
        """
        asked_s = time.monotonic()
        await self._await_start(timeout_s)
        timeout_s -= time.monotonic() - asked_s
        heard_ns = 0
        with contextlib.suppress(TornReadError):
            if (record := self._record()) is not None:
                heard_ns = int(record["monotonic_ns"])
        # when this time has passed, the wait ends
        until_ns = (heard_ns or time.monotonic_ns()) + round(SILENT_S * 1e9)
        request: dict[str, Any] = {"robot": self._robot, "action": action, "seconds": seconds}
        asking = asyncio.create_task(ask(self._socket, {**request, "until_ns": until_ns}, timeout_s))
        try:
            while not (await asyncio.wait({asking}, timeout=LOOK_S))[0]:
                status = self.status()
                if status is not None and status.pid and not status.alive:
                    raise UnavailableError(
                        f"{status.problem}: cobot run restarts it after {HANG_S:g} s; then try again"
                    )
            return list(asking.result()["names"])
        finally:
            asking.cancel()

    async def _await_start(self, timeout_s: float) -> None:
        """Wait until the recorder has started, or can no longer be expected to start."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while (status := self.status()) is not None and not status.pid and not status.problem:
                    await asyncio.sleep(LOOK_S)

    def _record(self) -> np.ndarray | None:
        """Read the recorder's own status record; None if nothing is recorded.

        Raises:
            TornReadError: the record cannot be read.
        """
        try:
            if self._memory is None or not self._memory.path.exists():
                self._memory = RecordingMemory.attach(self._robot, history=False)
            return self._memory.status.read()
        except TornReadError:
            raise
        except CobotError:
            return None

    def status(self) -> RecorderStatus | None:
        """Return the status of the recorder; None if this robot is not recorded."""
        try:
            record = self._record()
        except TornReadError as exc:
            return RecorderStatus(False, 0, "", 0, 0, 0, str(exc))
        if record is None or self._memory is None:
            return None
        heard_ns = int(record["monotonic_ns"]) if record["pid"] else self._memory.created_ns
        silent_s = (time.monotonic_ns() - heard_ns) * 1e-9
        problem = text(record["problem"])
        alive = bool(record["pid"]) and silent_s < SILENT_S
        if not alive and (record["pid"] or silent_s > START_S):
            problem = f"the recorder (pid {record['pid']}) has not responded for {silent_s:.0f} s"
        return RecorderStatus(
            alive=alive,
            pid=int(record["pid"]),
            recording=text(record["name"]) if record["recording"] else "",
            lost=int(record["lost"]),
            files=int(record["files"]),
            bytes=int(record["bytes"]),
            problem=problem,
        )
