"""Finds a gripper that can be simulated in the joints that follow an arm: two joints that slide, or joints
that turn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco

from cobot.launch.new_robot.fingers import FingerPair, sliding_pair
from cobot.launch.new_robot.turning_fingers import TurningFingers, turning_fingers
from cobot.launch.robot_file.tree import MovingJoint

Fingers = FingerPair | TurningFingers


def kept_fingers(
    fingers: Sequence[MovingJoint], rates: Mapping[str, tuple[float, float]], degrees: bool
) -> Fingers | str:
    """Make the gripper from the fingers. If the fingers do not form a gripper, return the reason as text.

    Args:
        degrees: whether the angles in the specification are in degrees.
    """
    slides = [each for each in fingers if each.joint.type == mujoco.mjtJoint.mjJNT_SLIDE]
    if not slides:
        return turning_fingers(fingers, rates, degrees)
    moved = {each.leader for each in slides}
    # A motor that is next to the fingers which it drives moves nothing in the file.
    idle = [each for each in fingers if each.name not in moved and not set(slides) & set(each.subtree)]
    return sliding_pair([each for each in fingers if each not in idle], rates)
