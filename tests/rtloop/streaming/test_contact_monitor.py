"""How hard the surroundings may push. Oracle: numpy."""

from __future__ import annotations

import numpy as np
import pytest
from sample_counts import samples

from cobot.errors import InputError
from rtloop.streaming.contact_monitor import ContactMonitor

NAMES = tuple(f"joint{number}" for number in range(1, 8))
PLACES = [
    *(("N·m", f"on {name}", name) for name in NAMES),
    *(("N", f"along {axis} at the TCP", axis) for axis in "xyz"),
    *(("N·m", f"about {axis} at the TCP", f"r{axis}") for axis in "xyz"),
]
SESSIONS, PUSHES = samples(1000), 20
"""Of 13 numbers each: a quarter of a million."""


def test_what_exceeds_the_most_is_found_and_named() -> None:
    random = np.random.default_rng(1)
    monitor, dof = ContactMonitor(NAMES), len(NAMES)
    exceeded = 0
    for _ in range(SESSIONS):
        most = random.uniform(0.5, 50.0, dof + 6)
        most[random.random(dof + 6) < 0.3] = np.inf
        monitor.begin(most[:dof], most[dof:])
        pushes = random.normal(size=(PUSHES, dof + 6)) * random.choice([0.1, 5.0, 60.0])
        pushes[0] = most  # as much as is permitted
        pushes[0, np.isinf(most)] = 1e308
        excess = np.abs(pushes) - most
        worst = excess.argmax(axis=1)
        for push, index, beyond in zip(pushes, worst.tolist(), excess.max(axis=1) > 0.0, strict=True):
            assert monitor.check(push) == beyond
            if not beyond:
                continue
            exceeded += 1
            unit, where, name = PLACES[index]
            reason = monitor.reason()
            assert reason == f"contact: {push[index]:.1f} {unit} {where}, allowed: {most[index]:g}"
            assert (reason.of, reason.value, reason.limit) == ((name,), push[index], most[index])
            assert reason.unit == unit
    assert SESSIONS * PUSHES // 5 < exceeded < SESSIONS * PUSHES


def test_what_is_no_number_exceeds_nothing_and_hides_nothing() -> None:
    monitor = ContactMonitor(NAMES)
    monitor.begin(np.full(7, 10.0), np.full(6, 10.0))
    push = np.full(13, np.nan)
    assert not monitor.check(push)
    push[9] = -11.0
    assert monitor.check(push)
    assert monitor.reason() == "contact: -11.0 N along z at the TCP, allowed: 10"


def test_more_joints_than_there_is_room_for_are_refused() -> None:
    with pytest.raises(InputError, match="17 joints, allowed: up to 16"):
        ContactMonitor([f"joint{number}" for number in range(17)])
