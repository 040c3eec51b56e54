"""Meshes of `cobot new-robot`. Oracles: numbers written into the files, coal's (assimp's) reading of them,
and the planes of a solid's faces.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import coal
import numpy as np
import pytest
import trimesh
import yaml
from thorough import few
from urdf_arms import ARMS, urdf

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.launch.robot_file.convex import solids
from cobot.launch.robot_file.mesh_reading import as_glb, read_mesh
from cobot.launch.robot_file.visuals import MAX_TRIANGLES
from cobot.launch.robot_file.worker import Worker, absolute
from cobot.robot.description import load_robot
from cobot.robot.geometry.visuals import visuals_of

CORNERS = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.06, 0], [0, 0, 0.07]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
BALL = '<sphere radius="0.03"/>'


def as_text_stl() -> bytes:
    facets = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in CORNERS[face])
        + "endloop\nendfacet\n"
        for face in FACES
    ]
    return f"solid a\n{''.join(facets)}endsolid a\n".encode()


def as_binary_stl() -> bytes:
    triangles = b"".join(bytes(12) + CORNERS[face].astype("<f4").tobytes() + bytes(2) for face in FACES)
    return b"solid, although it is binary".ljust(80) + len(FACES).to_bytes(4, "little") + triangles


def as_obj() -> bytes:
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    return "\n".join(lines).encode()


def as_ply() -> bytes:
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    lines = [f"{x} {y} {z}" for x, y, z in CORNERS] + [f"3 {a} {b} {c}" for a, b, c in FACES]
    faces = "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    return (head + faces + "\n".join(lines)).encode()


def as_dae(metres: float = 1.0, head: str = "") -> bytes:
    places = " ".join(map(str, (CORNERS / metres).ravel()))
    indices = " ".join(map(str, FACES.ravel()))
    return (
        f'<?xml version="1.0"?>{head}<COLLADA version="1.4.1" '
        'xmlns="http://www.collada.org/2005/11/COLLADASchema">'
        f'<asset><unit name="a" meter="{metres}"/><up_axis>Z_UP</up_axis></asset><library_geometries>'
        f'<geometry id="g"><mesh><source id="s"><float_array id="f" count="12">{places}</float_array>'
        '<technique_common><accessor source="#f" count="4" stride="3"><param name="X" type="float"/>'
        '<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>'
        f'<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>{indices}</p></triangles>'
        '</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="c"><node id="n">'
        '<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#c"/></scene></COLLADA>'
    ).encode()


def as_msh() -> bytes:
    return (
        np.array([4, 0, 0, 4], "<i4").tobytes()
        + CORNERS.astype("<f4").tobytes()
        + FACES.astype("<i4").tobytes()
    )


def as_glb_file(folder: Path) -> bytes:
    (folder / "source.obj").write_bytes(as_obj())
    return as_glb(folder / "source.obj", 4)[0]


def as_gltf(uri: str) -> bytes:
    buffers = [{"uri": uri, "byteLength": 96}]
    views = [
        {"buffer": 0, "byteOffset": 0, "byteLength": 48},
        {"buffer": 0, "byteOffset": 48, "byteLength": 48},
    ]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5125, "count": 12, "type": "SCALAR"},
    ]
    mesh = {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}
    return json.dumps(
        {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [mesh], "buffers": buffers, "bufferViews": views, "accessors": accessors,
        }
    ).encode()  # fmt: skip


@pytest.mark.parametrize(
    "kind",
    ["text.stl", "binary.STL", "a.obj", "a.ply", "metres.dae", "inches.dae", "a.msh", "a.glb", "a.gltf"],
)
def test_each_format_gives_the_corners_that_were_written(tmp_path: Path, kind: str) -> None:
    (tmp_path / "buffer.bin").write_bytes(CORNERS.astype("<f4").tobytes() + FACES.astype("<u4").tobytes())
    contents = {
        "text.stl": as_text_stl(), "binary.STL": as_binary_stl(), "a.obj": as_obj(), "metres.dae": as_dae(),
        "inches.dae": as_dae(0.0254), "a.msh": as_msh(), "a.glb": as_glb_file(tmp_path),
        "a.gltf": as_gltf("buffer.bin"), "a.ply": as_ply(),
    }  # fmt: skip
    (tmp_path / kind).write_bytes(contents[kind])
    vertices, triangles = read_mesh(tmp_path / kind)
    found = np.unique(np.round(vertices[triangles].reshape(-1, 3), 6), axis=0)
    np.testing.assert_allclose(found, np.unique(np.round(CORNERS, 6), axis=0), atol=1e-6)
    assert len(triangles) == 4
    if kind in ("text.stl", "binary.STL", "a.obj", "a.ply", "metres.dae"):
        other = coal.MeshLoader().load(str(tmp_path / kind), np.ones(3))
        other.computeLocalAABB()
        np.testing.assert_allclose(vertices.max(axis=0), other.aabb_local.max_, atol=1e-6)


def made_with(folder: Path, mesh: str, content: bytes, **options: object) -> NewRobot:
    (folder / mesh).write_bytes(content)
    (folder / "arm.urdf").write_text(urdf(ARMS["ur"]).replace(BALL, f'<mesh filename="{mesh}"/>', 1))
    new = NewRobot(folder / "arm.urdf", **options)  # type: ignore[arg-type]
    new.write(folder / "made")
    return new


@pytest.mark.parametrize(
    ("mesh", "content", "reason"),
    few(
        [
            ("a.stl", b"", "has no triangles: it is empty or damaged"),
            ("a.stl", b"x" * 1000, "has no triangles"),
            ("a.obj", b"v 0 0 0\nv 1 0 0\nv nan 0 1\nf 1 2 3", "has no triangles|not finite"),
            (
                "a.obj",
                b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3",
                "is a line or a point, not a surface|cannot be read",
            ),
            ("a.dae", b"PK\3\4zipped", "is not COLLADA: its first character is not <"),
            ("a.dae", as_dae(head='<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>'), "has a DOCTYPE"),
            ("a.gltf", as_gltf("../../../../etc/passwd"), "cannot be read"),
            (
                "a.ply",
                as_ply().replace(b"vertex 4", b"vertex 900000000000"),
                "has no triangles|cannot be read",
            ),
            ("a.msh", b"\xff" * 16, "is not a MuJoCo mesh"),
        ],
        3,
    ),
)
def test_hostile_meshes_are_rejected_with_the_line_the_link_and_the_path(
    tmp_path: Path, mesh: str, content: bytes, reason: str
) -> None:
    with pytest.raises(ConfigError, match=rf"arm\.urdf:1: link 'link0': mesh .*{mesh} .*({reason})"):
        made_with(tmp_path, mesh, content)
    assert not (tmp_path / "made").exists()


def test_a_buffer_of_a_size_that_is_only_claimed_is_not_allocated(tmp_path: Path) -> None:
    claimed = (
        as_gltf("buffer.bin")
        .replace(b'"count": 4', b'"count": 4000000000')
        .replace(b'"bufferView": 0, ', b"")
    )
    (tmp_path / "buffer.bin").write_bytes(bytes(96))
    with pytest.raises(ConfigError, match=r"a\.gltf .*(memory|cannot be read)"):
        made_with(tmp_path, "a.gltf", claimed)


def test_a_worker_that_takes_too_long_is_killed_and_the_next_request_has_another(tmp_path: Path) -> None:
    (tmp_path / "a.stl").write_bytes(as_binary_stl())
    request = {"file": absolute(tmp_path / "a.stl"), "into": absolute(tmp_path / "a.glb"), "triangles": 12}
    with Worker() as worker:
        with pytest.raises(ConfigError, match="takes longer than 0 s"):
            worker.ask("look", 0.0, **request)
        assert worker.ask("look", **request)


def test_millimetres_and_flat_meshes_are_reported(tmp_path: Path) -> None:
    large = as_obj().replace(b"0.05", b"50").replace(b"0.06", b"60").replace(b"0.07", b"70")
    flat = b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0.1 0.1 0\nf 1 2 3\nf 2 4 3"
    assert "link0: a.obj is 70 m long, which looks like millimetres" in " ".join(
        made_with(tmp_path, "a.obj", large).guessed
    )
    (tmp_path / "flat").mkdir()
    assert "link0: a.obj is flat" in " ".join(made_with(tmp_path / "flat", "a.obj", flat).guessed)


def yoke() -> tuple[np.ndarray, np.ndarray]:
    """Three boxes that leave 0.2 m by 0.3 m free between them, as vertices and triangles."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
         [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )  # fmt: skip
    boxes = [((0, 0, 0), (0.3, 0.1, 0.05)), ((0, 0, 0), (0.05, 0.1, 0.35)), ((0.25, 0, 0), (0.05, 0.1, 0.35))]
    vertices = np.concatenate([np.array(low) + corners * size for low, size in boxes])
    return vertices, np.concatenate([faces + 8 * index for index in range(3)])


