"""Clouds, height fields and meshes as solids. Oracles: cell by cell in numpy, and coal's triangles."""

import base64
import struct

import coal
import mujoco
import numpy as np
import pytest
from pydantic import ValidationError

from app.api.schemas.scene import PutObject
from app.api.solids import solid_of
from cobot.config import load_settings
from cobot.errors import InputError, LimitError
from cobot.robot.description import load_robot
from cobot.robot.geometry.mesh import parts, read
from cobot.robot.geometry.solids import MAX_SOLIDS, _along, cloud, columns
from cobot.robot.load import homogeneous
from cobot.robot.scene import Scene, SceneFile, SceneObject

ROBOT = load_robot(load_settings(None))
HOME = np.array(ROBOT.positions["home"].joints)
LEVEL = (1.0, 0.0, 0.0, 0.0)
CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
     [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def inside(boxes, points):
    """How many boxes each point is in."""
    return (np.abs(points[:, None] - boxes[None, :, :3]) < 0.5 * boxes[None, :, 3:]).all(axis=2).sum(axis=1)


def cup(radius=0.1, wall=0.01, height=0.2, sides=24):
    """A closed concave mesh, open above: an outer and an inner prism, and the ring between them."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rows = [(radius, 0.0), (radius, height), (radius - wall, height), (radius - wall, wall)]
    vertices = [np.column_stack([size * ring, np.full(sides, level)]) for size, level in rows]
    triangles = []
    for row in range(3):
        for side in range(sides):
            a, b = row * sides + side, row * sides + (side + 1) % sides
            triangles += [[a, b, b + sides], [a, b + sides, a + sides]]
    for side in range(1, sides - 1):
        triangles += [[0, side + 1, side], [3 * sides, 3 * sides + side, 3 * sides + side + 1]]
    return np.concatenate(vertices), np.array(triangles)


def test_a_cloud_is_its_voxels_and_no_more():
    random = np.random.default_rng(1)
    points = np.concatenate([random.uniform(-0.5, 0.5, (2000, 3)) * [1.0, 1.0, 0.02], [[0.0, 0.0, 0.4]]])
    boxes = cloud(points, 0.1)
    full = {tuple(cell) for cell in np.floor(points / 0.1).astype(int)}
    cells = np.stack(np.meshgrid(*[np.arange(-7, 7)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    expected = [int(tuple(cell) in full) for cell in cells.tolist()]
    assert inside(boxes, 0.1 * (cells + 0.5)).tolist() == expected
    assert len(boxes) < len(full) / 4


def test_a_cloud_that_is_too_fine_names_a_voxel_that_fits():
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (3000, 3))
    with pytest.raises(
        LimitError, match=r"3000 points fill 3000 voxels of 0.001 m, .*allowed: 500"
    ) as refused:
        cloud(points, 0.001)
    fits = float(str(refused.value).rsplit(" m would fit", 1)[0].rsplit(" ", 1)[1])
    assert len(cloud(points, fits)) <= MAX_SOLIDS


def test_the_search_for_a_voxel_that_fits_tries_one_order_if_that_is_far_off(monkeypatch):
    """A cloud of 130,000 points took 14 s before it was rejected."""
    sizes = []

    def note(boxes, axis):
        sizes.append(len(boxes))
        return _along(boxes, axis)

    monkeypatch.setattr("cobot.robot.geometry.solids._along", note)
    points = np.random.default_rng(4).uniform(-10.0, 10.0, (3000, 3))
    with pytest.raises(LimitError, match="would fit"):
        cloud(points, 0.001)
    orders = sizes.count(3000) / 3
    assert 6 <= orders < 15, "six for this voxel, and one for each voxel that still separates all points"


def test_a_height_field_is_a_column_on_each_cell():
    heights = np.array([[0.1, 0.1, 0.3], [0.1, np.nan, 0.0]])
    boxes = columns(heights, 0.5, 0.0, 0.0)
    random = np.random.default_rng(3)
    points = random.uniform([0.0, 0.0, -0.1], [1.5, 1.0, 0.4], (2000, 3))
    of_cell = heights[(points[:, 1] // 0.5).astype(int), (points[:, 0] // 0.5).astype(int)]
    expected = (points[:, 2] > 0.0) & (points[:, 2] < np.nan_to_num(of_cell))
    assert (inside(boxes, points) == expected).all()
    assert len(boxes) == 3


def test_heights_are_rounded_up_to_steps_and_an_error_names_one_that_fits():
    heights = 0.2 + 0.1 * np.sin(np.linspace(0.0, 6.0, 60))[:, None] * np.cos(np.linspace(0.0, 6.0, 60))
    with pytest.raises(LimitError, match=r"heights: 60 x 60 cells make .* boxes.*; a step of") as refused:
        columns(heights, 0.02, -0.1, 0.0)
    step = float(str(refused.value).rsplit(" m would fit", 1)[0].rsplit(" ", 1)[1])
    boxes = columns(heights, 0.02, -0.1, step)
    assert len(boxes) <= MAX_SOLIDS
    rows, places = np.indices(heights.shape)
    below = np.stack([0.02 * (places + 0.5), 0.02 * (rows + 0.5), heights - 1e-9], axis=-1).reshape(-1, 3)
    assert (inside(boxes, below) == 1).all()
    assert (inside(boxes, below + np.array([0.0, 0.0, step + 1e-6])) == 0).all()
    with pytest.raises(InputError, match="none of the 1 values is above the floor"):
        columns(np.array([[0.0]]), 0.1, 0.0, 0.0)


def test_convex_parts_of_a_mesh_are_exact_and_apart():
    vertices = np.concatenate([CUBE, CUBE * 0.5 + [3.0, 0.0, 0.0]])
    boxes, hulls = parts(vertices, np.concatenate([FACES, FACES[:, ::-1] + 8]), 0.01)
    assert len(boxes) == 0
    assert sorted(len(hull) for hull in hulls) == [8, 8]
    assert {tuple(corner) for hull in hulls for corner in hull} == {tuple(corner) for corner in vertices}


def test_a_cup_is_not_its_hull_and_stays_within_the_tolerance():
    """Oracle: coal's distance of a point from the triangles."""
    vertices, triangles = cup()
    tolerance = 0.06
    boxes, hulls = parts(vertices, triangles, tolerance)
    assert not hulls
    assert 1 < len(boxes) <= MAX_SOLIDS
    assert inside(boxes, np.array([[0.0, 0.0, 0.15]])).tolist() == [0]
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), len(vertices))
    model.addVertices(vertices)
    model.addTriangles(triangles.astype(np.int64))
    model.endModel()
    point, request = coal.Sphere(1e-6), coal.DistanceRequest()
    random = np.random.default_rng(4)
    weights = random.dirichlet([1.0, 1.0, 1.0], 3000)
    surface = np.einsum(
        "ij,ijk->ik", weights, vertices[triangles[random.integers(len(triangles), size=3000)]]
    )
    nudged = surface + 1e-9 * (np.array([0.0, 0.0, 0.1]) - surface)
    slack = boxes.copy()
    slack[:, 3:] += 1e-6
    assert (inside(slack, nudged) > 0).all()  # nothing is left out
    for box in boxes:
        for corner in box[:3] + 0.5 * box[3:] * random.choice([-1.0, 1.0], (4, 3)):
            result = coal.DistanceResult()
            place = coal.Transform3s(np.eye(3), corner)
            found = coal.distance(model, coal.Transform3s(), point, place, request, result)
            assert found <= tolerance + 1e-5


