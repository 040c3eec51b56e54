"""The robot: its description, model, kinematics, limits and collisions."""

# The compiled modules of this package call MuJoCo.
from cobot.robot import mujoco_library as mujoco_library
