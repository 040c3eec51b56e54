"""Advice about millimetres, added to errors about positions that no arm reaches."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cobot.motions.requests import MotionRequest
from cobot.robot.inverse_kinematics import reach_gap
from cobot.robot.model import RobotModel
from cobot.types import Array, Pose
from cobot.units import FAR_M, MILLIMETRES_TO_M


def advice_on_units(model: RobotModel, request: MotionRequest) -> str:
    """The advice if a position of the request is out of reach and looks like millimetres; otherwise ""."""
    for position in _positions(request):
        if FAR_M < np.abs(position).max() <= MILLIMETRES_TO_M and _is_out_of_reach(model, position):
            x, y, z = position
            return f"x {x:.6g}, y {y:.6g}, z {z:.6g} look like millimetres; positions are in m"
    return ""


def _positions(request: MotionRequest) -> Iterable[Array]:
    """The positions in the request, in the base frame, m."""
    if isinstance(request.goal, Pose):
        yield request.goal.position
    if request.via is not None:
        yield request.via
    if request.arc is not None:
        yield request.arc.centre
    yield from (pose.position for pose in request.through)


def _is_out_of_reach(model: RobotModel, position: Array) -> bool:
    return reach_gap(model, Pose(position, np.array([1.0, 0.0, 0.0, 0.0]))) > 0.0
