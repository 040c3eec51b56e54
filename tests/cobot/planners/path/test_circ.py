"""Arcs. Oracle: a circle chosen first, three points taken from it; scipy's slerp for the orientation."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from cobot.errors import PlanningError
from cobot.planners.path.circ import arc
from cobot.types import Pose

SEED = 20261122


def quaternion(turn: Rotation) -> np.ndarray:
    return np.asarray(turn.as_quat(scalar_first=True))


def on_circle(centre: np.ndarray, radius: float, plane: Rotation, angle: float) -> np.ndarray:
    flat = np.array([np.cos(angle), np.sin(angle), 0.0])
    return np.asarray(centre + radius * plane.apply(flat))


def test_a_random_arc_runs_along_its_circle_through_via_to_the_goal() -> None:
    random = np.random.default_rng(SEED)
    for _ in range(300):
        centre, radius = random.uniform(-1.0, 1.0, 3), random.uniform(0.02, 1.0)
        plane = Rotation.random(random_state=int(random.integers(2**31)))
        via_rad, goal_rad = np.sort(random.uniform(0.2, 2 * np.pi - 0.2, 2))
        if goal_rad - via_rad < 0.2:
            continue
        at = partial(on_circle, centre, radius, plane)
        first = Rotation.random(random_state=int(random.integers(2**31)))
        last = first * Rotation.from_rotvec(random.uniform(-1.0, 1.0, 3))
        path = arc(Pose(at(0.0), quaternion(first)), at(via_rad), Pose(at(goal_rad), quaternion(last)))
        assert path.length_m == pytest.approx(radius * goal_rad, rel=1e-6)
        assert path.angle_rad == pytest.approx((last * first.inv()).magnitude(), abs=1e-9)
        turns = Slerp([0.0, 1.0], Rotation.concatenate([first, last]))
        for share in (0.0, 0.3, via_rad / goal_rad, 1.0):
            pose = path.pose_at(share)
            np.testing.assert_allclose(pose.position, at(share * goal_rad), atol=1e-8)
            turned = Rotation.from_quat(pose.quaternion, scalar_first=True)
            assert (turned * turns(share).inv()).magnitude() < 1e-9


@pytest.mark.parametrize(
    ("via", "goal", "sentence"),
    [
        ([0.5, 0.0, 0.0], [1.0, 0.0, 0.0], "on one line; use lin"),
        ([2.0, 0.0, 0.0], [1.0, 0.0, 0.0], "on one line; use lin"),
        ([0.0, 0.0, 0.0005], [1.0, 0.0, 0.0], r"via and the start are 0\.50 mm apart"),
        ([0.5, 0.5, 0.0], [0.0, 0.0, 0.0], r"the goal and the start are 0\.00 mm apart"),
        ([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], "via and the goal are"),
    ],
)
def test_three_points_that_define_no_circle_are_refused(
    via: list[float], goal: list[float], sentence: str
) -> None:
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    with pytest.raises(PlanningError, match=sentence):
        arc(Pose(np.zeros(3), upright), np.array(via), Pose(np.array(goal), upright))
