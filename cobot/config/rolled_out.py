"""Settings that a fleet has rolled out. They replace values in the user's file, which does not change."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cobot.config.locations import resolve
from cobot.config.reading import load_settings
from cobot.config.settings import Settings
from cobot.errors import ConfigError
from cobot.strict import shown, unknown_key
from cobot.yaml_file import read_mapping

ROLLED_OUT_FILE = "settings.yaml"
FILES = {"robot": ("srdf", "cell"), "web": ("joint_limits",)}
"""Settings that name files; a fleet rolls them out with these files."""
OTHERS = {"robot": ("gripper",), "planning": None, "streaming": None, "recording": None}
"""Other settings that a fleet can roll out; None means the whole section. Settings about access are not among
them.
"""


def load_with_rolled_out(path: Path | None) -> Settings:
    """Read the settings as the next start or reload of a cell would apply them.

    Raises:
        ConfigError: see `load_settings`. Also if the rolled-out settings no longer match the user's file.
    """
    settings = load_settings(path)
    file = settings.rolled_out / ROLLED_OUT_FILE
    if not advice(settings):
        return settings
    try:
        if settings.robots:
            raise ConfigError(
                f"{path} has several robots, but settings can be rolled out only to a cell with one robot"
            )
        return load_settings(path, read_rolled_out(file.resolve()))
    except ConfigError as exc:
        raise ConfigError(f"{exc}; {advice(settings)}") from exc


def advice(settings: Settings) -> str:
    """A hint for a start that fails while rolled-out settings are in force; "" otherwise."""
    link = settings.rolled_out
    if not settings.fleet.connect or not link.is_symlink():
        return ""
    return f"the fleet has rolled out {link / ROLLED_OUT_FILE}; to continue without it, remove {link}"


def read_rolled_out(file: Path) -> dict[str, Any]:
    """The content of a file of rolled-out settings, with absolute paths.

    Raises:
        ConfigError: the file is not valid, or contains a setting that cannot be rolled out.
    """
    content = read_mapping(file)
    valid = sorted({*FILES, *OTHERS})
    for section, changes in content.items():
        if section not in valid:
            raise ConfigError(f"{file}: cannot be rolled out: {unknown_key(str(section), valid)}")
        if not isinstance(changes, dict):
            raise ConfigError(f"{file}: {section}: must be a mapping, got {shown(changes)}")
        files = FILES.get(section, ())
        keys = OTHERS.get(section, ())
        for key, value in changes.items():
            if keys is not None and key not in (*files, *keys):
                raise ConfigError(
                    f"{file}: cannot be rolled out: {section}: {unknown_key(str(key), [*files, *keys])}"
                )
            if key in files and value is not None:
                changes[key] = str(_inside(file, f"{section}.{key}", value))
    return content


def _inside(file: Path, key: str, value: object) -> Path:
    """The file that a setting names. It must be one of the rolled-out files."""
    if isinstance(value, str):
        found = resolve(value, file.parent)
        if found.is_relative_to(file.parent) or value.startswith("pkg://"):
            return found
    raise ConfigError(f"{file}: {key}: is {shown(value)}; it must be a file next to {file.name}")
