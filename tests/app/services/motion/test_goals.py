"""Goals in whatever frame they are given. Oracle: products of 4x4 matrices, and SciPy's rotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.services.motion.goals import TOOL, Goals, placed
from cobot.config import Settings
from cobot.errors import InputError
from cobot.motions.requests import NO_START, Arc, MotionRequest
from cobot.robot.description import RobotDescription
from cobot.types import Array, NamedPosition, PlannerName, Pose, Scaling

HALF = Scaling(0.5)


@pytest.fixture
def goals(robot: RobotDescription, settings: Settings) -> Goals:
    return Goals(robot, settings.planning)


def matrix(pose: Pose) -> Array:
    made = np.eye(4)
    made[:3, :3] = Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix()
    made[:3, 3] = pose.position
    return made


def random_pose(random: np.random.Generator) -> Pose:
    quaternion = Rotation.random(rng=random).as_quat(scalar_first=True)
    return Pose(random.uniform(-1.0, 1.0, 3), quaternion)


def test_everything_of_a_goal_is_placed_by_the_frame_that_it_is_given_in() -> None:
    random = np.random.default_rng(11)
    for _ in range(100):
        frame, target, through = (random_pose(random) for _ in range(3))
        via, centre, axis = random.uniform(-1.0, 1.0, (3, 3))
        by, line = matrix(frame), MotionRequest(NO_START, target, PlannerName.LIN, HALF, in_tool=True)
        arc = placed(replace(line, planner=PlannerName.CIRC, via=via), frame)
        about = placed(replace(line, planner=PlannerName.CIRC, arc=Arc(centre, axis)), frame)
        lines = placed(replace(line, planner=PlannerName.POLYLINE, through=(through,)), frame)
        assert isinstance(arc.goal, Pose)
        assert arc.via is not None
        assert about.arc is not None
        assert about.arc.axis is not None
        assert not arc.in_tool
        np.testing.assert_allclose(matrix(arc.goal), by @ matrix(target), atol=1e-12)
        np.testing.assert_allclose(matrix(lines.through[0]), by @ matrix(through), atol=1e-12)
        np.testing.assert_allclose(arc.via, (by @ [*via, 1.0])[:3], atol=1e-12)
        np.testing.assert_allclose(about.arc.centre, (by @ [*centre, 1.0])[:3], atol=1e-12)
        np.testing.assert_allclose(about.arc.axis, by[:3, :3] @ axis, atol=1e-12)


def test_what_is_given_in_the_tool_is_placed_where_the_motion_begins(
    goals: Goals, robot: RobotDescription
) -> None:
    start = np.array(robot.positions["home"].joints)
    ahead = Pose(np.array([0.0, 0.0, 0.1]), np.array([1.0, 0.0, 0.0, 0.0]))
    goal = goals.pose(MotionRequest(NO_START, ahead, PlannerName.LIN, HALF), TOOL)
    assert goal.in_tool
    request = goals.request(goal, start)
    assert isinstance(request.goal, Pose)
    tcp = matrix(robot.model.forward(start))
    np.testing.assert_allclose(request.goal.position, (tcp @ [0.0, 0.0, 0.1, 1.0])[:3], atol=1e-12)


def test_a_frame_that_moves_and_one_that_is_not_there_are_refused_with_the_valid_ones(goals: Goals) -> None:
    with pytest.raises(InputError, match=r"'tcp' moves with the joints; valid names: base_link, tool"):
        goals.frame("tcp")
    with pytest.raises(InputError, match=r"no frame 'nowhere'; valid names: base_link, tool"):
        goals.frame("nowhere")
    assert goals.frame("") is None


def test_a_taught_position_has_a_name_like_those_of_the_srdf(goals: Goals, robot: RobotDescription) -> None:
    with pytest.raises(InputError, match="there is no named position 'shelf'; valid names: home, "):
        goals.named("shelf")
    joints = robot.positions["home"].joints
    goals.taught = {"shelf": NamedPosition("shelf", "taught", joints, "")}
    np.testing.assert_array_equal(goals.named("shelf"), joints)
