"""Distances, their gradients and the proof that a motion is free. Oracles: MuJoCo, coal, dense samples."""

from __future__ import annotations

from itertools import combinations

import coal
import mujoco
import numpy as np
import pytest
from odd_arm import by_mujoco, odd_arm
from sample_counts import ENOUGH, samples
from thorough import few

from benchmarks.planning import scenes
from cobot.robot.clearance import Clearance
from cobot.robot.collision import RESOLUTION_M, geom_pairs
from cobot.robot.description import RobotDescription
from cobot.types import Array

SEED = 20261122


def test_distances_of_all_shapes_on_an_odd_arm_are_those_of_mujoco() -> None:
    mj = odd_arm()
    pairs = [pair for pair in combinations(range(mj.ngeom), 2) if pair[1] > 2]
    clearance = Clearance(mj, pairs, RESOLUTION_M)
    rows = np.random.default_rng(SEED).uniform(-1.5, 1.5, (200, mj.nq))
    found = clearance.distances(rows, 5.0)
    for joints, distances in zip(rows, found, strict=True):
        expected = by_mujoco(mj, joints, clearance.pairs)
        apart = expected > 1e-4  # MuJoCo's depth of a capsule in a box is not the shortest way out
        assert abs(distances - expected)[apart].max() < 2e-6
        assert (distances[~apart] < 1.01e-4).all()
        capped = clearance.distances(joints[None], 0.1)[0]
        assert abs(capped - np.minimum(distances, 0.1)).max() < 2e-6


def test_capsules_cylinders_and_boxes_are_as_far_apart_and_as_deep_in_each_other_as_coal_says() -> None:
    random = np.random.default_rng(SEED)
    for _ in range(samples(300)):
        place, quaternion, half = (
            random.uniform(-0.3, 0.3, 3),
            random.normal(size=4),
            random.uniform(0.03, 0.3, 3),
        )
        radius, length = random.uniform(0.02, 0.1), random.uniform(0.01, 0.2)
        quaternion /= np.linalg.norm(quaternion)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, quaternion)
        at = coal.Transform3s(turn.reshape(3, 3), place)
        shapes = {
            ("box", "capsule"): (coal.Box(*(2.0 * half)), coal.Capsule(radius, 2.0 * length)),
            ("cylinder", "capsule"): (
                coal.Cylinder(half[0], 2.0 * half[1]),
                coal.Capsule(radius, 2.0 * length),
            ),
            ("box", "sphere"): (coal.Box(*(2.0 * half)), coal.Sphere(radius)),
        }
        for (standing, moving), (first, second) in shapes.items():
            size = " ".join(map(str, half if standing == "box" else half[:2]))
            mj = mujoco.MjModel.from_xml_string(
                f'<mujoco><worldbody><geom type="{standing}" size="{size}"/><body pos="{_text(place)}" '
                f'quat="{_text(quaternion)}"><joint/><geom type="{moving}" size="{radius} {length}"/></body>'
                "</worldbody></mujoco>"
            )
            clearance = Clearance(mj, [(0, 1)], RESOLUTION_M)
            result = coal.DistanceResult()
            expected = coal.distance(first, coal.Transform3s(), second, at, coal.DistanceRequest(), result)
            assert clearance.distances(np.zeros((1, 1)), 5.0)[0, 0] == pytest.approx(expected, abs=2e-5)


def _text(values: Array) -> str:
    return " ".join(map(str, values))


def test_a_gradient_is_how_the_distance_changes(robot: RobotDescription) -> None:
    shipped = robot.model.mj
    for mj in (odd_arm(), scenes.among(robot, [(0.5, 0.1, 0.3, 0.1, 0.2, 0.05)]).model.mj):
        pairs = (
            geom_pairs(mj) if mj.ngeom > shipped.ngeom else [(0, 3), (1, 3), (2, 3), (1, 4), (3, 5), (5, 7)]
        )
        clearance = Clearance(mj, pairs, RESOLUTION_M)
        good = total = 0
        for joints in np.random.default_rng(SEED).uniform(-1.0, 1.0, (30, mj.nq)):
            steps = 1e-6 * np.eye(mj.nq)
            ahead, behind = (clearance.distances(joints + sign * steps, 1e3) for sign in (1.0, -1.0))
            for pair in range(clearance.count):
                distance_m, slope = clearance.gradient(joints, pair)
                assert distance_m == pytest.approx(clearance.distances(joints[None], 1e3)[0, pair], abs=1e-9)
                total += 1
                good += bool(abs(slope - (ahead - behind)[:, pair] / 2e-6).max() < 1e-3)
        # Not where the nearest feature changes, and as far as MuJoCo's iteration resolves the difference.
        assert good > 0.97 * total, (good, total)


