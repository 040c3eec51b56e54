"""Configurations that keep path constraints of the TCP, and steps between them."""

from cobot.robot.chain import Chain
from cobot.robot.clearance import Clearance
from cobot.types import Array

class Projection:
    def __init__(
        self,
        chain: Chain,
        low: Array,
        high: Array,
        cone: tuple[Array, Array, float] | None,
        box: tuple[Array, Array] | None,
        inside: float,
        inside_share: float,
    ) -> None:
        """
        Args:
            low, high: ranges of the joints, shape (dof,).
            cone: the tool's axis in the TCP's frame, its direction in the base frame, both shape (3,) and of
                unit length, and the largest angle between them, rad.
            box: lowest and highest corner for the TCP, shape (3,), m.
            inside: how far inside the constraints a projected configuration stays, rad or m.
            inside_share: the same as a share of a narrower range.
        """

    def keeps(self, joints: Array) -> bool:
        """Whether a configuration, shape (dof,), keeps all constraints."""

    def project(self, joints: Array) -> Array | None:
        """A configuration near a given one that keeps all constraints with a margin; None if no such
        configuration is found.

        Newton's method on the violated constraints, with the smallest joint motion.
        """

    def is_step(self, clearance: Clearance, begin: Array, end: Array, step_rad: float) -> bool:
        """Whether the straight joint motion between two configurations is free of collisions, keeps the
        constraints in its middle, and is at most three times as long as `step_rad`.
        """

    def steps_toward(
        self, clearance: Clearance, begin: Array, target: Array, step_rad: float
    ) -> tuple[list[Array], bool]:
        """Take steps from one configuration towards a target, as far as possible.

        Each step of `step_rad` is projected onto the constraints. The last step is the one before a step
        that fails, that is rejected by `is_step`, or that hardly brings the arm nearer to the target.

        Returns:
            The configurations after `begin`, and whether the last one is the target.
        """
