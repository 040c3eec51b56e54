"""Lines of the FR3, for which no arm angle is defined.

Oracle: the straight line, by the forward kinematics of the planned motion.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from franka_settings import franka_settings

from cobot.errors import UnreachableError
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.path.joint_path import MAX_DEVIATION_M
from cobot.planners.path.null_space import FEW, FINER, MANY, Particles
from cobot.robot.description import RobotDescription, load_robot
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

Searches = list[tuple[int, int, Particles]]


@pytest.fixture(scope="module")
def fr3() -> RobotDescription:
    return load_robot(franka_settings())


@pytest.fixture
def searches(monkeypatch: pytest.MonkeyPatch) -> Searches:
    """Number of configurations and factor of each search, and the search."""
    made: Searches = []

    class Noted(Particles):
        def __init__(self, robot: RobotDescription, start: Array, path: Any, *how: Any) -> None:
            super().__init__(robot, start, path, *how)
            made.append((how[0], how[1], self))

    monkeypatch.setattr("cobot.planners.path.cartesian.Particles", Noted)
    return made


def lin(robot: RobotDescription, start: Array, place: Array) -> Trajectory:
    goal = Pose(place, robot.model.forward(start).quaternion)
    motion = plan(robot, MotionRequest(start, goal, PlannerName.LIN, Scaling(1.0)))
    assert motion is not None
    return motion


@pytest.mark.parametrize(
    ("start", "place", "how"),
    [
        ((0.91, 0.66, 1.65, -0.39, 2.29, 2.36, 2.0), (0.2, 0.38, 0.8), (FEW, FINER)),
        ((2.14, -0.44, 1.37, -1.84, -1.68, 2.89, -0.6), (-0.24, -0.31, 0.66), (MANY, 1)),
    ],
)
def test_a_line_that_the_first_search_does_not_find_is_found_by_the_one_that_goes_on(
    fr3: RobotDescription,
    searches: Searches,
    start: tuple[float, ...],
    place: tuple[float, ...],
    how: tuple[int, int],
) -> None:
    motion = lin(fr3, np.array(start), np.array(place))
    assert [each[:2] for each in searches] == [(FEW, 1), how]
    at = fr3.model.poses(motion.sample(np.linspace(0.0, motion.duration_s, 50)))[:, :3]
    begin, way = at[0], np.array(place) - at[0]
    beside = np.cross(at - begin, way) / np.linalg.norm(way)
    assert np.linalg.norm(beside, axis=1).max() <= MAX_DEVIATION_M
    np.testing.assert_allclose(at[-1], place, atol=1e-6)


@pytest.mark.parametrize("way", [(0.35, 0.0, 0.2), (0.0, 0.0, 0.4)])
def test_a_line_that_no_joints_follow_is_searched_once(
    fr3: RobotDescription, searches: Searches, way: tuple[float, ...]
) -> None:
    """The refusal says to the quarter of a place how far joints lead."""
    start = np.array(fr3.positions["home"].joints)
    with pytest.raises(UnreachableError, match=r"reaches beyond \d+ % of the path$") as caught:
        lin(fr3, start, fr3.model.forward(start).position + way)
    ((count, factor, search),) = searches
    assert (count, factor) == (FEW, 1)
    reached = next(each.value for each in caught.value.findings if each.check == "redundancy")
    finest = np.linspace(0.0, 1.0, FINER * (len(search.shares) - 1) + 1)
    assert reached == pytest.approx(finest[finest <= reached + 1e-9].max())
    assert 0.7 < reached < 0.9
