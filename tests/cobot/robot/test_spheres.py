"""The spheres that decide first in a search. Oracles: exact distances, MuJoCo, dense samples."""

from __future__ import annotations

import json
import pickle
import re
import shutil
import subprocess
from itertools import combinations, pairwise
from math import comb
from pathlib import Path

import mujoco
import numpy as np
import pytest
from folders import ROOT
from instruction_sets import require_same_bits, sound_verdicts
from odd_arm import by_mujoco, odd_arm
from sample_counts import ENOUGH, samples

from benchmarks.planning import scenes
from cobot.errors import ConfigError
from cobot.robot.clearance import INSTRUCTIONS, Clearance
from cobot.robot.collision import RESOLUTION_M, geom_pairs
from cobot.robot.covers import cover
from cobot.robot.description import RobotDescription
from cobot.robot.enclosing import LOSS_M, nodes_around, tree_around
from cobot.robot.kept_arrays import KeptArrays
from cobot.types import Array

SEED = 20261130
LEAST_M = 0.01
SLIDE = 1
"""The joint of the odd arm that slides."""


def odd_clearance(least_m: float = LEAST_M) -> Clearance:
    mj = odd_arm()
    clearance = Clearance(mj, [p for p in combinations(range(mj.ngeom), 2) if p[1] > 2], RESOLUTION_M)
    clearance.require(least_m)
    return clearance


def clearances(robot: RobotDescription) -> list[Clearance]:
    """An arm with every shape, and the shipped one in each kind of clutter."""
    found = [odd_clearance()]
    for kind in scenes.KINDS:
        mj = next(scenes.problems(robot, kind, 1, SEED)).robot.model.mj
        found.append(Clearance(mj, geom_pairs(mj), RESOLUTION_M))
        found[-1].require(LEAST_M)
    return found


def rows_of(clearance: Clearance, count: int, random: np.random.Generator) -> Array:
    """Joints within the range of the slide, on which all bounds of motions depend."""
    rows = random.uniform(-2.0, 2.0, (samples(count), clearance.dof))
    rows[:, SLIDE] *= 0.05
    return rows


def rates_of(clearance: Clearance, half: float, random: np.random.Generator) -> Array:
    """Rates with which the slide stays in its range for half an interval."""
    rates = random.uniform(-2.0, 2.0, clearance.dof)
    rates[SLIDE] *= 0.05 / half
    return rates


def test_spheres_never_call_free_what_is_too_near_nor_a_hit_what_is_free(robot: RobotDescription) -> None:
    random, decided = np.random.default_rng(SEED), np.zeros(2, dtype=int)
    for clearance in clearances(robot):
        rows = rows_of(clearance, 4000, random)
        _, hit, unsure = sound_verdicts(clearance, rows, LEAST_M)
        decided += int(hit.sum()), int((~unsure).sum())
    assert decided.min() > 100 or not ENOUGH


def test_mujoco_finds_no_contact_nearer_than_required_where_the_spheres_see_none() -> None:
    mj, clearance = odd_arm(), odd_clearance()
    rows = rows_of(clearance, 400, np.random.default_rng(SEED + 1))
    found = clearance.sphere_verdicts(rows)
    assert found is not None
    for joints in rows[~found[2]]:
        assert by_mujoco(mj, joints, clearance.pairs).min() >= LEAST_M - 1e-6


def test_an_interval_that_the_spheres_prove_is_free_at_each_of_its_places(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED + 2)
    proven = 0
    for clearance in clearances(robot):
        for half in (0.02, 0.1):
            rates = rates_of(clearance, half, random)
            rows = rows_of(clearance, 400, random)
            found = clearance.sphere_verdicts(rows, rates=rates, half=half)
            assert found is not None
            _, unproven, unsure, _ = found
            assert (unproven | ~unsure).all() or (unproven >= unsure).all()
            for share in np.linspace(-half, half, 21):
                assert clearance.distances(rows[~unproven] + share * rates, 1.0).min(initial=1.0) >= LEAST_M
            proven += int((~unproven).sum())
    assert proven > 50 or not ENOUGH


