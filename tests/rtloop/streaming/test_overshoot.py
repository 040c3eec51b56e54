"""How far the arm goes beyond the targets of a stream that steps, stops or wavers, at jitter up to a period.

Oracle: the range of the targets that the test itself sends; the figures are those of docs/streaming.md.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from rig import Rig
from thorough import few

from benchmarks.streams.overshoot import (
    STREAMS,
    TARGETS,
    Follow,
    arrivals,
    beyond,
    beyond_steps,
    joints,
    noise,
    ramp,
    steps,
    swing,
    walk,
)
from cobot.config import Settings
from cobot.ipc.layout import Interpolation, Intervention, ServoMode, Stream
from cobot.robot.description import RobotDescription
from cobot.types import Array

ROUNDING_RAD = 4e-6
"""A stop this far beyond a target is one at the target: the safety layer rounds stops to 1e-7 rad."""
SWING = 0.1
"""Share of its step by which a stream may swing back on the near side of a target that stands still."""
Make = Callable[[int, np.random.Generator], Array]


def followed(rig: Rig, follow: Follow, make: Make, rate_hz: int) -> tuple[Array, Array, Array]:
    """Where a stream with a jitter of up to a period leads, its targets, and their arrivals in s."""
    random = np.random.default_rng([rate_hz, len(make.__name__)])
    targets = make(rate_hz, random)
    arrivals_s = arrivals(targets, rate_hz, random.uniform(), random)
    return follow(rig, rate_hz, targets, arrivals_s), targets, arrivals_s


@pytest.mark.parametrize("name", STREAMS)
@pytest.mark.parametrize("rate_hz", few([10, 100, 1000]))
def test_no_stream_goes_beyond_a_target_that_stands_still_and_each_reaches_it(
    rig: Rig, name: str, rate_hz: int
) -> None:
    way, targets, arrivals_s = followed(rig, STREAMS[name][0], steps, rate_hz)
    assert beyond_steps(way, targets, arrivals_s)[0] <= ROUNDING_RAD
    np.testing.assert_allclose(way[-1], targets[-1], atol=1e-5)


@pytest.mark.parametrize("kind", Interpolation)
@pytest.mark.parametrize("rate_hz", few([10, 30, 100, 1000]))
def test_a_stream_of_joints_hardly_swings_back_on_the_near_side_of_its_target(
    settings: Settings, robot: RobotDescription, kind: Interpolation, rate_hz: int
) -> None:
    for seed, jitter in ((0, 0.0), (1, 1.0), (2, 1.0)):
        random = np.random.default_rng([seed, rate_hz])
        targets = steps(rate_hz, random)
        arrivals_s = arrivals(targets, rate_hz, jitter, random)
        rig = Rig(settings, robot)
        way = joints(kind)(rig, rate_hz, targets, arrivals_s)
        rig.close()
        assert swing(way, targets, arrivals_s) <= SWING


@pytest.mark.parametrize("name", STREAMS)
@pytest.mark.parametrize("make", [ramp, walk, noise])
@pytest.mark.parametrize("rate_hz", few([10, 100, 1000]))
def test_no_stream_goes_beyond_the_range_of_its_targets_by_more_than_the_stated_share(
    rig: Rig, name: str, make: Make, rate_hz: int
) -> None:
    follow, share = STREAMS[name]
    way, targets, _ = followed(rig, follow, make, rate_hz)
    too_far, extent = beyond(way, targets)
    assert too_far <= share * extent + ROUNDING_RAD
    takes_its_time = name == f"servo mode {ServoMode.THROUGH}"  # It leaves no point out.
    # A curve through points that no joint can follow leads far away, so the next chunk is a jump.
    if not takes_its_time and not rig.interventions[Intervention.JUMP]:
        np.testing.assert_allclose(way[-1], targets[-1], atol=2e-5)


@pytest.mark.parametrize("make", TARGETS)
@pytest.mark.parametrize("rate_hz", [10, 30, 100, 333, 1000])
def test_a_stream_without_interpolation_never_looks_ahead(rig: Rig, make: Make, rate_hz: int) -> None:
    way, targets, _ = followed(rig, joints(Interpolation.NONE), make, rate_hz)
    assert beyond(way, targets)[0] <= ROUNDING_RAD


@pytest.mark.parametrize("kind", Interpolation)
def test_a_joint_target_that_stands_still_is_reached_whatever_velocity_is_stated(
    rig: Rig, kind: Interpolation
) -> None:
    """The client repeats a target and states that it moves on: that contradiction is its own."""
    assert rig.stream(interpolation=kind, decimation=10) == ""
    for cycle in range(1500):
        if cycle % 10 == 0:
            rig.aim(joints=rig.home + 0.01, joint_velocity=np.full(7, 0.1), feed_forward=1)
        rig.step()
    np.testing.assert_allclose(rig.commanded[-1], rig.home + 0.01, atol=1e-5)


@pytest.mark.parametrize("kind", Interpolation)
def test_a_pose_that_stands_still_is_reached_whatever_twist_is_stated(rig: Rig, kind: Interpolation) -> None:
    begin = rig.robot.model.chain.poses(rig.home[None])[0]
    assert rig.stream(Stream.CARTESIAN, interpolation=kind, decimation=10) == ""
    goal = begin + np.array([0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0])
    for cycle in range(2500):
        if cycle % 10 == 0:
            rig.aim(pose=goal, twist=np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.0]), feed_forward=1)
        rig.step()
    np.testing.assert_allclose(
        rig.robot.model.chain.poses(rig.commanded[-1][None])[0, :3], goal[:3], atol=1e-5
    )
