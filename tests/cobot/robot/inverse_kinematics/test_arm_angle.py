"""The redundancy of S-R-S arms. Oracles: numeric descents, and a fine grid of arm angles."""

from __future__ import annotations

from pathlib import Path

import arms_in_pinocchio
import numpy as np
import pytest
from sample_counts import samples

from cobot.errors import InputError
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import Arm, Criterion, SrsArm, inverse, inverse_all
from cobot.robot.inverse_kinematics.geometry import Axes
from cobot.robot.model import RobotModel
from cobot.types import Array, Pose

SEED = 20261123
ANGLES = np.linspace(-np.pi, np.pi, 360, endpoint=False)


@pytest.fixture(params=["shipped", "askew", "bent"])
def model(request: pytest.FixtureRequest, robot: RobotDescription, tmp_path: Path) -> RobotModel:
    if request.param == "shipped":
        return robot.model
    random = np.random.default_rng(SEED)
    geometry = arms_in_pinocchio.srs if request.param == "askew" else arms_in_pinocchio.bent
    axes, points, ranges = geometry(random)
    return arms_in_pinocchio.made(axes, points, ranges, tmp_path, random).model


def arm_of(model: RobotModel) -> SrsArm:
    assert model.inverse_kinematics.arm_angle is not None
    return model.inverse_kinematics.arm_angle


def drawn(model: RobotModel, count: int, seed: int = SEED) -> Array:
    limits = model.limits
    return np.random.default_rng(seed).uniform(limits.min_position, limits.max_position, (count, 7))


def posed(model: RobotModel, joints: Array) -> tuple[Array, Pose]:
    row = model.poses(joints[None])[0]
    return row, Pose(row[:3], row[3:])


def holds(intervals: Array, angle: float, slack: float = 1e-7) -> bool:
    return any(
        begin - slack <= angle + turn <= end + slack
        for begin, end in intervals
        for turn in (-2 * np.pi, 0.0, 2 * np.pi)
    )


def test_joints_have_an_angle_and_a_branch_that_give_them_back(model: RobotModel) -> None:
    arm = arm_of(model)
    for joints in drawn(model, samples(100)):
        angle, branch = arm.of(joints)
        row, _ = posed(model, joints)
        assert arm.joints(row, angle, branch) == pytest.approx(joints, abs=1e-7)
        assert holds(arm.intervals(row, branch), angle)


def test_what_descents_find_is_on_a_branch_and_in_its_intervals(model: RobotModel) -> None:
    arm, axes = arm_of(model), Axes(model.chain, model.mj.qpos0)
    numeric = Arm(model.chain, model.limits, model.mj.qpos0, axes.points[0], axes.reach(), 0.0)
    for joints in drawn(model, samples(10)):
        row, _ = posed(model, joints)
        for found in numeric.solve_all(row, joints, 0, 12, 3):
            angle, branch = arm.of(found)
            assert holds(arm.intervals(row, branch), angle), found.tolist()
            assert arm.joints(row, angle, branch) == pytest.approx(found, abs=1e-5)


def test_the_intervals_are_exact(model: RobotModel) -> None:
    arm, limits = arm_of(model), model.limits
    for joints in drawn(model, samples(12), SEED + 1):
        row, _ = posed(model, joints)
        grid = arm.grid(row[None], ANGLES)[0]
        for branch in range(arm.BRANCHES):
            intervals = arm.intervals(row, branch)
            inside = [holds(intervals, angle, 0.0) for angle in ANGLES]
            assert inside == (~np.isnan(grid[:, branch, 0])).tolist()
            for begin, end in intervals:
                assert -np.pi <= begin < np.pi
                assert begin <= end <= begin + 2 * np.pi + 1e-12
                if end - begin > 2 * np.pi - 1e-9 or branch_of(model) == "askew":
                    continue
                for angle in (begin, end):
                    stop = arm.joints(row, angle, branch)
                    assert stop is not None
                    room = np.minimum(stop - limits.min_position, limits.max_position - stop)
                    assert room[[0, 1, 2, 4, 5, 6]].min() < 1e-6


