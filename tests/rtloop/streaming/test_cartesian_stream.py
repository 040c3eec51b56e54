"""Poses and wrenches, streamed to the simulated arm on the virtual clock.

Oracles: scipy's rotations and closed forms for where the TCP shall be.
"""

from __future__ import annotations

import numpy as np
import pytest
from rig import Rig
from scipy.spatial.transform import Rotation, Slerp

from cobot.ipc.layout import Interpolation, Stream
from cobot.types import Array, LoopMode


def tcp(rig: Rig, joints: Array) -> Array:
    pose = np.zeros(7)
    rig.robot.model.forward_into(joints, pose)
    return pose


def commanded_tcp(rig: Rig) -> Array:
    return np.array([tcp(rig, joints) for joints in rig.commanded])


def require_limits(rig: Rig) -> None:
    for share in rig.rates():
        assert share.max() <= 1.011


def test_a_stream_of_poses_is_followed(rig: Rig) -> None:
    assert rig.stream(Stream.CARTESIAN, interpolation=Interpolation.QUINTIC) == ""
    assert rig.mode is LoopMode.CARTESIAN
    begin = tcp(rig, rig.home)
    wanted = []
    for cycle in range(3000):
        phase = np.pi * cycle * 1e-3
        pose = begin.copy()
        pose[1] += 0.05 * np.sin(phase) * (1 - np.exp(-cycle / 300)) ** 3
        pose[2] += 0.03 * (1 - np.cos(phase))
        if cycle % 10 == 0:
            rig.aim(pose=pose)
        wanted.append(pose)
        rig.step()
    got = commanded_tcp(rig)[-3000:]
    late = np.abs(got[10:, :3] - np.array(wanted)[:-10, :3])
    assert late[500:].max() < 2e-3
    turn = (
        Rotation.from_quat(got[:, 3:], scalar_first=True)
        * Rotation.from_quat(begin[3:], scalar_first=True).inv()
    )
    assert turn.magnitude().max() < 1e-3
    require_limits(rig)


def test_a_move_follows_line_and_slerp_and_ends_at_rest(rig: Rig) -> None:
    assert rig.stream(Stream.CARTESIAN) == ""
    begin = tcp(rig, rig.home)
    goal = begin.copy()
    goal[:3] += [0.05, -0.1, 0.08]
    goal[3:] = (
        Rotation.from_rotvec([0.2, 0.1, -0.3]) * Rotation.from_quat(begin[3:], scalar_first=True)
    ).as_quat(scalar_first=True)
    rig.aim(move=1, move_pose=goal, move_duration_s=3.0)
    rig.step(10)
    assert rig.loop.controller.streaming.move_running
    rig.aim(pose=begin)  # ignored while it moves
    for _ in range(4000):
        rig.step()
        if not rig.loop.controller.streaming.move_running:
            break
    assert 2900 < len(rig.commanded) < 3200
    got = commanded_tcp(rig)
    np.testing.assert_allclose(got[-1, :3], goal[:3], atol=1e-5)
    way = goal[:3] - begin[:3]
    share = np.clip((got[:, :3] - begin[:3]) @ way / (way @ way), 0.0, 1.0)
    off_line = np.linalg.norm(got[:, :3] - begin[:3] - share[:, None] * way, axis=1)
    assert off_line.max() < 1e-4
    slerp = Slerp([0.0, 1.0], Rotation.from_quat([begin[3:], goal[3:]], scalar_first=True))
    off_turn = (slerp(share).inv() * Rotation.from_quat(got[:, 3:], scalar_first=True)).magnitude()
    assert off_turn.max() < 2e-3
    times = np.linspace(0.0, 1.0, 3000)
    expected = 10 * times**3 - 15 * times**4 + 6 * times**5
    np.testing.assert_allclose(share[1000:2500], expected[1000:2500], atol=0.01)
    require_limits(rig)


def test_a_cancelled_move_comes_to_rest_where_it_is_and_the_stream_goes_on(rig: Rig) -> None:
    assert rig.stream(Stream.CARTESIAN) == ""
    begin = tcp(rig, rig.home)
    goal = begin.copy()
    goal[1] += 0.2
    rig.aim(move=1, move_pose=goal, move_duration_s=2.0)
    rig.step(1000)
    rig.aim(cancel=1)
    rig.step(500)
    assert not rig.loop.controller.streaming.move_running
    held = tcp(rig, rig.commanded[-1])
    assert 0.08 < held[1] - begin[1] < 0.16
    np.testing.assert_array_equal(rig.commanded[-1], rig.commanded[-50])
    held_on = held.copy()
    held_on[1] += 0.005
    rig.aim(pose=held_on)
    rig.step(300)
    assert tcp(rig, rig.commanded[-1])[1] == pytest.approx(held[1] + 0.005, abs=1e-4)
    require_limits(rig)


def test_a_move_that_is_too_fast_takes_longer(rig: Rig) -> None:
    assert rig.stream(Stream.CARTESIAN) == ""
    begin = tcp(rig, rig.home)
    goal = begin.copy()
    goal[1] += 0.25
    rig.aim(move=1, move_pose=goal, move_duration_s=0.05)
    rig.step(3000)
    got = commanded_tcp(rig)
    speed = np.linalg.norm(np.diff(got[:, :3], axis=0), axis=1) / 1e-3
    assert speed.max() <= 1.02 * rig.settings.streaming.linear_velocity
    np.testing.assert_allclose(got[-1, :3], goal[:3], atol=1e-4)
    require_limits(rig)


