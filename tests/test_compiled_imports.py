"""The import contracts hold for compiled modules too, though import-linter reads .py files alone.

It is shown a copy of the packages in which each compiled module is a .py file of its imports.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["root_packages"]
IMPORT = re.compile(
    r"^[ \t]*(from[ \t]+[\w.]+[ \t]+c?import[ \t]+(?:\([^)]*\)|[^#;\n]+)|c?import[ \t]+[^#;\n]+)", re.M
)


def imports(source: str) -> Iterator[str]:
    """The import statements of Cython source, as Python's."""
    for statement in IMPORT.findall(source.replace("\\\n", " ")):
        yield re.sub(r"\bcimport\b", "import", re.sub(r"#.*", "", statement)).strip()


def as_python(tree: Path) -> None:
    for compiled in [*tree.rglob("*.pyx"), *tree.rglob("*.pxd")]:
        with compiled.with_suffix(".py").open("a") as module:
            module.writelines(f"{statement}\n" for statement in imports(compiled.read_text()))


def check(tree: Path) -> subprocess.CompletedProcess[str]:
    linter = Path(sys.executable).with_name("lint-imports")
    command = [str(linter), "--no-cache", "--config", str(ROOT / "pyproject.toml")]
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    return subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for package in PACKAGES:
        unread = shutil.ignore_patterns("__pycache__", "*.so", "*.pyi")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=unread)
    return tmp_path


def test_compiled_modules_keep_the_import_contracts(tree: Path) -> None:
    as_python(tree)
    result = check(tree)
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_compiled_module_that_breaks_a_contract_by_way_of_another_is_found(tree: Path) -> None:
    (tree / "rtloop" / "a_step.pyx").write_text("from cobot.robot.a_core cimport (\n    one, two,\n)\n")
    (tree / "cobot" / "robot" / "a_core.pxd").write_text("from cobot.planners cimport lin  # not allowed\n")
    as_python(tree)
    result = check(tree)
    assert result.returncode == 1, result.stdout + result.stderr
    assert "rtloop.a_step -> cobot.robot.a_core" in result.stdout
    assert "cobot.robot.a_core -> cobot.planners" in result.stdout


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("from cobot.arrays cimport doubles, bytes_of", ["from cobot.arrays import doubles, bytes_of"]),
        ("cimport cython\nimport numpy as np", ["import cython", "import numpy as np"]),
        ("def f():\n    from cobot import errors  # late", ["from cobot import errors"]),
        ("from . cimport limits", ["from . import limits"]),
        (
            "from cobot.a cimport (\n    one,  # (the first\n    two,\n)\nx = 1",
            ["from cobot.a import (\n    one,  \n    two,\n)"],
        ),
        ('cdef extern from "mujoco/mujoco.h" nogil:\n    int mj_version()', []),
    ],
)
def test_import_statements_are_read(source: str, found: list[str]) -> None:
    assert list(imports(source)) == found