def test_a_yoke_becomes_solids_that_cover_it_and_leave_its_inside_free() -> None:
    vertices, triangles = yoke()
    whole = solids(vertices, triangles, split=False)
    assert whole.is_wrong
    assert len(whole.solids) == 1
    assert 0.05 < whole.void_m < 0.15
    split = solids(vertices, triangles, split=True)
    assert 2 <= len(split.solids) <= 8
    weights = np.random.default_rng(0).dirichlet(np.ones(3), (50, len(triangles)))
    points = np.einsum("nti,tij->ntj", weights, vertices[triangles]).reshape(-1, 3)
    assert np.min([beyond(solid, points) for solid in split.solids], axis=0).max() < 0.01
    middle = np.array([[0.15, 0.05, 0.2], [0.15, 0.05, 0.3]])
    assert min(beyond(solid, middle).min() for solid in split.solids) > 0.01
    assert beyond(whole.solids[0], middle).max() < 0.0


def beyond(solid: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """How far each point is outside the planes of a convex solid's faces, m."""
    offsets = np.einsum("ij,ij->i", solid.face_normals, solid.triangles[:, 0])
    return (points @ solid.face_normals.T - offsets).max(axis=1)


def test_solids_are_switched_off_and_a_convex_mesh_stays_one(tmp_path: Path) -> None:
    vertices, triangles = yoke()
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles
    ]
    for name, options, least, most in (("split", {}, 2, 8), ("hull", {"hulls": True}, 1, 1)):
        (tmp_path / name).mkdir()
        new = made_with(tmp_path / name, "yoke.obj", "\n".join(lines).encode(), **options)
        robot = load_robot(load_settings(tmp_path / name / "made" / "cobot-setting.yaml"))
        assert least <= robot.model.mj.nmesh <= most
        assert any("convex solids" in sentence for sentence in new.guessed) == (most > 1)
        assert any("is used for collisions, although" in sentence for sentence in new.guessed) == (most == 1)