def branch_of(model: RobotModel) -> str:
    """Of axes that are not at right angles a shoulder or a wrist cannot turn further at some arm angles."""
    axes = Axes(model.chain, model.mj.qpos0).directions
    square = all(abs(axes[i] @ axes[i + 1]) < 1e-9 for i in (0, 1, 4, 5))
    return "square" if square else "askew"


def test_the_grid_is_at_the_poses(model: RobotModel) -> None:
    rows = model.poses(drawn(model, 5))
    grid = arm_of(model).grid(rows, ANGLES[::20])
    for row, joints in zip(rows, grid, strict=True):
        found = joints.reshape(-1, 7)
        found = found[~np.isnan(found[:, 0])]
        poses = model.poses(found)
        assert np.abs(poses[:, :3] - row[:3]).max() < 1e-9
        assert (1.0 - np.abs(poses[:, 3:] @ row[3:])).max() < 1e-15
    assert arm_of(model).grid(np.zeros((0, 7)), ANGLES).shape == (0, 360, 8, 7)


def test_the_grid_has_the_joints_of_each_arm_angle(model: RobotModel) -> None:
    """Oracle: one arm angle at a time, which does not look for the intervals of feasible ones."""
    arm, angles = arm_of(model), np.append(ANGLES[::7], [-3.0, 4.0, 0.1])
    for row in model.poses(drawn(model, 3)):
        for branch, nodes in zip((5, 2), arm.grid(row[None], angles, [5, 2])[0].swapaxes(0, 1), strict=True):
            for angle, node in zip(angles, nodes, strict=True):
                joints = arm.joints(row, float(angle), branch)
                assert np.array_equal(node, np.full(7, np.nan) if joints is None else joints, equal_nan=True)


@pytest.mark.parametrize(("window", "step_rad"), [(3, 0.3), (20, 0.8), (400, 7.0)])
def test_the_nodes_that_lead_on_are_those_that_steps_reach(
    model: RobotModel, window: int, step_rad: float
) -> None:
    """Oracle: the whole grid, searched place by place in numpy."""
    arm, angles = arm_of(model), ANGLES[::3]
    apart = np.abs(np.subtract.outer(np.arange(len(angles)), np.arange(len(angles))))
    near = np.minimum(apart, len(angles) - apart) <= window
    reached = []
    for start in drawn(model, samples(8)):
        end = start + 0.3 * np.random.default_rng(SEED).normal(size=7)
        poses = model.poses(np.linspace(start, end, 9)[1:])
        branch = arm.of(start)[1]
        nodes = arm.grid(poses, angles, [branch])[:, :, 0]
        before, may = start[None], np.ones((len(angles), 1), bool)
        for row in nodes:
            steps = np.abs(row[:, None] - before).max(axis=2) <= step_rad
            row[~(steps & may).any(axis=1)] = np.nan
            before, may = row, near
        found = arm.leading_on(poses, angles, start, branch, window, step_rad)
        np.testing.assert_allclose(found, nodes, atol=1e-7)
        reached.append(int((~np.isnan(nodes[:, :, 0])).any(axis=1).sum()))
    assert max(reached) > 0


def test_the_angle_moves_smoothly_through_a_straight_elbow_and_over_the_shoulder(
    robot: RobotDescription,
) -> None:
    arm = arm_of(robot.model)
    for begin, end in (
        ([0.3, 0.5, -0.4, 0.6, 0.2, 0.7, 0.1], [0.3, 0.5, -0.4, -0.6, 0.2, 0.7, 0.1]),
        ([0.0, -0.5, 0.2, 0.3, 0.2, 0.7, 0.1], [0.4, 0.5, -0.2, 0.2, 0.2, 0.7, 0.1]),
    ):
        shares = np.linspace(0.0, 1.0, 400)[:, None]
        rows = np.array(begin) + shares * (np.array(end) - np.array(begin))
        angles = np.unwrap([arm.of(row)[0] for row in rows])
        assert np.abs(np.diff(angles)).max() < 0.05


