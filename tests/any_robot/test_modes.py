"""Every streaming and servo mode on four arms that `cobot new-robot` makes, see `arm_kinds`; on virtual time.

Oracles: closed forms for what is streamed; pinocchio's kinematics of the given URDF; numpy's finite
differences of all that was commanded, against the limits.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from converted_arms import Made
from rig import Loopback, Rig
from servo_bench import Bench, runner

from benchmarks.stress.judge import Judge
from cobot.ipc.layout import Interpolation, Stream
from cobot.types import LoopMode
from rtloop.backends.mujoco import MujocoBackend

STEP_S = 1 / 30


@pytest.fixture
def quick_rig(made: Made) -> Iterator[Rig]:
    """With the backend that is always where it is told to be."""
    rig = Rig(made.settings, made.arm.robot, start=made.ready)
    yield rig
    rig.close()


def soft(backend: Loopback | MujocoBackend) -> dict[str, object]:
    """Springs that it can have."""
    return {
        "stiffness": 0.5 * backend.nominal_stiffness,
        "cartesian_stiffness": 0.5 * backend.nominal_cartesian_stiffness,
    }


def require_rest(rig: Rig) -> None:
    rig.end_stream()
    rig.run()
    assert rig.mode is LoopMode.HOLD, rig.reason
    require_limits(rig)


def require_limits(rig: Rig) -> None:
    limits = rig.limits
    for share in rig.rates():
        assert share.max() <= 1.011
    rows = np.array(rig.commanded)
    assert ((rows >= limits.min_position) & (rows <= limits.max_position)).all()


def test_a_stream_of_joints_is_followed(made: Made, own_rig: Rig) -> None:
    rig = own_rig
    assert rig.stream(interpolation=Interpolation.QUINTIC, **soft(rig.simulation)) == ""
    size = np.where(made.slides, 0.03, 0.1)
    for cycle in range(1500):
        if cycle % 10 == 0:
            rig.aim(joints=made.ready + size * (1.0 - np.cos(np.pi * cycle / 1500)))
        rig.step()
    np.testing.assert_allclose(rig.commanded[-1], made.ready + 2.0 * size, atol=2e-3)
    assert rig.counted() == {}
    require_rest(rig)


def test_a_stream_of_poses_is_followed(made: Made, own_rig: Rig) -> None:
    rig, judge = own_rig, Judge(made.arm, made.arm.robot)
    assert rig.stream(Stream.CARTESIAN, interpolation=Interpolation.QUINTIC, **soft(rig.simulation)) == ""
    begin = made.pose(0.0, 0.0, 0.0)
    for cycle in range(1500):
        if cycle % 10 == 0:
            share = 0.5 * (1.0 - np.cos(np.pi * cycle / 1500))
            place = begin.position + share * np.array([0.04, -0.06, -0.05])
            rig.aim(pose=np.array([*place, *begin.quaternion]))
        rig.step()
    rig.step(200)
    assert judge.off(rig.commanded[-1], made.pose(0.04, -0.06, -0.05)) < 1e-3
    require_rest(rig)


def test_servo_points_bring_the_arm_to_the_last_of_them(made: Made, own_rig: Rig) -> None:
    goal, pose = made.moved(0.1, 0.03), made.pose(0.03, -0.03, -0.03)

    async def test(bench: Bench) -> None:
        own_rig.describe(0.5 * own_rig.simulation.nominal_stiffness)
        bench.set_mode(1, send_period=0.02)
        await bench.active()
        for number in range(60):
            joints = made.ready + (goal - made.ready) * min(1.0, number / 40)
            bench.point(joints, time=0.02, lookahead_time=0.1, gain=200.0, point_type="joint")
            await bench.cycles(20)
        for number in range(60, 0, -1):
            joints = made.ready + (goal - made.ready) * min(1.0, max(0, number - 20) / 40)
            bench.point(joints, time=0.02, lookahead_time=0.1, gain=200.0, point_type="joint")
            await bench.cycles(20)
        for number in range(60):
            share = min(1.0, number / 40)
            here = made.pose(0.03 * share, -0.03 * share, -0.03 * share)
            rz, ry, rx = here.abc
            values = [*here.position, rx, ry, rz]
            bench.point(values, point_type="cartesian", time=0.02)
            await bench.cycles(20)
        await bench.cycles(200)
        values = bench.servo.feedback()
        bench.stop()
        assert (values["points_accepted"], values["points_refused"]) == (180, 0), values
        await bench.idle()

    runner(own_rig, made.arm.robot, made.settings)(test)
    assert Judge(made.arm, made.arm.robot).off(own_rig.commanded[-1], pose) < 2e-3
    furthest = np.abs(np.array(own_rig.commanded) - goal).max(axis=1).min()
    assert furthest < 3e-3
    require_limits(own_rig)


@pytest.mark.parametrize("kind", Interpolation)
def test_every_interpolation_follows_a_slow_stream_within_the_limits(
    made: Made, quick_rig: Rig, kind: Interpolation
) -> None:
    rig, size = quick_rig, np.where(made.slides, 0.03, 0.1)
    assert rig.stream(interpolation=kind, decimation=33, **soft(rig.loopback)) == ""
    for cycle in range(1500):
        if cycle % 33 == 0:
            rig.aim(joints=made.ready + size * (1.0 - np.cos(np.pi * cycle / 1500)))
        rig.step()
    rig.step(400)
    np.testing.assert_allclose(rig.commanded[-1], made.ready + 2.0 * size, atol=2e-3)
    require_rest(rig)


def test_chunks_are_played_on_time(made: Made, quick_rig: Rig) -> None:
    rig, size = quick_rig, np.where(made.slides, 0.02, 0.06)
    assert rig.stream(**soft(rig.loopback)) == ""
    begin_s = float(rig.memory.state.data["robot_time_s"])

    def policy(times_s: np.ndarray) -> np.ndarray:
        phase = np.pi * np.maximum(times_s, 0.0)[:, None]
        return made.ready + size * (phase - np.sin(phase))

    chunk = rig.memory.chunk.data
    for sent in range(4):
        times_s = (np.arange(18) + 15 * sent + 1) * STEP_S
        chunk["session"], chunk["count"] = rig.memory.session.data["number"], len(times_s)
        chunk["number"] += 1
        chunk["times_s"][: len(times_s)] = begin_s + times_s
        chunk["points"][: len(times_s), : rig.limits.dof] = policy(times_s)
        rig.memory.chunk.publish()
        rig.step(500)
    cycles = np.arange(len(rig.commanded) - 2000, len(rig.commanded))
    beside = np.abs(np.array(rig.commanded)[cycles] - policy((np.arange(2000) + 1) * 1e-3))
    assert beside.max() < 2e-3
    assert rig.counted() == {}
    require_rest(rig)


def test_a_move_of_the_tcp_follows_a_line_and_ends_at_its_pose(made: Made, quick_rig: Rig) -> None:
    rig, judge = quick_rig, Judge(made.arm, made.arm.robot)
    assert rig.stream(Stream.CARTESIAN, **soft(rig.loopback)) == ""
    goal = made.pose(0.04, -0.05, -0.05, 0.2)
    rig.aim(move=1, move_pose=np.array([*goal.position, *goal.quaternion]), move_duration_s=2.0)
    rig.step(2500)
    assert not rig.loop.controller.streaming.move_running
    assert judge.off(rig.commanded[-1], goal) < 1e-3
    begin, way = made.pose(0.0, 0.0, 0.0).position, np.array([0.04, -0.05, -0.05])
    places = np.array([judge.tcp(joints)[0] for joints in rig.commanded[::50]]) - begin
    beside = places - np.outer(places @ way / (way @ way), way)
    assert np.linalg.norm(beside, axis=1).max() < 1e-3
    require_rest(rig)


def test_a_streamed_torque_moves_its_joint_and_a_stop_holds_the_arm(made: Made, own_rig: Rig) -> None:
    rig = own_rig
    assert rig.stream(Stream.JOINT_TORQUE, **soft(rig.simulation)) == ""
    last = rig.limits.dof - 1
    torque = np.zeros(rig.limits.dof)
    torque[last] = 0.02 * rig.limits.max_effort[last]
    for _ in range(300):
        rig.aim(joints=torque)
        rig.step()
    assert rig.mode is LoopMode.JOINT_TORQUE, rig.reason
    assert rig.memory.state.data["velocity"][last] > 0.0
    assert rig.memory.state.data["position"][last] > made.ready[last] + 1e-3
    rig.request()
    rig.run()
    assert rig.mode is LoopMode.HOLD, rig.reason
    require_limits(rig)


@pytest.mark.parametrize("mode", range(1, 8))
def test_every_servo_mode_brings_the_arm_to_the_last_point(made: Made, quick_rig: Rig, mode: int) -> None:
    goal = made.moved(0.1, 0.03)

    async def test(bench: Bench) -> None:
        quick_rig.describe(0.5 * quick_rig.loopback.nominal_stiffness)
        bench.set_mode(mode, send_period=0.02)
        await bench.active()
        for number in range(40):
            share = min(1.0, max(0.0, (number - 5) / 25))
            point = made.ready + share * (goal - made.ready)
            bench.point(point, time=0.02, lookahead_time=0.1, gain=200.0, point_type="joint")
            await bench.cycles(20)
        await bench.cycles(200)
        values = bench.servo.feedback()
        bench.stop()
        assert (values["points_accepted"], values["points_refused"]) == (40, 0), values
        await bench.idle()

    runner(quick_rig, made.arm.robot, made.settings)(test)
    np.testing.assert_allclose(quick_rig.commanded[-1], goal, atol=3e-3)
    require_limits(quick_rig)
