"""Loads a trajectory from shared memory into a path. It is copied and verified in pieces, one per cycle."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from cobot.ipc.layout import LOADED_SEGMENTS
from cobot.ipc.shm import Slot
from cobot.trajectory import ORDER
from cobot.types import Array, JointLimits
from rtloop.planned.path import Path
from rtloop.safety.limiter import POSITION_TOLERANCE_RAD

PIECE_TIMES = 4096
"""Number of breakpoints that are copied and checked in one cycle. They are fewer bytes than the segments that
are copied in one cycle.
"""
PLACES = np.linspace(0.0, 1.0, 9)
"""Points of a segment, as shares of its duration. If the fast check `Path.stays_within` fails, the positions
at these points are evaluated for the error message.
"""
REST_TOLERANCE = 1e-3
"""Maximum velocity (rad/s) and acceleration (rad/s²) at the start and at the end of a motion."""


class RefusedError(Exception):
    """Raised if a trajectory in shared memory is invalid. The text gives the reason."""


def load(
    path: Path, slot: Slot, motion_id: int, start: Array | None, tolerance_rad: float, limits: JointLimits
) -> Iterator[None]:
    """Copy a trajectory from its slot to a path, and verify the copy. Each step of the generator handles one
    piece. Real-time safe.

    To save cycles, the first segments are copied in the same step as the last breakpoints, and the last
    checks are made in the same step as the last segments. This matters for a replacement, because the arm is
    approaching the point of the change.

    All positions are checked in advance. Excessive velocities and accelerations can be detected during the
    motion, but at a joint limit it may be too late to stop.

    Args:
        start: joint positions at which the motion must begin at rest, shape (dof,), rad. None if the caller
            ensures this.
        limits: the position limits that no motion may exceed.

    Raises:
        RefusedError: the trajectory is invalid. Any step may raise it.
    """
    segments = _read_head(path, slot, motion_id)
    checksum = 0
    for begin in range(0, segments + 1, PIECE_TIMES):
        end = min(begin + PIECE_TIMES, segments + 1)
        piece = path.breakpoints_s[begin:end]
        piece[:] = slot.breakpoints_s[begin:end]
        checksum = zlib.crc32(piece.data, checksum)
        if not path.increases(begin, end):
            raise RefusedError("the trajectory's breakpoints must start at 0 and increase")
        if start is not None or end <= segments:
            yield
    low, high = limits.min_position - POSITION_TOLERANCE_RAD, limits.max_position + POSITION_TOLERANCE_RAD
    for begin in range(0, segments, LOADED_SEGMENTS):
        end = min(begin + LOADED_SEGMENTS, segments)
        piece = path.coefficients[begin:end]
        piece[:] = slot.coefficients[begin:end]
        checksum = zlib.crc32(piece.data, checksum)
        if not path.is_finite(begin, end):
            raise RefusedError("a coefficient of the trajectory is not finite")
        if not path.stays_within(begin, end, low, high):
            _refuse_positions(piece, path.breakpoints_s[begin : end + 1], limits)
        if start is not None or end < segments:
            yield
    if checksum != int(slot.head.data["checksum"]):
        raise RefusedError("the trajectory's checksum is wrong")
    path.begin(segments)
    _check_ends(path, start, tolerance_rad)
    path.begin(segments)


def _read_head(path: Path, slot: Slot, motion_id: int) -> int:
    """Check the header of the slot and return the number of segments."""
    if not slot.head.try_read():
        raise RefusedError("the trajectory slot is inconsistent")
    segments, found = int(slot.head.data["segments"]), int(slot.head.data["motion_id"])
    if found != motion_id:
        raise RefusedError(f"the slot contains motion {found}, not {motion_id}")
    if not 1 <= segments <= len(path.coefficients):
        raise RefusedError(f"the trajectory has {segments} segments, allowed: 1 to {len(path.coefficients)}")
    return segments


def _refuse_positions(piece: Array, times_s: Array, limits: JointLimits) -> None:
    """Raise a RefusedError that names the joint furthest beyond its limits."""
    powers = (np.diff(times_s)[:, None, None] * PLACES[:, None]) ** np.arange(ORDER)  # segment, place, power
    positions = np.matmul(powers, piece.transpose(0, 2, 1))  # segment, place, joint
    beyond = np.maximum(positions - limits.max_position, limits.min_position - positions)
    segment, place, joint = np.unravel_index(beyond.argmax(), beyond.shape)
    time_s = times_s[segment] + PLACES[place] * (times_s[segment + 1] - times_s[segment])
    position = positions[segment, place, joint]
    unit = limits.unit(int(joint))
    raise RefusedError(
        f"{time_s:.3f} s into the motion {limits.names[joint]} would be at {position:.4f} {unit}, "
        f"allowed: {limits.min_position[joint]:g} to {limits.max_position[joint]:g} {unit}"
    )


def _check_ends(path: Path, start: Array | None, tolerance_rad: float) -> None:
    """Check that the motion is at rest at both ends and starts at the arm's position."""
    found = np.zeros((3, path.coefficients.shape[1]))
    ends = {"end": path.duration_s} if start is None else {"end": path.duration_s, "start": 0.0}
    for where, path_time_s in ends.items():
        path.begin(path.segments)
        path.evaluate(path_time_s, 1.0, 0.0, found)
        if not np.abs(found[1:]).max() <= REST_TOLERANCE:
            raise RefusedError(f"the trajectory is not at rest at its {where}")
    if start is None:
        return
    off = np.abs(found[0] - start)
    joint = int(off.argmax())
    if not off[joint] <= tolerance_rad:
        raise RefusedError(
            f"the trajectory starts {off[joint]:.4f} rad from the position of joint {joint + 1}, allowed: "
            f"{tolerance_rad} rad"
        )
