"""Parts and fixtures that are meshes. Oracles: boxes of MuJoCo, and the inertia that trimesh computes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from physical_cell import CellArm, write_cell

from app.api.routers.cell import CellAnswer, _with_meshes
from cobot.cell import load_cell, meshes
from cobot.cell.plant import build_plant
from cobot.cell.surroundings import fixtures_in_scene, part_in_scene
from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.load import homogeneous

EDGE_M = 0.05
TABLE = {"shape": "box", "size_m": [0.5, 0.9, 0.2], "position_m": [0.6, 0.0, 0.1]}
PART: dict[str, Any] = {"shape": "mesh", "file": "part.stl", "mass_kg": 0.2, "position_m": [0.5, -0.3, 0.24]}
ANGLE = trimesh.util.concatenate(
    [
        trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [0.1, 0.04, 0.02]]),
        trimesh.creation.box(bounds=[[0.0, 0.0, 0.0201], [0.02, 0.04, 0.1]]),
    ]
)
"""Two boxes that form an angle. They have no corner in common, so each of them is convex and exact."""


def bowl() -> trimesh.Trimesh:
    """The lower half of a sphere's surface."""
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=0.03)
    sphere.update_faces(sphere.triangles_center[:, 2] < 0.0)
    return sphere


def cell_with(folder: Path, body: trimesh.Trimesh, kind: str = "stl", **changes: object) -> Path:
    """A cell file with a table and a part."""
    content = body.export(file_type=kind)
    (folder / f"part.{kind}").write_bytes(content if isinstance(content, bytes) else content.encode())
    part = {**PART, "file": f"part.{kind}", **changes}
    return write_cell(folder, {"hand": {}, "fixtures": {"table": TABLE}, "parts": {"part": part}})


def test_a_cube_of_millimetres_falls_onto_the_table_and_is_picked_up(
    settings: Settings, tmp_path: Path
) -> None:
    cell = cell_with(tmp_path, trimesh.creation.box([1e3 * EDGE_M] * 3), scale=0.001)
    arm = CellArm(settings, load_robot(settings), cell)
    arm.hold(500)
    np.testing.assert_allclose(arm.part("part").position, [0.5, -0.3, 0.2 + 0.5 * EDGE_M], atol=2e-4)
    arm.pick("part")
    assert arm.read("hand.measured_width") == pytest.approx(EDGE_M, abs=1e-3)
    assert arm.part("part").position[2] == pytest.approx(0.2 + 0.5 * EDGE_M + 0.12, abs=3e-3)
    arm.move_hand(0.08)
    arm.hold(600)
    assert arm.part("part").position[2] == pytest.approx(0.2 + 0.5 * EDGE_M, abs=3e-3), "it falls back"


def test_it_has_the_mass_and_the_inertia_of_a_box_of_its_size(
    robot: RobotDescription, tmp_path: Path
) -> None:
    cell = load_cell(cell_with(tmp_path, trimesh.creation.box([0.05, 0.03, 0.08])))
    body = build_plant(robot.model, cell, "base_link", "tcp").mj.body("part")
    squares = np.square([0.05, 0.03, 0.08])
    assert body.mass[0] == pytest.approx(0.2)
    moments = 0.2 / 12.0 * (squares.sum() - squares)
    np.testing.assert_allclose(sorted(body.inertia), sorted(moments), rtol=1e-5)