@pytest.mark.parametrize("kind", few(scenes.KINDS))
def test_dense_samples_find_nothing_on_motions_that_are_proven_free(
    robot: RobotDescription, kind: str
) -> None:
    """The adversary looks a hundred times as finely as the proof, and knows nothing of it."""
    problem = next(scenes.problems(robot, kind, 1, seed=SEED))
    clearance, margin_m = problem.robot.collision.clearance, robot.collision.margin_m
    random = np.random.default_rng(SEED)
    verdicts = {True: 0, False: 0}
    for _ in range(samples(60)):
        ends = problem.start + random.uniform(-0.5, 0.5, (2, 7)) * random.choice([0.1, 1.0])
        curve = ends[0] + np.linspace(0.0, 1.0, 6)[:, None] * (ends[1] - ends[0])
        curve[1:-1] += random.uniform(-0.3, 0.3, (4, 7))
        shares = np.linspace(0.0, 1.0, 400)[:, None]
        straight = ends[0] + shares * (ends[1] - ends[0])
        bent = curve[None].repeat(400, axis=0)
        for level in range(5):
            bent[:, : 5 - level] += shares[:, :, None] * (bent[:, 1 : 6 - level] - bent[:, : 5 - level])
        for rows, found in (
            (straight, clearance.contact(ends[None])),
            (bent[:, 0], clearance.contact(curve[None], first=True)),
        ):
            distances = clearance.distances(rows, 1.0)
            verdicts[found is None] += 1
            if found is None:
                assert distances.min() >= margin_m - RESOLUTION_M
            else:
                assert found[3] < margin_m
        if found is not None:  # the first place, in the ordered search
            before = distances[: int(399 * found[1])]
            assert before.min(initial=1.0) >= margin_m - RESOLUTION_M
    assert min(verdicts.values()) >= samples(10) or not ENOUGH, verdicts


def test_a_slide_and_a_branch_are_bounded_too() -> None:
    mj = odd_arm()
    pairs = [pair for pair in combinations(range(mj.ngeom), 2) if pair[1] > 2]
    clearance = Clearance(mj, pairs, RESOLUTION_M)
    random = np.random.default_rng(SEED)
    proven = 0
    for _ in range(samples(400)):
        ends = random.uniform(-1.0, 1.0, (2, mj.nq))
        rows = ends[0] + np.linspace(0.0, 1.0, 100)[:, None] * (ends[1] - ends[0])
        nearest_m = clearance.distances(rows, 5.0).min(axis=0)
        pair, missed = int(random.integers(clearance.count)), bool(random.random() < 0.8)
        least_m = np.full(clearance.count, -10.0)
        least_m[pair] = nearest_m[pair] + (random.uniform(2.0, 20.0) * RESOLUTION_M if missed else -0.01)
        clearance.require(least_m)
        is_free = clearance.contact(ends[None]) is None
        assert not (is_free and missed), (clearance.pairs[pair], least_m[pair])
        proven += is_free
    assert proven > samples(40) or not ENOUGH


def test_what_is_not_finite_or_of_another_shape_is_refused(robot: RobotDescription) -> None:
    clearance = robot.collision.clearance
    with pytest.raises(ValueError, match="not finite"):
        clearance.is_free(np.full(7, np.nan))
    with pytest.raises(ValueError, match="not finite"):
        clearance.contact(np.full((1, 2, 7), np.inf))
    with pytest.raises(ValueError, match="pieces of shape"):
        clearance.contact(np.zeros((1, 7, 7)))
    assert clearance.contact(np.zeros((0, 2, 7))) is None
    assert len(clearance.distances(np.zeros((0, 7)), 1.0)) == 0
