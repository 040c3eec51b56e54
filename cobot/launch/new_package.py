"""Parts that `cobot backend new` and `cobot gripper new` share: making pyproject.toml, checking a name, and
writing a folder with files.
"""

from __future__ import annotations

import keyword
import re
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from cobot.errors import ConfigError

PYPROJECT = """\
[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "{distribution}"
version = "0.1.0"
description = "{description}"
requires-python = ">=3.11"
dependencies = ["cobot>={version}"]

[project.entry-points."cobot.{group}"]
{name} = "{package}:{kind}"

[tool.setuptools]
py-modules = ["{package}"]
"""
NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
MAX_LENGTH = 40


def check_name(name: str, taken: Mapping[str, str], what: str, suffix: str) -> None:
    """Check that a new backend or gripper can have this name.

    Args:
        taken: the names that exist, each with the location where it is defined.
        what: "backend" or "gripper".
        suffix: appended to the examples of valid names in messages.

    Raises:
        ConfigError: the name is invalid, reserved by Python, or taken.
    """
    if len(name) > MAX_LENGTH or not NAME.fullmatch(name):
        raise ConfigError(
            f"{name[:80]!r} is not a valid name for a {what}; use up to {MAX_LENGTH} lowercase letters, "
            f"digits and single underscores, beginning with a letter, such as my_{suffix}"
        )
    if keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in sys.stdlib_module_names:
        raise ConfigError(f"{name!r} is reserved by Python: choose another name, such as {name}_{suffix}")
    if name in taken:
        valid = ", ".join(sorted(taken))
        raise ConfigError(f"{name!r} is taken by {taken[name]}; the {what}s are: {valid}")


def write_package(folder: Path, files: Mapping[str, str]) -> None:
    """Create a folder with the given files, either completely or not at all.

    Raises:
        ConfigError: the folder exists or cannot be written; nothing has been written.
    """
    parent = folder.parent
    if folder.exists():
        raise ConfigError(f"{folder}: already exists; choose another folder, or remove it")
    if not parent.is_dir():
        raise ConfigError(f"{folder}: cannot be written: there is no folder {parent}; create it first")
    try:
        with tempfile.TemporaryDirectory(dir=parent, prefix=".new-package-") as made:
            inside = Path(made) / "package"
            for place, content in files.items():
                file = inside / place
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(content, encoding="utf-8")
            inside.rename(folder)
    except OSError as exc:
        raise ConfigError(
            f"{folder}: cannot be written: {exc.strerror or exc}; choose another folder"
        ) from exc
