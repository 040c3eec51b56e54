"""The mesh files of a robot: finds them, and writes their convex solids into the robot's folder."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import mujoco

from cobot.errors import ConfigError
from cobot.launch.robot_file.packages import find_package
from cobot.launch.robot_file.worker import Worker, absolute
from cobot.xml_file import numbers, shown, where

FORMATS = (".stl", ".obj", ".ply", ".dae", ".glb", ".gltf", ".msh")
LARGE_M, SMALL_M = 10.0, 1e-3
"""Sizes above or below which a link was probably written in a different unit."""
SPLIT_TIMEOUT_S = 60.0
"""Timeout for decomposing one mesh, s. After it, the hull of the mesh is used."""
MIN_VOID_M = 0.01
"""Smallest depth of free space in a hull that is reported, m. Motions that need this space are rejected."""


class MissingMeshError(ConfigError):
    """The file of a mesh, or its package, does not exist."""


class Meshes:
    """The meshes of a URDF, as convex solids in the folder that is being made.

    Attributes:
        folder: the folder that is being made. The files are in its `SUBFOLDER`.
        split: whether a mesh becomes several solids if its hull would be wrong.
        skip_missing: whether shapes whose mesh does not exist are left out.
        said: sentences for the user.
    """

    SUBFOLDER = "meshes"

    def __init__(
        self,
        file: Path,
        packages: Sequence[Path],
        folder: Path,
        worker: Worker,
        said: list[str],
        *,
        split: bool,
        skip_missing: bool,
    ) -> None:
        self.file, self.packages, self.folder = file, packages, folder
        self.split, self.skip_missing, self.said = split, skip_missing, said
        self._worker = worker
        self._made: dict[tuple[Path, tuple[float, ...]], list[Path]] = {}

    def solids(self, mesh: Element, link: str) -> list[Path]:
        """The files of the convex solids that replace a link's <mesh>. Each mesh is converted once.

        Raises:
            ConfigError: the mesh cannot be used. The message names the line, the link and the user's path.
        """
        try:
            path = find_mesh(self.file, mesh, link, self.packages)
        except MissingMeshError as exc:
            if self.skip_missing:
                self.said.append(f"{link}: mesh {shown(mesh.get('filename') or '')} is missing and left out")
                return []
            raise MissingMeshError(f"{exc}; or leave out such shapes with --skip-missing-meshes") from exc
        scale = numbers(self.file, mesh, "scale", f"link {link!r}", 3, (1.0, 1.0, 1.0))
        key = path.resolve(), scale
        if key not in self._made:
            try:
                self._made[key] = self._write(path, scale, link)
            except ConfigError as exc:
                raise mesh_error(self.file, mesh, link, f"{path} {exc}") from exc
        return self._made[key]

    def _write(self, path: Path, scale: tuple[float, ...], link: str) -> list[Path]:
        into = self.folder / self.SUBFOLDER
        into.mkdir(exist_ok=True)
        request: dict[str, Any] = {
            "file": absolute(path),
            "into": absolute(into),
            "name": f"{len(self._made)}_{safe_stem(path)}",
            "scale": scale,
        }
        answer = self._worker.ask("solids", **request, split=False)
        void_m, is_split, why = answer["void"], False, ""
        if self.split and answer["wrong"]:
            try:
                answer = self._worker.ask("solids", SPLIT_TIMEOUT_S, **request, split=True)
                is_split = True
            except ConfigError:
                why = ": decomposing it failed or took too long"
        if is_split:
            self.said.append(
                f"{link}: {path.name} has become {len(answer['files'])} convex solids for collisions, "
                f"because its hull would fill {1000.0 * void_m:.0f} mm of free space (--hulls to use the "
                "hull)"
            )
        elif void_m >= MIN_VOID_M:
            self.said.append(
                f"{link}: the hull of {path.name} is used for collisions, although it fills "
                f"{1000.0 * void_m:.0f} mm of free space{why}"
            )
        self._report(path, link, answer)
        return [into / name for name in answer["files"]]

    def _report(self, path: Path, link: str, answer: dict[str, object]) -> None:
        if answer["flat"]:
            self.said.append(f"{link}: {path.name} is flat; its shape is 1 mm or 0.1 % of its size thick")
        size = answer["size"]
        assert isinstance(size, list)
        if sentence := odd_size(max(size)):
            self.said.append(f"{link}: {path.name} {sentence}")


def find_mesh(file: Path, mesh: Element, link: str, packages: Sequence[Path]) -> Path:
    """The file to which the <mesh> of a link refers.

    Raises:
        ConfigError: the file does not exist, or its format is not supported; the message names the line, the
            link and the path.
    """
    try:
        path = located(file, mesh.get("filename") or "", packages)
    except ConfigError as exc:
        raise type(exc)(str(mesh_error(file, mesh, link, str(exc)))) from exc
    if path.suffix.lower() not in FORMATS:
        formats = ", ".join(FORMATS)
        raise mesh_error(
            file, mesh, link, f"{path} has a format that cobot cannot read; convert it to one of: {formats}"
        )
    return path


def mesh_error(file: Path, mesh: Element, link: str, reason: str) -> ConfigError:
    return ConfigError(f"{where(file, mesh)}: link {link!r}: mesh {reason}")


def odd_size(size_m: float) -> str:
    """The reason why a length in a robot's file is implausible; "" if it is plausible."""
    if size_m >= LARGE_M:
        return (
            f"is {size_m:.4g} m long, which looks like millimetres: URDF uses metres; give the mesh "
            'scale="0.001 0.001 0.001"'
        )
    if size_m <= SMALL_M:
        return f"is {1000.0 * size_m:.3g} mm long, as if its scale were applied twice"
    return ""


