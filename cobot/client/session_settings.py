"""The settings of a streaming session. They are fixed when the session begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot.client.modes import CoordType
from cobot.errors import InputError
from cobot.ipc.layout import Interpolation, Stream
from cobot.ipc.session_rules import (
    DAMPING_RATIO,
    NO_FRAME,
    damping_flaw,
    decimation,
    nominal_session,
    stiffness_flaw,
)
from cobot.types import Array, vector


class SessionSettings:
    """The settings for the sessions of a `Robot`. A call affects only sessions that begin later.

    Args:
        info: record of `cobot.ipc.layout.info_dtype`.
    """

    def __init__(self, info: np.ndarray) -> None:
        self._limits_of = info
        self._dof = len(info["max_velocity"])
        self._request = nominal_session(info)

    def set_joint_impedance(self, K_q: Sequence[float], Z_q: Sequence[float] | None = None) -> None:
        """Set stiffness (N·m/rad, up to `info().K_q_nom`) and damping ratio (0.3 to 1) of the joints.

        Raises:
            InputError: a value is invalid; the message gives the limits.
        """
        self._set_impedance("", K_q, Z_q, "K_q", "Z_q")

    def set_cartesian_impedance(self, K_x: Sequence[float], Z_x: Sequence[float] | None = None) -> None:
        """Set stiffness (N/m, N·m/rad, up to `info().K_x_nom`) and damping ratio (0.3 to 1) of the TCP.

        Raises:
            InputError: a value is invalid; the message gives the limits.
        """
        self._set_impedance("cartesian_", K_x, Z_x, "K_x", "Z_x")

    def set_max_contact_wrench(self, wrench: Sequence[float]) -> None:
        """Set the external force (N) and torque (N·m) at the TCP at which a session ends; both above 0."""
        self._request["max_contact_wrench"] = _positive(wrench, 6, "wrench")

    def set_max_contact_torque(self, torques: Sequence[float]) -> None:
        """Set the external joint torques (N·m) at which a session ends. They must be above 0."""
        self._request["max_contact_torque"] = _positive(torques, self._dof, "torques")

    def set_force_control_axis(
        self, axes: Sequence[bool], max_vel: Sequence[float] = (1.0, 1.0, 1.0)
    ) -> None:
        """Select the axes of the force frame along which the wrench is controlled instead of the pose.

        Args:
            axes: whether each axis is selected, in the order x, y, z, rx, ry, rz.
            max_vel: maximum speed of force control along x, y and z, m/s.
        """
        if len(axes) != 6 or not all(isinstance(axis, bool | np.bool_) for axis in axes):
            raise InputError(f"axes must be six True or False values, got {list(axes)}")
        self._request["force_velocity"][:3] = _positive(max_vel, 3, "max_vel")
        self._request["force_axes"] = axes

    def set_force_control_frame(self, coord: CoordType, T: Sequence[float] = NO_FRAME) -> None:
        """Set the frame of the force axes, relative to the world frame or to the TCP's frame. It has a
        position x, y, z, in m, and a quaternion w, x, y, z.

        In the world frame, only its orientation is used, because the axes go through the TCP.
        """
        frame = vector(T, 7, name="T")
        if abs(float(np.linalg.norm(frame[3:])) - 1.0) > 1e-3:
            raise InputError(f"the quaternion of T must have length 1, got {frame[3:].tolist()}")
        self._request["force_in_tcp"] = CoordType(coord) is CoordType.TCP
        self._request["force_frame"] = frame

    def set_null_space_posture(self, ref_pos: Sequence[float]) -> None:
        """Set the joint angles (rad) to which the arm stays as close as the TCP pose permits."""
        posture = vector(ref_pos, self._dof, name="ref_pos")
        low, high = self._limits_of["min_position"], self._limits_of["max_position"]
        if not ((posture >= low) & (posture <= high)).all():
            raise InputError(
                f"ref_pos must be from {low.tolist()} to {high.tolist()}, got {posture.tolist()}"
            )
        self._request["posture"] = posture

    def _describe(self, stream: Stream, rate_hz: float, interpolate: bool, interpolation: str | None) -> None:
        if not 1 <= rate_hz <= 1000:
            raise InputError(f"inner_control_hz must be from 1 to 1000, got {rate_hz}")
        name = interpolation or ("linear" if interpolate else "none")
        valid = [kind.name.lower() for kind in Interpolation]
        if name not in valid:
            raise InputError(f"unknown interpolation {name!r}; valid values: {', '.join(valid)}")
        self._request["stream"] = stream
        self._request["interpolation"] = Interpolation[name.upper()]
        self._request["decimation"] = decimation(rate_hz, float(self._limits_of["period_s"]))

    def _set_impedance(
        self, prefix: str, stiffness: Sequence[float], damping: Sequence[float] | None, *names: str
    ) -> None:
        nominal = self._limits_of[f"{prefix}stiffness"]
        values = vector(stiffness, len(nominal), name=names[0])
        if flaw := stiffness_flaw(names[0], values, nominal):
            raise InputError(flaw)
        ratios = vector(
            [DAMPING_RATIO] * len(nominal) if damping is None else damping, len(nominal), name=names[1]
        )
        if flaw := damping_flaw(names[1], ratios):
            raise InputError(flaw)
        self._request[f"{prefix}stiffness"], self._request[f"{prefix}damping_ratio"] = values, ratios

    SetJointImpedance, SetCartesianImpedance = set_joint_impedance, set_cartesian_impedance
    SetMaxContactWrench, SetMaxContactTorque = set_max_contact_wrench, set_max_contact_torque
    SetForceControlAxis, SetForceControlFrame = set_force_control_axis, set_force_control_frame
    SetNullSpacePosture = set_null_space_posture


def _positive(values: Sequence[float], size: int, name: str) -> Array:
    numbers = vector(values, size, name=name)
    if not (numbers > 0.0).all():
        raise InputError(f"{name} must be above 0, got {numbers.tolist()}")
    return numbers
