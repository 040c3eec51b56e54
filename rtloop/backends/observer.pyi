import mujoco

from cobot.types import Array

class Observer:
    """Torques and wrench that the surroundings exert. Real-time safe.

    Attributes:
        effort: on the joints, shape (dof,), N·m.
        wrench: at the TCP, shape (6,), N and N·m, in the Jacobian's frame: the one that explains `effort`
            best.
        friction: dry friction of the joints in the last period, shape (dof,), N·m. The torque sensors of
            such an arm sit behind the gears: they feel the drive less this.

    Args:
        model, data: MuJoCo's, in which the arm moves.
        jacobian: of the TCP, shape (6, dof); its owner renews it before each `update`.
    """

    effort: Array
    wrench: Array
    friction: Array

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, jacobian: Array) -> None: ...
    def solve_by(self, data: mujoco.MjData) -> None: ...
    def reset(self) -> None:
        """The arm stands still and nothing pushes it."""

    def update(self) -> None:
        """After each step, while MuJoCo still has inertia and bias of the step's beginning."""
