"""The steps of CHOMP: obstacles push the points of a path, and each push is spread over the whole path."""

from cobot.robot.clearance import Clearance
from cobot.types import Array

class PathDescent:
    """A path that moves. Only its ends stay in place."""

    def __init__(
        self,
        clearance: Clearance,
        points: Array,
        smoothest: Array,
        spread: Array,
        low: Array,
        high: Array,
        pushed_m: float,
        width_m: float,
    ) -> None:
        """
        Args:
            points: evenly spaced points of the path, shape (n, dof), n at least 3. `step` changes them in
                place.
            smoothest: the inner points of the smoothest path, shape (n - 2, dof).
            spread: the matrix A⁻¹ by which the inner points share a push, shape (n - 2, n - 2).
            low, high: the joint limits, shape (dof,).
            pushed_m, width_m: the push has its full strength up to the distance `pushed_m`, m, and becomes 0
                at `pushed_m + width_m`.
        """

    @property
    def gradient(self) -> Array:
        """The gradient of the obstacle cost at the inner points, shape (n - 2, dof), from the last `push`."""

    def push(self) -> float:
        """Compute the gradient of the obstacle cost (equations 20 and 21 of the paper) at the inner points.

        Every pair is a body point with the other geom as its obstacle. The cost of its distance is 0 above
        `pushed_m + width_m`, quadratic between this and `pushed_m`, and linear below. It is weighted by the
        speed of the joints along the path. The curvature term vanishes on nearly straight paths and is left
        out.

        Returns:
            The smallest distance at the inner points, m, or `pushed_m + width_m` if it is larger.
        """

    def step(self, weight: float, longest: float) -> bool:
        """Move the inner points against the gradient of smoothness and obstacle cost, and back into the joint
        limits as in section 4.3 of the paper: subtract the violation, smoothed by A⁻¹.

        Args:
            weight: weight of the smoothness.
            longest: the largest change of a joint, rad.

        Returns:
            Whether a point has moved.
        """
