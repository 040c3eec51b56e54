"""The cycle on the virtual clock, as in the tests, and its inputs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import numpy as np
from rig import Rig

from cobot.config import load_settings
from cobot.robot.description import load_robot
from cobot.types import Array

MOVED = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0])
"""The joints that the streams here move: with the others the arm comes near to itself, and slows down."""


@contextlib.contextmanager
def rig(*, simulated: bool = False, start: Array | None = None) -> Iterator[Rig]:
    """A separate loop, with MuJoCo or with an arm that is always at its commanded position."""
    settings = load_settings(None)
    made = Rig(settings, load_robot(settings), simulated=simulated, start=start)
    with np.errstate(all="ignore"):  # as in rtloop's process
        try:
            yield made
        finally:
            made.close()


def eased(time_s: Array | float, rise_s: float) -> Array:
    """A value that rises from 0 to 1 within `rise_s`, with a continuous acceleration."""
    share = np.clip(np.asarray(time_s, float) / rise_s, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
