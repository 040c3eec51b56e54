"""The compiled modules under the address and undefined-behaviour sanitizers, with the tests that work them.

A copy of the checkout is compiled with COBOT_SANITIZE=1, and the tests run there in a process of their own.
What is compiled stays in build/sanitized: the next run compiles what has changed since, by its content.
Leaks are not looked for: the interpreter keeps much until it ends.
"""

from __future__ import annotations

import fcntl
import filecmp
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COPIED = (
    "benchmarks",
    "cobot",
    "rtloop",
    "app",
    "sequences",
    "config",
    "examples/pick_and_place",
    "tests",
    "pyproject.toml",
    "setup.py",
    "requirements/build.lock",
)
# Every file here works compiled modules with valid and with invalid input, and all of them together each one.
TESTS = (
    "tests/cobot/test_arrays.py",
    "tests/cobot/test_polynomials.py",
    "tests/cobot/planners/test_derivatives.py",
    "tests/cobot/planners/test_descent.py",
    "tests/cobot/planners/test_interior_point.py",
    "tests/cobot/planners/test_lattice.py",
    "tests/cobot/planners/test_rrt_connect.py",
    "tests/cobot/planners/search/test_constrained.py::test_a_projected_configuration_keeps_all_or_there_is_none",
    "tests/cobot/planners/search/test_constrained.py::test_a_projection_without_constraints_brings_the_joints_into_their_ranges",
    "tests/cobot/planners/search/test_constrained.py::test_a_tool_that_points_the_opposite_way_is_turned_into_its_cone",
    "tests/cobot/planners/search/test_constrained.py::test_steps_towards_a_target_follow_their_law",
    "tests/cobot/planners/timing/test_timed_fit.py::test_the_compiled_fit_follows_its_law",
    "tests/cobot/robot/test_chain.py",
    "tests/cobot/robot/test_dynamics.py",
    "tests/cobot/robot/inverse_kinematics",
    "tests/cobot/robot/test_clearance.py",
    "tests/cobot/robot/test_linear.py",
    "tests/cobot/robot/test_spheres.py",
    "tests/rtloop/backends/test_cell.py",
    "tests/rtloop/backends/test_laws.py",
    "tests/rtloop/generators/test_laws.py",
    "tests/rtloop/generators/test_otg.py",
    "tests/rtloop/generators/test_target_range.py",
    "tests/rtloop/generators/test_tracking_law.py",
    "tests/rtloop/inboxes",
    "tests/rtloop/planned/test_path_law.py",
    "tests/rtloop/safety/test_limiter_law.py",
    "tests/rtloop/sources/test_laws.py",
    "tests/rtloop/streaming/test_client_watch.py",
    "tests/rtloop/streaming/test_collision_monitor.py",
    "tests/rtloop/streaming/test_contact_monitor.py",
    "tests/rtloop/streaming/test_feed.py",
    "tests/rtloop/test_clock.py",
    "tests/rtloop/test_fence.py",
    "tests/rtloop/test_publisher.py",
    "tests/rtloop/test_recording.py",
    "tests/rtloop/test_wild_loop.py",
)
WILD_LOOP = "tests/rtloop/test_wild_loop.py::test_no_bytes_crash_the_loop_or_lead_it_beyond_the_limits"
SCENES = "cage", "shelf", "table"
NARROW = "test_ways_out_of_narrow_places_are_not_much_longer_than_the_best_and_the_same_again"
# These take long there: half a minute, of modules that the sources and the whole loop work too; searches that
# other tests make in other scenes; and another interpreter for a test that differs from its neighbour only in
# its seed.
TOO_LONG = (
    *(f"tests/cobot/planners/test_rrt_connect.py::test_a_path_makes_no_detour[{each}]" for each in SCENES),
    f"tests/cobot/planners/test_rrt_connect.py::{NARROW}",
    "tests/rtloop/generators/test_laws.py::test_poses_within_the_limits_of_the_tcp",
    "tests/rtloop/planned/test_path_law.py::test_the_rate_changes_as_the_law_says",
    f"{WILD_LOOP}[80000-2-between-loopback]",
)
SHARE_OF_SAMPLES = "0.01"
LIMIT_S = 1200
WHOLE = "whole"
"""A file that says that the last build came to its end."""
FAULTY_SOURCE = Path("cobot", "faulty.pyx")
# What the sanitizers must find, or the whole test says nothing.
FAULTY = """
from cobot.arrays cimport doubles

def read(array, Py_ssize_t index):
    return doubles(array, 1)[index]

def whole(double value):
    return <int>value
"""


