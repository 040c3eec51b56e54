"""The part of its effort limit that a motion leaves to each drive.

Oracle: the rule in docs/planning.md, by hand. Whole motions are in timing/test_time_law.py, the change from
one motion to another in blending/test_going_over.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from cobot.planners.effort_reserve import allowed_shares


@pytest.mark.parametrize(
    ("holding", "allowed"),
    [(0.0, 0.98), (0.9, 0.98), (-0.9, 0.98), (0.961, 0.98), (0.971, 0.985), (-0.971, 0.985), (0.989, 0.994)],
)
def test_a_motion_uses_98_percent_or_half_of_what_holding_the_arm_leaves(
    holding: float, allowed: float
) -> None:
    assert allowed_shares(np.array([holding])) == pytest.approx([allowed], abs=1e-12)


def test_wherever_the_arm_can_be_held_something_is_left_to_move_it_and_to_the_drive() -> None:
    holding = np.linspace(0.0, 0.9989, 500)
    assert (holding < allowed_shares(holding)).all()
    assert (allowed_shares(holding) < 0.999).all()
