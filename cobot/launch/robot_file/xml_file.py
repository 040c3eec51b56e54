"""Reads the XML of a robot's file: URDF, MJCF, or xacro, which is expanded to URDF."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from cobot.errors import ConfigError
from cobot.launch.robot_file.worker import Worker, absolute
from cobot.xml_file import Element, parse, where

__all__ = ["read_xml", "where"]


def read_xml(
    file: Path, worker: Worker, arguments: Mapping[str, str], packages: Sequence[Path]
) -> tuple[Element, Path]:
    """The root of a URDF or MJCF file, and the file's name for errors.

    For a xacro file, line numbers refer to the URDF to which it expands, so "(expanded)" is added to its
    name.

    Args:
        arguments: values of the arguments of a xacro file.
        packages: folders of ROS packages, see `find_package`.

    Raises:
        ConfigError: the file is missing, is not XML, is neither URDF nor MJCF, or cannot be expanded.
    """
    root, xacro_line = parse(file)
    named = file
    if xacro_line or file.suffix == ".xacro":
        root = _expand(file, worker, arguments, packages)
        named = file.with_name(f"{file.name} (expanded)")
    elif arguments:
        raise ConfigError(f"{file}: is not xacro, so --xacro has no effect; omit it")
    if root.tag not in ("robot", "mujoco"):
        raise ConfigError(
            f"{named}: the first element is <{root.tag}>; it must be <robot> (URDF) or <mujoco> (MJCF)"
        )
    return root, named


def _expand(file: Path, worker: Worker, arguments: Mapping[str, str], packages: Sequence[Path]) -> Element:
    with tempfile.TemporaryDirectory() as place:
        into = Path(place) / "expanded.urdf"
        try:
            worker.ask(
                "xacro",
                file=absolute(file),
                into=str(into),
                arguments=dict(arguments),
                packages=[absolute(folder) for folder in packages],
            )
        except ConfigError as exc:
            raise ConfigError(f"{file}: {exc}") from exc
        root, _ = parse(into)
    return root
