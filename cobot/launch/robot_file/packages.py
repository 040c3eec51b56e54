"""Finds the ROS packages that a robot's file names as `package://NAME/...` or, in xacro, `$(find NAME)`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

from cobot.errors import ConfigError

MANIFEST = "package.xml"


def find_package(name: str, file: Path, given: Sequence[Path], inner: str = "") -> Path:
    """The folder of a package.

    The name of the package must be that of its folder or in its manifest. The search covers the given folders
    and the folders directly in them; the folders next to the file; then the folders that contain the file,
    and the packages next to the file's own package.

    Args:
        file: the robot's file.
        given: folders of packages, or folders that contain packages.
        inner: a file in the package. If a given folder contains this file but no manifest, it is the package,
            even if its name differs.

    Raises:
        ConfigError: the package was not found; the message says what to do.
    """
    for folder in _candidates(name, file, given):
        if (folder / name).is_dir():
            return folder / name
        for place in (folder, *_packages_below(folder)):
            if _name(place) == name:
                return place
    for folder in given:
        if inner and (folder / inner).is_file() and not (folder / MANIFEST).is_file():
            return folder
    looked = f" ({', '.join(map(str, given))})" if given else ""
    raise ConfigError(
        f"there is no package {name!r} in the folders given{looked} or next to the file: add "
        f"--package FOLDER, the folder of {name} or the one above it"
    )


def _candidates(name: str, file: Path, given: Sequence[Path]) -> Iterator[Path]:
    yield from given
    if (file.parent / name).is_dir():  # package://meshes/..., after a tool has removed the package's name.
        yield file.parent
    for folder in file.resolve().parents:
        if (folder / MANIFEST).is_file() or folder.name == name:
            yield folder
            yield folder.parent


def _packages_below(folder: Path) -> Iterator[Path]:
    for manifest in sorted(folder.glob(f"*/{MANIFEST}")):
        yield manifest.parent


def _name(folder: Path) -> str:
    """Name of the package in a folder: the name in its manifest, or the folder name if there is no
    manifest.
    """
    try:
        found = ElementTree.parse(folder / MANIFEST).getroot().findtext("name")
    except (OSError, ElementTree.ParseError):
        found = None
    return (found or folder.resolve().name).strip()