def test_no_part_moves_farther_than_its_bound_in_an_interval() -> None:
    """The oracle is MuJoCo's kinematics of points inside the parts."""
    mj, clearance = odd_arm(), odd_clearance()
    random, data = np.random.default_rng(SEED + 3), mujoco.MjData(odd_arm())
    parts = sorted({geom for pair in clearance.pairs for geom in pair})
    moving = [geom for geom in parts if mj.geom_bodyid[geom] > 0]
    inside = {geom: surface(mj, geom, random, 50) for geom in moving}
    for _ in range(samples(60)):
        half = random.uniform(0.01, 0.3)
        joints, rates = rows_of(clearance, 1, random)[0], rates_of(clearance, half, random)
        found = clearance.sphere_verdicts(joints[None], rates=rates, half=half)
        assert found is not None
        places = []
        for share in (0.0, -half, half, random.uniform(-half, half)):
            data.qpos[:] = joints + share * rates
            mujoco.mj_kinematics(mj, data)
            places.append(
                [
                    data.geom_xpos[geom] + inside[geom] @ data.geom_xmat[geom].reshape(3, 3).T
                    for geom in moving
                ]
            )
        moved = np.linalg.norm(np.array(places[1:]) - places[0], axis=-1).max(axis=(0, 2))
        bounds = found[3][0, [parts.index(geom) for geom in moving], 3]
        assert (moved <= bounds + 1e-6).all()


def test_each_set_of_instructions_gives_the_same_bits(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED + 4)
    compared = 0
    for clearance in clearances(robot):
        rows, rates = rows_of(clearance, 1000, random), random.uniform(-1.0, 1.0, clearance.dof)
        compared += require_same_bits(clearance, rows, rates)
    assert compared >= 5


def lanes_bits(folder: Path, compiler: str, *options: str) -> Path:
    """A program that prints the bits of random checks, compiled with the options of `setup.py`."""
    (arithmetic,) = re.findall(r"^ARITHMETIC = (\[.+?\])$", (ROOT / "setup.py").read_text(), re.M)
    source, program = Path(__file__).with_name("lanes_bits.c"), folder / compiler
    command = [compiler, "-O2", *json.loads(arithmetic), "-Wno-psabi", "-I", str(ROOT / "cobot" / "robot")]
    subprocess.run([*command, *options, str(source), "-o", str(program)], check=True)
    return program


def test_neon_gives_the_same_bits(tmp_path: Path) -> None:
    """The oracle is the same program on this processor. An emulator runs the one for 64-bit Arm."""
    compiler, emulator = "aarch64-linux-gnu-gcc", shutil.which("qemu-aarch64-static")
    if shutil.which(compiler) is None or emulator is None or shutil.which("gcc") is None:
        pytest.skip("needs gcc-aarch64-linux-gnu, libc6-dev-arm64-cross and qemu-user-static")
    here = subprocess.run([lanes_bits(tmp_path, "gcc"), "plain"], capture_output=True, check=True).stdout
    there = lanes_bits(tmp_path, compiler, "-static")
    assert subprocess.run([emulator, there], capture_output=True, check=True).stdout == here
    hits = [line.split()[0] != b"0" for line in here.splitlines()]
    assert 100 < sum(hits) < len(hits)


