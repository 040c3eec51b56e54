"""Action chunks in a session: late, early, overlapping and missing ones, on the virtual clock.

Oracle: the policy's own curve, a closed form; numpy's finite differences against the limits.
"""

from __future__ import annotations

import numpy as np
import pytest
from rig import Rig

from cobot.types import Array, LoopMode

STEP_S = 1 / 30


@pytest.fixture
def stream(rig: Rig) -> Rig:
    assert rig.stream() == ""
    return rig


def policy(rig: Rig, times_s: Array) -> Array:
    """Smooth, from rest at 0, some 0.3 rad/s; shape (k, dof)."""
    phase = np.pi * np.maximum(times_s, 0.0)[:, None]
    return rig.home + 0.05 * (phase - np.sin(phase)) * np.linspace(1.0, 0.5, rig.limits.dof)


def now_s(rig: Rig) -> float:
    return float(rig.memory.state.data["robot_time_s"])


def send(rig: Rig, times_s: Array, points: Array) -> None:
    chunk = rig.memory.chunk.data
    chunk["session"] = rig.memory.session.data["number"]
    chunk["number"] += 1
    chunk["count"] = len(times_s)
    chunk["times_s"][: len(times_s)] = times_s
    chunk["points"][: len(times_s), : rig.limits.dof] = points
    rig.memory.chunk.publish()


def require_limits(rig: Rig) -> None:
    for share in rig.rates():
        assert share.max() <= 1.011


def play(rig: Rig, chunks: list[tuple[float, int]], begin_s: float) -> None:
    """Chunks of so many points that come at these times after the beginning, with the points that follow."""
    for at_s, count in chunks:
        while now_s(rig) - begin_s < at_s - 1e-9:
            rig.step()
        times = begin_s + (np.ceil(at_s / STEP_S + 0.5) + np.arange(count)) * STEP_S
        send(rig, times, policy(rig, times - begin_s))


def error(rig: Rig, begin_s: float) -> Array:
    """Between what was commanded since the beginning and the policy's curve, rad."""
    cycles = round((now_s(rig) - begin_s) / 1e-3)
    times = now_s(rig) - begin_s - np.arange(cycles)[::-1] * 1e-3
    return np.abs(np.array(rig.commanded[-cycles:]) - policy(rig, times))


def test_chunks_are_played_on_time_without_a_stop_at_their_borders(stream: Rig) -> None:
    begin_s = now_s(stream)
    play(stream, [(0.5 * k, 18) for k in range(5)], begin_s)
    stream.step(450)
    assert error(stream, begin_s).max() < 2e-3
    assert stream.counted() == {}
    speed = np.abs(np.diff(np.array(stream.commanded)[:, 0])) / 1e-3
    assert speed[700:1700].min() > 0.05, "no stop where one chunk ends and the next begins"
    require_limits(stream)


def test_an_early_chunk_that_overlaps_replaces_what_lies_ahead(stream: Rig) -> None:
    begin_s = now_s(stream)
    play(stream, [(0.2 * k, 30) for k in range(10)], begin_s)
    stream.step(300)
    assert error(stream, begin_s).max() < 2e-3
    assert stream.counted() == {}
    require_limits(stream)


def test_of_a_late_chunk_the_points_that_are_past_are_dropped_and_counted(stream: Rig) -> None:
    begin_s = now_s(stream)
    play(stream, [(0.0, 18)], begin_s)
    stream.step(400)
    times = begin_s + np.arange(6, 40) * STEP_S
    send(stream, times, policy(stream, times - begin_s))
    stream.step(400)
    assert stream.counted() == {"LATE": 1}
    assert error(stream, begin_s).max() < 2e-3
    require_limits(stream)


def test_a_chunk_that_is_wholly_past_changes_nothing(stream: Rig) -> None:
    begin_s = now_s(stream)
    play(stream, [(0.0, 25)], begin_s)
    stream.step(500)
    times = begin_s + np.arange(3, 9) * STEP_S
    send(stream, times, policy(stream, times - begin_s))
    stream.step(200)
    assert stream.counted() == {"LATE": 1}
    assert error(stream, begin_s).max() < 2e-3
    require_limits(stream)


def test_a_missing_chunk_lets_the_arm_come_to_rest_and_the_next_one_moves_it_on(stream: Rig) -> None:
    begin_s = now_s(stream)
    play(stream, [(0.0, 40)], begin_s)
    stream.step(2500)
    assert stream.counted() == {"COMMAND_TIMEOUT": 1}
    np.testing.assert_allclose(stream.commanded[-1], stream.commanded[-200], atol=1e-12)
    here = stream.commanded[-1]
    times = now_s(stream) + 0.05 + np.arange(1, 20) * STEP_S
    send(stream, times, here + 0.05 * (np.arange(1, 20)[:, None] / 19) ** 2)
    stream.step(2000)
    assert (stream.commanded[-1] > here + 0.03).all()
    assert stream.mode is LoopMode.JOINT_IMPEDANCE
    require_limits(stream)


def test_a_chunk_that_would_jump_is_refused_and_the_one_before_goes_on(stream: Rig) -> None:
    begin_s = now_s(stream)
    play(stream, [(0.0, 30)], begin_s)
    stream.step(400)
    times = now_s(stream) + np.arange(1, 10) * STEP_S
    send(stream, times, policy(stream, times - begin_s) + 0.5)
    stream.step(400)
    assert stream.counted() == {"JUMP": 1}
    assert error(stream, begin_s).max() < 2e-3
    require_limits(stream)


def test_a_chunk_that_is_no_number_latches_an_estop(stream: Rig) -> None:
    begin_s = now_s(stream)
    play(stream, [(0.0, 30)], begin_s)
    stream.step(400)
    times = now_s(stream) + np.arange(1, 10) * STEP_S
    points = policy(stream, times - begin_s)
    points[4, 2] = np.nan
    send(stream, times, points)
    stream.step(5)
    stream.run()
    assert stream.mode is LoopMode.ESTOP
    require_limits(stream)


def test_single_targets_and_chunks_take_turns(stream: Rig) -> None:
    begin_s = now_s(stream)
    play(stream, [(0.0, 20)], begin_s)
    stream.step(600)
    for _ in range(20):
        stream.aim(joints=stream.commanded[-1])
        stream.step(10)
    times = now_s(stream) + np.arange(2, 20) * STEP_S
    send(stream, times, np.tile(stream.commanded[-1] + 0.01, (18, 1)))
    stream.step(700)
    np.testing.assert_allclose(stream.commanded[-1], stream.commanded[-100], atol=1e-3)
    require_limits(stream)
