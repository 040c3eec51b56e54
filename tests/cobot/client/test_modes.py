"""Which use may follow which. Oracle: the rule in docs and docstring, pair by pair."""

from __future__ import annotations

from itertools import product

from cobot.client.modes import CARTESIAN_STREAMS, JOINT_STREAMS, SWITCHES, Mode


def test_unknown_is_left_for_idle_only_and_never_chosen() -> None:
    assert set(SWITCHES) == set(Mode)
    for before, after in product(Mode, Mode):
        allowed = after is Mode.IDLE if before is Mode.UNKNOWN else after is not Mode.UNKNOWN
        assert (after in SWITCHES[before]) == allowed, (before, after)


def test_streams_are_named_for_what_they_stream() -> None:
    assert {mode.name for mode in JOINT_STREAMS} == {"RT_JOINT_IMPEDANCE", "NRT_JOINT_IMPEDANCE"}
    assert {mode for mode in Mode if "CARTESIAN" in mode.name} == CARTESIAN_STREAMS
