import mujoco

from cobot.robot.model import RobotModel
from cobot.types import Array
from rtloop.backends import Impedance

def nominal_stiffness(robot: RobotModel) -> tuple[Array, Array]:
    """Stiffness of the joints, shape (dof,), N·m/rad, and of the TCP, shape (6,), N/m and N·m/rad; zero where
    the TCP cannot move.
    """

class Springs:
    """Torques that pull the arm to where it is commanded to be. Real-time safe.

    Attributes:
        joint_stiffness, tcp_stiffness: the nominal ones.

    Args:
        robot: whose model the data belongs to.
        data: MuJoCo's, in which the arm moves.
        jacobian: of the TCP, shape (6, dof); its owner renews it in each cycle.
    """

    joint_stiffness: Array
    tcp_stiffness: Array

    def __init__(self, robot: RobotModel, data: mujoco.MjData, jacobian: Array) -> None: ...
    def use(self, impedance: Impedance) -> None:
        """These springs from now on."""

    def torques(self, command: Array) -> Array:
        """Towards `command`, shape (3, dof), from MuJoCo's current state: shape (dof,), N·m."""
