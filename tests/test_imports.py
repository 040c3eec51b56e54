"""What the processes that wait for nobody's plan import: a start takes as long as its imports."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest

import cobot

ROOT = Path(__file__).parents[1]
IMPORTS = re.compile(r"^[ \t]*(?:import (.+)|from ([\w.]+) import (\([^)]*\)|.+))", re.M)
COMMAND = "cobot.launch.cli"
PROCESSES = (
    "rtloop.main",
    "cobot.dds.process",
    COMMAND,
    "cobot.launch.backups",  # of which `cobot run` restores what has been staged
    "cobot.launch.supervisor",
    "app.server",
)
SLOW = {"cobot.planners", "httpx", "httpx2", "ompl", "ruckig", "scipy"}
"""What only planning processes and clients need."""


PLANNING = (
    "app.services.motion.planning_worker",
    "app.services.motion.planning_tasks",
    "cobot.planners.blending.prolonged",
)


def test_a_planning_process_is_ready_without_what_only_some_planners_need() -> None:
    imported = _imported(PLANNING)
    assert "cobot.planners.ptp" in imported
    assert not imported & {"scipy", "ompl"}


def test_no_process_imports_what_only_planners_and_clients_need() -> None:
    assert not _imported(PROCESSES) & SLOW


def test_a_command_such_as_stop_imports_no_simulation() -> None:
    assert not _imported((COMMAND,)) & {"mujoco", "cobot.cell", *SLOW}


def _imported(modules: tuple[str, ...]) -> set[str]:
    code = f"import sys, {', '.join(modules)}; print(*sys.modules, sep='\\n')"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    imported = set(done.stdout.splitlines())
    assert imported >= set(modules)
    return imported


def test_what_the_type_checker_passes_over_is_imported_by_nobody() -> None:
    """Only others need it: what came from it would be of no type, and nobody would say so."""
    mypy = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]
    (unread,) = [each["module"] for each in mypy["overrides"] if each.get("follow_imports_for_stubs")]
    assert [each for each in unread if not each.endswith(".*")] == []
    found = {
        (str(file.relative_to(ROOT)), name)
        for package in mypy["packages"]
        for file in (ROOT / package).rglob("*.py*")
        if file.suffix in (".py", ".pyi")
        for name in _named(file.read_text(encoding="utf-8"))
    }
    assert ("cobot/planners/timing/path.py", "scipy.interpolate") in found
    assert [each for each in found if any(fnmatch(f"{each[1]}.", name) for name in unread)] == []


def _named(source: str) -> Iterator[str]:
    """All that its import statements may import."""
    for whole, package, some in IMPORTS.findall(source):
        if package:
            yield package
        yield from (f"{package}.{name}" if package else name for name in re.findall(r"[\w.]+", whole + some))


def test_the_contract_of_the_library_has_every_module_of_it() -> None:
    """import-linter cannot say "all but these": a new module has to be named in pyproject.toml."""
    folder = Path(cobot.__file__).parent
    names = {file.stem for file in folder.glob("*.py")} | {
        room.parent.name for room in folder.glob("*/__init__.py")
    }
    project = tomllib.loads((folder.parent / "pyproject.toml").read_text(encoding="utf-8"))
    library = project["tool"]["importlinter"]["contracts"][0]
    programs = {name for name in library["forbidden_modules"] if name.startswith("cobot.")}
    listed = {name.removeprefix("cobot.") for name in [*library["source_modules"], *programs]}
    assert listed == names - {"__init__", "__main__"}


def test_the_distribution_of_the_client_has_all_that_its_modules_import(tmp_path: Path) -> None:
    """Oracle: Python's import system, in a folder that has only the files of the distribution."""
    tree = ast.parse((ROOT / "packages" / "cobot-client" / "setup.py").read_text(encoding="utf-8"))
    found = {
        each.targets[0].id: ast.literal_eval(each.value)
        for each in tree.body
        if isinstance(each, ast.Assign)
        and isinstance(each.targets[0], ast.Name)
        and each.targets[0].id in ("FILES", "ONLY_WITH_THE_SERVICE")
    }
    modules = []
    for pattern in found["FILES"]:
        files = list((ROOT / "cobot").glob(pattern))
        assert files, f"{pattern} is listed, and there is no such file"
        for file in files:
            name = file.relative_to(ROOT)
            if name.relative_to("cobot").as_posix() not in found["ONLY_WITH_THE_SERVICE"]:
                (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(file, tmp_path / name)
                modules += [".".join(name.with_suffix("").parts)] if file.suffix == ".py" else []
    done = subprocess.run(
        [sys.executable, "-P", "-c", f"import {', '.join(sorted(modules))}".replace(".__init__", "")],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["config", "learning", "recorder", "ros2", "sequences"])
def test_a_foreign_package_may_have_the_name_of_a_folder_of_the_clone(name: str, tmp_path: Path) -> None:
    """Oracle: Python's own import of the foreign package, and the settings that cobot finds beside it."""
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text("FOREIGN = True\n", encoding="utf-8")
    script = f"import {name}; assert {name}.FOREIGN; from cobot.config import load_settings; load_settings()"
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
