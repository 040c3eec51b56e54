"""Builds the client from the source tree that contains this folder.

The service's distribution also has a package `cobot`. Two distributions that install the same files break
each other: the second one overwrites them, and removing one removes the files of both. So this distribution
installs its `cobot` into a separate folder, with a `.pth` file that appends the folder to Python's search
path. If the service is also installed, in either order, Python finds the service's `cobot` first, which
includes the client.
"""

from __future__ import annotations

import shutil
import sys
import tomllib
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.editable_wheel import editable_wheel
from setuptools.command.sdist import sdist

TREE = Path(__file__).resolve().parents[2]
FOLDER = "cobot_client"
FILES = (
    "__init__.py",
    "addresses.py",
    "client/*.py",
    "clock.py",
    "errors.py",
    "findings.py",
    "folders.py",
    "ipc/__init__.py",
    "ipc/layout.py",
    "ipc/session_rules.py",
    "ipc/state_fields.py",
    "motions/__init__.py",
    "motions/planners.py",
    "orientations.py",
    "pose.py",
    "py.typed",
    "reasons.py",
    "types.py",
)
ONLY_WITH_THE_SERVICE = {"client/shared_memory.py"}


class Take(build_py):
    """Collects the client's files. setuptools would find no packages here."""

    def run(self) -> None:
        into = Path(self.build_lib)
        shutil.rmtree(into, ignore_errors=True)  # files that an earlier build has left
        source = TREE / "cobot"
        for pattern in FILES:
            for file in sorted(source.glob(pattern)):
                name = file.relative_to(source)
                if name.as_posix() not in ONLY_WITH_THE_SERVICE:
                    (into / FOLDER / "cobot" / name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(file, into / FOLDER / "cobot" / name)
        shutil.copyfile(TREE / "LICENSE", into / FOLDER / "LICENSE")
        (into / f"{FOLDER}.pth").write_text(f"{FOLDER}\n", encoding="ascii")

    def get_source_files(self) -> list[str]:
        return []

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        return [str(file) for file in Path(self.build_lib).rglob("*") if file.is_file()]


class NoSources(sdist):
    def run(self) -> None:
        sys.exit(
            "cobot-client: there is no source distribution, because the sources are part of cobot; build a "
            "wheel"
        )


class NotEditable(editable_wheel):
    def run(self) -> None:
        sys.exit("cobot-client: there is no editable installation; put the clone itself on PYTHONPATH")


setup(
    version=tomllib.loads((TREE / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"],
    long_description=(TREE / "docs" / "client.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    cmdclass={"build_py": Take, "sdist": NoSources, "editable_wheel": NotEditable},
)
