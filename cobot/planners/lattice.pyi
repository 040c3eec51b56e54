"""The cheapest way through a graph of arm angles, from place to place of a path."""

import numpy as np
import numpy.typing as npt

from cobot.types import Array

def cheapest(
    rows: Array, costs: Array, start: Array, weights: Array, window: int, step_rad: float
) -> tuple[npt.NDArray[np.intp], int]:
    """The angles' indices at all places, shape (n,), and how many places any way leads to.

    The indices are empty where no way leads to the last place. An edge costs the sum of the squares of the
    joints' steps times their weights.

    Args:
        rows: joints, shape (n, m, dof), at places and angles; the last angle is next to the first.
        costs: of the nodes, shape (n, m), infinite where there is none.
        start: shape (dof,), from which edges lead to all nodes of the first place.
        weights: shape (dof,).
        window: edges lead to angles so many further or less far.
        step_rad: in which no joint turns further than this.
    """
