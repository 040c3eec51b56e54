"""Reads settings from files: the file that is part of cobot, with the changes from the user's file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cobot.config.locations import resolve
from cobot.config.section import parse
from cobot.config.sections import RobotSection
from cobot.config.settings import Settings
from cobot.errors import ConfigError
from cobot.strict import shown, unknown_key
from cobot.yaml_file import read_mapping

SETTINGS_FILE = "cobot-setting.yaml"
DEFAULT_SETTINGS = f"pkg://config/{SETTINGS_FILE}"
SECTIONS_OF_A_ROBOT = ("rt", "streaming", "planning")
"""Sections that an entry in `robots` may change, in addition to the sections about the robot itself."""


def load_settings(path: Path | None = None, over: dict[str, Any] | None = None) -> Settings:
    """Read the settings. Without a path, only the file that is part of cobot is read.

    The user's file needs only the keys whose values differ from cobot's own file. It may contain a list
    `robots`. Each entry contains the values for one robot that differ from the other settings in the file.

    Args:
        over: content that replaces values in the file, with absolute paths.

    Raises:
        ConfigError: a file is invalid. The error names the file, the key, the value and the valid values.
    """
    shipped = resolve(DEFAULT_SETTINGS, Path())
    content = read_mapping(shipped)
    path = shipped if path is None else path.resolve()
    if path != shipped:
        content = _merged(content, _with_backend_at_robot(path, read_mapping(path)))
    if over is not None:
        content = _merged(content, over)
    if "robots" not in content:
        return parse(Settings, path, content)
    entries = content.pop("robots")
    return _of_several(path, content, entries)


def _of_several(path: Path, content: dict[str, Any], entries: Any) -> Settings:
    """The settings from a file that has a list `robots`. `content` is the rest of the file, without this
    list.
    """
    each = [
        parse(Settings, path, _merged(content, changes), place=f"robots[{index}]: ")
        for index, changes in enumerate(_changes_of_each(path, entries))
    ]
    names = [settings.robot.name for settings in each]
    for index, name in enumerate(names):
        if name in names[:index]:
            first = names.index(name)
            raise ConfigError(
                f"{path}: robots[{index}]: robots[{first}] already has the name {name!r}; give each "
                "robot its own name"
            )
    return each[0].model_copy(update={"robots": tuple(each)})


def _changes_of_each(path: Path, entries: Any) -> Iterator[dict[str, Any]]:
    """The changes that each entry in `robots` makes to the settings."""
    if not isinstance(entries, list) or not entries:
        raise ConfigError(f"{path}: robots: must be a list of one or more robots, got {shown(entries)}")
    valid = [*RobotSection.model_fields, "joint_limits", *SECTIONS_OF_A_ROBOT]
    for index, entry in enumerate(entries):
        place = f"{path}: robots[{index}]"
        if not isinstance(entry, dict) or "name" not in entry:
            raise ConfigError(f"{place}: must be a mapping with a name, got {shown(entry)}")
        for key in entry:
            if key not in valid:
                raise ConfigError(f"{place}: {unknown_key(str(key), valid)}")
        changes = {key: entry[key] for key in SECTIONS_OF_A_ROBOT if key in entry}
        changes["robot"] = {key: entry[key] for key in RobotSection.model_fields if key in entry}
        changes = _with_backend_at_robot(place, changes)
        if "joint_limits" in entry:
            changes["web"] = {"joint_limits": entry["joint_limits"]}
        yield changes


def _with_backend_at_robot(place: object, content: dict[str, Any]) -> dict[str, Any]:
    """Move a backend from the section `rt`, where older files define it, to the section `robot`.

    Raises:
        ConfigError: both sections define a backend.
    """
    rt, robot = content.get("rt"), content.get("robot", {})
    if not isinstance(rt, dict) or "backend" not in rt or not isinstance(robot, dict):
        return content
    if "backend" in robot:
        raise ConfigError(
            f"{place}: rt.backend is {shown(rt['backend'])} and robot.backend is "
            f"{shown(robot['backend'])}: give only robot.backend, the newer name"
        )
    left = {key: value for key, value in rt.items() if key != "backend"}
    return {**content, "rt": left, "robot": {**robot, "backend": rt["backend"]}}


def _merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`base` with `changes` applied.

    A backend or gripper is replaced as a whole, because its options belong to its type.
    """
    merged = dict(base)
    for key, value in changes.items():
        both = isinstance(value, dict) and isinstance(base.get(key), dict)
        merged[key] = _merged(base[key], value) if both and key not in ("backend", "gripper") else value
    return merged
