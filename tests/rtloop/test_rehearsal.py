"""A planned motion on a simulated robot of its own.

Oracles: the rig of the tests, which runs the same motion by the same cycle as a service would; numpy.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rig import Rig

from cobot.config import Settings
from cobot.errors import PlanningError
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.forecast import evaluate_run
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.scene import Scene, SceneObject
from cobot.trajectory import Trajectory
from cobot.types import PlannerName, Scaling
from rtloop.rehearsal import rehearse

HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0])
THERE = np.array([0.3, 0.4, 0.0, -1.2, 0.0, 1.3, 0.0])


@pytest.fixture(scope="module")
def own(settings: Settings) -> RobotDescription:
    """Whose limits a test may change."""
    return load_robot(settings)


@pytest.fixture(scope="module")
def motion(own: RobotDescription) -> Trajectory:
    made = plan(own, MotionRequest(HOME, THERE, PlannerName.PTP, Scaling(1.0, 1.0)))
    assert made is not None
    return made


def test_it_is_what_the_cycle_does(settings: Settings, own: RobotDescription, motion: Trajectory) -> None:
    shown = Rig(settings, own, simulated=True, start=HOME)
    assert shown.start(motion) == ""
    shown.run()
    state = shown.memory.state.data
    run = rehearse(settings, own, HOME, motion)
    assert run.flaw is None
    np.testing.assert_allclose(run.positions[-1], state["position"], atol=1e-4)
    assert motion.duration_s < run.duration_s < motion.duration_s + 1.0
    assert 0.1 < run.effort.max() < 1.0
    assert run.off_rad.max() < 0.02
    shown.close()


def test_nothing_is_left_of_it_and_the_planners_robot_is_as_it_was(
    settings: Settings, own: RobotDescription, motion: Trajectory
) -> None:
    before = set(Path("/dev/shm").iterdir()), own.model.carried, own.model.gravity_torques(HOME)
    rehearse(settings, own, HOME, motion)
    names = {path.name for path in set(Path("/dev/shm").iterdir()) - before[0]}
    assert not [name for name in names if "rehearsal" in name]
    assert own.model.carried is before[1]
    np.testing.assert_array_equal(own.model.gravity_torques(HOME), before[2])


def test_what_the_drives_cannot_give_is_found_with_time_and_joint(
    settings: Settings, own: RobotDescription, motion: Trajectory
) -> None:
    weak = own.limits.max_effort.copy()
    own.limits.max_effort.flags.writeable = True
    try:
        own.limits.max_effort[1] = 0.8 * np.abs(own.model.gravity_torques(THERE))[1]
        flaw = rehearse(settings, own, HOME, motion).flaw
    finally:
        own.limits.max_effort[:] = weak
    assert flaw is not None
    assert flaw.joint == "joint2"
    assert 0.0 < flaw.time_s < motion.duration_s
    assert "the drive reaches its limit of" in flaw.says


def test_what_the_safety_layer_would_catch_is_found(
    settings: Settings, own: RobotDescription, motion: Trajectory
) -> None:
    """A motion that no planner makes: twice as fast as joint 1 may go."""
    hurried = Trajectory(motion.breakpoints_s / 3.0, motion.coefficients * 3.0 ** np.arange(6))
    flaw = rehearse(settings, own, HOME, hurried).flaw
    assert flaw is not None
    assert "the safety layer intervenes" in flaw.says
    assert flaw.time_s < motion.duration_s


def test_a_motion_that_the_cycle_refuses_is_an_error(
    settings: Settings, own: RobotDescription, motion: Trajectory
) -> None:
    with pytest.raises(
        PlanningError, match=r"the real-time loop rejects this motion: .*position of joint 2, allowed"
    ):
        rehearse(settings, own, THERE, motion)


def test_what_is_touched_is_found(settings: Settings, own: RobotDescription, motion: Trajectory) -> None:
    run = rehearse(settings, own, HOME, motion)
    found = evaluate_run(own, run)
    assert found.flaw is None
    assert found.closest_self is not None
    assert found.closest_environment is not None
    least = own.collision.clearance.distances(run.positions, 1.0).min()
    assert min(found.closest_self.distance_m, found.closest_environment.distance_m) == least
    place = own.model.poses(THERE[None])[0, :3]
    ball = SceneObject("sphere", (0.05,), (*place.tolist(), 1.0, 0.0, 0.0, 0.0))
    try:
        own.collision.surround(Scene(1, {"ball": ball}))
        flaw = evaluate_run(own, run).flaw
    finally:
        own.collision.surround(Scene())
    assert flaw is not None
    assert "ball" in flaw.says
    assert flaw.joint is None
    assert 0.0 < flaw.time_s < run.duration_s
