"""How what is limited changes along a path, and in time."""

from collections.abc import Sequence

from cobot.robot.chain import Chain
from cobot.types import Array

def speeds_and_bends(chain: Chain, derivatives: Array) -> Array:
    """For the TCP's linear motion, then its angular one: magnitude of the velocity, and of the part of its
    derivative across it, shape (2, 2, n), at joints and their derivatives, shape (4, n, dof)."""

def coordinates_at(
    chain: Chain, derivatives: Array, fastest: Array, directions: Sequence[Array]
) -> tuple[Array, Array]:
    """The derivatives of all coordinates, shape (3, n, m), and the least time per s, shape (n,),
    that the velocities allow.

    Args:
        derivatives: the joints and their derivatives by s, shape (4, n, dof).
        fastest: shape (n, dof + 2), the greatest velocities of the joints and of the TCP's two motions.
        directions: rad, of each of the TCP's motions that counts, in which it is looked at: from its tangent
            to its normal. None at all without limits of the TCP.
    """

def chained(derivatives: Array, law: Array, limits: Array | None = None) -> Array:
    """Derivatives by τ, shape (3, n, m), of derivatives by s, and of s and its derivatives by τ, (4, n).

    With limits, shape (m,) or (3, m), as shares of these.
    """