def test_a_mesh_that_is_too_fine_names_a_tolerance_that_fits():
    vertices, triangles = cup()
    with pytest.raises(LimitError, match=r"at a tolerance of 0.005 m: .* m would fit") as refused:
        parts(vertices, triangles, 0.005)
    fits = float(str(refused.value).rsplit(" m would fit", 1)[0].rsplit(" ", 1)[1])
    assert len(parts(vertices, triangles, fits)[0]) <= MAX_SOLIDS


def test_an_open_mesh_is_its_surface():
    boxes, hulls = parts(CUBE, FACES[:2], 0.2)  # one face, at x = 0
    assert not hulls
    assert inside(boxes, np.array([[0.0, 0.5, 0.5], [0.3, 0.5, 0.5]])).tolist() == [1, 0]


@pytest.mark.parametrize(
    ("vertices", "triangles", "message"),
    [
        (CUBE, [[0, 1, 8]], "there is no vertex 8; valid values: 0 to 7"),
        (CUBE, np.zeros((0, 3), int), "the mesh has no triangles"),
        (CUBE, [[0, 0, 1]], "all have the area 0"),
        (CUBE * 0.0, [[0, 1, 2]], "all at the same point"),
        (CUBE, [[0, 1, 2]] * 20_001, "at most 20000 are allowed, got 20001"),
    ],
)
def test_what_is_no_mesh_is_refused(vertices, triangles, message):
    with pytest.raises((InputError, LimitError), match=message):
        parts(vertices, triangles, 0.1)


