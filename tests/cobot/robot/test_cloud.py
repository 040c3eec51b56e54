"""Point clouds as cubes of a grid. Oracle: MuJoCo, with each cube as a geom of its own."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from independent_models import urdf
from instruction_sets import require_same_bits, sound_verdicts
from odd_arm import STANDING, by_mujoco, odd_arm
from sample_counts import samples

from cobot.errors import ConfigError, InputError
from cobot.robot.clearance import INSTRUCTIONS, Clearance
from cobot.robot.cloud import CloudTree, in_order, lane_nodes
from cobot.robot.collision import RESOLUTION_M, CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.enclosing import _box_tree
from cobot.robot.geometry.cells import _read, boxes_of, packed, tree_of
from cobot.robot.model import RobotModel
from cobot.robot.scene import Scene, SceneFile, SceneObject
from cobot.types import Array

SEED = 20261131
LEAST_M = 0.01
VOXEL_M = 0.04
TURN = "quat='.9 .1 .2 .3' pos='.05 -.1 .02'"
LEVEL = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


def cells(count: int = 250, seed: int = SEED) -> Array:
    """A sheet and scattered cells."""
    random = np.random.default_rng(seed)
    sheet = np.column_stack([random.integers(-10, 10, (count // 2, 2)), np.full(count // 2, 6)])
    return in_order(np.vstack([sheet, random.integers(-12, 12, (count // 2, 3))]))


def with_cloud(cloud: CloudTree) -> Clearance:
    x, y, z, *edges = cloud.bounds.tolist()
    half, cube = " ".join(str(0.5 * edge) for edge in edges), " ".join([repr(0.5 * cloud.voxel_m)] * 3)
    mj = odd_arm(
        f"<body {TURN}><geom type='box' pos='{x!r} {y!r} {z!r}' size='{half}'/>"
        f"<geom type='box' pos='{x!r} {y!r} {z!r}' size='{cube}'/></body>"
    )
    clearance = Clearance(mj, pairs_with(mj, [STANDING]), RESOLUTION_M, {STANDING: cloud})
    clearance.require(LEAST_M)
    return clearance


def with_cubes(cloud: CloudTree) -> tuple[mujoco.MjModel, list[tuple[int, int]]]:
    half = " ".join([repr(0.5 * cloud.voxel_m)] * 3)
    middles = [" ".join(map(repr, row)) for row in (cloud.voxel_m * (cloud.cells + 0.5)).tolist()]
    cubes = "".join(f"<geom type='box' pos='{middle}' size='{half}'/>" for middle in middles)
    mj = odd_arm(f"<body {TURN}>{cubes}</body>")
    return mj, pairs_with(mj, range(STANDING, STANDING + cloud.count))


def pairs_with(mj: mujoco.MjModel, geoms) -> list[tuple[int, int]]:
    moving = [geom for geom in range(mj.ngeom) if mj.body_weldid[mj.geom_bodyid[geom]] > 0]
    return [(geom, other) for geom in moving for other in geoms]


def rows_near(clearance: Clearance, count: int, random: np.random.Generator) -> Array:
    rows = random.uniform(-2.0, 2.0, (samples(count), clearance.dof))
    rows[:, 1] *= 0.05
    return rows


def test_the_distance_of_each_shape_is_that_from_the_nearest_cube() -> None:
    cloud = CloudTree(cells(), VOXEL_M)
    clearance, (mj, pairs) = with_cloud(cloud), with_cubes(cloud)
    rows = rows_near(clearance, 40, np.random.default_rng(SEED))
    found = clearance.distances(rows, 5.0)
    touching = 0
    for joints, row in zip(rows, found, strict=True):
        expected = by_mujoco(mj, joints, pairs).reshape(-1, cloud.count).min(axis=1)
        apart = expected > 0.0
        assert np.abs(row - expected)[apart].max(initial=0.0) < 1e-5
        assert (row[~apart] < 1e-6).all()
        touching += int((~apart).sum())
    assert touching > 10 or len(rows) < 40


def test_a_depth_is_that_of_the_deepest_cube_and_no_verdict_permits_a_deeper_one() -> None:
    """Oracle: a clearance with each cube as a geom of its own. The way out of a collision requires negative
    distances, see `cobot.planners.escape`."""
    cloud = CloudTree(cells(), VOXEL_M)
    clearance, (mj, pairs) = with_cloud(cloud), with_cubes(cloud)
    cubes = Clearance(mj, pairs, RESOLUTION_M)
    rows = rows_near(clearance, 40, np.random.default_rng(SEED + 10))
    expected = cubes.distances(rows, 5.0).reshape(len(rows), -1, cloud.count).min(axis=2)
    assert np.abs(clearance.distances(rows, 5.0) - expected).max() < 1e-5
    assert (expected < -VOXEL_M).any() or len(rows) < 40, "some are deeper than a cube is large"
    for index in range(clearance.count):
        for permitted_m in (-0.01, -0.03, -0.06):
            least_m = np.full(clearance.count, -50.0)
            least_m[index] = permitted_m
            clearance.require(least_m)
            free = np.array([clearance.is_free(row) for row in rows])
            assert (expected[free, index] >= permitted_m - 1e-5).all()
            assert (expected[~free, index] < permitted_m + 1e-5).all()
            assert np.array_equal(clearance.are_free(rows), free)


def test_the_nearest_cube_is_where_the_distance_is() -> None:
    cloud = CloudTree(cells(), VOXEL_M)
    clearance = with_cloud(cloud)
    mj = odd_arm(f"<geom type='box' {TURN} size='{0.5 * VOXEL_M} {0.5 * VOXEL_M} {0.5 * VOXEL_M}'/>")
    data = mujoco.MjData(mj)
    for joints in rows_near(clearance, 20, np.random.default_rng(SEED + 1)):
        distances = clearance.distances(joints[None], 5.0)[0]
        for index in np.flatnonzero(distances > 0.0):
            middle = clearance.nearest_cube(joints, int(index), 5.0)
            assert middle is not None
            data.qpos[:] = joints
            mujoco.mj_kinematics(mj, data)
            data.geom_xpos[STANDING] = middle
            geom = clearance.pairs[index][0] - 1  # this model has one geom less
            assert mujoco.mj_geomDistance(mj, data, geom, STANDING, 5.0, None) == pytest.approx(
                distances[index], abs=1e-5
            )
            assert clearance.nearest_cube(joints, int(index), 0.5 * float(distances[index])) is None


def test_the_derivative_of_a_distance_is_that_of_its_differences() -> None:
    clearance = with_cloud(CloudTree(cells(60), VOXEL_M))
    compared = 0
    for joints in rows_near(clearance, 30, np.random.default_rng(SEED + 2)):
        for index in range(clearance.count):
            distance, slope = clearance.gradient(joints, index)
            step = 1e-6 * np.eye(clearance.dof)
            ahead, behind = (clearance.distances(joints + s * step, 5.0)[:, index] for s in (1.0, -1.0))
            numeric = (ahead - behind) / 2e-6
            # Where the nearest cube or its nearest corner changes, there is no derivative.
            smooth = np.abs(ahead + behind - 2.0 * distance) < 1e-10
            if distance > 1e-3 and clearance.pairs[index][0] < STANDING + 4:  # capsule and sphere: exact
                assert np.abs(slope - numeric)[smooth].max(initial=0.0) < 1e-4
                compared += int(smooth.sum())
    assert compared > 50 or samples(30) < 30


def test_spheres_never_call_free_what_is_too_near_a_cube_and_all_instructions_agree() -> None:
    clearance = with_cloud(CloudTree(cells(), VOXEL_M))
    random = np.random.default_rng(SEED + 3)
    rows, rates = rows_near(clearance, 2000, random), random.uniform(-1.0, 1.0, clearance.dof)
    nearest, _, _ = sound_verdicts(clearance, rows, LEAST_M)
    assert require_same_bits(clearance, rows, rates)
    assert np.array_equal(clearance.are_free(rows), nearest >= LEAST_M)


def test_an_edge_among_cubes_is_free_or_not_as_exact_distances_say(monkeypatch: pytest.MonkeyPatch) -> None:
    cloud = CloudTree(cells(60), VOXEL_M)
    spheres = with_cloud(cloud)
    spheres.enclose()
    monkeypatch.setenv(INSTRUCTIONS, "exact")
    exact = with_cloud(cloud)
    exact.enclose()
    random = np.random.default_rng(SEED + 4)
    rows = rows_near(spheres, 60, random)
    rows = rows[exact.are_free(rows)]
    rows = np.vstack([np.stack([row, row + random.normal(size=row.shape) * 0.05]) for row in rows])
    verdicts = {True: 0, False: 0}
    for start, goal in pairwise(rows):
        found, expected = spheres.is_edge_free(start, goal), exact.is_edge_free(start, goal)
        verdicts[found] += 1
        places = start + np.linspace(0.0, 1.0, 200)[:, None] * (goal - start)
        nearest = exact.distances(places, 1.0).min()
        assert nearest >= LEAST_M - RESOLUTION_M - 1e-6 or not found
        assert found == expected or nearest < LEAST_M + 1e-3
        assert (spheres.contact(np.stack([start, goal])[None]) is None) == found or nearest < LEAST_M + 1e-3
    assert min(verdicts.values()) > 3 or samples(60) < 60, verdicts


def test_the_order_of_cells_depends_on_their_set_alone() -> None:
    random = np.random.default_rng(SEED + 5)
    given = random.integers(-50, 50, (5000, 3))
    order = in_order(given)
    assert np.array_equal(order, in_order(np.vstack([given[::-1], given[:100]])))
    assert np.array_equal(np.unique(order, axis=0), np.unique(given, axis=0))
    with pytest.raises(ValueError, match="must be below 1048576"):
        in_order(np.array([[0, 0, 1 << 20]]))


def test_text_gives_the_voxels_back_and_damage_is_named() -> None:
    random = np.random.default_rng(SEED + 6)
    points = random.uniform(-1.0, 1.0, (3000, 3))
    text = packed(points, 0.05)
    expected = np.unique(np.floor(points / 0.05).astype(int), axis=0)
    assert np.array_equal(np.unique(tree_of(text, 0.05).cells, axis=0), expected)
    assert np.array_equal(_read(text, 0.05).cells, tree_of(text, 0.05).cells), "also from the text alone"
    for wrong in ("", "no base64", text[:-8], text[:-8] + "AAAAAAAA"):
        with pytest.raises(InputError, match=r"cells: are damaged: .*add the point cloud again"):
            tree_of(wrong, 0.05)


@pytest.mark.parametrize("room", [1, 7, 100, 500])
def test_the_boxes_contain_each_voxel_and_reach_no_further_than_they_say(room: int) -> None:
    """The oracle is numpy: each voxel lies in a box; each corner of a box is near a voxel."""
    random = np.random.default_rng(SEED + 7)
    points = np.column_stack([random.uniform(-1.0, 1.0, (20_000, 2)), 0.1 * random.normal(size=20_000)])
    text = packed(points, 0.02)
    boxes, beyond_m = boxes_of(text, 0.02, room)
    assert 1 <= len(boxes) <= room
    middles = 0.02 * (tree_of(text, 0.02).cells + 0.5)
    low, high = boxes[:, :3] - 0.5 * boxes[:, 3:], boxes[:, :3] + 0.5 * boxes[:, 3:]
    assert all(
        ((middle - 0.01 >= low - 1e-9) & (middle + 0.01 <= high + 1e-9)).all(axis=1).any()
        for middle in middles[::61]
    )
    tree = tree_of(text, 0.02)
    assert tree.is_within(boxes)
    for row in range(0, len(boxes), 7):
        for changed in (np.delete(boxes, row, axis=0), boxes + 0.001 * np.eye(len(boxes))[row][:, None]):
            low_, high_ = changed[:, :3] - 0.5 * changed[:, 3:], changed[:, :3] + 0.5 * changed[:, 3:]
            left = middles
            for one, other in zip(low_, high_, strict=True):
                left = left[~((left - 0.01 >= one - 1e-9) & (left + 0.01 <= other + 1e-9)).all(axis=1)]
            assert tree.is_within(changed) == (not len(left))
    for corner in np.vstack([low, high]):
        away = np.linalg.norm(np.maximum(np.abs(middles - corner) - 0.01, 0.0), axis=1).min()
        assert away <= beyond_m + 1e-9


def test_trees_are_kept_for_all_clouds_of_a_scene_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera may send a new cloud each second; a scene may have 200 small ones."""
    random = np.random.default_rng(SEED + 11)
    monkeypatch.setattr("cobot.robot.geometry.cells.MAX_VOXELS", 3000)
    texts = [packed(random.uniform(-1.0, 1.0, (100, 3)), 0.001) for _ in range(60)]
    trees = [tree_of(text, 0.001) for text in texts]
    assert sum(tree.count for tree in trees[30:]) == 3000
    assert all(tree_of(text, 0.001) is tree for text, tree in zip(texts[30:], trees[30:], strict=True))
    assert not any(tree_of(text, 0.001) is tree for text, tree in zip(texts[:30], trees[:30], strict=True))


