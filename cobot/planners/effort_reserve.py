"""The part of its effort limit that a planned motion leaves to each drive.

A drive at its limit cannot correct its position. docs/planning.md, "Effort reserve", explains these shares.
Trajectories that clients send with their own times may use the whole limit.
"""

from __future__ import annotations

import numpy as np

from cobot.types import Array

PLANNED_EFFORT = 0.98
"""Maximum share of the effort limits in planned motions. `allowed_shares` describes the exception."""
TRANSITION_EFFORT = 0.99
"""Maximum share of the effort limits where a motion is joined with the next one. Both may already use
`PLANNED_EFFORT`. Without a margin above that value the join would often fail, and the arm would stop between
the two motions.
"""
MAX_HOLDING_EFFORT = 0.999
"""If holding the arm takes more than this share of an effort limit, no effort is left for a motion."""


def allowed_shares(holding: Array) -> Array:
    """Return the share of the effort limits that a motion may use in a posture.

    This is `PLANNED_EFFORT`. Exception: if holding the arm takes nearly as much or more, the share lies
    halfway between the holding effort and `MAX_HOLDING_EFFORT`, because the arm could hardly move otherwise.

    Args:
        holding: share of the limit that holding the arm takes, of either sign.
    """
    return np.asarray(np.maximum(PLANNED_EFFORT, 0.5 * (np.abs(holding) + MAX_HOLDING_EFFORT)))