def stl():
    body = b"".join(
        struct.pack("<12fH", 0.0, 0.0, 0.0, *(float(value) for value in CUBE[face].ravel()), 0)
        for face in FACES
    )
    return bytes(80) + struct.pack("<I", len(FACES)) + body


def obj():
    lines = [f"v {x} {y} {z}" for x, y, z in CUBE] + [f"f {a + 1}//1 {b + 1} {c + 1}" for a, b, c in FACES]
    return "\n".join(lines).encode()


def text_stl():
    rows = "\n".join(f"vertex {x} {y} {z}" for face in FACES for x, y, z in CUBE[face])
    return f"solid cube\n{rows}\nendsolid".encode()


@pytest.mark.parametrize("content", [stl(), obj(), text_stl()])
def test_files_of_meshes_are_read(content):
    vertices, triangles = read(content)
    assert vertices[triangles] == pytest.approx(CUBE[FACES])
    body = PutObject(
        shape="mesh", file=base64.b64encode(content).decode(), scale=0.1, x=0.0, y=0.0, z=0.0, mass=2.0
    )
    solid = solid_of("cube", body)
    assert (solid.solids, solid.size) == (1, pytest.approx((0.1, 0.1, 0.1)))
    centre, inertia = homogeneous(solid)
    assert centre == pytest.approx([0.05, 0.05, 0.05])
    assert inertia == pytest.approx(np.eye(3) * 2.0 * 0.01 / 6.0)


@pytest.mark.parametrize("content", [b"", b"nonsense", b"\xff\xfe", b"v 0 0 0\nf 1 x 2", stl()[:-1]])
def test_files_that_are_none_are_refused(content):
    with pytest.raises(InputError, match="file: is not an STL or OBJ mesh"):
        read(content)


def body_of(shape, **fields):
    return PutObject(shape=shape, x=0.5, y=0.0, z=0.0, **fields)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"shape": "mesh"}, "vertices is missing; a mesh needs vertices and triangles, or file"),
        ({"shape": "mesh", "file": "", "vertices": []}, "vertices is not allowed; a mesh needs file"),
        (
            {"shape": "point_cloud", "points": [[0, 0, 0]]},
            "voxel is missing; a point_cloud needs points and voxel",
        ),
        ({"shape": "height_field", "heights": [[1.0]]}, "resolution is missing"),
        ({"shape": "box", "size": [1, 1, 1], "voxel": 1.0}, "voxel is not allowed"),
    ],
)
def test_each_shape_has_its_own_fields(fields, message):
    with pytest.raises(ValidationError, match=message):
        PutObject(x=0.0, y=0.0, z=0.0, **fields)


