"""The compiled safety layer against its law in numpy (`laws.limiter`), on random inputs."""

from __future__ import annotations

import numpy as np
import pytest
from laws.limiter import NOTHING, Watch
from laws.limiter import Safety as PlainSafety
from sample_counts import samples
from thorough import few

from cobot.errors import InputError
from cobot.ipc.layout import Intervention
from cobot.robot.description import RobotDescription
from cobot.types import Array, JointLimits
from rtloop.generators.tracking import Tracker
from rtloop.safety.limiter import Safety

PERIOD_S = 1e-3
INPUTS = samples(100_000)
EPISODES, CYCLES = samples(250), 20
ALIKE = (1e-12, 1e-11, 1e-9)
"""rad, rad/s, rad/s²: the differences of positions carry their rounding, divided by the period and its
square."""
OTHERS = set(Intervention) - {
    Intervention.NOT_FINITE,
    Intervention.POSITION,
    Intervention.VELOCITY,
    Intervention.ACCELERATION,
    Intervention.JERK,
}
"""Kinds that others count."""


def pasts(limits: JointLimits, random: np.random.Generator, n: int) -> tuple[Array, Array]:
    """Three positions and a command that follows them, each shape (n, 3, dof): of arms that move well below
    their limits, at them or beyond, some of them close to a stop."""
    shape = (n, limits.dof)
    level = random.choice([0.05, 0.6, 1.2], (n, 1), p=[0.3, 0.5, 0.2])
    velocity, acceleration, jerk = (
        level * random.uniform(-1.0, 1.0, shape) * most
        for most in (limits.max_velocity, limits.max_acceleration, limits.max_jerk)
    )
    middle = 0.5 * (limits.min_position + limits.max_position)
    reach = random.choice([0.5, 0.9, 1.01], (n, 1), p=[0.4, 0.4, 0.2])
    position = middle + reach * random.uniform(-1.0, 1.0, shape) * (limits.max_position - middle)
    t = PERIOD_S * np.arange(-3, 1)[:, None]
    positions = position[:, None] + t * velocity[:, None] + t**2 / 2 * acceleration[:, None]
    positions += t**3 / 6 * jerk[:, None]
    inside = positions[:, :3].clip(limits.min_position, limits.max_position)
    return inside, np.stack([positions[:, 3], velocity, acceleration], axis=1)


def poison(command: Array, random: np.random.Generator) -> None:
    """One number in fifty commands is none, or beyond anything."""
    chosen = np.flatnonzero(random.random(len(command)) < 0.02)
    row, joint = random.integers(0, 3, len(chosen)), random.integers(0, command.shape[2], len(chosen))
    command[chosen, row, joint] = random.choice([np.nan, np.inf, -np.inf, 1e308], len(chosen))


class Bench:
    """A compiled safety layer that can be brought to any past."""

    def __init__(self, limits: JointLimits, share: float) -> None:
        self.safety = Safety(limits, PERIOD_S)
        self._limits, self._share = limits, share
        self._unlimited = limits.scaled(1e6, 1e9, 1e12)
        self._home = 0.5 * (limits.min_position + limits.max_position)
        self.safety.reset(self._home)

    def bring_to(self, past: Array) -> None:
        safety = self.safety
        safety.use(self._unlimited)
        if safety.pursuing:
            safety.reset(self._home)
        request = np.zeros_like(past)
        for position in past:
            request[0] = position
            safety.apply(request)
        assert not safety.pursuing
        safety.use(self._limits, self._share)


@pytest.mark.parametrize("streamed", [False, True])
def test_what_passes_and_what_is_caught_is_what_the_law_says(robot: RobotDescription, streamed: bool) -> None:
    random = np.random.default_rng(11)
    limits, share = robot.limits, 0.9
    past, command = pasts(limits, random, INPUTS // limits.dof)
    poison(command, random)
    watch = Watch(limits, PERIOD_S, share)
    kinds = watch.excess(past, command)
    if streamed:
        kinds = np.where(kinds == NOTHING, watch.foreseen(past, command), kinds)
    assert {NOTHING, *Intervention} - set(kinds.tolist()) == OTHERS
    bench = Bench(limits, share)
    safety = bench.safety
    for before, request, kind in zip(past, command, kinds.tolist(), strict=True):
        bench.bring_to(before)
        counts = safety.interventions.copy()
        finite = safety.apply(request, streamed=streamed)
        counted = (safety.interventions - counts).nonzero()[0].tolist()
        assert counted == ([] if kind == NOTHING else [kind])
        assert finite == (kind != Intervention.NOT_FINITE)
        assert safety.pursuing == (kind != NOTHING)
        if kind == NOTHING:
            assert safety.command.tobytes() == request.tobytes()


@pytest.mark.parametrize("streamed", [False, True])
@pytest.mark.parametrize("catch_up", few([np.inf, 0.5]))
def test_a_pursuit_goes_where_the_law_goes(robot: RobotDescription, streamed: bool, catch_up: float) -> None:
    """Requests wander off from the past at a constant acceleration, so that they are caught and met again.

    Both start anew often: what is planned anew from its own last step magnifies rounding.
    """
    random = np.random.default_rng(12)
    limits, share = robot.limits, 0.9
    past, command = pasts(limits, random, EPISODES)
    bench = Bench(limits, share)
    plain = PlainSafety(limits, PERIOD_S, share, catch_up, Tracker(limits.dof, PERIOD_S))
    pursued = 0
    for before, (position, velocity, acceleration) in zip(past, command, strict=True):
        bench.bring_to(before)
        bench.safety.use(limits, share, catch_up)
        plain.begin(before)
        jump = random.choice([0.0, 1e-5, 1e-2]) * random.uniform(-1.0, 1.0, limits.dof)
        counts = bench.safety.interventions - plain.interventions
        for cycle in range(CYCLES):
            t = cycle * PERIOD_S
            moved = position + jump + t * velocity + t**2 / 2 * acceleration
            request = np.array([moved, velocity + t * acceleration, acceleration])
            assert bench.safety.apply(request, streamed=streamed) == plain.apply(request, streamed=streamed)
            assert bench.safety.pursuing == plain.pursuing
            off = np.abs(bench.safety.command - plain.command).max(axis=1)
            assert (off <= ALIKE).all(), off
            pursued += plain.pursuing
        np.testing.assert_array_equal(bench.safety.interventions - plain.interventions, counts)
    assert pursued > EPISODES * CYCLES / 4


def test_more_joints_than_there_is_room_for_are_refused(robot: RobotDescription) -> None:
    ones = np.ones(17)
    limits = JointLimits(tuple(f"joint{i}" for i in range(17)), -ones, ones, ones, ones, ones, ones)
    with pytest.raises(InputError, match="17 joints, allowed: up to 16"):
        Safety(limits, PERIOD_S)
