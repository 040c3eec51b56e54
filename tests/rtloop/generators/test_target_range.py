"""How far a reference may go beyond its targets. Oracles: closed forms of steps and ramps, the range."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobot.errors import InputError
from rtloop.generators.target_range import FADING_S, SHARE, STILL_PERIODS, STILL_S, TargetRange

PERIOD_S, COMMAND_S = 1e-3, 0.01


def made(start: float = 0.0) -> TargetRange:
    found = TargetRange(1, PERIOD_S, COMMAND_S)
    found.begin(np.array([start]))
    return found


def bounds(found: TargetRange) -> tuple[float, float]:
    return float(found.low[0]), float(found.high[0])


def send(found: TargetRange, targets: list[float]) -> None:
    for target in targets:
        found.update(np.array([target]))
        for _ in range(round(COMMAND_S / PERIOD_S)):
            found.advance()


def test_nothing_is_beyond_a_start_or_a_single_step() -> None:
    found = made(0.3)
    assert bounds(found) == (0.3, 0.3)
    send(found, [0.3, 0.3, 0.5, 0.5, 0.5])
    assert bounds(found) == (0.3, 0.5)
    send(found, [0.4])
    assert bounds(found) == (0.4, 0.5)


def test_a_ramp_allows_its_share_of_the_way_but_for_the_longest_step() -> None:
    found = made()
    send(found, [0.01, 0.02, 0.03])
    fade = np.exp(-COMMAND_S / FADING_S)
    way = 0.01 * (1.0 + fade + fade**2) - 0.01
    np.testing.assert_allclose(bounds(found), (0.0, 0.03 + SHARE * way), rtol=1e-12)


def test_a_ramp_of_many_steps_is_limited_by_what_is_remembered() -> None:
    found = made()
    send(found, list(0.01 * np.arange(1, 3000)))
    beyond = bounds(found)[1] - 29.99
    np.testing.assert_allclose(beyond, SHARE * FADING_S * 0.01 / COMMAND_S, rtol=0.01)


def test_a_target_that_stands_still_is_the_only_bound() -> None:
    found = made()
    send(found, [0.01, 0.02, 0.03, 0.04])
    assert bounds(found)[1] > 0.04
    for _ in range(round(max(STILL_S, STILL_PERIODS * COMMAND_S) / PERIOD_S) + 1):
        found.advance()
    assert bounds(found) == (0.04, 0.04)
    send(found, [0.03])
    assert bounds(found) == (0.03, 0.04), "and a step after that is a single one"


def test_without_targets_everything_is_permitted() -> None:
    found = made()
    found.open()
    for _ in range(1000):
        found.advance()
    assert bounds(found) == (-np.inf, np.inf)


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=60))
def test_no_bound_is_beyond_the_range_of_the_targets_by_more_than_the_share(targets: list[float]) -> None:
    found = made()
    for index, target in enumerate(targets):
        send(found, [target])
        so_far = [0.0, *targets[: index + 1]]
        more = SHARE * (max(so_far) - min(so_far)) + 1e-12
        low, high = bounds(found)
        assert min(so_far) - more <= low <= target <= high <= max(so_far) + more


def test_more_coordinates_than_there_is_room_for_are_refused() -> None:
    with pytest.raises(InputError):
        TargetRange(1000, PERIOD_S, COMMAND_S)