@pytest.mark.parametrize("name", ["", "plain", "avx2"])
def test_an_edge_is_free_or_not_as_exact_distances_say(
    robot: RobotDescription, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    random = np.random.default_rng(SEED + 5)
    verdicts = {True: 0, False: 0}
    for kind in scenes.KINDS:
        problem = next(scenes.problems(robot, kind, 1, SEED))
        mj = problem.robot.model.mj
        ways = []
        for instructions in (name, "exact"):
            monkeypatch.setenv(INSTRUCTIONS, instructions)
            ways.append(Clearance(mj, geom_pairs(mj), RESOLUTION_M))
            ways[-1].require(LEAST_M)
            try:
                ways[-1].enclose()
            except ConfigError:
                pytest.skip(f"this processor does not have {name}")
        spheres, exact = ways
        rows = problem.start + random.normal(size=(samples(300), 7)) * random.choice([0.1, 0.5, 1.5], (1, 7))
        assert np.array_equal(spheres.are_free(rows), exact.are_free(rows))
        assert np.array_equal(spheres.are_free(rows), [exact.is_free(row) for row in rows])
        for ends in pairwise(rows[exact.are_free(rows)]):
            found, expected = spheres.is_edge_free(*ends), exact.is_edge_free(*ends)
            verdicts[found] += 1
            if found != expected:  # only within the resolution of the proof
                places = ends[0] + np.linspace(0.0, 1.0, 2000)[:, None] * (ends[1] - ends[0])
                nearest = exact.distances(places, 1.0).min()
                assert LEAST_M - RESOLUTION_M <= nearest < LEAST_M + 1e-5
    assert min(verdicts.values()) > 5 or not ENOUGH, verdicts


def surface(mj: mujoco.MjModel, geom: int, random: np.random.Generator, count: int) -> Array:
    """Extreme points of a convex geom in random directions, in its own frame, and mixtures of them."""
    kind, size = int(mj.geom_type[geom]), mj.geom_size[geom]
    ways = random.normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        points = np.sign(ways) * size
    elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        points = ways * size**2 / np.linalg.norm(ways * size, axis=1)[:, None]
    elif kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(mj.geom_dataid[geom])
        vertices = mj.mesh_vert[mj.mesh_vertadr[mesh] :][: mj.mesh_vertnum[mesh]]
        points = vertices[(ways @ vertices.T).argmax(axis=1)].astype(float)
    else:
        half = size[1] if kind != mujoco.mjtGeom.mjGEOM_SPHERE else 0.0
        across = ways[:, :2] / np.linalg.norm(ways[:, :2], axis=1)[:, None]
        round_ = kind != mujoco.mjtGeom.mjGEOM_CYLINDER
        points = size[0] * (ways if round_ else np.column_stack([across, np.zeros(count)]))
        points[:, 2] += half * np.sign(ways[:, 2])
    weights = random.dirichlet([0.3, 0.3, 0.3], size=count)
    mixed = sum(weights[:, [k]] * points[random.permutation(count)] for k in range(3))
    return np.vstack([points, np.asarray(mixed)])


def test_the_spheres_enclose_each_shape_and_the_inner_ones_lie_within(robot: RobotDescription) -> None:
    random = np.random.default_rng(SEED + 6)
    for mj in (odd_arm(), robot.model.mj):
        for geom in range(mj.ngeom):
            if mj.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
                continue
            tree = tree_around(mj, geom)
            is_leaf = tree[:, 5] == np.arange(len(tree)) + 1
            points = surface(mj, geom, random, 400)
            away = np.linalg.norm(points[:, None] - tree[:, :3], axis=2)
            assert (away[:, is_leaf] <= tree[is_leaf, 3] + 1e-7).any(axis=1).all(), "the leaves enclose it"
            assert (away[:, 0] <= tree[0, 3] + 1e-7).all(), "the first one encloses it"
            # A point outside an inner sphere in the direction of each extreme point: so the sphere is inside.
            ways = random.normal(size=(samples(200), 3))
            ways /= np.linalg.norm(ways, axis=1)[:, None]
            extents = (points @ ways.T).max(axis=0)
            inner = tree[tree[:, 4] > 0.0]
            beyond = inner[:, :3] @ ways.T + inner[:, 4:5] - extents
            assert beyond.max(initial=-1.0) < 0.06 * tree[0, 3], "sampled extents are a little too small"
            exact = int(mj.geom_type[geom]) != mujoco.mjtGeom.mjGEOM_ELLIPSOID
            loss = (tree[is_leaf, 3] - tree[is_leaf, 4])[tree[is_leaf, 4] > 0.0]
            assert not exact or loss.max(initial=0.0) <= LOSS_M + 0.01 * tree[0, 3]


def test_a_body_without_volume_is_enclosed_and_never_hits_for_certain() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.2, 0.0]])
    tree = cover(corners, [(0, 1, 2)], LOSS_M, 0.004)
    leaves = tree[tree[:, 5] == np.arange(len(tree)) + 1]
    points = np.random.default_rng(SEED).dirichlet([0.5, 0.5, 0.5], size=500) @ corners
    away = np.linalg.norm(points[:, None] - leaves[:, :3], axis=2)
    assert (away <= leaves[:, 3]).any(axis=1).all()
    assert tree[:, 4].max() <= 0.0


def test_corners_that_are_not_finite_and_unknown_instructions_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for corners in (np.empty((0, 3)), np.array([[0.0, np.nan, 0.0]])):
        with pytest.raises(ValueError, match="finite corners"):
            cover(corners, [(0,)] if len(corners) else [], LOSS_M, 0.004)
    monkeypatch.setenv(INSTRUCTIONS, "sse9")
    clearance = odd_clearance()
    with pytest.raises(ConfigError, match="COBOT_INSTRUCTIONS is 'sse9', allowed: plain"):
        clearance.are_free(np.zeros((1, clearance.dof)))


@pytest.mark.parametrize("name", ["fr3", "iiwa14"])
def test_mujocos_contacts_are_where_the_spheres_see_them(name: str) -> None:
    """The oracle is MuJoCo's collision pipeline: its own filter of pairs, broad phase and contacts."""
    mj = mujoco.MjModel.from_xml_path(str(ROOT / "config" / f"{name}.xml"))
    mj.geom_margin[:] = mj.pair_margin[:] = LEAST_M
    clearance = Clearance(mj, geom_pairs(mj), RESOLUTION_M)
    clearance.require(LEAST_M)
    random, data = np.random.default_rng(SEED + 7), mujoco.MjData(mj)
    rows = random.uniform(*mj.jnt_range[: clearance.dof].T, (samples(20_000), clearance.dof))
    found = clearance.sphere_verdicts(rows)
    assert found is not None
    hit, _, unsure, _ = found
    nearest = np.full(len(rows), np.inf)
    for place, joints in enumerate(rows):
        data.qpos[: clearance.dof] = joints
        mujoco.mj_kinematics(mj, data)
        mujoco.mj_collision(mj, data)
        nearest[place] = data.contact.dist.min(initial=np.inf)
    assert (nearest[~unsure] >= LEAST_M - 1e-6).all()
    assert (nearest[hit] < LEAST_M + 1e-6).all()
    assert min(hit.sum(), (~unsure).sum()) > 100 or not ENOUGH


