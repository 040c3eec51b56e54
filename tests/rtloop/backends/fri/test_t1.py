"""Streams and servo sessions by hand: the TCP keeps the reduced speed, whatever is asked for.

Oracles: the cabinet's own reflex, which ends the motion of a TCP that is faster than 0.25 m/s in T1, and
finite differences of where MuJoCo has the TCP in all that was sent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from fri_stream import PERIOD_S, FriStream
from paced_arm import PacedArm
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.robot.description import RobotDescription
from cobot.types import Array, LoopMode
from rtloop.backends.fri.messages import OperationMode

RIGID = {"stiffness": 0.0, "cartesian_stiffness": 0.0, "decimation": 2}
SIDE = np.array([0.5, 0.4, 0.3, 0.5, -0.4, -0.5, 0.6])


class ByHand(FriStream):
    """Its cabinet is in T1."""

    def __init__(self, settings: Settings, robot: RobotDescription, overlay: str = "position") -> None:
        super().__init__(settings, robot, overlay, OperationMode.T1)
        self.commanded.clear()

    def speed_m_s(self) -> float:
        """The greatest one of the TCP."""
        model = self.robot.model.mj
        data = mujoco.MjData(model)
        places = []
        for joints in self.commanded:
            data.qpos[:7] = joints
            mujoco.mj_kinematics(model, data)
            places.append(data.site(self.settings.robot.tcp).xpos.copy())
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).max() / PERIOD_S)

    def went_by_hand(self, least_rad: float = 0.1) -> None:
        """It moved, and neither the cabinet nor the oracle found it too fast."""
        assert self.channel.controller.motions == 1, self.channel.controller.events
        assert self.speed_m_s() < 0.25
        assert np.abs(np.array(self.commanded) - self.commanded[0]).max() > least_rad


@pytest.fixture
def make(settings: Settings, robot: RobotDescription) -> Iterator[Callable[[str], ByHand]]:
    made: list[ByHand] = []

    def one(overlay: str) -> ByHand:
        made.append(ByHand(settings, robot, overlay))
        return made[-1]

    yield one
    for each in made:
        each.close()


@pytest.fixture
def rig(make: Callable[[str], ByHand]) -> ByHand:
    return make("position")


def swung(time_s: float, rate: float = 3.0) -> Array:
    """Faster than permitted, by some tens."""
    return SIDE * np.sin(rate * time_s)


@pytest.mark.parametrize("kind", [Interpolation.LINEAR, Interpolation.QUINTIC, Interpolation.RUCKIG])
def test_a_stream_of_joints_keeps_the_reduced_speed(rig: ByHand, kind: Interpolation) -> None:
    assert rig.stream(interpolation=kind, **RIGID) == ""
    for cycle in range(400):
        if cycle % 2 == 0:
            rig.aim(joints=rig.home + swung(cycle * PERIOD_S))
        rig.step()
    assert rig.mode is LoopMode.JOINT_IMPEDANCE, rig.reason
    rig.end_stream()
    rig.run()
    rig.went_by_hand(0.05)


@pytest.mark.parametrize("kind", [Interpolation.LINEAR, Interpolation.RUCKIG])
def test_a_stream_of_poses_keeps_it_and_comes_near_it(rig: ByHand, kind: Interpolation) -> None:
    assert rig.stream(Stream.CARTESIAN, interpolation=kind, **RIGID) == ""
    begin = np.zeros(7)
    rig.robot.model.forward_into(rig.home, begin)
    for cycle in range(500):
        pose = begin.copy()
        pose[1] += 0.35 * np.sin(2.0 * cycle * PERIOD_S)  # up to 0.7 m/s
        if cycle % 2 == 0:
            rig.aim(pose=pose)
        rig.step()
    assert rig.mode is LoopMode.CARTESIAN, rig.reason
    rig.end_stream()
    rig.run()
    rig.went_by_hand()
    assert rig.speed_m_s() > 0.15


@pytest.mark.parametrize(
    "mode", [ServoMode.REPLANNED, ServoMode.DIRECT, ServoMode.BUFFERED, ServoMode.THROUGH]
)
def test_a_servo_session_keeps_it(rig: ByHand, mode: ServoMode) -> None:
    assert rig.stream(servo_mode=mode, watchdog_s=0.5, **RIGID) == ""
    head = rig.memory.point_head.data
    for cycle in range(400):
        if cycle % 2 == 0:
            head["session"], head["number"] = rig.memory.session.data["number"], cycle // 2 + 1
            block = rig.memory.points[(cycle // 2 + 1) % len(rig.memory.points)]
            block.data["number"], block.data["time_s"] = cycle // 2 + 1, 2 * PERIOD_S
            block.data["lookahead_s"], block.data["gain"] = 0.0, 0.0
            block.data["joints"] = rig.home + swung(cycle * PERIOD_S)
            block.publish()
            rig.memory.point_head.publish()
        rig.step()
    rig.end_stream()
    rig.run()
    rig.went_by_hand(0.03)


def test_poses_beside_a_force_axis_keep_it(make: Callable[[str], ByHand]) -> None:
    rig = make("wrench")
    axis = [0, 0, 1, 0, 0, 0]
    assert rig.stream(Stream.CARTESIAN, force_axes=axis, **RIGID) == ""
    begin = np.zeros(7)
    rig.robot.model.forward_into(rig.home, begin)
    for cycle in range(300):
        pose = begin.copy()
        pose[1] += 0.35 * np.sin(2.0 * cycle * PERIOD_S)
        if cycle % 2 == 0:
            rig.aim(pose=pose, wrench=[0, 0, -40.0, 0, 0, 0])
        rig.step()
    assert rig.mode is LoopMode.CARTESIAN, rig.reason
    rig.went_by_hand()


def test_streamed_torques_keep_it(make: Callable[[str], ByHand]) -> None:
    rig = make("torque")
    assert rig.stream(Stream.JOINT_TORQUE, **RIGID) == ""
    for _ in range(200):
        rig.aim(joints=[40.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        rig.step(2)
    assert rig.mode is LoopMode.JOINT_TORQUE, rig.reason
    rig.went_by_hand(0.05)


def test_a_session_that_was_begun_at_full_speed_ends_when_the_key_is_turned(
    settings: Settings, robot: RobotDescription
) -> None:
    """A device that goes on meanwhile."""
    arm = PacedArm(settings, robot.limits)
    rig = Rig(settings, robot, backend=arm)
    try:
        assert rig.stream(**RIGID) == ""
        rig.step(250)
        assert rig.mode is LoopMode.JOINT_IMPEDANCE
        arm.report = replace(arm.report, operation_mode="T1", speed_scaling=0.1)
        rig.step(300)
        assert rig.mode is LoopMode.HOLD
        assert rig.reason.startswith("the robot has been switched to T1: ")
        assert rig.stream(**RIGID) == ""
        for _ in range(100):
            rig.aim(joints=rig.home + 0.5)
            rig.step(10)
        assert rig.rates()[0].max() <= 0.1 * (1 + 1e-6)
        arm.report = replace(arm.report, speed_scaling=0.0)
        rig.step(400)
        assert rig.mode is LoopMode.HOLD
        assert rig.stream(**RIGID) == (
            "the robot is in T1 and permits 0 of its speed, a stream needs 0.01 or more"
        )
    finally:
        rig.close()
