"""The XML of a robot's file: URDF or MJCF, not xacro."""

from __future__ import annotations

from pathlib import Path

from cobot.errors import ConfigError
from cobot.xml_file import Element, parse, where

__all__ = ["read_xml", "where"]


def read_xml(file: Path) -> Element:
    """The root of a URDF or MJCF file.

    Raises:
        ConfigError: the file is missing, is not XML, or is neither format; for xacro it gives the command
            that expands it.
    """
    root, xacro = parse(file)
    if xacro or file.suffix == ".xacro":
        stem = file.name.split(".")[0] + ("" if file.suffix == ".xacro" else "_expanded")
        where = f":{xacro}" if xacro else ""
        raise ConfigError(f"{file}{where}: is xacro; expand it first: xacro {file.name} > {stem}.urdf")
    if root.tag not in ("robot", "mujoco"):
        raise ConfigError(
            f"{file}: the first element is <{root.tag}>; it must be <robot> (URDF) or <mujoco> (MJCF)"
        )
    return root
