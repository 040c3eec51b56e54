"""Tools on the flange of the shipped arm, and how pinocchio sees them."""

from __future__ import annotations

import numpy as np
import pinocchio
from independent_models import Pinocchio
from scipy.spatial.transform import Rotation

from cobot.robot.tool import Tool

TURN = Rotation.from_rotvec([0.3, -0.5, 0.8])
AXES = TURN.as_matrix() @ np.diag([0.05, 0.07, 0.09]) @ TURN.as_matrix().T
XX, XY, XZ, YY, YZ, ZZ = AXES[np.triu_indices(3)].tolist()
INERTIA = (XX, XY, XZ, YY, YZ, ZZ)
W, X, Y, Z = Rotation.from_rotvec([0.2, 0.1, -0.4]).as_quat(scalar_first=True).tolist()
TCP = (0.03, -0.04, 0.2, W, X, Y, Z)
DOWN_X, DOWN_Y, DOWN_Z = (Rotation.from_rotvec([0.4, 0.2, 0.0]).as_matrix() @ [0.0, 0.0, -9.81]).tolist()
TILTED = (DOWN_X, DOWN_Y, DOWN_Z)
TOOL = Tool(
    version=3, name="gripper", mass=10.0, centre=(0.02, -0.05, 0.12), inertia=INERTIA, tcp=TCP, gravity=TILTED
)
LOAD = Tool(version=4, name="load", mass=10.0, centre=(0.02, -0.05, 0.12), inertia=INERTIA, tcp=TCP)


def loaded(tool: Tool) -> Pinocchio:
    """The arm by pinocchio, with the tool as a body on the flange; its frame `tcp` is the tool's."""
    other = Pinocchio()
    frame = other.model.frames[other.tcp]  # this arm's flange is the TCP of its file
    inertia = pinocchio.Inertia(tool.mass, np.array(tool.centre), tool.inertia_matrix)
    other.model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
    if tool.tcp is not None:
        turn = Rotation.from_quat(tool.tcp[3:], scalar_first=True).as_matrix()
        place = frame.placement * pinocchio.SE3(turn, np.array(tool.tcp[:3]))
        other.model.frames[other.tcp].placement = place
    if tool.gravity is not None:
        other.model.gravity.linear = np.array(tool.gravity)
    other.data = other.model.createData()
    return other
