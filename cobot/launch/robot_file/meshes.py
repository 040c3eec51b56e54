"""The mesh files of a robot: finding them, and copying them into the folder that is made."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import mujoco

from cobot.errors import ConfigError

MESHES = (".stl", ".obj", ".msh")


def collect_meshes(file: Path, spec: mujoco.MjSpec, folder: Path) -> None:
    """Copy them and the height fields into the folder, so that it may be moved. Textures go: nobody looks.

    Raises:
        ConfigError: one is not there or cannot be copied.
    """
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    source = Path(spec.modelfiledir or file.parent) / (spec.compiler.meshdir or "")
    for index, shape in enumerate((*spec.meshes, *spec.hfields)):
        if not shape.file:
            continue
        path = source / shape.file
        if not path.is_file():
            raise ConfigError(f"{file}: there is no mesh {path}")
        shape.name = shape.name or path.stem
        shape.file = f"{index}_{path.name}"
        try:
            (folder / "meshes").mkdir(exist_ok=True)
            shutil.copyfile(path, folder / "meshes" / shape.file)
        except OSError as exc:
            raise ConfigError(f"{file}: mesh {path} cannot be copied: {exc.strerror}") from exc
    spec.modelfiledir, spec.compiler.meshdir = str(folder), "meshes"


def find_mesh(file: Path, name: str, packages: Sequence[Path]) -> Path:
    path = _located(file, name, packages)
    if path.suffix.lower() not in MESHES:
        raise ConfigError(
            f"{file}: the shape of a link for collisions is {name}, which MuJoCo cannot read; convert it to "
            f"one of: {', '.join(MESHES)}"
        )
    return path.resolve()


def _located(file: Path, name: str, packages: Sequence[Path]) -> Path:
    if not name.startswith("package://"):
        path = file.parent / name.removeprefix("file://")
        if not path.is_file():
            raise ConfigError(f"{file}: there is no mesh {path}")
        return path
    package, _, inner = name.removeprefix("package://").partition("/")
    for folder in packages:
        for place in (folder / package / inner, folder / inner):
            if place.is_file() and (place != folder / inner or folder.resolve().name == package):
                return place
    looked = f" ({', '.join(map(str, packages))})" if packages else ""
    raise ConfigError(
        f"{file}: {name} is in none of the packages given{looked}; add --package FOLDER, the folder "
        f"{package} or the one above it"
    )
