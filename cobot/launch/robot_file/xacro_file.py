"""Expands xacro to URDF.

This runs in the worker, because a xacro file contains Python expressions, which may never end.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from xml.dom.minidom import parse
from xml.parsers.expat import ExpatError

from cobot.errors import ConfigError
from cobot.launch.robot_file.packages import find_package


def expand(file: Path, into: Path, arguments: Mapping[str, str], packages: Sequence[Path]) -> None:
    """Write the URDF that a xacro file describes.

    Args:
        into: the file to write, in UTF-8.
        arguments: values of the file's `<xacro:arg>`.
        packages: see `find_package`.

    Raises:
        ConfigError: xacro cannot expand the file. The message gives the reason without the file's name.
    """
    _provide_packages(file, packages)
    import xacro

    try:
        document = xacro.process_file(str(file), mappings=dict(arguments))
    except ConfigError:
        raise
    except (Exception, SystemExit) as exc:  # expressions in the file may raise any error
        reason = " ".join(str(exc).split()) or type(exc).__name__
        raise ConfigError(f"xacro cannot expand it: {reason}{_known_arguments(file)}") from exc
    into.write_text(document.toprettyxml(indent="  "), encoding="utf-8")


def _provide_packages(file: Path, packages: Sequence[Path]) -> None:
    """Provide the folders for `$(find NAME)`. Otherwise xacro would look for them in a ROS installation."""
    index = ModuleType("ament_index_python.packages")
    index.get_package_share_directory = (  # type: ignore[attr-defined]
        lambda name: str(find_package(name, file, packages))
    )
    sys.modules["ament_index_python"] = ModuleType("ament_index_python")
    sys.modules["ament_index_python.packages"] = index


def _known_arguments(file: Path) -> str:
    """The arguments that a file declares, as a hint; "" if it declares no arguments."""
    try:
        declared = parse(str(file)).getElementsByTagName("xacro:arg")
    except (ExpatError, OSError, ValueError):  # it has already been reported
        return ""
    names = [argument.getAttribute("name") for argument in declared]
    return f"; its arguments are: {', '.join(names)}; set them with --xacro NAME:=VALUE" if names else ""