def test_a_hull_that_fills_some_free_space_is_used_and_reported(tmp_path: Path) -> None:
    """The oracle is the depth of a notch: its middle is half its width of 44 mm from the sides."""
    box = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    vertices, triangles = yoke()
    parts = [
        ((0, 0, 0), (0.3, 0.1, 0.05)),
        ((0, 0, 0.05), (0.128, 0.1, 0.1)),
        ((0.172, 0, 0.05), (0.128, 0.1, 0.1)),
    ]
    vertices = np.concatenate([np.array(low) + box * size for low, size in parts])
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles
    ]
    new = made_with(tmp_path, "notch.obj", "\n".join(lines).encode())
    (sentence,) = [each for each in new.guessed if "notch.obj" in each]
    depth_mm = re.search(r"hull of notch\.obj is used for collisions, although it fills (\d+) mm", sentence)
    assert depth_mm is not None
    assert 22 - 13 <= int(depth_mm[1]) <= 22 + 13, "half the notch, within one cell of 0.3 m / 24"


def test_each_shape_and_colour_of_a_visual_is_one_that_check_accepts(tmp_path: Path) -> None:
    shapes = ('capsule radius="0.1" length="0.2"', 'cylinder radius="0.1" length="0.2"',
              'sphere radius="0.1"', 'box size="1 2 3"')  # fmt: skip
    seen = "".join(
        f'<visual><geometry><{shape}/></geometry><material name=""><color rgba="255 -1 0.5 1"/></material>'
        "</visual>"
        for shape in shapes
    )
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]).replace("<collision>", f"{seen}<collision>", 1))
    NewRobot(tmp_path / "arm.urdf").write(tmp_path / "made")
    found = visuals_of(tmp_path / "made" / "model.xml").visuals
    assert [each.shape for each in found] == [shape.split()[0] for shape in shapes]
    assert [each.color for each in found] == [[1.0, 0.0, 0.5, 1.0]] * 4


