"""Beats that come faster than time passes are a fault; those that make up for a pause are none.

Oracle: the times that are given, and for the whole loop the kernel's own CLOCK_MONOTONIC, of which only what
cannot be shorter counts.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from paced_arm import PacedArm
from rig import Rig

from cobot.config import Settings
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode, PlannerName, Scaling
from rtloop.clock import FastClock, Pace, RealtimeClock
from rtloop.main import clock_of

PERIOD_NS = 1_000_000
AT_ONCE = 152
"""Beats of 1 ms that may come at once: 0.1 s after a pause, and how far they may scatter."""


class Beats:
    """A device's beats, at times that are given."""

    def __init__(self) -> None:
        self.pace, self.now_ns = Pace(PERIOD_NS * 1e-9), 1

    def come(self, count: int, every_ns: float = PERIOD_NS, scatter_ns: float = 0.0) -> int:
        """The first that is too early; all, if none is."""
        seed = 7
        scatter = np.random.default_rng(seed).uniform(-scatter_ns, scatter_ns, count)
        begun_ns = self.now_ns
        for beat in range(count):
            self.now_ns = max(self.now_ns, int(begun_ns + (beat + 1) * every_ns + scatter[beat]))
            if self.pace.early_ns(self.now_ns, beaten=True):
                return beat
        return count


@pytest.mark.parametrize("share", [0.995, 1.0, 1.005])
def test_clocks_may_differ_a_little_and_beats_may_scatter(share: float) -> None:
    beats = Beats()
    assert beats.come(100_000, share * PERIOD_NS, scatter_ns=20e6) == 100_000


@pytest.mark.parametrize("every_ns", [0.0, 0.9 * PERIOD_NS])
def test_a_tenth_of_a_second_is_made_up_for_after_each_pause(every_ns: float) -> None:
    beats = Beats()
    for _ in range(20):
        beats.come(3000)
        beats.now_ns += 100 * PERIOD_NS
        behind = 100 if every_ns == 0.0 else 1000
        assert beats.come(behind, every_ns) == behind


def test_no_more_is_made_up_for_after_a_longer_pause() -> None:
    beats = Beats()
    beats.come(3000)
    beats.now_ns += 1000 * PERIOD_NS
    assert 100 < beats.come(1000, 0.0) <= AT_ONCE


def test_beats_without_a_pause_are_found_early() -> None:
    beats = Beats()
    beats.come(20_000)
    assert beats.come(1000, 0.1 * PERIOD_NS) < 60
    beats = Beats()
    beats.come(20_000)
    assert beats.come(10_000, 0.95 * PERIOD_NS) < 2000


def test_periods_without_a_beat_are_time_that_passes() -> None:
    beats = Beats()
    for _ in range(5000):
        beats.now_ns += PERIOD_NS
        assert beats.pace.early_ns(beats.now_ns, beaten=False) == 0
        beats.now_ns += PERIOD_NS
        assert beats.pace.early_ns(beats.now_ns, beaten=True) == 0
    assert beats.come(1000, 0.0) <= AT_ONCE


def test_a_device_that_is_faster_than_time_is_a_fault_and_the_arm_stops_by_the_clock(
    settings: Settings, robot: RobotDescription
) -> None:
    arm = PacedArm(settings, robot.limits)
    rig = Rig(settings, robot, backend=arm, clock=RealtimeClock(settings.rt.period_s))
    try:
        goal = rig.home + 0.3
        request = MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(1.0))
        assert rig.start(plan_ptp(robot, request, goal)) == ""
        begun_s = time.monotonic()
        beats = 0
        while rig.mode is not LoopMode.FAULT and beats < 100_000:
            rig.loop.beat()
            rig.step()
            beats += 1
        passed_s = time.monotonic() - begun_s
        assert rig.reason.startswith("the robot's packets arrive too fast: ")
        assert rig.reason.endswith(", but a period is 0.001 s")
        assert beats <= passed_s / settings.rt.period_s + AT_ONCE
        faulted_s, more = time.monotonic(), 50
        for _ in range(more):
            rig.loop.beat()
            rig.step()
        assert time.monotonic() - faulted_s > 0.8 * more * settings.rt.period_s
    finally:
        rig.close()


@pytest.mark.parametrize(("hardware", "kind"), [(True, RealtimeClock), (False, FastClock)])
def test_hardware_never_goes_by_robot_time(
    settings: Settings, robot: RobotDescription, hardware: bool, kind: type
) -> None:
    arm = PacedArm(settings, robot.limits)
    arm.capabilities = replace(arm.capabilities, hardware=hardware)
    assert type(clock_of(arm, "fast", settings.rt.period_s)) is kind
