"""The <visual> shapes of a URDF. Their list is written to visuals.yaml, and their meshes as GLB to visuals/.

They are not part of model.xml, so neither collision checking nor the real-time process loads them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import yaml
from scipy.spatial.transform import Rotation

from cobot.errors import ConfigError
from cobot.launch.robot_file.meshes import find_mesh, safe_stem
from cobot.launch.robot_file.urdf_checks import SHAPES, ZERO, check_shape
from cobot.launch.robot_file.worker import Worker, absolute
from cobot.robot.geometry.visuals import MANIFEST
from cobot.xml_file import numbers

SUBFOLDER = "visuals"
TIMEOUT_S = 30.0
"""Timeout for converting one mesh, s. After it, the visual is left out."""
MAX_TRIANGLES = 40_000
"""Target for the number of triangles of all meshes of a robot together. Finer meshes are simplified, so that
the panel draws the robot quickly, even without a graphics card.
"""


class Visuals:
    """The visuals of one file, and the meshes that have been written for them."""

    def __init__(self, file: Path, root: Element, packages: Sequence[Path], said: list[str]) -> None:
        self._file, self._packages, self._said = file, packages, said
        self._found = [
            (str(link.get("name")), visual)
            for link in root.findall("link")
            for visual in link.findall("visual")
        ]
        self._written: dict[Path, tuple[str, int]] = {}
        meshes = sum(visual.find("geometry/mesh") is not None for _, visual in self._found)
        self._share = MAX_TRIANGLES // max(meshes, 1)
        self._drawn: Counter[str] = Counter()
        self._colours = {
            material.get("name"): colour
            for material in root.findall("material")
            if (colour := material.find("color")) is not None
        }

    def write(self, folder: Path, worker: Worker) -> None:
        """Write the manifest and its meshes. A visual that cannot be read is reported and left out."""
        entries: list[dict[str, Any]] = []
        for link, visual in self._found:
            try:
                entries.append(self._entry(visual, link, folder, worker))
            except ConfigError as exc:
                self._said.append(f"{link}: a <visual> is left out: {exc}")
        self._report_size()
        if entries:
            text = yaml.safe_dump({"visuals": entries}, sort_keys=False, default_flow_style=None)
            (folder / MANIFEST).write_text(text, encoding="utf-8")

    def _entry(self, visual: Element, link: str, folder: Path, worker: Worker) -> dict[str, Any]:
        file, of = self._file, f"link {link!r}"
        check_shape(file, visual, of)
        shape = next(visual.iterfind("geometry/*"))
        origin = visual.find("origin")
        place = Element("origin") if origin is None else origin
        turn = Rotation.from_euler("xyz", numbers(file, place, "rpy", of, 3, ZERO))
        entry: dict[str, Any] = {
            "link": link,
            "shape": shape.tag,
            "position": list(numbers(file, place, "xyz", of, 3, ZERO)),
            "quaternion": turn.as_quat(scalar_first=True).tolist(),
            "color": self._colour(visual, of),
        }
        for dimension, count in SHAPES.get(shape.tag, ()):
            entry[dimension] = list(numbers(file, shape, dimension, of, count))
        if shape.tag == "mesh":
            entry["scale"] = list(numbers(file, shape, "scale", of, 3, (1.0, 1.0, 1.0)))
            entry["file"] = self._mesh(find_mesh(file, shape, link, self._packages), folder, worker)
        return entry

    def _mesh(self, path: Path, folder: Path, worker: Worker) -> str:
        path = path.resolve()
        if path not in self._written:
            (folder / SUBFOLDER).mkdir(exist_ok=True)
            name = f"{SUBFOLDER}/{len(self._written)}_{safe_stem(path)}.glb"
            try:
                into = absolute(folder / name)
                answer = worker.ask("look", TIMEOUT_S, file=absolute(path), into=into, triangles=self._share)
            except ConfigError as exc:
                raise ConfigError(f"{path} {exc}") from exc
            self._written[path] = name, answer["triangles"]
        name, triangles = self._written[path]
        self._drawn[path.name] += triangles
        return name

    def _report_size(self) -> None:
        total = self._drawn.total()
        if total <= 1.1 * MAX_TRIANGLES:
            return
        largest = ", ".join(f"{name} ({count:,})" for name, count in self._drawn.most_common(3))
        self._said.append(
            f"the visuals have {total:,} triangles, more than {MAX_TRIANGLES:,}, so a computer without a "
            f"graphics card may draw them slowly: parts with several colours are not simplified, others only "
            f"as far as their form permits; the largest: {largest}"
        )

    def _colour(self, visual: Element, of: str) -> list[float] | None:
        """Red, green, blue and opacity, each from 0 to 1; None if the mesh's own colours apply."""
        material = visual.find("material")
        if material is None:
            return None
        colour = material.find("color")
        colour = self._colours.get(material.get("name")) if colour is None else colour
        if colour is None:
            return None
        return [min(max(share, 0.0), 1.0) for share in numbers(self._file, colour, "rgba", of, 4)]
