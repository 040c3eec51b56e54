"""The shortest way through a cloud of configurations."""

from cobot.robot.clearance import Clearance
from cobot.types import Array

def shortest(
    clearance: Clearance, nodes: Array, goals: int, shorter_than_rad: float, work: int
) -> Array | None:
    """The corners of the shortest free way from the first node to one of the last, shape (n, dof).

    Args:
        nodes: shape (n, dof), rad; each may be joined to each by a straight motion.
        goals: so many of the last ones are goals.
        work: it gives up after about so many configurations looked at.

    Returns:
        None if there is no way shorter than this, or none is found with so much work.
    """