def test_visuals_are_kept_beside_the_model_and_change_nothing_in_it(tmp_path: Path) -> None:
    (tmp_path / "a.dae").write_bytes(as_dae())
    text = urdf(ARMS["ur"])
    seen = (
        '<visual><origin xyz="0.1 0.2 0.3" rpy="0 0 1.5707963267948966"/><geometry>'
        '<mesh filename="a.dae" scale="2 2 2"/>'
        '</geometry><material name="red"/></visual><visual><geometry><box size="1 2 3"/></geometry></visual>'
        '<visual><geometry><mesh filename="gone.dae"/></geometry></visual><collision>'
    )
    red = '<material name="red"><color rgba="1 0 0 1"/></material></robot>'
    models = []
    for name, content in (
        ("without", text),
        ("with", text.replace("<collision>", seen, 1).replace("</robot>", red)),
    ):
        (tmp_path / f"{name}.urdf").write_text(content)
        new = NewRobot(tmp_path / f"{name}.urdf")
        new.write(tmp_path / name)
        models.append((tmp_path / name / "model.xml").read_bytes())
    assert models[0] == models[1]
    assert not (tmp_path / "without" / "visuals.yaml").exists()
    first, second = yaml.safe_load((tmp_path / "with" / "visuals.yaml").read_text())["visuals"]
    assert first["color"] == [1.0, 0.0, 0.0, 1.0]
    assert first["position"] == [0.1, 0.2, 0.3]
    np.testing.assert_allclose(first["quaternion"], [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-12)
    assert (second["shape"], second["size"]) == ("box", [1.0, 2.0, 3.0])
    vertices, _ = read_mesh(tmp_path / "with" / first["file"])
    np.testing.assert_allclose(vertices.max(axis=0), CORNERS.max(axis=0), atol=1e-6)
    assert any(
        "link0: a <visual> is left out: " in each and "gone.dae does not exist" in each
        for each in new.guessed
    )


def test_fine_visuals_are_simplified_to_a_budget_and_keep_form_and_colour(tmp_path: Path) -> None:
    """Oracle: the sphere, whose radius is 0.1 m everywhere."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    red = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255])
    ball.visual = trimesh.visual.TextureVisuals(material=red)
    (tmp_path / "red.glb").write_bytes(trimesh.exchange.gltf.export_glb(trimesh.Scene(ball)))
    (tmp_path / "plain.stl").write_bytes(ball.export(file_type="stl"))
    seen = "".join(
        f'<visual><geometry><mesh filename="{name}"/></geometry></visual>'
        for name in ("red.glb", "plain.stl", "plain.stl")
    )
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]).replace("<collision>", f"{seen}<collision>", 1))
    new = NewRobot(tmp_path / "arm.urdf")
    new.write(tmp_path / "made")
    files = sorted((tmp_path / "made" / "visuals").iterdir())
    found = [next(iter(trimesh.load_scene(each).geometry.values())) for each in files]
    assert 2 * len(ball.faces) > MAX_TRIANGLES
    drawn = len(found[0].faces) + 2 * len(found[1].faces)
    assert 0.9 * MAX_TRIANGLES < drawn <= MAX_TRIANGLES, "a mesh counts as often as it is drawn"
    assert "triangles" not in " ".join(new.guessed)
    for each in found:
        assert np.abs(np.linalg.norm(each.triangles_center, axis=1) - 0.1).max() < 3e-4
        assert each.area == pytest.approx(4.0 * np.pi * 0.1**2, rel=1e-3)
    assert found[0].visual.material.baseColorFactor.tolist() == [255, 0, 0, 255]


@pytest.mark.parametrize("colours", [1, 2])
def test_a_mesh_of_one_colour_is_simplified_and_one_of_several_stays(tmp_path: Path, colours: int) -> None:
    """PLY has a colour for each corner, which a simplified mesh could not keep."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    ball.visual.vertex_colors = [[0, 0, 255, 255]] * len(ball.vertices)
    if colours == 2:
        ball.visual.vertex_colors[0] = [0, 255, 0, 255]
    (tmp_path / "ball.ply").write_bytes(ball.export(file_type="ply"))
    (tmp_path / "ball.glb").write_bytes(as_glb(tmp_path / "ball.ply", 500)[0])
    found = next(iter(trimesh.load_scene(tmp_path / "ball.glb").geometry.values()))
    assert len(found.faces) == (500 if colours == 1 else len(ball.faces))
    assert len(np.unique(found.visual.vertex_colors, axis=0)) == colours
    assert [0, 0, 255, 255] in found.visual.vertex_colors.tolist()


def test_visuals_that_stay_larger_than_the_budget_are_reported(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    ball.visual.vertex_colors = [[0, 0, 255, 255], *[[0, 255, 0, 255]] * (len(ball.vertices) - 1)]
    (tmp_path / "ball.ply").write_bytes(ball.export(file_type="ply"))
    seen = '<visual><geometry><mesh filename="ball.ply"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]).replace("<collision>", f"{seen}<collision>", 1))
    new = NewRobot(tmp_path / "arm.urdf")
    new.write(tmp_path / "made")
    count = f"{len(ball.faces):,}"
    said = [each for each in new.guessed if f"the visuals have {count} triangles, more than 40,000" in each]
    assert len(said) == 1
    assert said[0].endswith(f"the largest: ball.ply ({count})")


def test_a_mesh_without_area_stays_as_it_is(tmp_path: Path) -> None:
    """Oracle: its triangles, of which each is a line."""
    line = trimesh.Trimesh(
        np.arange(300.0)[:, None] * [1.0, 0.0, 0.0], np.arange(300).reshape(-1, 3), process=False
    )
    (tmp_path / "line.stl").write_bytes(line.export(file_type="stl"))
    (tmp_path / "line.glb").write_bytes(as_glb(tmp_path / "line.stl", 50)[0])
    found = next(iter(trimesh.load_scene(tmp_path / "line.glb", process=False).geometry.values()))
    assert len(found.faces) == 100


def test_the_parts_of_a_mesh_share_its_budget_and_keep_their_edges(tmp_path: Path) -> None:
    """Oracle: the two boxes, whose volume, corners and normals are known."""
    parts = [trimesh.creation.box(extents=[0.1, 0.2, 0.3]) for _ in range(2)]
    fine = [part.subdivide().subdivide().subdivide().subdivide() for part in parts]
    scene = trimesh.Scene({"near": fine[0], "far": fine[1].apply_translation([1.0, 0.0, 0.0])})
    (tmp_path / "two.glb").write_bytes(trimesh.exchange.gltf.export_glb(scene))
    (tmp_path / "few.glb").write_bytes(as_glb(tmp_path / "two.glb", 600)[0])
    found = list(trimesh.load_scene(tmp_path / "few.glb").geometry.values())
    assert all(100 < len(each.faces) <= 300 for each in found)
    for each in found:
        assert each.volume == pytest.approx(0.1 * 0.2 * 0.3, rel=1e-6)
        normals = np.abs(each.vertex_normals)
        np.testing.assert_allclose(normals.max(axis=1), 1.0, atol=1e-6)
