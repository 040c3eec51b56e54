"""The cheapest way through a graph of arm angles, from place to place of a path."""

import numpy as np
import numpy.typing as npt

from cobot.types import Array

def cheapest(
    rows: Array, costs: Array, start: Array, weights: Array, window: int, step_rad: float
) -> tuple[npt.NDArray[np.intp], int]:
    """The indices of the angles at all places, shape (n,), and the number of places that some way reaches.

    There are no indices if no way reaches the last place. The cost of an edge is the sum of the squares of
    the joints' steps times their weights.

    Args:
        rows: joints, shape (n, m, dof), at places and angles; the last angle is next to the first.
        costs: costs of the nodes, shape (n, m); infinite if there is no node.
        start: joints, shape (dof,), from which edges lead to all nodes of the first place.
        weights: shape (dof,).
        window: largest difference of the angles' indices along an edge.
        step_rad: largest turn of a joint along an edge.
    """

def link(
    rows: Array, costs: Array, before: Array, costs_before: Array, weights: Array, step_rad: float
) -> tuple[npt.NDArray[np.intp], Array]:
    """For each of n nodes of a place, the index of the node before on the cheapest way to it, shape (n,), and
    the cost of that way with the node's own cost; infinite if no edge leads to the node.

    Args:
        rows, before: joints at this place and at the one before, shapes (n, dof) and (m, dof).
        costs, costs_before: costs of the nodes, shape (n,), and of the ways to those before, shape (m,).
    """

def leads(rows: Array, good: npt.NDArray[np.bool_], start: Array, window: int, step_rad: float) -> int:
    """The number of places that some way reaches, whatever it costs; `good` marks the nodes, shape (n, m)."""