@pytest.mark.parametrize("criterion", [Criterion.NEAREST, Criterion.LIMITS, Criterion.MANIPULABILITY])
def test_the_best_is_no_worse_than_any_of_a_fine_grid(model: RobotModel, criterion: Criterion) -> None:
    arm, limits = arm_of(model), model.limits
    middle = 0.5 * (limits.min_position + limits.max_position)

    def against(rows: Array, seed: Array) -> Array:
        if criterion is Criterion.NEAREST:
            return np.asarray(np.linalg.norm(rows - seed, axis=1))
        if criterion is Criterion.LIMITS:
            return np.abs((rows - middle) / (limits.max_position - middle)).max(axis=1)
        return np.array([-arm.manipulability(row) for row in rows])

    worse = 0
    rows, seeds = drawn(model, samples(25)), drawn(model, samples(25), SEED + 9)
    for joints, seed in zip(rows, seeds, strict=True):
        row, pose = posed(model, joints)
        step = 8 if criterion is Criterion.MANIPULABILITY else 1
        grid = arm.grid(row[None], ANGLES[::step]).reshape(-1, 7)
        best = against(grid[~np.isnan(grid[:, 0])], seed).min()
        found = against(inverse(model, pose, seed, criterion)[None], seed)[0]
        worse += found > best + 1e-3 * abs(best)
    assert worse <= 0.04 * len(rows)  # a lesser minimum beside the best one


def beside_aligned_axes(model: RobotModel, count: int, seed: int) -> Array:
    random, limits = np.random.default_rng(seed), model.limits
    rows = drawn(model, count, seed + 1)
    for joints in rows:
        chosen = random.choice([1, 3, 5], random.integers(1, 4), replace=False)
        joints[chosen] = np.clip(
            random.choice([0.0, 1e-9, 1e-7, 1e-6, -1e-4, 1e-3, -0.05], len(chosen)),
            limits.min_position[chosen],
            limits.max_position[chosen],
        )
    return rows


def test_beside_aligned_axes_the_nearest_is_no_further_than_the_joints_that_made_the_pose(
    model: RobotModel,
) -> None:
    # There some joints race along the arm angle, and a grid of angles steps over the nearest solution.
    # Beside a straight elbow, and a nanoradian from where axes align, rounding decides which ones there are.
    random, limits, further = np.random.default_rng(SEED + 11), model.limits, 0
    for joints in beside_aligned_axes(model, samples(300), SEED + 11):
        step = random.choice([1e-6, 1e-4, 1e-2]) * random.normal(size=7)
        seed = np.clip(joints + step, limits.min_position, limits.max_position)
        away = np.linalg.norm(inverse(model, posed(model, joints)[1], seed) - seed)
        least = np.linalg.norm(joints - seed)
        if arm_of(model).is_vague(joints) or (joints[[1, 5]] == 1e-9).any():
            assert away <= 3.0 * least + 0.02, joints.tolist()
            further += away > 1.01 * least + 1e-6
        else:
            assert away <= least + 1e-6, joints.tolist()
    assert further <= 0.03 * samples(300)


def test_of_all_joints_that_lead_to_a_pose_beside_aligned_axes_the_nearest_are_found(
    model: RobotModel,
) -> None:
    # Also from seeds that have nothing to do with the pose. Oracle: the exhaustive search below. With a
    # straight elbow besides, rounding decides which of them are at the pose.
    rows = beside_aligned_axes(model, samples(40), SEED + 21)
    for joints, seed in zip(rows, drawn(model, samples(40), SEED + 23), strict=True):
        if arm_of(model).is_vague(joints):
            continue
        _, pose = posed(model, joints)
        row = np.concatenate([pose.position, pose.quaternion])
        away = np.linalg.norm(inverse(model, pose, seed) - seed)
        assert away <= least_distance(arm_of(model), row, seed) + 1e-6, (joints.tolist(), seed.tolist())