def safe_stem(path: Path) -> str:
    """A file's name without its ending, reduced to characters that every program accepts."""
    return "".join(each if each.isascii() and each.isalnum() else "_" for each in path.stem)[:40]


def collect_meshes(file: Path, spec: mujoco.MjSpec, folder: Path) -> None:
    """Copy the model's meshes and height fields into `folder`, so that `folder` can be moved later.

    Raises:
        ConfigError: a file does not exist or cannot be copied.
    """
    source = Path(spec.modelfiledir or file.parent) / (spec.compiler.meshdir or "")
    for index, shape in enumerate((*spec.meshes, *spec.hfields)):
        if not shape.file:
            continue
        path = source / shape.file
        if not path.is_file():
            raise ConfigError(
                f"{file}: mesh {shape.name or path.stem!r}: the file {path} does not exist; copy it there"
            )
        shape.name = shape.name or path.stem
        shape.file = f"{index}_{path.name}"
        try:
            (folder / "meshes").mkdir(exist_ok=True)
            shutil.copyfile(path, folder / "meshes" / shape.file)
        except OSError as exc:
            raise ConfigError(f"{file}: mesh {path} cannot be copied: {exc.strerror}") from exc
    spec.modelfiledir, spec.compiler.meshdir = str(folder), "meshes"


def located(file: Path, name: str, packages: Sequence[Path]) -> Path:
    """The file that a URDF names. The name may be relative to the URDF, absolute, or in a package.

    Raises:
        ConfigError: the name is invalid; the message does not name the file and the link.
        MissingMeshError: the file does not exist; the message names the folders that were searched.
    """
    if "\0" in name or len(name) > 1000:
        raise ConfigError(f"{shown(name)} is not a file name")
    if not name.startswith("package://"):
        path = file.parent / name.removeprefix("file://")
        if not path.is_file():
            raise MissingMeshError(f"{path} does not exist; copy it there, or correct its name in the file")
        return path
    package, _, inner = name.removeprefix("package://").partition("/")
    try:
        path = find_package(package, file, packages, inner) / inner
    except ConfigError as exc:
        raise MissingMeshError(f"{name}: {exc}") from exc
    if not path.is_file():
        raise MissingMeshError(f"{name}: {path} does not exist; copy it there, or give its package's folder")
    return path
