"""What a build needs, and what it makes."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType

import pytest
from packaging.requirements import Requirement
from wheels import Environment

ROOT = Path(__file__).parents[1]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
CLIENT = tomllib.loads((ROOT / "packages" / "cobot-client" / "pyproject.toml").read_text())
BUILD = PYPROJECT["build-system"]
MODULES = sorted(
    ".".join(source.relative_to(ROOT).with_suffix("").parts)
    for package in ("cobot", "rtloop", "app")
    for source in (ROOT / package).rglob("*.pyx")
)
# Each in a process of its own, which shares with the others what they all need of other people.
IMPORT_EACH = """
import importlib, os, sys
import numpy, pydantic, yaml
assert not {"cobot", "mujoco"} & set(sys.modules)
def failed(module):
    if child := os.fork():
        return os.waitpid(child, 0)[1]
    importlib.import_module(module)
    os._exit(0)
sys.exit(", ".join(module for module in sys.argv[1:] if failed(module)) or 0)
"""
MAX_RUN_PACKAGES = 58
NO_COMPILER = "cobot needs a C compiler: install gcc or clang (Debian: apt-get install gcc), or set CC"


def preflight(environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-S", "setup.py", "preflight"]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def build() -> ModuleType:
    """setup.py, without building anything."""
    spec = importlib.util.spec_from_file_location("cobot_setup", ROOT / "setup.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_there_are_compiled_modules() -> None:
    assert "cobot.arrays" in MODULES


@pytest.mark.thorough
def test_each_compiled_module_can_be_imported_first() -> None:
    """What it needs, MuJoCo's library above all, its package provides."""
    result = subprocess.run(
        [sys.executable, "-c", IMPORT_EACH, *MODULES], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr


def test_a_missing_compiler_is_one_sentence(tmp_path: Path) -> None:
    result = preflight({"PATH": str(tmp_path)})
    assert result.returncode == 1
    assert result.stderr == NO_COMPILER + "\n"


def test_a_compiler_that_is_chosen_but_missing_is_not_replaced() -> None:
    result = preflight({**os.environ, "CC": "/no/such/compiler -m64"})
    assert result.stderr == NO_COMPILER + "\n"


def test_missing_headers_are_one_sentence(
    build: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert build.preflight() is None
    monkeypatch.setattr(sysconfig, "get_path", lambda name: str(tmp_path))
    assert re.fullmatch(
        r"cobot needs the C headers of Python 3\.\d+ .*: there is no Python\.h in .*", build.preflight()
    )


def test_what_the_build_needs_is_pinned_with_hashes() -> None:
    lock = (ROOT / "requirements/build.lock").read_text().lower()
    for requirement in BUILD["requires"]:
        assert f"\n{requirement.lower()} \\\n    --hash=" in "\n" + lock


def test_dependencies_are_ranges_that_have_the_pinned_versions_in_them() -> None:
    pins = dict(re.findall(r"^([\w.-]+)==(\S+)", (ROOT / "requirements/dev.lock").read_text(), re.M))
    pins |= dict(re.findall(r"^([\w.-]+)==(\S+)", (ROOT / "requirements/run.lock").read_text(), re.M))
    project = PYPROJECT["project"]
    needed = [*project["dependencies"], *CLIENT["project"]["dependencies"]]
    for each in map(Requirement, needed):
        operators = {specifier.operator for specifier in each.specifier}
        assert operators == {">=", "<"} or each.name == "mujoco-core", each  # compiled into our modules
    for each in map(Requirement, [*needed, *project["optional-dependencies"]["dev"]]):
        assert pins[each.name.lower()] in each.specifier, each


def test_few_packages_are_installed_to_run() -> None:
    """The oracle is the lock, of which `make run` installs the lines whose marker holds here."""
    lines = re.findall(r"^(\S+==.+?) ?\\$", (ROOT / "requirements/run.lock").read_text(), re.M)
    pins = list(map(Requirement, lines))
    assert len([pin for pin in pins if pin.marker is None or pin.marker.evaluate()]) <= MAX_RUN_PACKAGES


@pytest.fixture
def parent(tmp_path: Path) -> Path:
    """A folder with a clone in it that is named cobot: its Python modules, and what setup.py reads."""
    clone = tmp_path / "parent" / "cobot"
    for package in ("cobot", "rtloop", "app", "config", "sequences"):
        unread = shutil.ignore_patterns("__pycache__", "*.so", "*.py[xi]", "*.pxd")
        shutil.copytree(ROOT / package, clone / package, ignore=unread)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy2(ROOT / name, clone)
    return clone.parent


def test_a_script_beside_the_clone_gets_the_installed_package(parent: Path, tmp_path: Path) -> None:
    """To Python, a clone named cobot beside the script is a package cobot, without an __init__."""
    make = "from setuptools import build_meta; build_meta.build_editable('made')"
    subprocess.run([sys.executable, "-c", make], cwd=parent / "cobot", check=True, capture_output=True)
    (wheel,) = (parent / "cobot" / "made").glob("*.whl")
    environment = Environment(tmp_path / "environment")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(environment.packages)
    for each in CLIENT["project"]["dependencies"]:
        environment.lend(Requirement(each))
    (parent / "script.py").write_text("from cobot import Robot\nimport cobot\nprint(cobot.__file__)\n")
    found = str(parent / "cobot" / "cobot" / "__init__.py")
    assert environment.run("script.py", cwd=parent) == found
    assert environment.run("-c", "import cobot.client; print(cobot.__file__)", cwd=parent) == found
