"""The compiled tracker against its law in numpy and Ruckig (`laws.tracking`), on random states."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from laws.tracking import Tracker as PlainTracker
from sample_counts import samples

from cobot.types import Array, JointLimits
from rtloop.generators.tracking import Tracker

PERIOD_S = 1e-3
DOF = 16
CALLS = samples(6250)  # of 16 joints: 100,000 problems
ALIKE = 0.9999
"""Ruckig accepts ends 1e-8 rad beside the target, and once in many thousands misses the fastest way."""


def limits_of(random: np.random.Generator) -> JointLimits:
    names = tuple(f"joint{i}" for i in range(DOF))
    velocity, acceleration, jerk = (
        random.uniform(low, high, DOF) for low, high in ((1, 4), (2, 12), (20, 200))
    )
    return JointLimits(
        names, -np.full(DOF, 3.0), np.full(DOF, 3.0), velocity, acceleration, jerk, np.ones(DOF)
    )


def state_of(limits: JointLimits, random: np.random.Generator, level: float) -> Array:
    rates = level * random.uniform(-1.0, 1.0, (2, DOF)) * [limits.max_velocity, limits.max_acceleration]
    return np.array([random.uniform(-2.9, 2.9, DOF), *rates])


def share_alike(step: Callable[[PlainTracker | Tracker, int], object]) -> float:
    """Of the joints, which both trackers bring to the same state."""
    plain, compiled = PlainTracker(DOF, PERIOD_S), Tracker(DOF, PERIOD_S)
    alike = 0
    for call in range(CALLS):
        assert step(plain, call) == step(compiled, call)
        alike += np.isclose(compiled.ahead, plain.ahead, rtol=1e-9, atol=1e-9).all(axis=0).sum()
    return alike / (CALLS * DOF)


def test_both_brake_alike() -> None:
    random = np.random.default_rng(1)
    limits = limits_of(random)
    states = [state_of(limits, random, random.choice([0.0, 1e-6, 0.5, 1.3])) for _ in range(CALLS)]
    assert share_alike(lambda tracker, k: tracker.brake(states[k], limits)) == 1.0


def test_both_approach_a_target_alike() -> None:
    random = np.random.default_rng(2)
    limits = limits_of(random)
    bounds = limits.min_position, limits.max_position
    states = [state_of(limits, random, random.choice([0.0, 0.5, 0.9])) for _ in range(CALLS)]
    aims = [
        (
            (state[0] + random.choice([1e-4, 1e-2, 1.0]) * random.uniform(-1.0, 1.0, DOF)).clip(-2.99, 2.99),
            random.choice([0.0, 1.0]) * random.uniform(-1.2, 1.2, DOF) * limits.max_velocity,
        )
        for state in states
    ]

    def step(tracker: PlainTracker | Tracker, k: int) -> None:
        tracker.approach(states[k], *aims[k], limits, limits.max_velocity, bounds)

    assert share_alike(step) > ALIKE


def test_both_go_along_with_a_request_alike() -> None:
    random = np.random.default_rng(3)
    limits = limits_of(random)
    states = [state_of(limits, random, random.choice([0.0, 0.3, 0.8])) for _ in range(CALLS)]
    requests = []
    for state in states:
        off = random.choice([1e-4, 1e-2, 0.3]) * random.uniform(-1.0, 1.0, (3, DOF))
        requests.append(
            (state + off * np.array([[1.0], [3.0], [10.0]])) * [[1.0], [random.choice([0, 1])], [1.0]]
        )

    def step(tracker: PlainTracker | Tracker, k: int) -> bool:
        return tracker.along(states[k], requests[k], limits, 0.9, (np.inf, 0.5)[k % 2])

    assert share_alike(step) > ALIKE
