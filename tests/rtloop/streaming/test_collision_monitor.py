"""The compiled collision monitor. Oracle: the same law in numpy, with all distances by MuJoCo
and the way to rest by Ruckig."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from independent_models import changed_world, robot_in
from laws.collision_monitor import CollisionMonitor as PlainMonitor
from sample_counts import samples
from thorough import few

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.streaming.collision_monitor import CollisionMonitor

LOOKS, WAYS = samples(25_000), 250
ASK_EVERY = LOOKS // WAYS | 1
"""Odd, so that a way out is asked for in each phase of a look."""


@pytest.fixture
def here(robot: RobotDescription, tmp_path: Path) -> RobotDescription:
    """The robot beside a box."""
    return robot_in(changed_world(tmp_path, post=(0.5, 0.2, 0.3, 0.05, 0.1, 0.3)), robot)


def wandering(robot: RobotDescription, seed: int, count: int) -> Array:
    """Commands, shape (count, 3, dof): joints that drift from one place to the next, at any speed."""
    random, limits = np.random.default_rng(seed), robot.limits
    corners = random.uniform(limits.min_position, limits.max_position, (count // 50 + 2, limits.dof))
    at = np.arange(count) / 50.0
    joints = np.array([np.interp(at, range(len(corners)), column) for column in corners.T]).T
    velocity = random.uniform(-1.0, 1.0, joints.shape) * limits.max_velocity
    velocity[::3] = 0.0
    velocity[1::3] = 0.1 * (corners[at.astype(int)[1::3] + 1] - joints[1::3])
    acceleration = random.uniform(-1.2, 1.2, joints.shape) * limits.max_acceleration
    acceleration[::3] = 0.0
    return np.stack([joints, velocity, acceleration], axis=1)


@pytest.mark.parametrize("touching", [False, True])
@pytest.mark.parametrize("seed", few([1, 2]))
def test_share_block_and_way_out_are_those_of_numpy(
    settings: Settings, here: RobotDescription, seed: int, touching: bool
) -> None:
    plain = PlainMonitor(here.model, settings.streaming, settings.rt.period_s)
    monitor = CollisionMonitor(here.model, settings.streaming, settings.rt.period_s)
    first = wandering(here, seed, LOOKS)[0]
    for each in (plain, monitor):
        each.begin(first, touching=touching)
    random = np.random.default_rng(seed)
    slowed = blocked = ways = inside = deeper = 0
    for cycle, command in enumerate(wandering(here, seed, LOOKS)):
        plain.look(command)
        monitor.look(command)
        assert abs(monitor.share - plain.share) <= 1e-10, cycle  # Ruckig rounds, and small rooms magnify it.
        assert monitor.blocked == plain.blocked, cycle
        assert monitor.inside == plain.inside, cycle
        inside += plain.inside
        slowed, blocked = slowed + (plain.share < 1.0), blocked + plain.blocked
        if cycle % ASK_EVERY == 0:
            heading = random.normal(size=here.limits.dof) * 10.0 ** random.uniform(-3.0, 0.0)
            leads_away = monitor.leads_away(command[0], heading)
            assert leads_away == plain.leads_away(command[0], heading), cycle
            ways += leads_away
            leads_deeper = monitor.leads_deeper(command[0], heading)
            assert leads_deeper == plain.leads_deeper(command[0], heading), cycle
            deeper += leads_deeper
    assert slowed > LOOKS // 100
    assert blocked > LOOKS // 100
    assert 0 < ways < WAYS
    assert 0 < deeper < WAYS
    assert 0 < inside < LOOKS


def test_a_command_that_is_not_finite_changes_nothing(settings: Settings, robot: RobotDescription) -> None:
    monitor = CollisionMonitor(robot.model, settings.streaming, settings.rt.period_s)
    command = np.zeros((3, 7))
    monitor.begin(command, touching=False)
    for _ in range(8):
        monitor.look(np.full((3, 7), np.nan))
    assert (monitor.share, monitor.blocked) == (1.0, False)
    monitor.look(command)
    assert not monitor.leads_away(np.full(7, np.nan), command[0])
