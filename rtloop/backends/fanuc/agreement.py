"""Checks that the controller and the model describe the same arm, and determines the reference from which the
controller measures joint 3.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from cobot.foreign import fixed
from cobot.orientations import kuka_quaternion
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits, Pose
from rtloop.backends import BackendError
from rtloop.backends.agreement import check_agreement
from rtloop.backends.fanuc.joints import J3, JointUnits, to_horizon
from rtloop.backends.fanuc.messages import StatusPacket
from rtloop.backends.fanuc.options import FanucOptions
from rtloop.results import ACCEPTED, Accepted, Rejected

SAME_DEG = 0.1
"""Maximum difference between an axis in the two interfaces at rest, degrees. It allows for rounding."""


def face_plate(packet: StatusPacket) -> Pose | None:
    """Return the reported pose of the face plate in the world frame; None if the controller reports none.

    W, P and R are successive rotations about the fixed axes x, y and z.
    """
    x, y, z, w, p, r = packet.pose[:6]
    if not all(map(math.isfinite, packet.pose[:6])) or not any(packet.pose[:6]):
        return None
    turn = kuka_quaternion(math.radians(r), math.radians(p), math.radians(w))
    return Pose(1e-3 * np.array([x, y, z]), np.array(turn))


class ArmAgreement:
    """Compares the controller's report at rest with the model."""

    def __init__(self, options: FanucOptions, limits: JointLimits, model: RobotModel) -> None:
        self._options, self._limits, self._model = options, limits, model

    def units(self, packet: StatusPacket, rmi_axes: tuple[float, ...] | None) -> JointUnits:
        """Find the conversion between this controller's axes and the model's joints.

        Args:
            rmi_axes: the axes from the Remote Motion Interface, converted to the form of Stream Motion; None
                if the interface does not report them.

        Raises:
            BackendError: the controller's pose differs from the model's, or the reference of joint 3 cannot
                be determined.
        """
        asked = self._options.j3
        kinds = [asked] if asked != "auto" else ["relative", "horizon"]
        found = {kind: JointUnits(self._limits, horizon=kind == "horizon") for kind in kinds}
        plate = face_plate(packet) if self._options.check_pose else None
        if plate is not None:
            results = {kind: self._agrees(units, packet, plate) for kind, units in found.items()}
            good = [kind for kind, result in results.items() if result is ACCEPTED]
            if not good:
                (rejected, *_) = (each for each in results.values() if isinstance(each, Rejected))
                raise BackendError(rejected.reason + self._hint(found, packet, plate))
            kinds = good
        elif asked == "auto" and self._limits.dof > J3 and rmi_axes is not None:
            kinds = self._by_rmi(packet.joints, rmi_axes)
        return found[kinds[0]]

    def _agrees(self, units: JointUnits, packet: StatusPacket, plate: Pose) -> Accepted | Rejected:
        joints = units.to_model(packet.joints)
        if not np.isfinite(joints).all():
            return Rejected("the controller reports a joint that is not finite")
        return check_agreement(self._model, joints, self._in_base(plate, joints))

    def _in_base(self, plate: Pose, joints: Array) -> Pose:
        """Return the pose of the face plate in the model's base frame. The origin of FANUC's world frame is
        at the height of joint 2.
        """
        height_m = self._options.world_z_m
        if height_m is None:
            ours = self._model.forward(joints) @ self._model.flange_in_tcp()
            height_m = float(ours.position[2] - plate.position[2])
        return dataclasses.replace(plate, position=plate.position + np.array([0.0, 0.0, height_m]))

    def _hint(self, found: dict[str, JointUnits], packet: StatusPacket, plate: Pose) -> str:
        """Return the advice to set the other reference of joint 3, if only one was checked and the other one
        would agree; otherwise "".
        """
        if len(found) > 1 or self._limits.dof <= J3:
            return ""
        other = "relative" if "horizon" in found else "horizon"
        units = JointUnits(self._limits, horizon=other == "horizon")
        agrees = self._agrees(units, packet, plate) is ACCEPTED
        return f". With robot.backend.j3: {other} they agree" if agrees else ""

    @staticmethod
    def _by_rmi(axes: tuple[float, ...], rmi_axes: tuple[float, ...]) -> list[str]:
        apart = np.abs(np.subtract(axes, rmi_axes))
        if apart.max() < SAME_DEG:
            return ["relative"]
        if np.abs(np.subtract(axes, to_horizon(rmi_axes))).max() < SAME_DEG:
            return ["horizon"]
        axis = int(apart.argmax())
        raise BackendError(
            f"Stream Motion reports axis {axis + 1} at {fixed(axes[axis], 3)} degrees, the Remote Motion "
            f"Interface at {fixed(rmi_axes[axis], 3)}: is the arm moving, or is this a different robot? "
            "To skip this comparison, set robot.backend.j3 to relative or horizon"
        )
