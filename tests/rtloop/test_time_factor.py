"""The time factor of a simulation.

Oracle: the same motion at a factor of 1, bit by bit, and the deadlines of the clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from paced_arm import PacedArm
from rig import Loopback, Rig

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.ipc.layout import Command, MotionResult
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription
from cobot.robot.device import Capabilities
from cobot.types import Array, LoopMode, PlannerName, Scaling
from rtloop.clock import FastClock, RealtimeClock
from rtloop.main import clock_of
from rtloop.time_factor import time_factor_refusal

NOT_FACTORS = (0.0, -1.0, 0.05, 4.5, float("nan"), float("inf"))


@pytest.fixture
def rigs(settings: Settings, robot: RobotDescription) -> Iterator[Callable[[], Rig]]:
    made: list[Rig] = []

    def make() -> Rig:
        clock = RealtimeClock(settings.rt.period_s)
        made.append(Rig(settings, robot, simulated=True, clock=clock))
        return made[-1]

    yield make
    for rig in made:
        rig.close()


def moved(rig: Rig, robot: RobotDescription, factors: dict[int, float]) -> tuple[Array, Array]:
    """All commanded and measured positions of a motion; at each cycle in `factors` the factor changes."""
    goal = rig.home + np.array([0.4, -0.2, 0.2, 0.1, 0.0, 0.3, 0.0])
    trajectory = plan(robot, MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(0.8)))
    assert trajectory is not None
    assert rig.start(trajectory) == ""
    measured = []
    for cycle in range(3000):
        if cycle in factors:
            rig.send(Command.TIME_FACTOR, value=factors[cycle])
        rig.step()
        measured.append(rig.loop._measured.position.copy())
    assert rig.result is MotionResult.ARRIVED, rig.reason
    return np.array(rig.commanded), np.array(measured)


@pytest.mark.parametrize("factors", [{0: 0.1}, {0: 4.0}, {0: 0.25, 200: 4.0, 400: 1.0, 500: 0.3}])
def test_the_commands_and_the_arm_do_not_depend_on_the_factor(
    rigs: Callable[[], Rig], robot: RobotDescription, factors: dict[int, float]
) -> None:
    plain, scaled = rigs(), rigs()
    expected = moved(plain, robot, {})
    found = moved(scaled, robot, factors)
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, other)
    assert scaled.clock.factor == list(factors.values())[-1], "it was in force"
    assert float(scaled.memory.state.read()["time_factor"]) == scaled.clock.factor
    assert float(plain.memory.state.read()["time_factor"]) == 1.0


@pytest.mark.parametrize(("factor", "planned_ns"), [(0.1, 10_000_000), (1.0, 1_000_000), (4.0, 250_000)])
def test_only_the_time_between_the_cycles_of_a_planned_motion_changes(factor: float, planned_ns: int) -> None:
    clock = RealtimeClock(1e-3)
    clock.scale(factor)
    clock.wait(moving=True)
    for planned, period_ns in ((True, planned_ns), (False, 1_000_000), (True, planned_ns)):
        before_ns, missed = clock._deadline_ns, clock.overruns
        late_ns = clock.wait(moving=True, planned=planned)
        missed = clock.overruns - missed
        assert clock._deadline_ns - before_ns == (1 + missed) * period_ns
        assert missed == (late_ns // period_ns if late_ns > period_ns else 0)


def test_a_stop_and_the_rest_run_in_real_time(rigs: Callable[[], Rig], robot: RobotDescription) -> None:
    """A stop would otherwise take ten times as long, and its confirmation too."""
    rig = rigs()
    controller = rig.loop.controller
    assert rig.answer(rig.send(Command.TIME_FACTOR, value=0.1)) == ""
    trajectory = plan(robot, MotionRequest(rig.home, rig.home + 0.2, PlannerName.PTP, Scaling(0.5)))
    assert trajectory is not None
    asked: list[tuple[LoopMode, bool]] = []
    assert rig.start(trajectory) == ""
    asked.append((rig.mode, _is_scaled(rig)))
    rig.step(100)
    rig.request()
    rig.step(2)
    asked.append((rig.mode, _is_scaled(rig)))
    rig.run()
    asked.append((rig.mode, _is_scaled(rig)))
    assert asked == [(LoopMode.TRAJECTORY, True), (LoopMode.STOPPING, False), (LoopMode.HOLD, False)]
    assert rig.stream() == "", "a session too, with its watchdogs"
    assert controller.mode is LoopMode.JOINT_IMPEDANCE
    assert not _is_scaled(rig)


def _is_scaled(rig: Rig) -> bool:
    """Whether the loop waits for a scaled period; it waits once."""
    rig.loop.beat()
    before_ns, missed = rig.clock._deadline_ns, rig.clock.overruns  # type: ignore[attr-defined]
    rig.loop.beat()
    passed_ns = rig.clock._deadline_ns - before_ns  # type: ignore[attr-defined]
    periods = 1 + rig.clock.overruns - missed
    return bool(passed_ns == periods * 10_000_000)


@pytest.mark.parametrize("factor", NOT_FACTORS)
def test_a_factor_out_of_range_is_rejected(rigs: Callable[[], Rig], factor: float) -> None:
    rig = rigs()
    words = rig.answer(rig.send(Command.TIME_FACTOR, value=factor))
    assert words == f"the time factor is {factor:g}, allowed: 0.1 to 4"
    assert rig.clock.factor == 1.0


def test_only_a_simulation_in_step_with_the_computer_has_a_factor(
    settings: Settings, robot: RobotDescription
) -> None:
    real = Loopback(robot.limits.dof)
    real.capabilities = Capabilities(hardware=True)  # type: ignore[attr-defined]
    paced = PacedArm(settings, robot.limits)
    paced.capabilities = replace(paced.capabilities, hardware=False)
    free = Loopback(robot.limits.dof)
    period_s = settings.rt.period_s
    for backend, clock, words in (
        (real, "realtime", "this backend moves a real arm"),
        (paced, "realtime", "this device has its own clock"),
        (free, "fast", "with rt.clock: fast, motions run as fast as the computer can"),
    ):
        with pytest.raises(ConfigError, match=f"^rt.time_factor is 0.5, but .*{words}"):
            clock_of(backend, clock, period_s, 0.5)
        assert clock_of(backend, clock, period_s, 1.0).factor == 1.0, "which every robot has"
    assert clock_of(free, "realtime", period_s, 0.5).factor == 0.5
    assert "real arm" in time_factor_refusal(real, RealtimeClock(period_s), 2.0)
    assert "rt.clock" in time_factor_refusal(free, FastClock(period_s), 2.0)


def test_a_new_rtloop_continues_with_the_factor_of_the_one_that_died(
    settings: Settings, robot: RobotDescription
) -> None:
    rig = Rig(settings, robot, clock=RealtimeClock(settings.rt.period_s))
    try:
        assert rig.answer(rig.send(Command.TIME_FACTOR, value=0.25)) == ""
        rig.step()
        after = Rig(settings, robot, memory=rig.memory, clock=RealtimeClock(settings.rt.period_s))
        assert after.clock.factor == 0.25
        rig.memory.state.data["time_factor"] = np.nan
        rig.memory.state.publish()
        damaged = Rig(settings, robot, memory=rig.memory, clock=RealtimeClock(settings.rt.period_s))
        assert damaged.clock.factor == 1.0
    finally:
        rig.close()
