"""How far a reference may go beyond its targets.

Oracles: closed forms of steps and ramps, the range, scipy's rotations.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cobot.errors import InputError
from cobot.types import Array
from rtloop.generators.target_range import (
    FADING_S,
    POSE_SHARE,
    SHARE,
    STILL_PERIODS,
    STILL_S,
    PoseRange,
    TargetRange,
)

PERIOD_S, COMMAND_S = 1e-3, 0.01
STILL_AFTER = round(max(STILL_S, STILL_PERIODS * COMMAND_S) / PERIOD_S) + 1
"""Periods after which a target stands still."""
EVERYWHERE = (-np.inf, np.inf)


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


def wait(found: TargetRange | PoseRange) -> None:
    for _ in range(STILL_AFTER):
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
    wait(found)
    assert bounds(found) == (0.04, 0.04)
    send(found, [0.03])
    assert bounds(found) == (0.03, 0.04), "and a step after that is a single one"


def test_without_targets_everything_is_permitted() -> None:
    found = made()
    found.open()
    for _ in range(1000):
        found.advance()
    assert bounds(found) == EVERYWHERE
    send(found, [0.1, 0.2])
    assert bounds(found) == EVERYWHERE, "until the next begin"
    found.begin(np.array([0.2]))
    assert bounds(found) == (0.2, 0.2)


def test_a_stated_motion_permits_everything_until_its_target_stands_still() -> None:
    found = made()
    found.open_at(np.array([0.1]))
    assert bounds(found) == EVERYWHERE
    wait(found)
    assert bounds(found) == (0.1, 0.1)
    for _ in range(3 * STILL_AFTER):
        found.open_at(np.array([0.1]))
        found.advance()
        assert bounds(found) == (0.1, 0.1), "however often it is stated again"
    found.open_at(np.array([0.2]))
    assert bounds(found) == EVERYWHERE, "it moves on"


def test_after_a_stated_motion_the_range_begins_at_its_last_target() -> None:
    found = made()
    for target in (0.1, 0.2, 0.3):
        found.open_at(np.array([target]))
    send(found, [0.3])
    assert bounds(found) == (0.3, 0.3)
    send(found, [0.25])
    assert bounds(found) == (0.25, 0.3)


def test_targets_that_are_known_ahead_extend_the_range() -> None:
    found = made(0.1)
    found.extend(np.array([0.4]))
    found.extend(np.array([0.2]))
    assert bounds(found) == (0.1, 0.4)
    found.extend(np.array([-0.3]))
    assert bounds(found) == (-0.3, 0.4)


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


# Poses


def pose(position: list[float], turn: list[float]) -> Array:
    """A pose with a turn, as a rotation vector about the axes of the base, from the base."""
    return np.array([*position, *Rotation.from_rotvec(turn).as_quat(scalar_first=True)])


def begun(at: Array) -> PoseRange:
    found = PoseRange(PERIOD_S, COMMAND_S)
    found.begin(at)
    return found


def test_a_pose_range_begins_at_its_pose_and_measures_the_room_from_another() -> None:
    found = begun(pose([0.4, 0.1, 0.6], [0.0, 0.0, 0.3]))
    low, high = found.room(pose([0.5, 0.1, 0.6], [0.0, 0.0, 0.1]))
    np.testing.assert_allclose(low, [-0.1, 0.0, 0.0, 0.0, 0.0, 0.2], atol=1e-15)
    np.testing.assert_array_equal(high, low)


def test_a_range_of_poses_allows_its_share_of_the_way_and_of_the_turn() -> None:
    found = begun(pose([0.4, 0.1, 0.6], [0.0, 0.0, 0.0]))
    for step in (1, 2, 3):
        there = pose([0.4, 0.1 + 0.01 * step, 0.6], [0.02 * step, 0.0, 0.0])
        found.update(there)
        for _ in range(round(COMMAND_S / PERIOD_S)):
            found.advance()
    fade = np.exp(-COMMAND_S / FADING_S)
    share = POSE_SHARE * (fade + fade**2)
    low, high = found.room(there)
    np.testing.assert_allclose(high, [0.0, 0.01 * share, 0.0, 0.02 * share, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(low, [0.0, -0.03, 0.0, -0.06, 0.0, 0.0], atol=1e-12)


def test_a_pose_with_the_other_sign_of_its_quaternion_is_no_turn() -> None:
    found = begun(pose([0.4, 0.1, 0.6], [0.0, 0.5, 0.0]))
    there = pose([0.4, 0.1, 0.6], [0.0, 0.5, 0.0]) * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0]
    found.update(there)
    assert not any(bound.any() for bound in found.room(there))


def test_a_pose_stands_still_after_a_while_whatever_twist_is_stated() -> None:
    here = pose([0.4, 0.1, 0.6], [0.0, 0.0, 0.0])
    found = begun(here)
    assert not found.stands(here)
    there = pose([0.4, 0.2, 0.6], [0.0, 0.0, 0.0])
    found.update(there, True)
    assert np.isinf(found.room(there)).all()
    wait(found)
    assert found.stands(there)
    assert not found.stands(here)
    found.update(there, True)
    assert not any(bound.any() for bound in found.room(there))
    found.update(here, True)
    assert not found.stands(here)
    assert np.isinf(found.room(here)[0][1]), "along y it moves on"