def curves(problem: scenes.Problem, random: np.random.Generator, degree: int, count: int) -> list[Array]:
    """Motions of three Bezier curves each, bent by different amounts, around places near a free one."""
    found = []
    for _ in range(samples(count)):
        spread = random.choice([0.02, 0.15, 0.6])
        way = np.cumsum(random.normal(size=(3 * degree + 1, 7)) * spread / degree, axis=0)
        places = problem.start + random.normal(size=7) * random.choice([0.0, 0.4]) + way
        found.append(np.stack([places[degree * k : degree * (k + 1) + 1] for k in range(3)]))
    return found


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_a_motion_is_proven_exactly_as_without_spheres(
    robot: RobotDescription, degree: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The oracles are the exact proof, and exact distances at many places of the motion."""
    random = np.random.default_rng(SEED + 8)
    verdicts = {True: 0, False: 0}
    weights = np.array([comb(degree, k) for k in range(degree + 1)])
    shares = np.linspace(0.0, 1.0, 400)[:, None]
    bernstein = weights * shares ** np.arange(degree + 1) * (1.0 - shares) ** (degree - np.arange(degree + 1))
    for kind in scenes.KINDS:
        problem = next(scenes.problems(robot, kind, 1, SEED))
        mj = problem.robot.model.mj
        spheres = Clearance(mj, geom_pairs(mj), RESOLUTION_M)
        spheres.enclose()
        monkeypatch.setenv(INSTRUCTIONS, "exact")
        exact = Clearance(mj, geom_pairs(mj), RESOLUTION_M)
        exact.enclose()
        monkeypatch.delenv(INSTRUCTIONS)
        for least_m in (LEAST_M, -0.02):
            spheres.require(least_m)
            exact.require(least_m)
            for pieces in curves(problem, random, degree, 60):
                found, expected = spheres.contact(pieces), exact.contact(pieces)
                verdicts[found is None] += 1
                nearest_m = min(exact.distances(bernstein @ piece, 1.0).min() for piece in pieces)
                if found is None:
                    assert expected is None
                    assert nearest_m >= least_m - RESOLUTION_M
                else:
                    piece, share, pair, distance_m = found
                    at = share ** np.arange(degree + 1) * (1.0 - share) ** (degree - np.arange(degree + 1))
                    there = exact.distances((weights * at @ pieces[piece])[None], 1.0)[0, pair]
                    assert distance_m < least_m
                    assert there == pytest.approx(distance_m, abs=1e-6)
                first, expected = spheres.contact(pieces, first=True), exact.contact(pieces, first=True)
                assert (first is None) == (expected is None)
                if first is not None and expected is not None:
                    assert first[:2] == expected[:2]
    assert min(verdicts.values()) > 5 or not ENOUGH, verdicts


def test_pieces_that_the_spheres_prove_are_not_looked_at_again(robot: RobotDescription) -> None:
    """The oracle is the number of configurations that the proof looks at."""
    clearance = Clearance(robot.collision._mj, robot.collision.pairs, RESOLUTION_M)
    clearance.require(LEAST_M)
    pieces = np.linspace(0.0, 0.064, 65)[:, None] * np.ones(7)
    assert clearance.contact(np.stack([pieces[:-1], pieces[1:]], axis=1)) is None
    assert clearance.evaluations < 64, "less than one configuration for each piece"


def test_the_spheres_of_a_mesh_are_kept_without_the_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    """The oracle is the size of the keys by which the spheres are found again."""
    trees, nodes = KeptArrays(10_000_000), KeptArrays(10_000_000)
    monkeypatch.setattr("cobot.robot.enclosing._TREES", trees)
    monkeypatch.setattr("cobot.robot.enclosing._NODES", nodes)
    random = np.random.default_rng(SEED + 9)
    points = 0.05 * random.normal(size=(20_000, 3)).astype(np.float32)
    spec = mujoco.MjSpec()
    spec.add_mesh(name="fine", uservert=points.ravel().tolist())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="fine")
    mj = spec.compile()
    first = nodes_around(mj, 0, np.eye(3), np.zeros(3))
    assert nodes_around(mj, 0, np.eye(3), np.zeros(3)) is first
    assert len(pickle.dumps([*trees._kept, *nodes._kept])) < 1000 < points.nbytes
