"""Checks, activates and removes settings of a cell that come with a bundle.

The files of each bundle are in a folder named by the hash of the bundle. A link points to the folder that is
in force. The user's own settings file does not change; see `cobot.config.rolled_out`.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
from base64 import b64decode, b64encode
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import yaml
from pydantic import AfterValidator, Field

from cobot.client.rest import Client
from cobot.config import Settings, load_settings
from cobot.config.rolled_out import FILES, ROLLED_OUT_FILE, read_rolled_out
from cobot.errors import CobotError, ConfigError, InputError, UnavailableError
from cobot.launch.process import RUN_MODULE
from cobot.robot.kept import keep
from cobot.strict import StrictModel

CHECK_S = 120.0
PLACES = ("fleet", "logs", "kept", "sequences")
"""Sections of the settings that differ between cells."""
_NAME = r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}"


def _valid_base64(text: str) -> str:
    try:
        b64decode(text, validate=True)
    except ValueError as exc:
        raise ValueError(f"must be base64: {exc}") from exc
    return text


class BundleFile(StrictModel):
    """A settings file in a bundle. Its path is relative to `settings.yaml`."""

    path: Annotated[str, Field(pattern=rf"^{_NAME}(/{_NAME}){{0,3}}$")]
    base64: Annotated[str, AfterValidator(_valid_base64)]

    @property
    def content(self) -> bytes:
        return b64decode(self.base64)


class CellSettings:
    """The settings that the fleet has rolled out to this cell.

    Args:
        source: the user's settings file.
    """

    def __init__(self, settings: Settings, source: Path, client: Client) -> None:
        self._source, self._client = source, client
        self._link = settings.rolled_out
        self._folder = self._link.parent

    @property
    def active(self) -> str:
        """The bundle whose settings are in force, or will be after a restart; "" if there is none."""
        try:
            return self._link.readlink().name
        except OSError:
            return ""

    @contextlib.contextmanager
    def trial(self, files: Sequence[BundleFile]) -> Iterator[Settings]:
        """Context manager that provides this cell's settings as they would be with the given files. The files
        exist only during the context.

        Raises:
            InputError: the settings are invalid or not suitable for this cell, or `cobot check` finds an
                error.
        """
        with TemporaryDirectory(prefix="cobot-settings-") as name:
            folder = Path(name).resolve()
            _write(folder, files)
            try:
                settings = load_settings(self._source, read_rolled_out(folder / ROLLED_OUT_FILE))
            except ConfigError as exc:
                raise InputError(f"settings: {str(exc).replace(f'{folder}/', '')}") from exc
            if settings.robots:
                raise InputError(
                    "settings: this cell has several robots; its settings can only be changed in the cell "
                    "itself"
                )
            _check(settings, folder)
            yield settings

    def activate(self, name: str, files: Sequence[BundleFile]) -> list[str]:
        """Activate the settings of a bundle.

        Returns:
            The changes that need a cell restart.

        Raises:
            CobotError: the service rejects the settings, or the disk is full.
        """
        folder = self._folder / name
        _write(folder, files)  # written file by file, because the folder may already be in force
        return self.switch(name)

    def switch(self, name: str) -> list[str]:
        """Activate the settings of an earlier bundle. If its name is "", only the user's settings are used.

        Returns:
            The changes that need a cell restart.

        Raises:
            CobotError: the service rejects the settings.
        """
        before = self.active
        self._point_to(name)
        try:
            answer = self._client.reload()
        except CobotError:
            self._point_to(before)
            raise
        return [str(each) for each in answer["needs_restart"]]

    def remove_others(self, *kept: str) -> None:
        """Remove the folders of all bundles except the given ones and the active one."""
        needed = {*kept, self.active}
        for folder in self._folder.glob("*"):
            if folder != self._link and folder.name not in needed:
                shutil.rmtree(folder, ignore_errors=True)

    def _point_to(self, name: str) -> None:
        try:
            if not name:
                self._link.unlink(missing_ok=True)
                return
            new = self._folder / "new"
            new.unlink(missing_ok=True)
            new.symlink_to(name)
            os.replace(new, self._link)
        except OSError as exc:
            raise UnavailableError(f"{self._link}: cannot be written: {exc.strerror}") from exc


def files_of(folder: Path) -> list[dict[str, str]]:
    """The files in the settings folder of a bundle, in the form of `BundleFile`. The list is empty if the
    folder does not exist.

    Raises:
        InputError: the folder contains no settings.yaml, or the settings cannot be rolled out.
        OSError: a file cannot be read.
    """
    if not folder.is_dir():
        return []
    try:
        read_rolled_out(folder.resolve() / ROLLED_OUT_FILE)
    except ConfigError as exc:
        raise InputError(str(exc)) from exc
    return [
        {"path": file.relative_to(folder).as_posix(), "base64": b64encode(file.read_bytes()).decode()}
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    ]


def configuration_of(settings: Settings) -> str:
    """A hash of the settings and their file contents. Names and paths are omitted, because they differ
    between cells.
    """
    content = []
    for each in settings.each.values():
        dumped = _without_paths(each.model_dump(exclude={"robots", *PLACES}))
        files = {"robot": (*FILES["robot"], "model"), "web": (*FILES["web"], "endpoints")}
        for section, keys in files.items():
            named = [getattr(getattr(each, section), key) for key in keys]
            dumped[section]["files"] = [None if path is None else _content_of(path) for path in named]
        del dumped["robot"]["name"]
        content.append(dumped)
    return sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()[:16]


def _without_paths(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _without_paths(value) for key, value in content.items() if not isinstance(value, Path)}
    return content


def _content_of(path: Path) -> str:
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    return sha256(b"".join(each.read_bytes() for each in files if each.is_file())).hexdigest()


def _write(folder: Path, files: Sequence[BundleFile]) -> None:
    for file in files:
        keep(folder / file.path, file.content, "the file")


def _check(settings: Settings, folder: Path) -> None:
    """Check settings as `cobot check` does, except for `fleet.connect`.

    Raises:
        InputError: the check finds an error.
    """
    content = settings.model_dump(mode="json", exclude={"robots"})
    content["fleet"]["connect"] = []
    trial = folder / ".trial.yaml"  # file names in a bundle never begin with a dot
    trial.write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    command = [*RUN_MODULE, "cobot", "check", "--config", str(trial)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=CHECK_S, check=False)
    except subprocess.TimeoutExpired as exc:
        raise InputError(f"settings: `cobot check` did not end within {CHECK_S:g} s") from exc
    if done.returncode:
        faults = [line for line in done.stdout.splitlines() if line.startswith("FAILED")]
        said = "; ".join(faults) or done.stderr.strip() or f"cobot check ended with {done.returncode}"
        raise InputError(f"settings: {said.replace(f'{folder}/', '')[:1500]}")
