"""The packages that users of ROS 2 build. Oracles: catkin_pkg, colcon and rosidl, of ROS 2 itself."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from real_ros import PYTHON, SEED, built_packages, environment, need_ros, users_packages

from app.aubo.interfaces import PACKAGE, SMALL, package_files, write_package
from cobot.config import Settings
from cobot.launch.moveit import write_moveit_config

pytestmark = pytest.mark.thorough

VALIDATE = """
import sys
from catkin_pkg.package import parse_package
for folder in sys.argv[1:]:
    warnings = []
    package = parse_package(folder, warnings=warnings)
    package.validate(warnings=warnings)
    assert not warnings, warnings
    print(package.name, *(str(group) for group in package.member_of_groups))
"""
USE = """
import sys
from importlib import import_module
for type_ in sys.argv[1:]:
    package, kind, name = type_.split("/")
    made = getattr(import_module(f"{package}.{kind}"), name)
    for part in ("Request", "Response", "Goal", "Result"):
        if hasattr(made, part):
            print(type_, part, sorted(getattr(made, part).get_fields_and_field_types()))
"""


def test_each_package_says_about_itself_what_ros_asks_for(settings: Settings, tmp_path: Path) -> None:
    need_ros()
    moveit = write_moveit_config(settings, tmp_path)
    whole, small = tmp_path / "whole" / PACKAGE, tmp_path / "small" / PACKAGE
    write_package(whole, package_files())
    write_package(small, package_files(SMALL))
    command = [PYTHON, "-c", VALIDATE, whole, small, moveit]
    said = subprocess.run(command, env=environment(), capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    interfaces = "aubo_interfaces rosidl_interface_packages"
    assert said.stdout.splitlines() == [interfaces, interfaces, "iiwa_moveit_config"]


@pytest.mark.timeout(600)
def test_interfaces_are_built_and_imported() -> None:
    """Few of them: all 295 take more than half an hour of a core."""
    packages = users_packages()
    files = [path.removesuffix(".srv").removesuffix(".action") for path in packages["aubo_interfaces"]]
    types = [f"aubo_interfaces/{path}" for path in files if "/" in path]
    command = [PYTHON, "-c", USE, *types]
    prefix = built_packages(packages)
    said = subprocess.run(command, env=environment(prefix), capture_output=True, text=True, check=False)
    assert said.returncode == 0, f"seed {SEED}: {said.stderr}"
    assert {line.split()[0] for line in said.stdout.splitlines()} == set(types)