def test_few_boxes_are_exact() -> None:
    wall = np.stack(np.meshgrid(np.arange(30), np.arange(2), np.arange(20)), axis=-1).reshape(-1, 3) + 0.5
    boxes, beyond_m = boxes_of(packed(0.01 * wall, 0.01), 0.01)
    assert (len(boxes), beyond_m) == (1, 0.0)
    assert boxes[0] == pytest.approx([0.15, 0.01, 0.1, 0.3, 0.02, 0.2])


def cloud_object(points: Array, voxel_m: float) -> SceneObject:
    text = packed(points, voxel_m)
    boxes, beyond_m = boxes_of(text, voxel_m)
    return SceneObject(
        "point_cloud", (1.0, 1.0, 1.0), LEVEL, boxes=tuple(map(tuple, boxes.tolist())),
        tolerance=beyond_m, cells=text, voxel=voxel_m,
    )  # fmt: skip


def test_planners_use_the_voxels_and_streams_the_boxes(robot: RobotDescription) -> None:
    """A hollow shell around the arm's hand: its boxes fill the gap that the voxels leave."""
    random, joints = np.random.default_rng(SEED + 8), robot.positions["home"].joints
    ways = random.normal(size=(60_000, 3))
    hand = robot.model.forward(np.array(joints)).position
    shell = hand + 0.7 * ways / np.linalg.norm(ways, axis=1)[:, None]
    shell = shell[np.abs(shell - hand)[:, :2].max(axis=1) > 0.3]
    item = cloud_object(shell, 0.01)
    assert item.tree is not None
    assert item.tree.count > 10_000
    assert 100 < item.solids <= 500
    checker = robot.collision.among(Scene(1, {"shell": item}))
    assert checker.mj.ngeom == robot.model.mj.ngeom + 2
    assert checker.mj_in_boxes.ngeom == robot.model.mj.ngeom + item.solids
    nearest = checker.nearest.at(np.array(joints))[1]
    assert nearest is not None
    assert nearest.second == "shell"
    middles = 0.01 * (item.tree.cells + 0.5)
    beyond = np.maximum(np.abs(middles - nearest.points[1]) - 0.005, 0.0)
    assert np.linalg.norm(beyond, axis=1).min() < 1e-5, "the nearest point is on a voxel"
    assert np.linalg.norm(np.subtract(*nearest.points)) == pytest.approx(nearest.distance_m, abs=1e-5)
    held = replace(item, attached=True)
    assert robot.collision.among(Scene(1, {"shell": held})).mj.ngeom == robot.model.mj.ngeom + item.solids


