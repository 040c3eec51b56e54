"""What a build needs, and what it makes."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
BUILD = tomllib.loads((ROOT / "pyproject.toml").read_text())["build-system"]
MODULES = sorted(
    ".".join(source.relative_to(ROOT).with_suffix("").parts)
    for package in ("cobot", "rtloop", "app", "ros2", "sequences")
    for source in (ROOT / package).rglob("*.pyx")
)
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


@pytest.mark.parametrize("module", MODULES)
def test_a_compiled_module_can_be_imported_first(module: str) -> None:
    """What it needs, MuJoCo's library above all, its package provides."""
    subprocess.run([sys.executable, "-c", f"import {module}"], cwd=ROOT, check=True)


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
    lock = (ROOT / "requirements-build.lock").read_text().lower()
    for requirement in BUILD["requires"]:
        assert f"\n{requirement.lower()} \\\n    --hash=" in "\n" + lock