def runtime(name: str) -> Path:
    """A library of the compiler's."""
    command = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")
    if not shutil.which(command[0]):
        command = ["gcc"]
    asked = [*command, f"-print-file-name={name}"]
    return Path(subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip())


def in_copy(copy: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    # libstdc++ comes first because libasan looks for its `throw` once, at the start.
    environment = {
        **os.environ,
        "LD_PRELOAD": f"{runtime('libasan.so')} {runtime('libstdc++.so.6')}",
        # Where memory came from is told in few lines: keeping the calls of each allocation takes long.
        "ASAN_OPTIONS": "detect_leaks=0:malloc_context_size=2",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        "PYTHONMALLOC": "malloc",  # Each object of Python's has its own bounds then.
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # Importing them takes seconds there.
        "PYTHONPATH": str(copy),
        "COBOT_SHARE_OF_SAMPLES": SHARE_OF_SAMPLES,
    }
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, text=True, check=False, timeout=LIMIT_S
    )


def sources(top: Path) -> set[Path]:
    """The files of a checkout, relative to its top, but what Python and the compiler have made of them."""
    named = [top / name for name in COPIED]
    files = [file for each in named for file in ([each] if each.is_file() else each.rglob("*"))]
    return {
        file.relative_to(top)
        for file in files
        if file.is_file() and file.suffix != ".so" and "__pycache__" not in file.parts
    } - {FAULTY_SOURCE}


def compiled(files: set[Path]) -> set[Path]:
    return {file for file in files if file.suffix in (".pyx", ".pxd")}