def test_a_cloud_survives_its_file_and_a_damaged_one_is_named(tmp_path) -> None:
    points = np.random.default_rng(SEED + 9).uniform(-1.0, 1.0, (5000, 3))
    file = SceneFile(tmp_path / "scene.json")
    scene = Scene(3, {"cloud": cloud_object(points, 0.02)})
    file.write(scene)
    assert file.read() == scene
    whole = file.path.read_text()
    file.path.write_text(whole.replace(scene.objects["cloud"].cells[20:60], "A" * 40))
    with pytest.raises(ConfigError, match=r"scene.json: objects.cloud.cells: are damaged"):
        file.read()
    assert file.read(by_voxels=False).objects["cloud"].boxes == scene.objects["cloud"].boxes
    file.write(Scene(3, {"cloud": replace(scene.objects["cloud"], boxes=())}))
    with pytest.raises(ConfigError, match=r"scene.json: objects.cloud.boxes: are missing"):
        file.read(by_voxels=False)
    file.write(Scene(3, {"cloud": replace(scene.objects["cloud"], boxes=scene.objects["cloud"].boxes[1:])}))
    with pytest.raises(ConfigError, match=r"scene.json: objects.cloud.boxes: do not contain all voxels of"):
        file.read()


def test_a_new_cloud_is_not_read_back_from_its_text(monkeypatch: pytest.MonkeyPatch) -> None:
    """For 200,000 voxels this took 0.1 s, in which an arm may move on towards what has appeared."""
    read: list[str] = []
    monkeypatch.setattr("cobot.robot.geometry.cells._read", lambda text, voxel_m: read.append(text))
    points = np.random.default_rng(SEED + 12).uniform(-1.0, 1.0, (500, 3))
    assert cloud_object(points, 0.02).tree is not None
    assert not read


