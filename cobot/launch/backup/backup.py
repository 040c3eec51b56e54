"""A backup of the settings file and of everything that people have set up in the service. It can be restored
later.

A restore never changes a running robot. The archive is checked, stored as `NAME.restore.zip`, and used by the
next `cobot run`. That run first makes a backup of everything that it replaces. This backup is called
`NAME.before-restore.zip` until the restore is complete, then `NAME.before-restore.last.zip`. The archive is
removed last, so if the run is killed earlier, the next run begins the restore again.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from cobot.config import Settings, load_settings
from cobot.errors import ConfigError, InputError
from cobot.folders import open_new
from cobot.launch.backup.archive import pack, unpack
from cobot.robot.kept import keep, read_kept
from cobot.robot.limits import load_joint_limits
from cobot.robot.scene import scene_in
from cobot.robot.tool import Tool
from cobot.strict import sentences, shown
from cobot.types import NamedPosition

FORMAT = 1
SETTINGS = "settings.yaml"
MAX_PROGRAM_FILES = 200 * 20
KINDS: Mapping[str, Callable[[bytes], object]] = {
    "tool": TypeAdapter(Tool).validate_json,
    "scene": scene_in,
    "positions": TypeAdapter(dict[str, NamedPosition]).validate_json,
}
"""The kinds of documents that each robot has, and the function that checks each kind. The scene includes the
named frames.
"""
_PROGRAM = re.compile(r"programs/(?P<id>[a-z0-9][a-z0-9_-]{0,63})/(?P<version>[1-9][0-9]{0,8})\.json")


def joints_of(settings: Settings) -> dict[str, list[str]]:
    """Each robot's joint names.

    Raises:
        ConfigError: see `load_joint_limits`.
    """
    return {
        name: list(load_joint_limits(each.web.joint_limits).names) for name, each in settings.each.items()
    }


@dataclass(frozen=True, slots=True)
class Backup:
    """The content of an archive that has been checked.

    Attributes:
        about: keys of the manifest: `cobot` (the version that made it), `created`, and `robots` with their
            joints.
        settings: content of the user's settings file; None if there was no file.
        robots: for each robot, the contents of its files by their names. A name is the path in the archive
            without `robots/NAME/`.
    """

    about: dict[str, Any]
    settings: bytes | None
    robots: dict[str, dict[str, bytes]]

    @property
    def summary(self) -> list[str]:
        """A description of the content for people, with one line for each robot."""
        lines = [f"{name}: {_counted(files)}" for name, files in self.robots.items()]
        return [*(["the settings file"] if self.settings is not None else []), *lines]


def make_backup(settings: Settings, source: Path | None) -> bytes:
    """Create the archive.

    Args:
        settings: settings of all robots.
        source: the user's settings file; None if the user has no settings file.

    Raises:
        ConfigError: a file cannot be read.
    """
    files: dict[str, bytes] = {}
    if source is not None:
        files[SETTINGS] = _read(source)
    for name, each in settings.each.items():
        for kind in KINDS:
            with contextlib.suppress(FileNotFoundError):
                files[f"robots/{name}/{kind}.json"] = read_kept(_document(each, kind))
        for path in _programs(each.programs_folder):
            files[f"robots/{name}/programs/{path.parent.name}/{path.name}"] = _read(path)
    about = {
        "format": FORMAT,
        "cobot": version("cobot"),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "robots": joints_of(settings),
    }
    return pack(files, about)


def read_backup(content: bytes, settings: Settings) -> Backup:
    """Check completely that an archive can be restored for the robots in these settings.

    Raises:
        InputError: the content is not a backup, is damaged or hostile, or is from different robots or a newer
            cobot.
    """
    about, files = unpack(content)
    if about.get("format") != FORMAT:
        raise InputError(
            f"the backup has the format {shown(about.get('format'))}, but this cobot reads the format "
            f"{FORMAT}"
        )
    made, own = str(about.get("cobot")), version("cobot")
    if _release(made) > _release(own):
        raise InputError(f"the backup was made by cobot {made}, but this is cobot {own}; update cobot first")
    of, here = about.get("robots"), joints_of(settings)
    if of != here:
        raise InputError(
            f"the backup belongs to other robots: {shown(of)}; this cobot has {shown(here)}; robots and "
            "joints must have the same names"
        )
    robots: dict[str, dict[str, bytes]] = {name: {} for name in here}
    for path, text in files.items():
        if path == SETTINGS:
            continue
        _, name, inner = (*path.split("/", 2), "", "")[:3]
        if not path.startswith("robots/") or name not in robots or not _is_valid(inner, text, path):
            raise InputError(f"the backup contains {shown(path)}, which is not a file of a backup")
        robots[name][inner] = text
    return Backup(about, files.get(SETTINGS), robots)


def staged_file(settings: Settings) -> Path:
    """The archive that the next `cobot run` restores."""
    return (settings.kept or settings.logs) / f"{settings.robot.name}.restore.zip"


def stage(settings: Settings, content: bytes) -> None:
    """Store a checked archive for the next start.

    Raises:
        UnavailableError: there is no space or no permission.
    """
    keep(staged_file(settings), content, "the backup to restore")


def activate(settings: Settings, source: Path | None) -> Backup:
    """Restore the staged archive. No cobot with these settings may be running.

    Raises:
        InputError: the archive is not valid. It is put aside, and nothing has changed.
        UnavailableError: there is no space or no permission. The next start tries again.
    """
    staged = staged_file(settings)
    try:
        backup = read_backup(read_kept(staged), settings)
        if backup.settings is not None and source is not None:
            _require_settings(backup.settings, source, list(backup.robots))
    except (InputError, OSError) as exc:
        os.replace(staged, staged.with_suffix(".rejected"))
        raise InputError(f"{staged}: {exc}; the archive was put aside, and nothing was restored") from exc
    before = staged.with_name(f"{settings.robot.name}.before-restore.zip")
    if not before.exists():  # if a restore was killed, it contains the original state
        keep(before, make_backup(settings, source), "the backup")
    for name, each in settings.each.items():
        _restore(each, backup.robots[name])
    if backup.settings is not None and source is not None:
        keep(source, backup.settings, "the settings file")
    staged.unlink()
    os.replace(before, before.with_suffix(".last.zip"))
    return backup


def _restore(settings: Settings, files: Mapping[str, bytes]) -> None:
    for kind in KINDS:
        path = _document(settings, kind)
        if (text := files.get(f"{kind}.json")) is None:
            path.unlink(missing_ok=True)
        else:
            keep(path, text, f"the {kind}")
    folder = settings.programs_folder
    new = folder.with_name(f"{folder.name}.new")
    shutil.rmtree(new, ignore_errors=True)
    for name, text in files.items():
        if found := _PROGRAM.fullmatch(name):
            keep(new / found["id"] / f"{found['version']}.json", text, "the program")
    shutil.rmtree(folder, ignore_errors=True)
    if new.exists():
        os.replace(new, folder)


def _require_settings(text: bytes, source: Path, robots: list[str]) -> None:
    """Check that the settings can be read in their final folder and belong to these robots."""
    trial = source.with_name(f".{source.name}.restore")
    try:
        with open_new(trial) as file:
            file.write(text)
        found = list(load_settings(trial).each)
    except ConfigError as exc:
        raise InputError(f"{SETTINGS} of the backup: {str(exc).replace(str(trial), SETTINGS)}") from exc
    finally:
        trial.unlink(missing_ok=True)
    if found != robots:
        raise InputError(
            f"{SETTINGS} of the backup contains the robots {', '.join(found)}, but this cobot has "
            f"{', '.join(robots)}"
        )


def _is_valid(name: str, text: bytes, path: str) -> bool:
    """Whether a robot in a backup may have a file with this name. The content is checked too.

    Raises:
        InputError: the content is invalid.
    """
    if found := _PROGRAM.fullmatch(name):
        document = _json(text, path)
        if document.get("id") != found["id"] or document.get("version") != int(found["version"]):
            raise InputError(
                f"{shown(path)} of the backup contains a different program or version than its name states"
            )
        return True
    kind = name.removesuffix(".json")
    if kind not in KINDS or name == kind:
        return False
    _json(text, path)
    try:
        KINDS[kind](text)
    except (ValidationError, InputError) as exc:
        problem = sentences(exc.errors()) if isinstance(exc, ValidationError) else exc
        raise InputError(f"{shown(path)} of the backup is not valid: {problem}") from exc
    return True


def _json(text: bytes, path: str) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as exc:
        raise InputError(f"{shown(path)} of the backup is not JSON: {exc}") from exc
    if not isinstance(document, dict):
        raise InputError(f"{shown(path)} of the backup is not a JSON object")
    return document


def _document(settings: Settings, kind: str) -> Path:
    files = {"tool": settings.tool_file, "scene": settings.scene_file, "positions": settings.positions_file}
    return files[kind]


def _programs(folder: Path) -> Iterator[Path]:
    """The files of stored programs."""
    found = sorted(folder.glob("*/*.json")) if folder.is_dir() else []
    for path in found[:MAX_PROGRAM_FILES]:
        if _PROGRAM.fullmatch(f"programs/{path.parent.name}/{path.name}"):
            yield path


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be read: {exc.strerror}") from exc


def _release(text: str) -> tuple[int, ...]:
    """The first two numbers of a version; (0,) if the text is not a version."""
    found = re.match(r"(\d+)\.(\d+)", text)
    return (int(found[1]), int(found[2])) if found else (0,)


def _counted(files: Mapping[str, bytes]) -> str:
    programs = {name.split("/")[1] for name in files if name.startswith("programs/")}
    kinds = [kind for kind in KINDS if f"{kind}.json" in files]
    return ", ".join([*kinds, f"{len(programs)} programs"])
