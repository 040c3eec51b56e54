"""Wheels of this checkout, and environments that have nothing but what is put into them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import venv
from importlib.metadata import distribution
from pathlib import Path

from folders import ROOT
from packaging.requirements import Requirement

PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
ALONE = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
"""The environment of a process that sees no checkout."""


def build(source: Path, into: Path) -> Path:
    """The wheel that pip makes of a folder, with what is installed here."""
    options = ["--no-build-isolation", "--no-deps", "--no-index", "--wheel-dir", str(into)]
    subprocess.run([*PIP, "wheel", *options, str(source)], check=True)
    (wheel,) = into.glob("*.whl")
    return wheel


def client_wheel(into: Path) -> Path:
    """That of the client; in a copy, because several may be made at a time."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in ("cobot", "packages", "docs"):
            unread = shutil.ignore_patterns("__pycache__", "*.so", "*.png", "build", "*.egg-info")
            shutil.copytree(ROOT / name, copy / name, ignore=unread)
        for name in ("pyproject.toml", "LICENSE"):
            shutil.copy2(ROOT / name, copy)
        return build(copy / "packages" / "cobot-client", into)


class Environment:
    """A virtual environment with no packages in it."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder, symlinks=True)
        self.python = folder / "bin" / "python"
        self.packages = Path(sysconfig.get_path("purelib", "venv", {"base": str(folder)}))

    def pip(self, *command: str) -> None:
        subprocess.run([*PIP, "--python", str(self.python), *command], check=True, env=ALONE)

    def install(self, *wheels: Path) -> None:
        """One after the other, in this order."""
        for wheel in wheels:
            self.pip("install", "--no-deps", "--no-index", "--no-compile", str(wheel))

    def lend(self, requirement: Requirement) -> None:
        """Have it share a package of this environment, and those that it needs."""
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            return
        lent = distribution(requirement.name)
        assert lent.version in requirement.specifier, requirement
        for name in {Path(file).parts[0] for file in lent.files or () if Path(file).parts[0] != ".."}:
            if not (self.packages / name).exists():
                (self.packages / name).symlink_to(lent.locate_file(name))
        for needed in lent.requires or ():
            self.lend(Requirement(needed))

    def run(self, *arguments: str | Path, cwd: Path | None = None) -> str:
        """What Python prints; in a folder without packages, unless it is said where."""
        command = [str(self.python), *map(str, arguments)]
        done = subprocess.run(
            command,
            cwd=cwd or self.python.parent,
            env=ALONE,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout.strip()
