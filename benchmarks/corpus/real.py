"""Robot descriptions that other people have written, from the packages of the environment `.venv/corpus`.

`make corpus` fills that environment from its own lock file, because the packages take 0.9 GB and depend on
whole robotics stacks that nothing here needs. Files that are xacro are expanded with the package `xacro`,
whose `$(find NAME)` needs an ament index: a small module replaces it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml

ENVIRONMENT = Path(sys.prefix) / "corpus"
EXPECTED = Path(__file__).with_name("real.yaml")
SHARED = ("cmeel.prefix", "share")
"""The folder of `cmeel` packages below site-packages."""
ROBOSUITE_ROBOTS = Path("robosuite", "models", "assets", "robots")
IGNORED = re.compile(r"macro|/(table|camera|environment|accessories)")
"""Xacro files that define no robot of their own."""
NAMES_IN_URIS = {
    "abb_irb140": "abb_irb140_description",
    "abb_irb140_support": "abb_irb140_description",
    "interbotix_descriptions": "trossen_descriptions",
    "ridgeback_description": "clearpath_ridgeback_description",
}
"""Packages whose folder in rtb-data has another name than the one in their files."""
AMENT_INDEX = """
import os

def get_package_share_directory(name):
    path = os.path.join({packages!r}, name)
    if not os.path.exists(path):
        raise LookupError("there is no package " + name)
    return path
"""


@dataclass(frozen=True, slots=True)
class Description:
    """A file, and what `cobot new-robot` is expected to make of it.

    Attributes:
        name: unique, made of the package and the file.
        options: of `cobot new-robot`, besides --output.
        refused: a part of the expected reason for refusing it; None for an arm that has to be converted.
        check: a part of what `cobot check` is expected to fail with; None for an arm that has to pass.
    """

    name: str
    file: Path
    options: tuple[str, ...] = ()
    refused: str | None = None
    check: str | None = None


def installed() -> bool:
    return (ENVIRONMENT / "bin" / "python").exists()


def real_descriptions(folder: Path) -> Iterator[Description]:
    """Every URDF and every arm in MJCF form in the environment.

    Args:
        folder: for links to packages and for expanded files; kept between runs.
    """
    site = next((ENVIRONMENT / "lib").glob("python3*")) / "site-packages"
    packages = _link_packages(site, folder / "packages")
    expected = yaml.safe_load(EXPECTED.read_text(encoding="utf-8"))
    files = {
        **{_name(file, site): file for file in sorted(site.rglob("*.urdf"))},
        **{
            f"robosuite/{file.parent.name}": file
            for file in sorted(site.glob(f"{ROBOSUITE_ROBOTS}/*/robot.xml"))
        },
        **_expand(site, packages, folder),
    }
    for name, file in sorted(files.items()):
        entry = expected.get(name, {})
        package_options = ("--package", str(packages)) if file.suffix == ".urdf" else ()
        options = (*package_options, *map(str, entry.get("options", ())))
        yield Description(name, file, options, entry.get("refused"), entry.get("check"))


def _name(file: Path, site: Path) -> str:
    inner = file.relative_to(site)
    parts = inner.parts[2:] if inner.parts[:2] == SHARED else inner.parts
    return f"{parts[0].replace('_', '-')}/{file.stem}"


def _link_packages(site: Path, links: Path) -> Path:
    """Make a folder that contains a link for each `package://NAME/` in the corpus."""
    links.mkdir(parents=True, exist_ok=True)
    rtb = site / "rtbdata" / "xacro"
    folders = {folder.name: folder for folder in rtb.iterdir()}
    folders["armer_xarm"] = site / "rtbdata" / "armer_xarm"
    for kuka in (rtb / "kuka_description").iterdir():
        folders[kuka.name if kuka.name == "kuka_resources" else f"{kuka.name}_support"] = kuka
    folders |= {name: rtb / folder for name, folder in NAMES_IN_URIS.items()}
    for share in site.joinpath(*SHARED).iterdir():
        folders[share.name] = share
        folders |= {robot.name: robot for robot in share.glob("robots/*")}
    for name, to in folders.items():
        if not (link := links / name).is_symlink():
            link.symlink_to(to)
    return links


def _expand(site: Path, packages: Path, folder: Path) -> dict[str, Path]:
    """Convert the xacro files that define a robot to URDF. Files that xacro itself cannot read are
    left out.
    """
    index = folder / "index" / "ament_index_python"
    index.mkdir(parents=True, exist_ok=True)
    (index / "__init__.py").write_text("")
    (index / "packages.py").write_text(AMENT_INDEX.format(packages=str(packages)))
    (folder / "expanded").mkdir(exist_ok=True)
    made = {}
    for source in sorted(site.rglob("*.xacro")):
        text = source.read_text(errors="replace")
        if IGNORED.search(str(source.relative_to(site))) or not re.search(r"<robot[^>]*\sname=", text):
            continue
        file = folder / "expanded" / f"{source.name.split('.')[0]}.urdf"
        arguments = ["load_gazebo_models:=false"] if "load_gazebo_models" in text else []
        command = [ENVIRONMENT / "bin" / "xacro", source, "-o", file, *arguments]
        environment = {**os.environ, "PYTHONPATH": str(index.parent)}
        if file.exists() or not subprocess.run(command, env=environment, capture_output=True).returncode:
            made[f"xacro/{file.stem}"] = file
    return made
