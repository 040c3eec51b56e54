"""Defaults and checks for the records that clients write into shared memory.

`cobot.ipc.layout` defines the records. The checks raise an InputError that gives the field, the value and the
valid range.
"""

from __future__ import annotations

import numpy as np

from cobot.errors import InputError
from cobot.ipc.layout import CHUNK_POINTS, Stream, session_dtype
from cobot.types import Array

DAMPING_RATIO = 0.7
DAMPING_RATIOS = (0.3, 1.0)
"""Range of damping ratios. Below this range the arm would oscillate; above it the control cycle could not
follow.
"""
MAX_DECIMATION = 1000
"""Maximum number of cycles between two targets."""
FORCE_RATE_RAD_S = 5.0
"""Decay rate of a force error if only the arm's own springs are elastic, rad/s. With elastic surroundings the
error decays more slowly. The rate is well below the bandwidth of the estimated external wrench.
"""
NO_FRAME = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
MOVE_S = (0.001, 600.0)
"""Shortest and longest duration of a `move_to_pose`, s."""
QUATERNION_TOLERANCE = 1e-2
MIN_STEP_S = 0.0005
LATEST_S = 1e9
"""Largest absolute time in a chunk, s: about thirty years."""
_TARGETS = {
    Stream.JOINT_IMPEDANCE: ("joints", "joint_velocity", "joint_acceleration"),
    Stream.CARTESIAN: ("pose", "wrench", "twist", "twist_rate"),
    Stream.JOINT_TORQUE: ("joints",),
    Stream.GUIDED: (),
}


def nominal_session(info: np.ndarray) -> np.ndarray:
    """The settings of the default session: the robot's nominal stiffness, no force control, and no contact
    limits.

    Args:
        info: record of `cobot.ipc.layout.info_dtype`.

    Returns:
        Record of `cobot.ipc.layout.session_dtype`; stream, interpolation and decimation are still 0.
    """
    request = np.zeros((), session_dtype(len(info["max_velocity"])))
    request["stiffness"], request["cartesian_stiffness"] = info["stiffness"], info["cartesian_stiffness"]
    request["damping_ratio"], request["cartesian_damping_ratio"] = DAMPING_RATIO, DAMPING_RATIO
    request["max_contact_torque"], request["max_contact_wrench"] = np.inf, np.inf
    request["force_velocity"] = 1.0
    request["force_frame"] = NO_FRAME
    request["posture"] = np.nan
    return request


def decimation(command_hz: float, period_s: float) -> int:
    """Number of cycles per target for a client that sends `command_hz` targets per second. A cycle takes
    `period_s`.
    """
    return min(max(round(1.0 / (command_hz * period_s)), 1), MAX_DECIMATION)


def stiffness_flaw(name: str, values: Array, nominal: Array) -> str:
    """The error for an invalid stiffness, N·m/rad or N/m, given the nominal values; "" if all are valid.

    If a nominal value is 0, the arm cannot move the TCP in that direction, and only 0 is valid.
    """
    if (((values > 0.0) | (nominal == 0.0)) & (values >= 0.0) & (values <= nominal)).all():
        return ""
    return f"{name} must be above 0 and at most {nominal.tolist()}, got {values.tolist()}"


def damping_flaw(name: str, values: Array) -> str:
    """The error for an invalid damping ratio; "" if all are valid."""
    low, high = DAMPING_RATIOS
    if ((values >= low) & (values <= high)).all():
        return ""
    return f"{name} must be from {low:g} to {high:g}, got {values.tolist()}"


def check_session(request: np.ndarray, info: np.ndarray) -> None:
    """Check the values that rtloop does not check, and normalise the force frame's quaternion."""
    if not np.isin(request["force_axes"], (0.0, 1.0)).all():
        raise InputError(f"force_axes must be 0 or 1 each, got {request['force_axes'].tolist()}")
    _normalise(request["force_frame"], "force_frame")
    posture, low, high = request["posture"], info["min_position"], info["max_position"]
    if not (np.isnan(posture).all() or ((posture >= low) & (posture <= high)).all()):
        raise InputError(f"posture must be from {low.tolist()} to {high.tolist()}, got {posture.tolist()}")


def check_setpoint(setpoint: np.ndarray, stream: Stream) -> None:
    """Check a target of a session with this kind of stream, and its `move_to_pose` if it has one. The
    quaternions are normalised in place.
    """
    for name in _TARGETS[stream]:
        _require_finite(setpoint[name], name)
    if stream is not Stream.CARTESIAN:
        return
    if setpoint["number"]:
        _normalise(setpoint["pose"], "pose")
    if setpoint["move"]:
        _require_finite(setpoint["move_pose"], "move_pose")
        _normalise(setpoint["move_pose"], "move_pose")
        (shortest, longest), duration = MOVE_S, float(setpoint["move_duration_s"])
        if not shortest <= duration <= longest:
            raise InputError(
                f"the duration of a move must be from {shortest:g} to {longest:g} s, got {duration:g}"
            )


def check_chunk(chunk: np.ndarray, stream: Stream) -> None:
    """Check timed joint targets."""
    if stream is not Stream.JOINT_IMPEDANCE:
        raise InputError(
            f"a {stream.name.lower()} stream does not accept chunks; use a joint_impedance stream"
        )
    count = int(chunk["count"])
    if not 1 <= count <= CHUNK_POINTS:
        raise InputError(f"a chunk has from 1 to {CHUNK_POINTS} points, got {count}")
    times = chunk["times_s"][:count]
    _require_finite(times, "times_s")
    _require_finite(chunk["points"][:count], "points")
    if not (np.diff(times) >= MIN_STEP_S).all():
        raise InputError(f"times_s must increase by at least {MIN_STEP_S} s, got {times.tolist()}")
    if not (np.abs(times) <= LATEST_S).all():
        raise InputError(f"times_s must be on the robot's clock, up to {LATEST_S:g} s, got {times.tolist()}")


def _require_finite(values: Array, name: str) -> None:
    if not np.isfinite(values).all():
        raise InputError(f"{name} must be finite, got {values.tolist()}")


def _normalise(pose: Array, name: str) -> None:
    length = float(np.linalg.norm(pose[3:]))
    if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
        raise InputError(f"the quaternion of {name} must have length 1, got {pose[3:].tolist()}")
    pose[3:] /= length


def force_gain(cartesian_stiffness: Array) -> float:
    """TCP velocity for each newton of force error, m/s per N; 0 if there are no springs.

    Args:
        cartesian_stiffness: stiffness of a session, shape (6,), N/m and N·m/rad.
    """
    stiffest = float(cartesian_stiffness[:3].max())
    return FORCE_RATE_RAD_S / stiffest if stiffest else 0.0
