"""RRT-Connect of VAMP (Apache-2.0), which checks samples of its path with spheres, and keeps no margin.

W. Thomason, Z. Kingston, L. E. Kavraki, "Motions in Microseconds via Vectorized Sampling-Based Planning",
2024, arXiv 2309.14545. There is no wheel, and its own build downloads sources. It is compiled
here without downloads, see `vamp_parts/FetchInitCPM.cmake`, with all instructions of this processor.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tarfile
import time
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType

from scipy.spatial.transform import Rotation

from benchmarks.planning.motion_bench_maker import ARCHIVES, ARMS, Problem, archive
from benchmarks.planning.peers.searches import MissingPeer, Search, Unsolved
from cobot.robot.scene import Scene

PARTS = Path(__file__).with_name("vamp_parts")
BUILD = ARCHIVES / "vamp"
RANGES_RAD = {"panda": 1.0, "ur5": 1.5}
"""Longest edges, as `vamp.constants.ROBOT_RRT_RANGES` has them."""
MAX_ITERATIONS = 1_000_000


def search_of(arm: str) -> Search:
    """
    Raises:
        MissingPeer: it is not compiled and cannot be.
    """
    vamp = _module()
    robot = getattr(vamp, arm)

    def search(problem: Problem) -> tuple[float, ...] | Unsolved:
        around = _environment(vamp, problem.scene, boxes_alone=problem.name.startswith("box "))
        start, goal = (list(map(float, end)) for end in (problem.start, problem.goal))
        if not (robot.validate(start, around) and robot.validate(goal, around)):
            return Unsolved.ENDS
        settings = vamp.RRTCSettings()
        settings.range = RANGES_RAD[arm]
        settings.max_iterations = settings.max_samples = MAX_ITERATIONS
        samples = robot.halton()
        begun_ns = time.process_time_ns()
        found = robot.rrtc(start, [goal], around, settings, samples)
        searched_ns = time.process_time_ns()
        if not found.solved:
            return Unsolved.SEARCH
        robot.simplify(found.path, around, vamp.SimplifySettings(), samples)
        return (searched_ns - begun_ns) / 1e6, (time.process_time_ns() - begun_ns) / 1e6

    return search


def _environment(vamp: ModuleType, scene: Scene, boxes_alone: bool) -> object:
    """The objects, converted as in VAMP's own evaluation: cylinders become capsules, except in the scenes
    "box", where they become boxes.
    """
    around = vamp.Environment()
    for each in scene.objects.values():
        place, (w, *vector) = list(each.pose[:3]), each.pose[3:]
        angles = Rotation.from_quat([*vector, w]).as_euler("XYZ").tolist()
        if each.shape == "box":
            around.add_cuboid(vamp.Cuboid(place, angles, [0.5 * side for side in each.size]))
            continue
        radius, length = each.size
        if boxes_alone:
            around.add_cuboid(vamp.Cuboid(place, angles, [radius, radius, 0.5 * length]))
        else:
            around.add_capsule(vamp.Cylinder(place, angles, radius, length))
    return around


@cache
def _module() -> ModuleType:
    if not (made := sorted(BUILD.glob("_core_ext.*.so"))):
        _compile()
        made = sorted(BUILD.glob("_core_ext.*.so"))
    spec = importlib.util.spec_from_file_location("_core_ext", made[0])
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except ImportError as exc:
        raise MissingPeer(f"{made[0]} does not fit this Python: delete it ({exc})") from exc
    return module


def _compile() -> None:
    """Compile VAMP, which takes one to two minutes."""
    if not (shutil.which("cmake") and (shutil.which("c++") or shutil.which("g++"))):
        raise MissingPeer("not compiled: cmake or a C++ compiler is missing")
    try:
        prefix = Path(str(distribution("cmeel-eigen").locate_file("cmeel.prefix")))
        import nanobind
    except (PackageNotFoundError, ImportError) as exc:
        raise MissingPeer("not compiled: Eigen or nanobind is missing (pip install .[bench])") from exc
    print("compiling VAMP, which takes one to two minutes", file=sys.stderr)
    if (source := archive()) is None:
        raise MissingPeer(f"not compiled: no vamp_planner-*.tar.gz in {ARCHIVES}")
    with tarfile.open(source) as packed:
        packed.extractall(ARCHIVES, filter="data")
    robots = {"VAMP_ROBOT_MODULES": list(ARMS), "VAMP_ROBOT_STRUCTS": ["Panda", "UR5"]}
    options = {
        "CMAKE_BUILD_TYPE": "Release",
        "CMAKE_MODULE_PATH": PARTS,
        "CMAKE_PREFIX_PATH": prefix,
        "CMAKE_CXX_FLAGS": f"-isystem {prefix / 'include'} -isystem {PARTS}",
        "PARTS": PARTS,
        "Python_EXECUTABLE": sys.executable,
        "nanobind_DIR": nanobind.cmake_dir(),
        "VAMP_INSTALL_CPP_LIBRARY": "OFF",
        "VAMP_LTO": "OFF",  # as its wheels would be built
        **{name: ";".join(names) for name, names in robots.items()},
    }
    unpacked = next(ARCHIVES.glob("vamp_planner-*/"))
    configure = [
        "cmake",
        "-S",
        unpacked,
        "-B",
        BUILD,
        *(f"-D{name}={value}" for name, value in options.items()),
    ]
    BUILD.mkdir(exist_ok=True)
    with (BUILD / "build.log").open("w") as log:
        for command in (configure, ["cmake", "--build", BUILD, "--target", "_core_ext"]):
            if subprocess.run(list(map(str, command)), stdout=log, stderr=log, check=False).returncode:
                raise MissingPeer(f"not compiled: see {log.name}")
