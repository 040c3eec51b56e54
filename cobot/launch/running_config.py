"""The configuration of a running cobot: a copy that only a reload changes.

Editing a file of a running robot changes nothing at first. A process that restarts (rtloop, the service, a
planning process) reads the copy. So an edit that is unfinished, wrong or not yet reloaded cannot take effect
through a restart. The copy is one folder next to the robot's shared memory:

    settings.yaml   complete, with absolute paths; replaced as a whole
    EDITION-...     the files of joint limits, named positions, endpoints and cells that it names
    processes.json  what the supervisor runs

The model is not copied: it may consist of many files, and no reload reads it again.
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

from cobot.cell import cell_file, load_cell
from cobot.config import SECTIONS_OF_A_ROBOT, Settings
from cobot.errors import ConfigError, SharedMemoryError
from cobot.ipc.memory_file import FOLDER

SETTINGS = "settings.yaml"
PROCESSES = "processes.json"


@dataclass(frozen=True, slots=True)
class ProcessState:
    """State of a process, as the supervisor sees it. `restarts` is the number of restarts since the
    supervisor's start.
    """

    pid: int
    restarts: int


class RunningConfig:
    """The folder with the configuration of one `cobot run`.

    Args:
        folder: see `of`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def of(cls, robot: str) -> RunningConfig:
        """The configuration of the cobot whose default robot has this name."""
        return cls(FOLDER / f"cobot-{robot}.run")

    @classmethod
    def mine(cls) -> list[RunningConfig]:
        """The configuration of each of this user's cobots that is running or was killed. Copies that belong
        to other users are not trusted.
        """
        found = []
        for folder in FOLDER.glob("cobot-*.run"):
            with contextlib.suppress(OSError):
                if folder.lstat().st_uid == os.geteuid():
                    found.append(cls(folder))
        return found

    @property
    def file(self) -> Path:
        """The settings file, for `cobot.config.load_settings`."""
        return self.folder / SETTINGS

    def create(self, settings: Settings) -> None:
        """Start with an empty folder, and remove the files of a killed run. Another user's folder is
        rejected, because its owner could change the robot's configuration.

        Raises:
            SharedMemoryError: see `prepare`.
        """
        self.remove()
        try:
            self.folder.mkdir(mode=0o700)
        except OSError as exc:
            raise SharedMemoryError(
                f"{self.folder}: cannot be created: {exc.strerror}; if another user owns the folder, "
                "remove it, or set another robot.name"
            ) from exc
        self.prepare(settings)
        self.commit()

    def prepare(self, settings: Settings) -> Path:
        """Copy these settings and the files that they name. They do not take effect yet.

        Returns:
            The settings file.

        Raises:
            SharedMemoryError: there is no room in the shared memory, or no permission.
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
        """Make the last prepared copy the current configuration, in one atomic step."""
        os.replace(self.folder / f"new-{SETTINGS}", self.file)

    def remove(self) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def publish(self, processes: Mapping[str, ProcessState]) -> None:
        """Write the names and states of the running processes. If /dev/shm is full, nothing is written,
        because a full disk must not stop the processes.
        """
        with contextlib.suppress(OSError):
            new = self.folder / f"new-{PROCESSES}"
            new.write_text(json.dumps({name: asdict(each) for name, each in processes.items()}))
            os.replace(new, self.folder / PROCESSES)

    def processes(self) -> dict[str, ProcessState]:
        """The processes that are running, by name; empty if none have been written."""
        try:
            told = json.loads((self.folder / PROCESSES).read_text(encoding="utf-8"))
            return {name: ProcessState(**each) for name, each in told.items()}
        except (OSError, ValueError, TypeError):
            return {}

    def _content(self, settings: Settings, edition: str) -> dict[str, Any]:
        """The settings as the content of a settings file."""
        content = settings.model_dump(mode="json", exclude={"robots"})
        content["web"]["endpoints"] = self._copy(settings.web.endpoints, f"{edition}-endpoints")
        entries = []
        for each in settings.each.values():
            dumped = each.model_dump(mode="json", include={"robot", *SECTIONS_OF_A_ROBOT})
            robot = dumped.pop("robot")
            robot["srdf"] = self._copy(each.robot.srdf, f"{edition}-{each.robot.name}-positions")
            limits = self._copy(each.web.joint_limits, f"{edition}-{each.robot.name}-limits")
            if each.robot.cell is not None:
                robot["cell"] = self._copy_cell(each.robot.cell, f"{edition}-{each.robot.name}-cell")
            entries.append({**robot, **dumped, "joint_limits": limits})
        if settings.robots:
            return {**content, "robots": entries}
        content["web"]["joint_limits"] = entries[0]["joint_limits"]
        content["robot"]["srdf"], content["robot"]["cell"] = entries[0]["srdf"], entries[0]["cell"]
        return content

    def _copy(self, source: Path, name: str) -> str:
        """Copy a file. A missing file is not an error here; the process that reads it reports it."""
        if not source.is_file():
            return str(source)
        target = self.folder / f"{name}{source.suffix}"
        shutil.copyfile(source, target)
        return str(target)

    def _copy_cell(self, source: Path, name: str) -> str:
        """Copy a cell file with its meshes. An invalid file is not an error here; the process that reads it
        reports it.
        """
        source = cell_file(source)
        try:
            meshes = load_cell(source).files
        except ConfigError:
            return str(source)
        target = self.folder / name / source.name
        for file in (Path(source.name), *meshes):
            copy = target.parent / file
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source.parent / file, copy)
        return str(target)

    def _remove_unused(self) -> None:
        """Remove all editions except the current one, including those that never took effect."""
        present = self.file.read_text(encoding="utf-8") if self.file.exists() else ""
        for file in self.folder.glob("[0-9]*-*"):
            if file.name in present:
                continue
            if file.is_dir():
                shutil.rmtree(file)
            else:
                file.unlink()