def test_checks_of_a_scene_share_the_spheres_of_a_cloud(monkeypatch: pytest.MonkeyPatch) -> None:
    """For 200,000 voxels each check of a motion that waits made them again, which took 40 ms."""
    cloud, made = CloudTree(cells(), VOXEL_M), []

    def note(tree: Array, *place: Array) -> Array:
        made.append(len(tree) == 2 * cloud.count - 1)
        return lane_nodes(tree, *place)

    monkeypatch.setattr("cobot.robot.cloud.lane_nodes", note)
    rows = rows_near(with_cloud(cloud), 100, np.random.default_rng(SEED + 13))
    expected = with_cloud(CloudTree(cells(), VOXEL_M)).are_free(rows)
    first, second = with_cloud(cloud), with_cloud(cloud)
    assert np.array_equal(first.are_free(rows), expected)
    del first
    assert np.array_equal(second.are_free(rows), expected)
    assert cloud.nodes_at(np.eye(3), np.ones(3))[0, :3] == pytest.approx(1.0), "another place"
    assert cloud.nodes_at(np.eye(3), np.zeros(3))[0, :3] == pytest.approx(0.0)
    assert np.array_equal(second.are_free(rows), expected), "it keeps those of its own place"
    assert sum(made) == 4


def test_a_picture_of_an_old_scene_is_not_kept_for_the_new_one(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread draws the old scene while the service takes over a new one."""
    old, new = (Scene(each, {"seen": cloud_object(np.full((1, 3), 2.0 + each), 0.1)}) for each in (1, 2))
    checker, later = robot.collision.among(old), robot.collision.among(new)
    slow = RobotModel.among

    def take_over_meanwhile(*given, **options):
        made = slow(*given, **options)
        monkeypatch.undo()
        checker.take_over(later)
        return made

    monkeypatch.setattr(RobotModel, "among", take_over_meanwhile)
    assert checker.mj_in_boxes.geom_pos[-1] == pytest.approx(3.05, abs=0.1)
    assert checker.scene is new
    assert checker.mj_in_boxes.geom_pos[-1] == pytest.approx(4.05, abs=0.1)


def test_no_spheres_are_made_around_a_large_floor(
    robot: RobotDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Around 6 m x 6 m they took 8 s, in which the service answered nothing."""
    made: list[float] = []

    def note(*size: float) -> Array:
        made.append(max(size))
        return _box_tree(*size)

    monkeypatch.setattr("cobot.robot.enclosing._box_tree", note)
    floor = SceneObject("box", (2.0, 2.0, 0.1), (0.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0))
    item = cloud_object(np.array([[0.0, 0.0, 2.0], [0.5, 0.0, 2.0]]), 0.01)
    robot.collision.among(Scene(1, {"floor": floor, "seen": item})).clearance.enclose()
    assert not [half for half in made if half > 0.5]


def test_a_robot_from_a_urdf_sees_the_voxels(robot: RobotDescription, tmp_path) -> None:
    """MuJoCo discards the geoms of a URDF that collide with nothing."""
    file, ball = tmp_path / "arm.urdf", '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    file.write_text(urdf().replace("</link>", f"{ball}</link>"), encoding="utf-8")
    model = RobotModel.load(file, robot.limits)
    joints = np.array(robot.positions["home"].joints)
    item = cloud_object(model.forward(joints).position + np.array([[0.2, 0.0, 0.0], [-0.8, 0.0, 0.0]]), 0.01)
    checker = CollisionChecker(model, 0.01).among(Scene(1, {"seen": item}))
    nearest = checker.nearest.at(joints)[1]
    assert nearest is not None
    assert nearest.second == "seen"
    beyond = np.abs(0.01 * (item.tree.cells + 0.5) - nearest.points[1])  # type: ignore[union-attr]
    assert beyond.max(axis=1).min() < 0.005 + 1e-6, "the nearest point is on a voxel"
    assert not any(other == checker.mj.ngeom - 1 for pair in checker.pairs for other in pair)
