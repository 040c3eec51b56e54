"""The configuration that a running cobot goes by: a copy, which only a reload changes.

Whoever edits a file of a running robot changes nothing by that alone. What starts anew (rtloop, the
service, a planning process) reads the copy, so an edit that is half done, wrong or not yet reloaded cannot
get in through a restart. The copy lies beside the robot's shared memory, as one folder:

    settings.yaml   complete, with absolute paths; replaced as a whole
    EDITION-...     the files of joint limits, named positions and endpoints that it names
    processes.json  what the supervisor runs

The model stays where it is: it may be made of many files, and no reload reads it again.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from cobot.config import SECTIONS_OF_A_ROBOT, Settings
from cobot.errors import SharedMemoryError
from cobot.ipc.shm import FOLDER

SETTINGS = "settings.yaml"
PROCESSES = "processes.json"


@dataclass(frozen=True, slots=True)
class ProcessState:
    """A process as the supervisor knows it; `restarts` counts from the supervisor's start."""

    pid: int
    restarts: int


class RunningConfig:
    """The folder of one `cobot run`.

    Args:
        folder: see `of`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def of(cls, robot: str) -> RunningConfig:
        """That of the cobot whose default robot has this name."""
        return cls(FOLDER / f"cobot-{robot}.run")

    @classmethod
    def mine(cls) -> list[RunningConfig]:
        """Those of this user's cobots that run, or were killed. What others put there is not believed."""
        found = []
        for folder in FOLDER.glob("cobot-*.run"):
            with contextlib.suppress(OSError):
                if folder.lstat().st_uid == os.geteuid():
                    found.append(cls(folder))
        return found

    @property
    def file(self) -> Path:
        """The settings' file, for `cobot.config.load_settings`."""
        return self.folder / SETTINGS

    def create(self, settings: Settings) -> None:
        """Begin anew, whatever a killed run has left. A folder that somebody else has put there is refused:
        who owns it could change what the robot goes by.

        Raises:
            SharedMemoryError: see `prepare`.
        """
        self.remove()
        try:
            self.folder.mkdir(mode=0o700)
        except OSError as exc:
            raise SharedMemoryError(
                f"{self.folder}: cannot be made: {exc.strerror}; if it is another user's, remove it, or set "
                "another robot.name"
            ) from exc
        self.prepare(settings)
        self.commit()

    def prepare(self, settings: Settings) -> Path:
        """Copy these settings and the files that they name, without anybody going by them yet.

        Returns:
            The settings' file.

        Raises:
            SharedMemoryError: there is no room or no permission.
        """
        new = self.folder / f"new-{SETTINGS}"
        try:
            self._remove_unused()
            content = self._content(settings, str(time.monotonic_ns()))
            new.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")
        except OSError as exc:
            raise SharedMemoryError(f"{self.folder}: cannot be written: {exc.strerror}") from exc
        return new

    def commit(self) -> None:
        """Make what was prepared last the configuration, at once and as a whole."""
        os.replace(self.folder / f"new-{SETTINGS}", self.file)

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def publish(self, processes: Mapping[str, ProcessState]) -> None:
        """Tell who runs, by name. A full /dev/shm keeps nobody from running."""
        with contextlib.suppress(OSError):
            new = self.folder / f"new-{PROCESSES}"
            new.write_text(json.dumps({name: asdict(each) for name, each in processes.items()}))
            os.replace(new, self.folder / PROCESSES)

    def processes(self) -> dict[str, ProcessState]:
        """Who runs, by name; empty if nobody has told."""
        try:
            told = json.loads((self.folder / PROCESSES).read_text(encoding="utf-8"))
            return {name: ProcessState(**each) for name, each in told.items()}
        except (OSError, ValueError, TypeError):
            return {}

    def _content(self, settings: Settings, edition: str) -> dict[str, Any]:
        """The settings as a file of their own would say them."""
        content = settings.model_dump(mode="json", exclude={"robots"})
        content["web"]["endpoints"] = self._copy(settings.web.endpoints, f"{edition}-endpoints")
        entries = []
        for each in settings.each.values():
            dumped = each.model_dump(mode="json", include={"robot", *SECTIONS_OF_A_ROBOT})
            robot = dumped.pop("robot")
            robot["srdf"] = self._copy(each.robot.srdf, f"{edition}-{each.robot.name}-positions")
            limits = self._copy(each.web.joint_limits, f"{edition}-{each.robot.name}-limits")
            entries.append({**robot, **dumped, "joint_limits": limits})
        if settings.robots:
            return {**content, "robots": entries}
        content["web"]["joint_limits"] = entries[0]["joint_limits"]
        content["robot"]["srdf"] = entries[0]["srdf"]
        return content

    def _copy(self, source: Path, name: str) -> str:
        """A file that is not there is left to whoever needs it."""
        if not source.is_file():
            return str(source)
        target = self.folder / f"{name}{source.suffix}"
        shutil.copyfile(source, target)
        return str(target)

    def _remove_unused(self) -> None:
        """Of the editions before the present one, and of those that nobody went by in the end."""
        present = self.file.read_text(encoding="utf-8") if self.file.exists() else ""
        for file in self.folder.glob("[0-9]*-*"):
            if file.name not in present:
                file.unlink()
