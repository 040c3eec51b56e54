"""Finds the files that settings name."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator, ValidationInfo

from cobot import shipped
from cobot.errors import ConfigError


def resolve(location: str, folder: Path) -> Path:
    """The file that a setting names: pkg://PACKAGE/PATH, ~/PATH, or relative to `folder`.

    pkg://config and pkg://sequences contain files that are part of cobot.

    Raises:
        ConfigError: the package is not installed, or the path leads out of it.
    """
    if not location.startswith("pkg://"):
        try:
            return (folder / Path(location).expanduser()).resolve()
        except (RuntimeError, OSError, ValueError) as exc:  # unknown user, a cycle of links, or a NUL byte
            raise ConfigError(f"{location}: {exc}") from exc
    package, _, inner = location.removeprefix("pkg://").partition("/")
    root = _folder_of(package)
    if root is None:
        raise ConfigError(f"{location}: the Python package {package!r} is not installed")
    path = (root / inner).resolve()
    if not path.is_relative_to(root):
        raise ConfigError(f"{location}: is outside the package {package!r}")
    return path


def _folder_of(package: str) -> Path | None:
    """The folder of this name that is part of cobot, otherwise the folder of an installed package; None if
    neither exists.

    cobot's files come first, because another package may also be named `config`.
    """
    if package in shipped.NAMES:
        return (shipped.FOLDER / package).resolve()
    try:
        spec = importlib.util.find_spec(package) if package.isidentifier() else None
    except (ImportError, ValueError):
        return None
    if spec is None or not spec.submodule_search_locations:
        return None
    return Path(next(iter(spec.submodule_search_locations))).resolve()


def _in_folder(value: object, info: ValidationInfo) -> Path:
    if not isinstance(value, str) or "\0" in value:
        raise ValueError(f"must be a path, got {value!r}")
    return resolve(value, (info.context or {})["folder"])


Location = Annotated[Path, BeforeValidator(_in_folder)]
"""A path in a settings file. It is resolved against the folder of that file."""