@pytest.mark.parametrize("kind", ["stl", "obj"])
def test_a_shape_that_is_not_convex_keeps_its_gap_and_its_centre(
    kind: str, robot: RobotDescription, tmp_path: Path
) -> None:
    """The arm's model and the plant have the same mass, centre and inertia: those that trimesh computes."""
    cell = load_cell(cell_with(tmp_path, ANGLE, kind))
    part, size = cell.parts["part"], np.array([0.1, 0.04, 0.1])
    held = part_in_scene(part, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    assert held.solids == 2
    np.testing.assert_allclose(held.size, size, atol=1e-6)
    body = build_plant(robot.model, cell, "base_link", "tcp").mj.body("part")
    centre, inertia = homogeneous(held)
    np.testing.assert_allclose(centre, ANGLE.center_mass - 0.5 * size, atol=1e-6)
    np.testing.assert_allclose(inertia, 0.2 / ANGLE.volume * ANGLE.moment_inertia, rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(body.ipos, centre, atol=1e-9)
    np.testing.assert_allclose(sorted(body.inertia), sorted(np.linalg.eigvalsh(inertia)), rtol=1e-6)
    whole = load_cell(cell_with(tmp_path, ANGLE, kind, hull=True))
    assert part_in_scene(whole.parts["part"], held.pose).solids == 1


def test_an_open_shape_is_boxes_within_the_tolerance(tmp_path: Path) -> None:
    part = load_cell(cell_with(tmp_path, bowl(), tolerance_m=0.01)).parts["part"]
    assert 1 < len(part.mesh.boxes) <= meshes.MAX_SOLIDS
    lows = np.array([np.array(box[:3]) - 0.5 * np.array(box[3:]) for box in part.mesh.boxes])
    highs = np.array([np.array(box[:3]) + 0.5 * np.array(box[3:]) for box in part.mesh.boxes])
    for corner in np.reshape(part.mesh.vertices, (-1, 3)):
        assert ((lows - 1e-9 <= corner) & (corner <= highs + 1e-9)).all(axis=1).any()
    assert highs.max() <= 0.03 + 0.01


def test_a_fixture_is_the_same_mesh_in_the_scene(tmp_path: Path) -> None:
    (tmp_path / "stand.stl").write_bytes(ANGLE.export(file_type="stl"))
    stand = {"shape": "mesh", "file": "stand.stl", "position_m": [0.6, 0.0, 0.05]}
    scene = fixtures_in_scene(load_cell(write_cell(tmp_path, {"fixtures": {"stand": stand}})))["stand"]
    assert (scene.shape, scene.solids, scene.mass) == ("mesh", 2, 0.0)


def test_rest_has_the_triangles_on_request(tmp_path: Path) -> None:
    cell = load_cell(cell_with(tmp_path, ANGLE))
    service: Any = SimpleNamespace(
        require=lambda: cell, parts=lambda: {"part": (0.5, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0)}, switches=list
    )
    (part,) = CellAnswer.of(service).parts
    assert (part.shape, part.mesh) == ("mesh", None)
    (part,) = CellAnswer.model_validate_json(_with_meshes(CellAnswer.of(service), cell.parts)).parts
    assert part.mesh is not None
    assert len(part.mesh.vertices) == 3 * len(ANGLE.vertices), "each of them once"
    shown = np.reshape(part.mesh.vertices, (-1, 3))[part.mesh.triangles]
    np.testing.assert_allclose(shown.min(axis=0), -0.5 * np.array(part.size_m), atol=1e-6)
    assert len(shown) == 3 * len(ANGLE.faces)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"file": None}, "parts.part: file is missing: a mesh needs an STL or OBJ file"),
        ({"file": "other.stl"}, "other.stl: no such file"),
        ({"file": "../part.stl"}, "parts.part.file: ../part.stl is outside the folder of the cell file"),
        ({"file": "/etc/hostname"}, "/etc/hostname is outside the folder of the cell file"),
        ({"file": "link.stl"}, "link.stl is outside the folder of the cell file"),
        ({"file": "."}, "no such file"),
        ({"file": "a\0b"}, "parts.part.file: a\\x00b: "),
        ({"file": "\x1b[31m.stl"}, "\\x1b[31m.stl: no such file"),
        ({"file": "broken.stl"}, "parts.part.file: broken.stl: is not an STL or OBJ mesh"),
        ({"file": "empty.stl"}, "empty.stl: is not an STL or OBJ mesh"),
        ({"file": "nan.obj"}, "nan.obj: vertices: a coordinate is not a finite"),
        (
            {"file": "wrong.obj"},
            "wrong.obj: triangles: the mesh has no triangles, or one of them refers to a vertex",
        ),
        ({"file": "large.stl"}, "large.stl has 20.0 MB, allowed: 20 MB: simplify the mesh"),
        (
            {"scale": 1000.0},
            "the bounding box is 100 x 40 x 100 m, allowed: edges of 0.002 to 2 m: set scale",
        ),
        ({"scale": 0.0}, "parts.part.scale: must be greater than or equal to 0.000001"),
        (
            {"file": "bowl.stl", "tolerance_m": 0.002},
            "would fit; set tolerance_m, or hull: true",
        ),
        (
            {"size_m": [0.1, 0.1, 0.1]},
            "size_m: is not allowed for a mesh, whose size comes from its file; use scale",
        ),
        ({"shape": "box"}, "parts.part: file: a box must not have a file; did you mean shape: mesh?"),
    ],
)
def test_a_mesh_that_is_none_is_rejected_with_the_place(
    changes: dict[str, object], words: str, tmp_path: Path
) -> None:
    folder = tmp_path / "cell"
    folder.mkdir()
    (tmp_path / "part.stl").write_bytes(ANGLE.export(file_type="stl"))
    (folder / "link.stl").symlink_to(tmp_path / "part.stl")
    (folder / "broken.stl").write_bytes(b"\x00\xff" * 500)
    (folder / "empty.stl").write_bytes(b"")
    (folder / "nan.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "wrong.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n")
    with (folder / "large.stl").open("wb") as large:
        large.truncate(meshes.MAX_FILE_BYTES + 1)
    (folder / "bowl.stl").write_bytes(bowl().export(file_type="stl"))
    file = cell_with(folder, ANGLE, **changes)
    with pytest.raises(ConfigError) as caught:
        load_cell(file)
    assert str(caught.value).startswith(f"{file}: parts.part")
    assert words in str(caught.value)
    assert str(caught.value).isprintable()