def update(kept: Path) -> None:
    """Make the sources of the kept checkout those of this one.

    The build compares dates, so a file that differs is as new as now, whatever its date is here. Where
    modules have come or gone, or a build has not come to its end, all is made anew.
    """
    wanted, had, whole = sources(ROOT), sources(kept), kept / WHOLE
    if whole.exists() and compiled(had) == compiled(wanted):
        copy = shutil.copyfile
    else:
        shutil.rmtree(kept, ignore_errors=True)
        had, copy = set(), shutil.copy2
        if (ROOT / "build" / "cython").exists():  # It is translated already.
            shutil.copytree(ROOT / "build" / "cython", kept / "build" / "cython")
    for gone in had - wanted:
        (kept / gone).unlink()
    for each in wanted:
        if each not in had or not filecmp.cmp(ROOT / each, kept / each, shallow=False):
            (kept / each).parent.mkdir(parents=True, exist_ok=True)
            copy(ROOT / each, kept / each)
    for link in (ROOT / "cobot" / "shipped").glob("*"):
        if link.is_symlink() and not (kept / link.relative_to(ROOT)).is_symlink():
            (kept / link.relative_to(ROOT)).symlink_to(link.readlink())
    if not whole.exists() or (kept / FAULTY_SOURCE).read_text() != FAULTY:
        (kept / FAULTY_SOURCE).write_text(FAULTY)
    whole.unlink(missing_ok=True)


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout whose compiled modules are watched.

    One run at a time updates and compiles the kept one; each works in a copy of its own.
    """
    if not runtime("libasan.so").is_absolute() or not runtime("libubsan.so").is_absolute():
        pytest.skip("the compiler has no sanitizers")
    # Another environment or compiler has other headers.
    made_with = f"{sys.prefix} {sys.version} {os.environ.get('CC')} {runtime('libasan.so')}"
    kept = ROOT / "build" / "sanitized" / hashlib.sha256(made_with.encode()).hexdigest()[:12]
    kept.parent.mkdir(parents=True, exist_ok=True)
    with kept.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        update(kept)
        build = [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"]
        environment = {**os.environ, "COBOT_SANITIZE": "1"}
        subprocess.run(build, cwd=kept, env=environment, check=True, timeout=LIMIT_S)
        (kept / WHOLE).touch()
        folder = tmp_path_factory.mktemp("sanitized") / "checkout"
        shutil.copytree(kept, folder, ignore=shutil.ignore_patterns("__pycache__", "build"))
    return folder


def test_a_change_is_compiled_whatever_its_date(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    checkout, kept = tmp_path / "checkout", tmp_path / "kept"
    monkeypatch.setitem(globals(), "ROOT", checkout)
    package = checkout / "cobot"
    package.mkdir(parents=True)
    for name in ("changed.pyx", "same.pyx", "gone.py"):
        (package / name).write_text("before")
        os.utime(package / name, (1000, 1000))
    update(kept)
    (kept / WHOLE).touch()
    assert {file.stat().st_mtime for file in map(kept.joinpath, sources(kept))} == {1000}
    (package / "changed.pyx").write_text("after!")
    os.utime(package / "changed.pyx", (500, 500))
    (package / "gone.py").unlink()
    update(kept)
    assert (kept / "cobot" / "changed.pyx").read_text() == "after!"
    assert (kept / "cobot" / "changed.pyx").stat().st_mtime > 1000
    assert (kept / "cobot" / "same.pyx").stat().st_mtime == 1000
    assert sources(kept) == sources(checkout)


@pytest.mark.parametrize("after", ["a build that did not end", "a new module"])
def test_all_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: str) -> None:
    checkout, kept = tmp_path / "checkout", tmp_path / "kept"
    monkeypatch.setitem(globals(), "ROOT", checkout)
    (checkout / "cobot").mkdir(parents=True)
    (checkout / "cobot" / "one.pyx").touch()
    update(kept)
    (kept / "cobot" / "one.so").touch()
    if after == "a new module":
        (kept / WHOLE).touch()
        (checkout / "cobot" / "one.pxd").touch()
    update(kept)
    assert not (kept / "cobot" / "one.so").exists()
    assert sources(kept) == sources(checkout)


def imports(source: str, module: str) -> bool:
    """Whether Python or Cython source names a module in an import."""
    package, _, name = module.rpartition(".")
    named = rf"(\([^)]*|[^\n]*)\b{name}\b"
    return bool(re.search(rf"^\s*(from {module} c?import|from {package} c?import {named})", source, re.M))


def test_each_compiled_module_is_worked_there() -> None:
    """A test of the list imports it, or a helper of tests/support, or a compiled module that is so
    imported; of what is not compiled only the front of a package stands between.
    """
    listed = [ROOT / test.partition("::")[0] for test in TESTS]
    files = [file for each in listed for file in ([each] if each.is_file() else each.glob("*.py"))]
    files += (ROOT / "tests" / "support").glob("*.py")
    left = {}
    for package in ("cobot", "rtloop"):
        for file in [*(ROOT / package).rglob("*.pyx"), *(ROOT / package).rglob("__init__.py")]:
            module = file.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
            left[module.removesuffix(".__init__")] = [file, *file.parent.glob(f"{file.stem}.pxd")]
    while files:
        sources = [file.read_text() for file in files]
        found = [module for module in left if any(imports(source, module) for source in sources)]
        files = [file for module in found for file in left.pop(module)]
    assert not [module for module, (file, *_) in left.items() if file.suffix == ".pyx"]


@pytest.mark.thorough
@pytest.mark.timeout(2 * LIMIT_S)
def test_the_sanitizers_find_nothing_in_the_compiled_modules(copy: Path) -> None:
    deselected = [f"--deselect={test}" for test in TOO_LONG]
    # Without rewritten assertions: to compile the tests takes seconds there.
    options = ("--assert=plain", "-p", "pytest_timeout", "-x")
    result = in_copy(copy, "-m", "pytest", *options, *deselected, *TESTS)
    assert result.returncode == 0, result.stdout[-10000:] + result.stderr[-10000:]


@pytest.mark.thorough
@pytest.mark.timeout(2 * LIMIT_S)
@pytest.mark.parametrize(
    ("call", "finding"),
    [
        ("read(numpy.zeros(7), 7)", "heap-buffer-overflow"),
        ("whole(float('nan'))", "outside the range of representable values"),
    ],
)
def test_the_sanitizers_see_the_compiled_modules(copy: Path, call: str, finding: str) -> None:
    code = f"import numpy; from cobot.faulty import read, whole; read(numpy.zeros(7), 6); {call}"
    result = in_copy(copy, "-c", code)
    assert result.returncode != 0
    assert finding in result.stderr
