"""Parts of a trajectory. Oracle: the whole, sampled."""

from __future__ import annotations

import numpy as np
import pytest

from cobot.trajectory import Trajectory, from_hermite
from cobot.trajectory_parts import cut, remainder_at


def wavy(pieces: int = 40) -> Trajectory:
    random = np.random.default_rng(5)
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.01, 0.2, pieces))])
    return from_hermite(times, *(random.uniform(-1.0, 1.0, (pieces + 1, 7)) for _ in range(3)))


@pytest.mark.parametrize("share", [0.0, 0.003, 0.37, 0.999])
def test_what_is_left_of_a_motion_has_the_same_polynomials(share: float) -> None:
    whole = wavy()
    time_s = share * whole.duration_s
    left, offset_s = remainder_at(whole, time_s)
    index = int(np.flatnonzero(whole.breakpoints_s == offset_s)[0])
    assert offset_s <= time_s <= whole.breakpoints_s[index + 1]
    np.testing.assert_array_equal(left.coefficients, whole.coefficients[index:])
    np.testing.assert_array_equal(left.breakpoints_s, whole.breakpoints_s[index:] - offset_s)


def test_nothing_before_the_start_and_a_piece_after_the_end_is_left() -> None:
    whole = wavy()
    assert remainder_at(whole, -1.0)[1] == 0.0
    assert remainder_at(whole, 1e9)[0].segments == 1


@pytest.mark.parametrize("seed", range(5))
def test_a_part_between_two_times_is_the_motion_there(seed: int) -> None:
    whole, random = wavy(), np.random.default_rng(seed)
    begin_s, end_s = np.sort(random.uniform(0.0, whole.duration_s, 2))
    part = cut(whole, begin_s, end_s)
    times = np.linspace(0.0, part.duration_s, 200)
    for order in range(3):
        np.testing.assert_allclose(
            part.sample(times, order), whole.sample(begin_s + times, order), atol=1e-6, rtol=1e-6
        )