def test_rows_of_heights_are_equally_long():
    with pytest.raises(InputError, match=r"objects.a: heights: all rows must be equally long .*\[1, 2\]"):
        solid_of("objects.a", body_of("height_field", heights=[[1.0], [1.0, 2.0]], resolution=0.1))


@pytest.mark.parametrize("value", ["1e9", "nan", "1e308"])
def test_a_file_of_far_places_is_refused(value):
    file = base64.b64encode(obj().replace(b"v 1.0", f"v {value}".encode())).decode()
    with pytest.raises(LimitError, match=r"objects.a: vertices: x, y and z must be at most 100 m"):
        solid_of("objects.a", body_of("mesh", file=file))


def everything():
    vertices, triangles = cup()
    return {
        "cloud": solid_of("a", body_of("point_cloud", points=[[0.1, 0.2, 0.3], [0.1, 0.2, 0.4]], voxel=0.05)),
        "ground": solid_of("b", body_of("height_field", heights=[[0.1, 0.2]], resolution=0.2)),
        "cup": solid_of(
            "c",
            body_of("mesh", vertices=vertices.tolist(), triangles=triangles.tolist(), tolerance=0.06),
        ),
        "wedge": solid_of(
            "d", body_of("mesh", vertices=(0.2 * CUBE).tolist(), triangles=FACES.tolist(), b=0.4)
        ),
    }


def test_all_of_them_are_kept_and_seen_as_far_as_mujoco_says(tmp_path):
    scene = Scene(2, everything())
    file = SceneFile(tmp_path / "scene.json")
    file.write(scene)
    assert file.read() == scene
    checker, model = ROBOT.collision.among(scene), ROBOT.model.among(scene)
    data, random = mujoco.MjData(model), np.random.default_rng(6)
    seen = set()
    for joints in random.uniform(0.7 * ROBOT.limits.min_position, 0.7 * ROBOT.limits.max_position, (5, 7)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        found = checker.clearance.distances(joints[None], 5.0)[0]
        for index, pair in enumerate(checker.pairs):
            names = set(checker.names(index)) & set(scene.objects)
            expected = mujoco.mj_geomDistance(model, data, *pair, 5.0, None) if names else 0.0
            if expected > 1e-3:
                seen |= names
                assert found[index] == pytest.approx(expected, abs=2e-5), checker.names(index)
    assert seen == set(scene.objects)


def test_a_wedge_is_where_its_place_says():
    """Oracle: coal's convex distance from a small ball that is held."""
    wedge = everything()["wedge"]
    ball = SceneObject("sphere", (0.01,), (0.0, 0.0, 0.1, *LEVEL), attached=True)
    scene = Scene(1, {"wedge": wedge, "ball": ball})
    checker = ROBOT.collision.among(scene)
    found = {
        frozenset(checker.names(index)): each
        for index, each in enumerate(checker.clearance.distances(HOME[None], 5.0)[0])
    }
    tcp, turn = ROBOT.model.forward(HOME), np.empty(9)
    mujoco.mju_quat2Mat(turn, tcp.quaternion)
    place = tcp.position + turn.reshape(3, 3) @ [0.0, 0.0, 0.1]
    mujoco.mju_quat2Mat(turn, np.array(wedge.pose[3:]))
    middle = np.array(wedge.pose[:3]) + turn.reshape(3, 3) @ [0.1, 0.1, 0.1]
    cube = coal.Transform3s(turn.reshape(3, 3).copy(), middle)
    expected = coal.distance(
        coal.Box(0.2, 0.2, 0.2), cube, coal.Sphere(0.01), coal.Transform3s(np.eye(3), place),
        coal.DistanceRequest(), coal.DistanceResult(),
    )  # fmt: skip
    assert found[frozenset(("wedge", "ball"))] == pytest.approx(expected, abs=1e-5)
