"""Inverse kinematics of arms of every kind. Oracles: pinocchio's forward kinematics, and numeric descents."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import arms_in_pinocchio
import numpy as np
import pytest
from arms_in_pinocchio import SomeArm
from sample_counts import samples

from cobot.errors import UnreachableError
from cobot.robot.inverse_kinematics import Arm, Criterion, SixAxisArm, SrsArm, inverse, inverse_all
from cobot.robot.inverse_kinematics.geometry import Axes
from cobot.robot.inverse_kinematics.reach import NEAR_STARTS, NEAR_STEPS, nearest_to, row_of
from cobot.types import Array, JointLimits, Pose

SEED = 20261122
CLOSED = {
    "three parallel axes": (arms_in_pinocchio.universal, SixAxisArm),
    "three parallel axes, one turned back": (arms_in_pinocchio.turned_back, SixAxisArm),
    "spherical wrist": (arms_in_pinocchio.spherical, SixAxisArm),
    "skew wrist": (arms_in_pinocchio.skew_wrist, SixAxisArm),
    "axes that meet": (arms_in_pinocchio.crossing, SixAxisArm),
    "upright axes": (arms_in_pinocchio.stacked, SixAxisArm),
    "s-r-s": (arms_in_pinocchio.srs, SrsArm),
    "s-r-s with a stop at the straight elbow": (arms_in_pinocchio.bent, SrsArm),
}
NUMERIC = {
    "six axes anywhere": (arms_in_pinocchio.general(6), Arm),
    "seven axes anywhere": (arms_in_pinocchio.general(7), Arm),
    "seven axes, offset wrist": (arms_in_pinocchio.offset_wrist, Arm),
    "an arm on two slides": (arms_in_pinocchio.gantry, Arm),
}
KINDS = CLOSED | NUMERIC
SIX_AXIS = [name for name, (_, kind) in CLOSED.items() if kind is SixAxisArm]
SINGULAR = np.array([0.0, 1e-9, -1e-8, 1e-7, 1e-5, 1e-3, np.pi / 2, -np.pi / 2])


def arm_of(name: str, folder: Path, random: np.random.Generator, digits: int = 17) -> SomeArm:
    axes, points, ranges = KINDS[name][0](random)
    return arms_in_pinocchio.made(
        axes, points, ranges, folder, random, (0, 1) if len(axes) == 8 else (), digits
    )


def anywhere(rows: Array, arm: SomeArm, random: np.random.Generator) -> None:
    """As they are drawn."""


def at_limits(rows: Array, arm: SomeArm, random: np.random.Generator) -> None:
    """Some joints, up to all, exactly at a limit."""
    limits = arm.model.limits
    for row in rows:
        chosen = random.random(limits.dof) < random.random()
        row[chosen] = np.where(random.random(limits.dof) < 0.5, limits.min_position, limits.max_position)[
            chosen
        ]


def nearly_singular(rows: Array, arm: SomeArm, random: np.random.Generator) -> None:
    """Some joints, up to all, at angles at which axes align or an elbow is straight, or just beside."""
    limits = arm.model.limits
    for row in rows:
        chosen = random.random(limits.dof) < random.random()
        angles = np.clip(random.choice(SINGULAR, limits.dof), limits.min_position, limits.max_position)
        row[chosen] = angles[chosen]


@pytest.mark.parametrize("postures", [anywhere, at_limits, nearly_singular])
@pytest.mark.parametrize("name", KINDS)
def test_every_pose_of_the_arm_is_solved_within_the_limits(
    name: str,
    postures: Callable[[Array, SomeArm, np.random.Generator], None],
    tmp_path: Path,
) -> None:
    random = np.random.default_rng(SEED)
    arm = arm_of(name, tmp_path, random)
    limits = arm.model.limits
    rows, seeds = arm.drawn(random, samples(150)), arm.drawn(random, samples(150))
    postures(rows, arm, random)
    for joints, seed in zip(rows, seeds, strict=True):
        pose = arm.pose(joints)
        found = inverse(arm.model, pose, seed)
        assert arm.off(found, pose) < 1e-9, joints.tolist()
        assert (limits.min_position <= found).all(), joints.tolist()
        assert (found <= limits.max_position).all(), joints.tolist()


@pytest.mark.parametrize("name", KINDS)
def test_the_geometry_is_recognised_wherever_the_arm_stands(name: str, tmp_path: Path) -> None:
    arm = arm_of(name, tmp_path, np.random.default_rng(SEED + 1))
    assert type(arm.model.inverse_kinematics) is KINDS[name][1]
    assert arm.model.inverse_kinematics.closed_form == (name in CLOSED)


def test_the_shipped_arm_is_s_r_s(robot: object) -> None:
    assert type(robot.model.inverse_kinematics) is SrsArm  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", CLOSED)
def test_a_file_that_rounds_its_numbers_still_has_a_closed_form_and_exact_answers(
    name: str, tmp_path: Path
) -> None:
    random = np.random.default_rng(SEED + 2)
    arm = arm_of(name, tmp_path, random, digits=6)
    assert type(arm.model.inverse_kinematics) is KINDS[name][1]
    for joints, seed in zip(arm.drawn(random, 40), arm.drawn(random, 40), strict=True):
        pose = arm.pose(joints)
        assert arm.off(inverse(arm.model, pose, seed), pose) < 1e-9


def test_an_arm_whose_axes_miss_by_a_millimetre_is_solved_numerically(tmp_path: Path) -> None:
    random = np.random.default_rng(SEED + 3)
    axes, points, ranges = arms_in_pinocchio.spherical(random)
    points[4] = points[4] + np.array([0.0, 0.0, 1e-3])
    arm = arms_in_pinocchio.made(axes, points, ranges, tmp_path, random)
    assert not arm.model.inverse_kinematics.closed_form
    for joints, seed in zip(arm.drawn(random, 20), arm.drawn(random, 20), strict=True):
        pose = arm.pose(joints)
        assert arm.off(inverse(arm.model, pose, seed), pose) < 1e-9


@pytest.mark.parametrize("name", SIX_AXIS)
def test_all_branches_are_those_that_descents_find_and_the_arms_own(name: str, tmp_path: Path) -> None:
    random = np.random.default_rng(SEED + 4)
    arm = arm_of(name, tmp_path, random)
    model, limits = arm.model, arm.model.limits
    axes = Axes(model.chain, model.mj.qpos0)
    numeric = Arm(model.chain, limits, model.mj.qpos0, axes.points[0], axes.reach(), 0.0)
    for joints in arm.drawn(random, samples(15)):
        pose = arm.pose(joints)
        every = inverse_all(model, pose, joints)
        assert all(arm.off(found, pose) < 1e-9 for found in every)
        assert np.abs(every[0] - joints).max() < 1e-6
        row = np.concatenate([pose.position, pose.quaternion])
        for found in numeric.solve_all(row, joints, 0, 24, 1):
            apart = [(found - other) / arms_in_pinocchio.TURN for other in every]
            off = min(np.abs(turns - np.round(turns)).max() for turns in apart)  # up to full turns
            assert off < 1e-6, (joints.tolist(), found.tolist())


def test_a_joint_that_turns_twice_round_stays_in_the_turn_of_the_seed(tmp_path: Path) -> None:
    random = np.random.default_rng(SEED + 5)
    arm = arm_of("three parallel axes", tmp_path, random)
    for seed in arm.drawn(random, 50):
        joints = np.clip(
            seed + random.uniform(-0.02, 0.02, 6), -arms_in_pinocchio.TURN, arms_in_pinocchio.TURN
        )
        found = inverse(arm.model, arm.pose(joints), seed)
        assert np.linalg.norm(found - seed) <= np.linalg.norm(joints - seed) + 1e-9


def test_a_joint_that_would_be_just_beyond_a_full_turn_is_taken_a_turn_back(tmp_path: Path) -> None:
    random = np.random.default_rng(SEED + 5)
    arm = arm_of("three parallel axes", tmp_path, random)
    joints = np.array([1e-7, 0.3, -0.7, -1.1, 0.8, 0.001])
    seed = joints + 6.0 * np.eye(6)[0]
    every = inverse_all(arm.model, arm.pose(joints), seed)
    assert min(np.abs(found - joints).max() for found in every) < 1e-8


def test_the_limits_are_read_anew_for_each_question(tmp_path: Path) -> None:
    random = np.random.default_rng(SEED + 6)
    arm = arm_of("spherical wrist", tmp_path, random)
    model, limits = arm.model, arm.model.limits
    joints = 0.5 * (limits.min_position + limits.max_position) + 0.1
    pose = arm.pose(joints)
    assert inverse(model, pose, joints) == pytest.approx(joints, abs=1e-9)
    ones = np.ones(6)
    limits.take_over(JointLimits(limits.names, joints - 0.5, joints - 0.01, ones, ones, ones, ones))
    with pytest.raises(UnreachableError, match="within the joints' limits"):
        inverse(model, pose, joints)


@pytest.mark.parametrize("criterion", [Criterion.LIMITS, Criterion.MANIPULABILITY])
@pytest.mark.parametrize("name", ["spherical wrist", "six axes anywhere", "seven axes, offset wrist"])
def test_a_criterion_prefers_what_is_best_by_it(name: str, criterion: Criterion, tmp_path: Path) -> None:
    random = np.random.default_rng(SEED + 7)
    arm = arm_of(name, tmp_path, random)
    model, limits = arm.model, arm.model.limits

    def rated(joints: Array) -> float:
        if criterion is Criterion.MANIPULABILITY:
            jacobian = model.jacobian(joints)
            return float(np.sqrt(np.linalg.det(jacobian @ jacobian.T)))
        room = np.minimum(joints - limits.min_position, limits.max_position - joints)
        return float((room / (limits.max_position - limits.min_position)).min())

    for joints in arm.drawn(random, 8):
        pose = arm.pose(joints)
        best = inverse(model, pose, joints, criterion)
        assert arm.off(best, pose) < 1e-9
        every = inverse_all(model, pose, joints)
        assert rated(best) >= max(rated(other) for other in every) - 1e-9


def test_what_is_far_away_is_out_of_reach_by_a_length_whatever_the_arm(tmp_path: Path) -> None:
    for number, name in enumerate(KINDS):
        if name == "an arm on two slides":
            continue  # whose reach is not bounded by its links
        random = np.random.default_rng(SEED + number)
        arm = arm_of(name, tmp_path, random)
        pose = arm.pose(arm.drawn(random, 1)[0])
        far = type(pose)(pose.position + np.array([0.0, 12.0, 0.0]), pose.quaternion)
        with pytest.raises(UnreachableError, match=r"out of reach by [\d.]+ m, and gets as near as"):
            inverse(arm.model, far, arm.drawn(random, 1)[0])


@pytest.mark.parametrize("name", ["spherical wrist", "seven axes, offset wrist", "an arm on two slides"])
def test_joints_are_carried_from_pose_to_pose_until_one_fails(name: str, tmp_path: Path) -> None:
    # Oracle: the descents one by one.
    random, step = np.random.default_rng(SEED + 8), 0.3
    arm = arm_of(name, tmp_path, random)
    model, limits, ended = arm.model, arm.model.limits, 0
    for begin, end in zip(arm.drawn(random, 12), arm.drawn(random, 12), strict=True):
        poses = model.poses(begin + np.linspace(0.05, 1.0, 40)[:, None] * (end - begin))
        found = model.inverse_kinematics.carry(poses, begin, 60, step)
        before = begin
        for pose, joints in zip(poses, found, strict=False):
            expected, solved, _, _ = model.inverse_kinematics.descend(pose, before, 60)
            assert solved
            assert np.array_equal(joints, expected)
            assert np.abs(joints - before).max() <= step
            before = joints
        if len(found) < len(poses):
            joints, solved, _, _ = model.inverse_kinematics.descend(poses[len(found)], before, 60)
            turned = np.abs(joints - before)
            at_limit = (joints <= limits.min_position) | (joints >= limits.max_position)
            assert not solved or turned.max() > step or (at_limit & (turned > 1e-9)).any()
            ended += 1
    assert ended > 0
    assert model.inverse_kinematics.carry(np.empty((0, 7)), begin, 60, step).shape == (0, limits.dof)


def test_a_descent_slides_along_what_it_shall_stay_within(tmp_path: Path) -> None:
    # Oracle: another library's forward kinematics; and without bounds the limits hold as before.
    random, name = np.random.default_rng(SEED + 9), "an arm on two slides"
    arm = arm_of(name, tmp_path, random)
    kinematics, limits, along = arm.model.inverse_kinematics, arm.model.limits, 0
    for seed in arm.drawn(random, 60):
        low = np.maximum(limits.min_position, seed - 0.2)
        high = np.minimum(limits.max_position, seed + 0.2)
        (pose,) = arm.model.poses((seed + random.uniform(-0.5, 0.5, limits.dof)).clip(low, high)[None])
        joints, solved, _, _ = kinematics.descend(pose, seed, 60, within=(low, high))
        assert ((joints >= low) & (joints <= high)).all()
        if solved:
            assert arm.off(joints, Pose(pose[:3], pose[3:])) < 1e-9
            along += bool(((joints == low) | (joints == high)).any())
        several = kinematics.descend_all(pose, np.stack([seed, low, high]), 60, (low, high))
        alone = [kinematics.descend(pose, each, 60, within=(low, high)) for each in (seed, low, high)]
        assert several.tolist() == [each.tolist() for each, is_solved, _, _ in alone if is_solved]
        beyond, _, _, _ = kinematics.descend(pose, limits.max_position + 1.0, 0)
        assert np.array_equal(beyond, limits.max_position)
    assert along > 3


@pytest.mark.parametrize("name", ["s-r-s", "spherical wrist", "seven axes, offset wrist"])
def test_the_nearest_joints_to_a_pose_out_of_reach_are_those_of_the_best_full_descent(
    name: str, tmp_path: Path
) -> None:
    # Oracle: all descents with all steps. Most of those of `nearest_to` end early.
    random, same = np.random.default_rng(SEED + 9), 0
    arm = arm_of(name, tmp_path, random)
    limits, descend = arm.model.limits, arm.model.kinematics(()).descend
    for joints in arm.drawn(random, 10):
        pose = arm.pose(joints)
        far = Pose(pose.position * 1.5, pose.quaternion)
        starts = np.random.default_rng(0).uniform(
            limits.min_position, limits.max_position, (NEAR_STARTS, limits.dof)
        )
        full = min(sum(descend(row_of(far), start, NEAR_STEPS, True)[2:]) for start in (joints, *starts))
        found = nearest_to(arm.model, far, joints)
        same += found.distance_m + found.angle_rad < full + 1e-6
    assert same >= 9
