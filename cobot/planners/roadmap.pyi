"""The shortest way through a cloud of configurations."""

from cobot.robot.clearance import Clearance
from cobot.types import Array

def shortest(
    clearance: Clearance, nodes: Array, goals: int, shorter_than_rad: float, work: int
) -> Array | None:
    """The corners of the shortest free way from the first node to a goal, shape (n, dof).

    Args:
        nodes: shape (n, dof), rad. A straight motion may connect any two of them.
        goals: number of nodes at the end of `nodes` that are goals.
        work: the search ends after about this many configurations have been checked.

    Returns:
        None if there is no way shorter than `shorter_than_rad`, or none is found within `work`.
    """
