"""Recordings for clients: the files that are there, and what the recorder is asked for."""

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
"""The first recorder of a `cobot run` may be silent for so long: it has yet to begin."""
LOOK_S = 0.2
"""Interval between checks whether the recorder still lives, s."""


@dataclass(frozen=True, slots=True)
class RecorderStatus:
    """How the recorder of a robot stands.

    Attributes:
        alive: whether it has shown a sign of life in the last seconds.
        recording: the continuous recording that runs, "" for none.
        lost: cycles that are in no recording, because the recorder came too late for them.
        files, bytes: of all recordings.
        problem: why nothing can be recorded; "" while all is well.
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
        settings: of the robot.
        default_robot: that the recorder's socket is named after.

    Attributes:
        reading: held while one is read: one at a time.
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
        """The newest first."""
        return self._store.all()

    def path(self, name: str) -> Path:
        """The path of a finished recording.

        Raises:
            InputError: the name is invalid.
            NotFoundError: there is no recording of that name.
        """
        return self._store.path(name)

    def remove(self, name: str) -> None:
        """Raises as `path` does."""
        self._store.remove(name)

    async def ask(self, action: str, seconds: float | None, timeout_s: float) -> list[str]:
        """Have the recorder `dump` the last seconds, `start` or `stop` a continuous recording.

        It waits for a recorder that `cobot run` has just started.

        Returns:
            The names of the files; of one that has been started, what they will begin with.

        Raises:
            UnavailableError: it does not run, it hangs, or the disk refuses.
            ConflictError: there is a continuous recording already, or none to stop.
        """
        asked_s = time.monotonic()
        await self._await_start(timeout_s)
        timeout_s -= time.monotonic() - asked_s
        heard_ns = 0
        with contextlib.suppress(TornReadError):
            if (record := self._record()) is not None:
                heard_ns = int(record["monotonic_ns"])
        until_ns = (heard_ns or time.monotonic_ns()) + round(SILENT_S * 1e9)  # then the wait ends
        request: dict[str, Any] = {"robot": self._robot, "action": action, "seconds": seconds}
        asking = asyncio.create_task(ask(self._socket, {**request, "until_ns": until_ns}, timeout_s))
        try:
            while not (await asyncio.wait({asking}, timeout=LOOK_S))[0]:
                status = self.status()
                if status is not None and status.pid and not status.alive:
                    raise UnavailableError(
                        f"{status.problem}: after {HANG_S:g} s cobot run starts another one; ask again"
                    )
            return list(asking.result()["names"])
        finally:
            asking.cancel()

    async def _await_start(self, timeout_s: float) -> None:
        """Return when the recorder has begun, or cannot be expected any more."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while (status := self.status()) is not None and not status.pid and not status.problem:
                    await asyncio.sleep(LOOK_S)

    def _record(self) -> np.ndarray | None:
        """What the recorder says of itself; None where nothing is recorded.

        Raises:
            TornReadError: it cannot be read.
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
        """The status of the recorder; None if this robot is not recorded."""
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
            problem = f"the recorder (pid {record['pid']}) has been silent for {silent_s:.0f} s"
        return RecorderStatus(
            alive=alive,
            pid=int(record["pid"]),
            recording=text(record["name"]) if record["recording"] else "",
            lost=int(record["lost"]),
            files=int(record["files"]),
            bytes=int(record["bytes"]),
            problem=problem,
        )
