"""A wheel runs outside the checkout, with nothing of it."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from running import Run, answering

ROOT = Path(__file__).parents[2]
# With what is compiled already: the wheel has to be whole, not new.
SOURCES = ("cobot", "rtloop", "app", "ros2", "sequences", "config", "build")
FILES = ("pyproject.toml", "setup.py", "requirements-build.lock", "README.md", "LICENSE")


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """The folder that the wheel of this checkout was unpacked into."""
    copy = tmp_path / "copy"
    for name in SOURCES:
        if (ROOT / name).exists():
            unread = shutil.ignore_patterns("__pycache__", "lib", "bdist.*")
            shutil.copytree(ROOT / name, copy / name, ignore=unread)
    for name in FILES:
        shutil.copy2(ROOT / name, copy)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "wheel"]
    options = ["--no-build-isolation", "--no-deps", "--no-index", "--wheel-dir", str(tmp_path)]
    subprocess.run([*pip, *options, str(copy)], check=True)
    shutil.rmtree(copy)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    return tmp_path / "installed"


def stems(folder: Path, last_names: str) -> set[Path]:
    """The compiled modules there, or what they are made from, without their last names."""
    packages = [folder / name for name in ("cobot", "rtloop", "app", "ros2", "sequences")]
    found = {each for package in packages for each in package.rglob(last_names)}
    return {each.relative_to(folder).with_name(each.name.split(".")[0]) for each in found}


def test_a_wheel_runs_outside_the_checkout(
    installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert stems(installed, "*.so") == stems(ROOT, "*.pyx")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(installed))
    with answering(Run(tmp_path)) as run:
        for module in ("rtloop", "app"):
            process = run.child(module)
            assert process is not None
            loaded = [Path(each.path) for each in process.memory_maps() if ".so" in each.path]
            assert not any(each.is_relative_to(ROOT / package) for each in loaded for package in SOURCES)
