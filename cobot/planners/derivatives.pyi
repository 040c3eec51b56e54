"""Derivatives of the limited quantities along a path, and over time."""

from collections.abc import Sequence

from cobot.robot.chain import Chain
from cobot.types import Array

def speeds_and_bends(chain: Chain, derivatives: Array) -> Array:
    """The length of the TCP's velocity, and of the part of its derivative normal to it, shape (2, 2, n).

    The linear motion comes first, then the angular one.

    Args:
        derivatives: the joints and their derivatives, shape (4, n, dof).
    """

def coordinates_at(
    chain: Chain, derivatives: Array, fastest: Array, directions: Sequence[Array]
) -> tuple[Array, Array]:
    """The derivatives of all coordinates, shape (3, n, m), and the shortest time per s, shape (n,), that the
    velocity limits allow.

    Args:
        derivatives: the joints and their derivatives by s, shape (4, n, dof).
        fastest: velocity limits of the joints and of the TCP's linear and angular motion, shape (n, dof + 2).
        directions: for each limited motion of the TCP the directions in which it is limited, rad from its
            tangent towards its normal. Empty without limits of the TCP.
    """

def chained(derivatives: Array, law: Array, limits: Array | None = None) -> Array:
    """Derivatives by τ, shape (3, n, m), computed from the derivatives by s, and from s and its derivatives
    by τ, shape (4, n).


    If `limits`, shape (m,) or (3, m), are given, the results are shares of them.
    """
