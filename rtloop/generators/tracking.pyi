"""From where the arm is towards something else, a period at a time, within the limits."""

from cobot.types import Array, JointLimits

class Tracker:
    """Plans again in each cycle, each joint independently. Real-time safe.

    States have the shape (3, dof): rad, rad/s, rad/s².

    Attributes:
        ahead: target of the arm one period later.
    """

    @property
    def ahead(self) -> Array: ...
    def __init__(self, dof: int, period_s: float) -> None:
        """
        Raises:
            InputError: too many joints.
        """
    def brake(self, state: Array, limits: JointLimits) -> bool:
        """Towards rest from a state as fast as the limits permit; whether it is reached."""
    def approach(
        self,
        state: Array,
        target: Array,
        velocity: Array,
        limits: JointLimits,
        max_velocity: Array,
        bounds: tuple[Array, Array],
    ) -> None:
        """Towards a target, to arrive there with this velocity or a lower one.

        No faster than can be on the way: there is no going back for a run-up.

        Args:
            max_velocity: instead of that of the limits, rad/s.
            bounds: the lowest and the highest positions. Who can stop between them, towards a target
                between them, will not leave them.
        """
    def along(
        self,
        state: Array,
        request: Array,
        limits: JointLimits,
        share: float,
        catch_up: float,
        bounds: tuple[Array, Array] | None = None,
    ) -> bool:
        """Towards a request that moves: in a frame that moves with it, the difference goes to zero.

        Args:
            catch_up: how much faster than the request it may be, rad/s.
            bounds: the lowest and the highest positions, each shape (dof,). A joint that could stop only
                beyond them goes to rest at the one it moves to.

        Returns:
            Whether there is a way; it need not keep the limits, as the request need not.
        """