def least_distance(arm: SrsArm, row: Array, seed: Array) -> float:
    """Of the joints at all arm angles of all branches from a seed, rad, by an exhaustive search: a grid that
    is made finer until no joint turns by more than 0.05 rad between two angles, and then where it is lowest.
    """
    least = np.inf
    for branch in range(arm.BRANCHES):
        for begin, end in arm.intervals(row, branch):
            angles = np.linspace(begin, end, 200)
            angles = np.sort(np.append(angles, [begin + 1e-11, end - 1e-11]))
            joints = arm.grid(row[None], angles, only=[branch])[0, :, 0]
            while True:
                turns = np.abs(np.diff(joints, axis=0))
                turns = np.nan_to_num(np.minimum(turns, 2.0 * np.pi - turns), nan=1.0).max(axis=1)
                coarse = np.flatnonzero((turns > 0.05) & (np.diff(angles) > 1e-12))
                if len(coarse) == 0 or len(angles) > 4000:
                    break
                between = 0.5 * (angles[coarse + 1] + angles[coarse])
                found = arm.grid(row[None], between, only=[branch])[0, :, 0]
                angles = np.insert(angles, coarse + 1, between)
                joints = np.insert(joints, coarse + 1, found, axis=0)
            away = np.nan_to_num(np.linalg.norm(joints - seed, axis=1), nan=np.inf)
            for place in np.flatnonzero(away < min(least, away.min()) + 0.1):
                around = away[max(place - 1, 0) : place + 2]
                if away[place] == around.min():
                    low, high = angles[max(place - 1, 0)], angles[min(place + 1, len(angles) - 1)]
                    least = min(least, lowest(arm, row, seed, branch, low, high), away[place])
    return float(least)


def lowest(arm: SrsArm, row: Array, seed: Array, branch: int, low: float, high: float) -> float:
    """The least distance between two arm angles, by ever finer grids."""
    least = np.inf
    for _ in range(4):
        angles = np.linspace(low, high, 41)
        away = np.linalg.norm(arm.grid(row[None], angles, only=[branch])[0, :, 0] - seed, axis=1)
        if np.isnan(away).all():
            break
        place = int(np.nanargmin(away))
        least = min(least, float(away[place]))
        low, high = angles[max(place - 1, 0)], angles[min(place + 1, 40)]
    return least


def test_the_clearest_of_all_is_taken_where_clearance_is_asked_for(robot: RobotDescription) -> None:
    model = robot.model
    _, pose = posed(model, np.array(robot.positions["home"].joints))

    def elbow_to_the_left(joints: Array) -> float:
        return float(joints[0])

    seed = np.zeros(7)
    best = inverse(model, pose, seed, Criterion.CLEARANCE, elbow_to_the_left)
    every = inverse_all(model, pose, seed, spread=4)
    assert best[0] >= max(joints[0] for joints in every)
    with pytest.raises(InputError, match="needs a function"):
        inverse(model, pose, seed, Criterion.CLEARANCE)


def test_spread_solutions_are_apart_within_the_limits_and_the_nearest_come_first(model: RobotModel) -> None:
    limits = model.limits
    for joints in drawn(model, 5):
        row, pose = posed(model, joints)
        every = np.array(inverse_all(model, pose, joints, spread=6))
        assert np.abs(model.poses(every)[:, :3] - row[:3]).max() < 1e-9
        assert ((every >= limits.min_position) & (every <= limits.max_position)).all()
        away = np.linalg.norm(every - joints, axis=1)
        assert (np.diff(away) >= 0.0).all()
        assert away[0] < 1e-6


def test_a_branch_that_does_not_exist_is_refused(robot: RobotDescription) -> None:
    arm = arm_of(robot.model)
    row = robot.model.poses(np.full((1, 7), 0.3))[0]
    for branch in (-1, 8):
        with pytest.raises(InputError, match="from 0 to 7"):
            arm.joints(row, 0.0, branch)
        with pytest.raises(InputError, match="from 0 to 7"):
            arm.intervals(row, branch)


def test_a_pose_that_the_elbow_does_not_reach_has_no_arm_angle(robot: RobotDescription) -> None:
    arm = arm_of(robot.model)
    row = np.array([0.0, 0.0, 3.0, 0.0, 1.0, 0.0, 0.0])
    assert all(len(arm.intervals(row, branch)) == 0 for branch in range(8))
    assert arm.joints(row, 0.0, 0) is None
    # The tool points down: the wrist is 0.126 m above it, the shoulder at 0.36 m, the arm 0.82 m long.
    assert arm.gap(row) == pytest.approx(3.0 + 0.126 - 0.36 - 0.82, abs=1e-9)