def test_the_same_move_again_goes_on_instead_of_starting_over(rig: Rig) -> None:
    assert rig.stream(Stream.CARTESIAN) == ""
    goal = tcp(rig, rig.home)
    goal[1] += 0.1
    for number in range(1, 20):
        rig.aim(move=number, move_pose=goal, move_duration_s=2.0)
        rig.step(100)
    rig.step(200)
    assert not rig.loop.controller.streaming.move_running
    assert tcp(rig, rig.commanded[-1])[1] == pytest.approx(goal[1], abs=1e-5)


@pytest.mark.parametrize("poison", [np.nan, np.inf])
@pytest.mark.parametrize("field", ["pose", "wrench"])
def test_a_pose_or_wrench_that_is_no_number_latches_an_estop(rig: Rig, poison: float, field: str) -> None:
    assert rig.stream(Stream.CARTESIAN) == ""
    rig.aim(pose=tcp(rig, rig.home))
    rig.step(20)
    rig.memory.setpoint.data[field][2] = poison
    rig.aim()
    rig.step(20)
    rig.run()
    assert rig.mode is LoopMode.ESTOP


def test_a_pose_out_of_reach_is_approached_and_breaks_no_limit(rig: Rig) -> None:
    assert rig.stream(Stream.CARTESIAN) == ""
    pose = tcp(rig, rig.home)
    for cycle in range(6000):
        if cycle % 10 == 0:
            pose[0] += 0.004
            rig.aim(pose=pose)
        rig.step()
    assert rig.mode is LoopMode.CARTESIAN
    require_limits(rig)


def test_streaming_into_the_floor_slows_down_and_holds_above_it(rig: Rig) -> None:
    assert rig.stream(Stream.CARTESIAN, interpolation=Interpolation.QUINTIC) == ""
    pose = tcp(rig, rig.home)
    for cycle in range(6000):
        if cycle % 10 == 0 and pose[2] > -0.3:
            pose[2] -= 0.002
            rig.aim(pose=pose)
        rig.step()
    counted = rig.counted()
    assert counted["PROXIMITY"] >= 1
    assert counted["COLLISION"] >= 1
    lowest = commanded_tcp(rig)[:, 2].min()
    assert lowest > 0.01
    assert rig.robot.collision.is_free(rig.commanded[-1])
    require_limits(rig)
    for _ in range(200):
        pose[2] = min(pose[2] + 0.004, 0.3)
        here = tcp(rig, rig.commanded[-1])
        rig.aim(pose=np.array([*here[:2], here[2] + 0.002, *here[3:]]))
        rig.step(10)
    assert tcp(rig, rig.commanded[-1])[2] > lowest + 0.05


def test_the_elbow_goes_where_the_posture_wants_it_and_the_tcp_stays(rig: Rig) -> None:
    model = rig.robot.model
    wanted = rig.home.copy()
    for _ in range(300):  # along the null space, by 0.3 rad of joint 3 or so
        null = np.linalg.svd(model.jacobian(wanted))[2][-1]
        wanted += 1e-3 * null * np.sign(null[2])
    assert rig.stream(Stream.CARTESIAN, posture=wanted) == ""
    begin = tcp(rig, rig.home)
    for cycle in range(8000):
        if cycle % 100 == 0:
            rig.aim(pose=begin)
        rig.step()
    poses = commanded_tcp(rig)
    assert np.abs(poses[:, :3] - begin[:3]).max() < 1e-4
    apart = np.abs(wanted - rig.home).max()
    assert np.abs(rig.commanded[-1] - wanted).max() < 0.2 * apart
    assert rig.counted() == {}
    require_limits(rig)


def test_a_move_begins_at_once_however_rare_the_targets_are(rig: Rig) -> None:
    assert rig.stream(Stream.CARTESIAN, decimation=1000) == ""
    goal = tcp(rig, rig.home)
    goal[1] += 0.1
    rig.step(5)
    rig.aim(move=1, move_pose=goal, move_duration_s=2.0)
    rig.step(100)
    assert rig.loop.controller.streaming.move_running
    rig.aim(cancel=1)
    rig.step(2)
    assert not rig.loop.controller.streaming.move_running


def test_no_stream_of_poses_moves_the_tcp_faster_than_its_limit(rig: Rig) -> None:
    """A line at 0.4 m/s that leads the wrist close to a singularity, where the joints cannot follow."""
    assert rig.stream(Stream.CARTESIAN, decimation=10) == ""
    pose = tcp(rig, rig.home)
    for cycle in range(2500):
        if cycle % 10 == 0 and cycle < 1500:
            pose[0] += 0.004 if cycle < 800 else -0.004
            rig.aim(pose=pose)
        rig.step()
    speed = np.linalg.norm(np.diff(commanded_tcp(rig)[:, :3], axis=0), axis=1) / 1e-3
    assert speed.max() <= 1.1 * rig.settings.streaming.linear_velocity
    require_limits(rig)
