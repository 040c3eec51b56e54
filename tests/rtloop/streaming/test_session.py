"""A streaming session, stepped on the virtual clock: what is followed, what is refused, what ends it.

Oracle: numpy's finite differences of all that was commanded, against joint_limits.yaml and the streaming
section; closed forms for what arrives where.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from rig import Loopback, Rig

from cobot.ipc.layout import Command, Interpolation, Stream
from cobot.types import Array, LoopMode
from rtloop.backends import ImpedanceControlled

COMMAND_TIMEOUT_CYCLES = 500


@pytest.fixture
def stream(rig: Rig) -> Rig:
    """A session of joint targets, taken every 10 ms."""
    assert rig.stream() == ""
    return rig


def wave(rig: Rig, cycle: int, size_rad: float = 0.2) -> Array:
    """Smooth, from rest, at 0.5 Hz: some 0.3 rad/s at the most on each joint."""
    target = rig.home.copy()
    target += size_rad * (1.0 - np.cos(np.pi * cycle * 1e-3)) / 2.0
    return target


def feed(rig: Rig, cycles: int, every: int = 10, begin: int = 0) -> None:
    for cycle in range(begin, begin + cycles):
        if cycle % every == 0:
            rig.aim(joints=wave(rig, cycle))
        rig.step()


def require_limits(rig: Rig) -> None:
    """No rate of what was commanded exceeds the robot's limits by more than the safety layer's 1 %."""
    for share in rig.rates():
        assert share.max() <= 1.011


def test_a_stream_is_followed_and_its_end_leaves_the_arm_at_rest(stream: Rig) -> None:
    assert stream.mode is LoopMode.JOINT_IMPEDANCE
    feed(stream, 2000)
    np.testing.assert_allclose(stream.commanded[-1], wave(stream, 1990), atol=5e-3)
    stream.end_stream()
    stream.run()
    assert stream.mode is LoopMode.HOLD
    assert stream.reason == "the client has ended the session"
    assert stream.loop.controller.streaming.session == 0
    assert stream.loopback.impedance is None
    require_limits(stream)


@pytest.mark.parametrize("kind", Interpolation)
@pytest.mark.parametrize("rate_hz", [10, 30, 100])
def test_every_interpolation_keeps_the_limits_at_every_rate(
    rig: Rig, kind: Interpolation, rate_hz: int
) -> None:
    every = round(1000 / rate_hz)
    assert rig.stream(interpolation=kind, decimation=every) == ""
    feed(rig, 2000, every)
    rig.step(600)
    np.testing.assert_allclose(rig.commanded[-1], wave(rig, 2000 - every), atol=2e-2)
    require_limits(rig)
    section = rig.settings.streaming
    velocity = np.abs(np.diff(np.array(rig.commanded), axis=0)) / 1e-3
    assert velocity.max() <= 1.011 * section.joint_velocity
    assert set(rig.counted()) <= {"VELOCITY", "ACCELERATION", "JERK", "COMMAND_TIMEOUT"}


@pytest.mark.parametrize("kind", [Interpolation.QUINTIC, Interpolation.RUCKIG])
def test_smooth_interpolation_of_a_smooth_stream_needs_no_intervention(rig: Rig, kind: Interpolation) -> None:
    assert rig.stream(interpolation=kind, decimation=33) == ""
    for cycle in range(2000):
        if cycle % 33 == 0:
            phase = np.pi * cycle * 1e-3
            rig.aim(joints=rig.home + 0.05 * (phase - np.sin(phase)))  # from rest, up to 0.3 rad/s
        rig.step()
    assert rig.counted() == {}


def test_a_jump_is_refused_and_the_stream_goes_on(stream: Rig) -> None:
    feed(stream, 500)
    outlier = wave(stream, 500)
    outlier[2] += 0.5
    stream.aim(joints=outlier)
    stream.step(10)
    assert stream.counted()["JUMP"] == 1
    assert stream.mode is LoopMode.JOINT_IMPEDANCE
    feed(stream, 1000, begin=510)
    np.testing.assert_allclose(stream.commanded[-1], wave(stream, 1500), atol=5e-3)
    assert stream.counted()["JUMP"] == 1
    require_limits(stream)


def test_a_jump_within_the_specs_threshold_is_refused_if_the_robot_cannot_be_that_fast(stream: Rig) -> None:
    target = stream.home.copy()
    target[0] += 0.05  # within 10 rad/s for 10 ms, but not within 1.48 rad/s for 20 ms
    stream.aim(joints=target)
    stream.step(20)
    assert stream.counted() == {"JUMP": 1}
    np.testing.assert_array_equal(stream.commanded[-1], stream.home)


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("joint", [0, 6])
def test_a_target_that_is_no_number_latches_an_estop(stream: Rig, poison: float, joint: int) -> None:
    feed(stream, 700)
    target = wave(stream, 700)
    target[joint] = poison
    stream.aim(joints=target)
    stream.step(10)
    stream.run()
    assert stream.mode is LoopMode.ESTOP
    assert "not finite" in stream.reason
    assert stream.counted()["NOT_FINITE"] == 1
    assert np.isfinite(stream.commanded).all()
    require_limits(stream)


def test_a_silent_client_brings_the_arm_to_rest_and_a_new_target_moves_it_again(stream: Rig) -> None:
    feed(stream, 1500)  # in the middle of a swing
    moving = np.abs(stream.loop.controller.safety.velocity).max()
    assert moving > 0.2
    ramp = stream.commanded[-1] - stream.commanded[-2]
    stream.step(COMMAND_TIMEOUT_CYCLES + 300)
    assert stream.counted()["COMMAND_TIMEOUT"] == 1
    assert stream.mode is LoopMode.JOINT_IMPEDANCE
    held = stream.commanded[-1]
    np.testing.assert_array_equal(stream.commanded[-100], held)
    assert np.abs(ramp).max() > 0.0
    stream.aim(joints=held + 0.01)
    stream.step(200)
    np.testing.assert_allclose(stream.commanded[-1], held + 0.01, atol=1e-3)
    require_limits(stream)


@pytest.mark.parametrize("kind", Interpolation)
def test_a_stream_that_runs_into_a_limit_arrives_there_at_rest(rig: Rig, kind: Interpolation) -> None:
    assert rig.stream(interpolation=kind) == ""
    target = rig.home.copy()
    highest = rig.limits.max_position[5]
    for cycle in range(4000):
        if cycle % 10 == 0:
            target[5] = rig.home[5] + 1.5 * max(0.0, cycle * 1e-3 - 0.1)  # 1.5 rad/s, and never slower
            rig.aim(joints=target)
        rig.step()
        if target[5] > highest + 0.6:
            break
    rig.step(600)
    joint = np.array(rig.commanded)[:, 5]
    assert joint.max() <= highest + 1.1e-5
    assert joint[-1] == pytest.approx(highest, abs=2e-5)
    np.testing.assert_array_equal(joint[-50:], joint[-1])
    assert rig.counted()["POSITION"] >= 1
    require_limits(rig)


def test_a_fixed_target_is_never_overshot(rig: Rig) -> None:
    assert rig.stream(interpolation=Interpolation.NONE) == ""
    target = rig.home + 0.02
    rig.aim(joints=target)
    rig.step(1500)
    joints = np.array(rig.commanded)
    assert (joints <= target + 1e-12).all()
    np.testing.assert_allclose(joints[-1], target, atol=1e-9)
    require_limits(rig)


def test_a_stop_request_ends_the_session_and_a_new_one_may_begin(stream: Rig) -> None:
    feed(stream, 1500)
    stream.request("stops")
    stream.run()
    assert (stream.mode, stream.reason) == (LoopMode.HOLD, "stop requested")
    assert stream.stream() == ""
    require_limits(stream)


def test_an_estop_of_the_client_needs_no_turn_of_its_targets(stream: Rig) -> None:
    feed(stream, 1500)
    stream.memory.stream_requests.data["estops"] += 1
    stream.memory.stream_requests.publish()
    stream.run()
    assert stream.mode is LoopMode.ESTOP
    assert stream.stream().startswith("the arm is in mode ESTOP")
    require_limits(stream)


def test_late_cycles_in_a_row_end_a_session(stream: Rig) -> None:
    feed(stream, 100)
    stream.step(20, late_ns=2_000_000)
    stream.run()
    assert "began late" in stream.reason
    assert stream.counted()["OVERRUN"] == 1


def test_the_arm_comes_to_rest_when_its_client_is_killed(rig: Rig) -> None:
    client = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    try:
        assert rig.stream(pid=client.pid) == ""
        feed(rig, 1500)
        client.send_signal(signal.SIGKILL)
        client.wait()
        rig.step(60)
        assert rig.mode is LoopMode.STOPPING
        assert rig.reason == "the streaming client has died"
        rig.run()
        assert rig.mode is LoopMode.HOLD
        require_limits(rig)
    finally:
        client.kill()
        client.wait()


def test_no_motion_starts_during_a_session_and_no_session_when_a_stop_came_first(stream: Rig) -> None:
    assert stream.answer(stream.send(Command.START)) == "the arm is in mode JOINT_IMPEDANCE"
    stream.request("stops")
    stream.run()
    assert stream.stream(stops=0) == "a stop has been requested in the meantime"


@pytest.mark.parametrize(
    ("wish", "sentence"),
    [
        ({"stream": 9}, "there is no stream 9"),
        ({"interpolation": 7}, "there is no stream 1 with interpolation 7"),
        ({"decimation": 0}, "decimation must be from 1 to 1000, got 0"),
        ({"stiffness": 1e9}, "stiffness must be above 0 and at most"),
        ({"stiffness": np.nan}, "stiffness must be above 0 and at most"),
        ({"damping_ratio": 0.1}, "damping_ratio must be from 0.3 to 1"),
        ({"max_contact_torque": 0.0}, "max_contact_torque must be above 0"),
        ({"force_frame": np.nan}, "force_frame must be a position and a unit quaternion"),
        ({"force_frame": np.zeros(7)}, "force_frame must be a position and a unit quaternion"),
        ({"force_velocity": 0.0}, "force_velocity must be above 0"),
        ({"pid": 2**22 + 1}, "cannot be watched"),
    ],
)
def test_a_session_that_makes_no_sense_is_refused(rig: Rig, wish: dict[str, object], sentence: str) -> None:
    assert sentence in rig.stream(**wish)
    assert rig.mode is LoopMode.HOLD
    assert rig.stream() == ""


class PositionOnly:
    """Drives that are told positions, and nothing else."""

    def __init__(self, loopback: Loopback) -> None:
        for name in ("open", "enable", "read", "write", "disable", "close"):
            setattr(self, name, getattr(loopback, name))


def test_drives_that_cannot_give_way_follow_positions_and_refuse_forces(rig: Rig) -> None:
    backend = PositionOnly(rig.loopback)
    assert not isinstance(backend, ImpedanceControlled)
    rig.loop.controller.streaming._backend = backend
    lacks = "needs {}, which the backend mujoco does not have; it accepts positions only"
    for wish in ({}, {"stiffness": 0.0}, {"cartesian_stiffness": 0.0}):
        assert lacks.format("impedance control") in rig.stream(**wish)
    stiff = {"stiffness": 0.0, "cartesian_stiffness": 0.0}
    assert lacks.format("torque control") in rig.stream(Stream.JOINT_TORQUE, **stiff)
    force = lacks.format("impedance control or wrench control")
    assert force in rig.stream(Stream.CARTESIAN, force_axes=1.0, **stiff)
    assert rig.stream(**stiff) == ""
    feed(rig, 500)
    np.testing.assert_allclose(rig.commanded[-1], wave(rig, 490), atol=5e-3)


def test_targets_of_another_session_are_ignored(stream: Rig) -> None:
    setpoint = stream.memory.setpoint.data
    stream.aim(joints=stream.home + 0.01)
    setpoint["session"] += 1
    stream.memory.setpoint.publish()
    stream.step(100)
    np.testing.assert_array_equal(stream.commanded[-1], stream.home)


def test_a_setpoint_block_of_random_bytes_moves_nothing(stream: Rig) -> None:
    feed(stream, 300)
    rng = np.random.default_rng(3)
    block = stream.memory.setpoint
    for _ in range(50):
        block._shared[:] = rng.integers(0, 256, len(block._shared), np.uint8).tobytes()
        block._head[0] = int(rng.integers(0, 2**63)) & ~1
        stream.step(10)
    assert stream.mode is LoopMode.JOINT_IMPEDANCE
    assert stream.loop.controller.streaming.box.torn_reads >= 50
    stream.step(600)
    assert stream.counted()["COMMAND_TIMEOUT"] == 1
    require_limits(stream)


def test_a_dead_rtloops_session_does_not_go_on_in_the_next_one(stream: Rig) -> None:
    feed(stream, 500)
    stream.step()
    successor = Rig(stream.settings, stream.robot, memory=stream.memory)
    successor.step(20)
    assert successor.mode is LoopMode.HOLD
    assert successor.reason == "rtloop was restarted"
    assert successor.loop.controller.streaming.session == 0


def test_hand_guiding_by_the_device_is_rejected_if_the_device_cannot(rig: Rig) -> None:
    assert "cannot release the arm for hand guiding by itself" in rig.stream(Stream.GUIDED)
    assert rig.mode is LoopMode.HOLD


@pytest.mark.parametrize("stream_kind", [each for each in Stream if each is not Stream.GUIDED])
def test_each_stream_has_its_mode(rig: Rig, stream_kind: Stream) -> None:
    assert rig.stream(stream_kind) == ""
    assert rig.mode.name == stream_kind.name
    assert int(rig.memory.session.data["pid"]) == os.getpid()


def test_after_one_catch_a_smooth_stream_is_let_go_at_once(rig: Rig) -> None:
    assert rig.stream(interpolation=Interpolation.QUINTIC) == ""
    pursued = 0
    for cycle in range(3000):
        if cycle % 10 == 0:
            rig.aim(joints=rig.home + 0.001 + 0.15 * (1.0 - np.cos(1e-3 * cycle)))  # begins 1 mrad off
        rig.step()
        pursued += rig.loop.controller.safety.pursuing and cycle > 500
    assert pursued == 0
    assert sum(rig.counted().values()) <= 3
    jerk = np.abs(np.diff(np.array(rig.commanded)[-2000:], 3, axis=0)) / 1e-9
    assert jerk.max() < 2.0


@pytest.mark.parametrize("rate_hz", [1.0, 1.5])
def test_a_stream_may_be_as_slow_as_it_has_said(rig: Rig, rate_hz: float) -> None:
    every = round(1000 / rate_hz)
    assert rig.stream(decimation=every) == ""
    for step in range(1, 5):
        rig.aim(joints=rig.home + 0.03 * step)
        rig.step(every)
    rig.step(2 * every)
    np.testing.assert_allclose(rig.commanded[-1], rig.home + 0.12, atol=1e-6)
    assert "JUMP" not in rig.counted()
    assert "COMMAND_TIMEOUT" not in rig.counted()


def test_after_a_pause_the_next_target_is_measured_by_the_pause(stream: Rig) -> None:
    feed(stream, 500)
    stream.step(1500)
    held = stream.commanded[-1]
    stream.aim(joints=held + 0.06)  # more than in one period of 10 ms
    stream.step(500)
    assert "JUMP" not in stream.counted()
    np.testing.assert_allclose(stream.commanded[-1], held + 0.06, atol=1e-6)


@pytest.mark.parametrize("pid", [0, 2**31, 2**40, 2**64 - 1])
def test_a_client_that_no_process_is_cannot_open_a_session(rig: Rig, pid: int) -> None:
    assert f"process {pid}, cannot be watched" in rig.stream(pid=pid)
    rig.step(10)
    assert rig.mode is LoopMode.HOLD
    assert rig.stream() == ""
