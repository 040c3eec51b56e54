"""Streams of torques and forces through an overlay of the cabinet's motion, in the real cycle.

Oracle: the simulated cabinet's arm, whose drives are its own dynamics.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from fri_stream import FriStream

from cobot.config import Settings
from cobot.ipc.layout import Stream
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode
from rtloop.backends.fri.codec import decode_command
from rtloop.backends.fri.messages import CommandMessage
from rtloop.streaming.overlay import MAX_WRENCH

STIFF = {"stiffness": 0.0, "cartesian_stiffness": 0.0}


class Overlaid(FriStream):
    """With what its cabinet was sent, and where that has brought its arm."""

    @property
    def sent(self) -> CommandMessage:
        command = decode_command(self.channel.answers[-1])
        assert isinstance(command, CommandMessage)
        return command

    @property
    def position(self) -> np.ndarray:
        return self.channel.controller.arm.measured.position.copy()


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription, request: pytest.FixtureRequest) -> Iterator[Overlaid]:
    made = Overlaid(settings, robot, request.param)
    yield made
    made.close()


def stream(rig: Overlaid, seconds: float, **target: object) -> None:
    """The same target again and again."""
    for _ in range(round(seconds / 0.05)):
        rig.aim(**target)
        rig.step(10)
    assert rig.channel.controller.motions == 1, rig.channel.controller.events


@pytest.mark.parametrize("rig", ["torque"], indirect=True)
def test_a_stream_of_torques_moves_the_arm_and_its_end_stops_it(rig: Overlaid) -> None:
    start = rig.position
    assert rig.stream(Stream.JOINT_TORQUE, **STIFF) == ""
    assert rig.mode is LoopMode.JOINT_TORQUE
    stream(rig, 0.5, joints=[4.0, 0, 0, 0, 0, 0, 0])
    assert rig.mode is LoopMode.JOINT_TORQUE, rig.reason
    assert rig.sent.torque == pytest.approx([4.0, 0, 0, 0, 0, 0, 0])
    assert rig.position[0] - start[0] > 0.02
    rig.end_stream()
    rig.step(400)
    assert rig.mode is LoopMode.HOLD, rig.reason
    assert rig.sent.torque == (0.0,) * 7
    rest = rig.position
    rig.step(50)
    np.testing.assert_allclose(rig.position, rest, atol=1e-4)


@pytest.mark.parametrize("rig", ["torque"], indirect=True)
def test_torques_rise_and_fall_without_a_jump_and_never_beyond_the_drives(rig: Overlaid) -> None:
    assert rig.stream(Stream.JOINT_TORQUE, **STIFF) == ""
    rig.channel.answers.clear()
    stream(rig, 0.2, joints=[1e6, 0, 0, 0, 0, 0, 0])
    rig.end_stream()
    rig.step(200)
    sent = [decode_command(each) for each in rig.channel.answers]
    torque = np.array([each.torque for each in sent if isinstance(each, CommandMessage)])[:, 0]
    most = rig.limits.max_effort[0]
    assert torque.max() == pytest.approx(most)
    assert np.abs(np.diff(torque)).max() == pytest.approx(most * 0.005 / 0.1)


@pytest.mark.parametrize("rig", ["wrench"], indirect=True)
@pytest.mark.parametrize("turned", [False, True])
def test_force_control_presses_along_its_axes_alone(rig: Overlaid, turned: bool) -> None:
    """In a frame that is turned by a quarter about z: its x is the base's y."""
    half = 0.5**0.5
    frame = [0.0, 0, 0, half, 0, 0, half] if turned else [0.0, 0, 0, 1, 0, 0, 0]
    axes = [1.0, 0, 0, 0, 0, 0] if turned else [0.0, 1, 0, 0, 0, 0]
    pose = rig.robot.model.forward(rig.loop.controller.safety.position)
    start = rig.robot.model.forward(rig.position).position
    assert rig.stream(Stream.CARTESIAN, force_axes=axes, force_frame=frame, **STIFF) == ""
    here = [*pose.position, *pose.quaternion]
    force = [20.0, 0, 0, 0, 0, 0] if turned else [0.0, 20.0, 50.0, 0, 0, 0]
    stream(rig, 1.0, pose=here, wrench=force)
    assert rig.mode is LoopMode.CARTESIAN, rig.reason
    assert rig.sent.wrench == pytest.approx([0.0, 20.0, 0, 0, 0, 0], abs=1e-9)
    moved = rig.robot.model.forward(rig.position).position - start
    assert moved[1] > 0.002
    stream(rig, 0.2, pose=here, wrench=[1e6] * 6)
    assert max(rig.sent.wrench) <= MAX_WRENCH[0]
    rig.end_stream()
    rig.step(300)
    assert rig.sent.wrench == (0.0,) * 6


@pytest.mark.parametrize("rig", ["position", "wrench", "torque"], indirect=True)
def test_what_the_overlay_does_not_take_is_refused_with_what_it_can(
    rig: Overlaid, request: pytest.FixtureRequest
) -> None:
    overlay = request.node.callspec.params["rig"]
    able = {
        "position": "has inputs and outputs",
        "torque": "has torque control",
        "wrench": "has wrench control",
    }
    said = f"which the backend fri does not have; it {able[overlay]}"
    if overlay != "torque":
        refusal = rig.stream(Stream.JOINT_TORQUE, **STIFF)
        assert "a stream of torques needs torque control" in refusal
        assert said in refusal
    if overlay != "wrench":
        refusal = rig.stream(Stream.CARTESIAN, force_axes=1.0, **STIFF)
        assert "force control needs impedance control or wrench control" in refusal
    refusal = rig.stream(max_contact_wrench=5.0, **STIFF)
    assert "max_contact_wrench needs wrench, which the backend fri does not measure" in refusal
    assert rig.stream(max_contact_torque=50.0, **STIFF) == ""
