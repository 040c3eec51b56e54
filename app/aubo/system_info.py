"""SystemInfo: versions and times."""

from __future__ import annotations

import hashlib
import platform
import time
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import cobot
from app.aubo.registry import Int64, service

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "SystemInfo"
PACKAGES = ("app", "cobot", "rtloop")


@service(CLASS)
def get_control_software_version_code(robot: Services) -> int:
    """The version of this software as one number.

    Returns:
        1002003 for version 1.2.3.
    """
    del robot
    return _code(version("cobot"))


@service(CLASS)
def get_control_software_full_version(robot: Services) -> str:
    """The version of this software.

    Returns:
        the version, such as "1.2.3".
    """
    del robot
    return version("cobot")


@service(CLASS)
def get_interface_version_code(robot: Services) -> int:
    """The version of this interface, which is the version of the software.

    Returns:
        1002003 for version 1.2.3.
    """
    del robot
    return _code(version("cobot"))


@service(CLASS)
def get_control_software_version_hash(robot: Services) -> str:
    """A hash of the source code of this software.

    Returns:
        the first 16 digits of the SHA-256 of all its Python files.
    """
    del robot
    return _source_hash()


@service(CLASS)
def get_control_software_build_date(robot: Services) -> str:
    """The modification time of the newest Python file of this software.

    Returns:
        the time in the form of ISO 8601, UTC.
    """
    del robot
    newest = max(path.stat().st_mtime for path in _sources())
    return datetime.fromtimestamp(newest, UTC).isoformat(timespec="seconds")


@service(CLASS)
def get_control_system_time(robot: Services) -> Int64:
    """The computer's time.

    Returns:
        the time, ns since 1970-01-01, UTC.
    """
    del robot
    return time.time_ns()


@service(CLASS)
def get_platform(robot: Services) -> str:
    """The platform that this software runs on.

    Returns:
        Python's version and the operating system.
    """
    del robot
    return f"Python {platform.python_version()}, {platform.platform()}"


def _code(text: str) -> int:
    major, minor, patch = (int(part) for part in text.split(".")[:3])
    return (major * 1000 + minor) * 1000 + patch


def _sources() -> list[Path]:
    root = Path(cobot.__file__).parent.parent
    return sorted(path for package in PACKAGES for path in (root / package).rglob("*.py"))


@cache
def _source_hash() -> str:
    digest = hashlib.sha256()
    for path in _sources():
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
