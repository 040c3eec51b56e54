"""The ROS interfaces of the vendor services and actions: their definitions, and the package that a ROS user
builds.

`python -m app.aubo.interfaces FOLDER` writes the package below a folder, from the registry. With --small, the
package has only the interfaces that the manual's client needs. Both packages have the same name, because the
name is part of the types.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import textwrap
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

from app.actions.servo_action import ServoModeAction
from app.aubo.classes import REGISTRY
from app.aubo.fields import REQUIRED, ServiceField
from app.aubo.registry import VendorService
from cobot.errors import ConfigError

PACKAGE = "aubo_interfaces"
WIDTH = 110
ACTIONS = {"ServoMode": ServoModeAction.definition}
"""The definitions of the vendor actions, by name."""
SMALL = frozenset(
    f"{PACKAGE}/srv/{name}"
    for name in ("GetDof", "GetExecId", "GetJointPositions", "InverseKinematics", "IsSteady", "MoveJoint")
)
"""Interfaces that the client in section 8.0 of the manual needs. Building them takes a few dozen compile
steps instead of 2,068.
"""

LISTED = re.compile(r'^  "(.+)"$', re.MULTILINE)
"""Pattern of a line in CMakeLists.txt that lists an interface."""

PACKAGE_XML = """<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>0.1.0</version>
  <description>Services and actions of a robot served by cobot. Generated from its registry.</description>
  <maintainer email="cobot@example.com">cobot</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <build_depend>rosidl_default_generators</build_depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""
CMAKE_LISTS = """cmake_minimum_required(VERSION 3.8)
project({package})

find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)

rosidl_generate_interfaces(${{PROJECT_NAME}}
{files}
)

ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""


@cache
def interface_definitions() -> Mapping[str, str]:
    """Return the definition of each interface, by type: `aubo_interfaces/srv/GetDof`,
    `.../action/ServoMode`.
    """
    by_type: dict[str, list[VendorService]] = {}
    for found in REGISTRY.values():
        by_type.setdefault(found.type_name, []).append(found)
    services = {f"{PACKAGE}/srv/{name}": _srv(by_type[name]) for name in sorted(by_type)}
    actions = {f"{PACKAGE}/action/{name}": ACTIONS[name] for name in sorted(ACTIONS)}
    return MappingProxyType(services | actions)


def package_files(wanted: Collection[str] | None = None) -> dict[str, str]:
    """Return the content of each file of the package, by its path in the package's folder.

    Args:
        wanted: the types in the package; None: all.
    """
    texts = {}
    for name, text in interface_definitions().items():
        _, kind, short = name.split("/")
        if wanted is None or name in wanted:
            texts[f"{kind}/{short}.{kind}"] = text
    listed = "\n".join(f'  "{path}"' for path in texts)
    return {
        "package.xml": PACKAGE_XML.format(package=PACKAGE),
        "CMakeLists.txt": CMAKE_LISTS.format(package=PACKAGE, files=listed),
        **texts,
    }


def write_package(folder: Path, files: Mapping[str, str]) -> None:
    """Write the files to a folder that is empty, does not exist, or contains only an earlier version of the
    package.

    Raises:
        ConfigError: the folder has other files; nothing has been changed.
        OSError: it cannot be written.
    """
    for earlier in _earlier_files(folder):
        earlier.unlink()
    for path, text in files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")


def _earlier_files(folder: Path) -> list[Path]:
    """Return the files of a package that this module has written, as listed in its CMakeLists.txt."""
    if not folder.exists():
        return []
    if not folder.is_dir():
        raise ConfigError(f"{folder}: is a file; move it, or choose another folder")
    files = [path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir()]
    description, build = folder / "package.xml", folder / "CMakeLists.txt"
    known: set[Path] = set()
    if description.is_file() and description.read_bytes() == PACKAGE_XML.format(package=PACKAGE).encode():
        listed = LISTED.findall(build.read_text("utf-8", "replace")) if build.is_file() else []
        known = {description, build, *(folder / path for path in listed)}
    if other := sorted(str(path.relative_to(folder)) for path in files if path not in known):
        more = f" and {len(other) - 3} more" if len(other) > 3 else ""
        raise ConfigError(
            f"{folder}: has other files, which this command has not written: {', '.join(other[:3])}{more}; "
            f"move them, or choose another folder"
        )
    return files


def _srv(services: list[VendorService]) -> str:
    """Return the .srv definition of all services that share a type."""
    first = services[0]
    lines: list[str] = []
    for found in services:
        lines += _comment(f"/ROBOT/{found.robot_class}/{found.method}: {found.doc}")
    lines += [line for field in first.parameters for line in _lines(field)]
    lines += [
        "---",
        *_comment("0 is success"),
        "int32 code",
        *_comment("the error"),
        "string message",
    ]
    return "\n".join([*lines, *_lines(first.result)]) + "\n"


def _lines(field: ServiceField) -> list[str]:
    defaulted = field.default not in (REQUIRED, None, field.empty)
    note = f" {json.dumps(field.empty)} stands for {json.dumps(field.default)}." if defaulted else ""
    return [*_comment(field.doc + note), f"{field.ros_type} {field.name}"]


def _comment(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent="# ", subsequent_indent="#   ", break_long_words=False)


def main() -> int:
    """Write the package that a ROS user builds. Returns the exit status: 0, or 2 if nothing was written."""
    parser = argparse.ArgumentParser(prog="python -m app.aubo.interfaces", description=__doc__)
    parser.add_argument("folder", type=Path, help="the src folder of a colcon workspace")
    parser.add_argument(
        "--small", action="store_true", help="only the interfaces that the manual's client needs"
    )
    chosen = parser.parse_args()
    files = package_files(SMALL if chosen.small else None)
    try:
        write_package(chosen.folder / PACKAGE, files)
    except (ConfigError, OSError) as exc:
        print(exc, file=sys.stderr)
        return 2
    print(f"{chosen.folder / PACKAGE}: {len(files) - 2} interfaces")
    return 0


if __name__ == "__main__":
    sys.exit(main())
