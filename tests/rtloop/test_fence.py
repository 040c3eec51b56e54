"""The fence of a motion. The oracle is MuJoCo, which is asked where the TCP is and how fast."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from rig import Rig

from cobot.ipc.layout import Command, MotionResult
from cobot.motions.fence import Fence
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, LoopMode, PlannerName, Scaling
from rtloop.planned.path import Path

EVERYWHERE = Fence((-5.0, -5.0, -5.0), (5.0, 5.0, 5.0), 100.0)
UP_TO_M, UP_TO_RAD = 1e-3, 1.01
"""What rtloop lets pass of places, m, and as a factor of speeds."""


def planned(robot: RobotDescription, start: Array, goal: Array) -> Trajectory:
    motion = plan(robot, MotionRequest(start, goal, PlannerName.PTP, Scaling(speed=1.0)))
    assert motion is not None
    return motion


@pytest.fixture
def there(rig: Rig, robot: RobotDescription) -> Trajectory:
    """Joint 1 turns by a quarter: the TCP goes from the x axis to the y axis."""
    start = np.array(robot.positions["home"].joints)
    goal = start.copy()
    goal[0] += np.pi / 2
    return planned(robot, start, goal)


def places(robot: RobotDescription, rig: Rig) -> tuple[Array, Array]:
    """Of the TCP in each cycle so far, shape (n, 3), m, and its speeds between them, m/s."""
    mj = robot.model.mj
    data = mujoco.MjData(mj)
    found = []
    for joints in rig.commanded:
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        found.append(data.site_xpos[robot.model.tcp_site].copy())
    return np.array(found), np.linalg.norm(np.diff(found, axis=0), axis=1) / rig.settings.rt.period_s


def test_a_motion_within_its_fence_is_bit_for_bit_as_without(rig: Rig, there: Trajectory) -> None:
    rig.start(there, fence=EVERYWHERE)
    begun = len(rig.commanded)
    rig.run()
    assert rig.loop.controller.motion_result is MotionResult.ARRIVED
    path = Path(len(there.coefficients), there.dof)
    path.breakpoints_s[: there.segments + 1] = there.breakpoints_s
    path.coefficients[: there.segments] = there.coefficients
    path.begin(there.segments)
    rows = np.zeros((3, there.dof))
    for time_s, found in zip(rig.path_times[begun:], rig.commanded[begun:], strict=True):
        path.evaluate(time_s, 1.0, 0.0, rows)
        assert np.array_equal(found, rows[0])


def test_an_arm_comes_to_rest_before_it_leaves_the_box(
    rig: Rig, robot: RobotDescription, there: Trajectory
) -> None:
    high = 0.3
    assert rig.start(there, fence=replace(EVERYWHERE, high=(5.0, high, 5.0))) == ""
    rig.run()
    controller = rig.loop.controller
    assert controller.motion_result is MotionResult.STOPPED
    assert controller.mode is LoopMode.HOLD
    assert controller.reason.startswith("the motion would leave its fence: the TCP would be at y = 0.3")
    assert controller.reason.endswith("m, but the fence is from -5 to 0.3 m")
    found, _ = places(robot, rig)
    assert 0.1 < found[:, 1].max() <= high + UP_TO_M


def test_an_arm_that_would_be_too_fast_is_stopped(
    rig: Rig, robot: RobotDescription, there: Trajectory
) -> None:
    rig.start(there, fence=replace(EVERYWHERE, speed_m_s=0.2))
    rig.run()
    assert "the fence permits 0.2 m/s" in rig.loop.controller.reason
    _, speeds = places(robot, rig)
    assert 0.0 < speeds.max() <= 0.2 * UP_TO_RAD


def test_the_next_motion_has_no_fence_of_the_last_one(
    rig: Rig, robot: RobotDescription, there: Trajectory
) -> None:
    rig.start(there, fence=replace(EVERYWHERE, speed_m_s=0.2))
    rig.run()
    rest = rig.loop.controller.safety.position.copy()
    assert rig.start(planned(robot, rest, there.start)) == ""
    rig.run()
    assert rig.loop.controller.motion_result is MotionResult.ARRIVED


@pytest.mark.parametrize("hole", range(7))
def test_half_a_fence_is_refused(rig: Rig, there: Trajectory, hole: int) -> None:
    slot = rig.memory.slots[0]
    slot.write(1, there, EVERYWHERE)
    slot.head.data["fence"][hole] = np.nan
    slot.head.publish()
    answer = rig.answer(rig.send(Command.START, slot=0, motion_id=1))
    assert answer == "the motion's fence is not complete"
    assert rig.loop.controller.mode is LoopMode.HOLD


def test_the_service_finds_what_rtloop_would_stop(robot: RobotDescription, there: Trajectory) -> None:
    chain = robot.model.chain
    assert EVERYWHERE.breach(there, chain) == ""
    box = replace(EVERYWHERE, high=(5.0, 0.3, 5.0))
    assert "into the motion the TCP would be at y = 0.3" in box.breach(there, chain)
    assert "m/s, but the fence permits 0.2 m/s" in replace(EVERYWHERE, speed_m_s=0.2).breach(there, chain)
