"""The planned path that is being followed: a private copy of a trajectory from shared memory."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import numpy as np

from cobot.ipc.shm import Slot
from cobot.trajectory import ORDER
from cobot.types import Array, JointLimits
from rtloop.safety.limiter import POSITION_TOLERANCE_RAD

BASIS = struct.Struct("=18d")
PIECE_SEGMENTS = 96
PIECE_TIMES = 4096
"""How much is copied and checked in one cycle: 32 kB with seven joints, some tens of microseconds."""
MAX_BREAKPOINTS = 24
"""That a stop looks at: where they are closer together, the path is smooth between them."""
PLACES = np.linspace(0.0, 1.0, 9)
REST_TOLERANCE = 1e-3
"""What a motion may have left of velocity (rad/s) and acceleration (rad/s²) at its ends."""


def _derivative_maps() -> Array:
    """Shape (6, 18): powers of the time (6,) @ this = what each coefficient adds to each derivative."""
    maps = np.zeros((ORDER, ORDER, 3))  # power, coefficient, derivative
    for coefficient in range(ORDER):
        factor = 1.0
        for derivative in range(3):
            factor *= coefficient - derivative
            if coefficient > derivative:
                maps[coefficient - derivative - 1, coefficient, derivative] = factor
    return maps.reshape(ORDER, ORDER * 3)


_DERIVATIVES = _derivative_maps()


class Path:
    """Piecewise quintics, evaluated without allocation.

    Attributes:
        duration_s: path time at the end.
    """

    def __init__(self, capacity: int, dof: int) -> None:
        self._times = np.zeros(capacity + 1)
        self._coefficients = np.zeros((capacity, dof, ORDER))
        self._segments = 0
        self._turn_to(0)
        self._basis = np.zeros((3, ORDER))
        self._basis_bytes = self._basis.data.cast("B")
        self.duration_s = 0.0

    def evaluate(self, path_time_s: float, rate: float, slope: float, out: Array) -> None:
        """Where the joints are at a path time not before the last one. Real-time safe.

        Args:
            rate, slope: first and second derivative of the path time, 1 and 1/s.
            out: shape (3, dof): rad, rad/s, rad/s²; with the path P(s), P, P' r and P'' r² + P' r'.
        """
        times = self._times
        while self._index < self._segments - 1 and path_time_s >= times[self._index + 1]:
            self._turn_to(self._index + 1)
        u = path_time_s - self._begin_s
        u2 = u * u
        u3 = u2 * u
        u4 = u3 * u
        first, second, third, fourth = 2.0 * u, 3.0 * u2, 4.0 * u3, 5.0 * u4  # with 1: powers' derivatives
        square = rate * rate
        BASIS.pack_into(
            self._basis_bytes,
            0,
            *(1.0, u, u2, u3, u4, u4 * u),
            *(0.0, rate, rate * first, rate * second, rate * third, rate * fourth),
            *(0.0, slope, 2.0 * square + slope * first, 6.0 * u * square + slope * second),
            *(12.0 * u2 * square + slope * third, 20.0 * u3 * square + slope * fourth),
        )
        np.dot(self._basis, self._segment, out=out)

    def _turn_to(self, index: int) -> None:
        self._index = index
        self._begin_s = float(self._times[index])
        self._segment = self._coefficients[index].T

    def breakpoints(self, from_s: float, to_s: float) -> Array:
        """The path's breakpoints between two path times, at the most `MAX_BREAKPOINTS` of them."""
        times = self._times[: self._segments + 1]
        begin, end = np.searchsorted(times, (from_s, to_s))
        return times[begin : end : 1 + (end - begin) // MAX_BREAKPOINTS]

    def sample(self, times_s: Array) -> Array:
        """First to third derivative at path times, shape (3, n, dof); at rest past the end."""
        inside = np.minimum(times_s, self.duration_s)
        last = self._segments
        index = np.searchsorted(self._times[1:last], inside, side="right")
        powers = np.empty((len(times_s), ORDER))
        powers[:, 0] = 1.0
        powers[:, 1:] = (inside - self._times[index])[:, None]
        np.multiply.accumulate(powers, axis=1, out=powers)
        basis = np.dot(powers, _DERIVATIVES).reshape(-1, ORDER, 3)
        values = np.matmul(self._coefficients[index], basis)
        values[times_s >= self.duration_s, :, 2] = 0.0
        return np.asarray(values.transpose(2, 0, 1))


class RefusedError(Exception):
    """A trajectory in shared memory is not one that may be followed; the text says why."""


def load(
    path: Path, slot: Slot, motion_id: int, start: Array, tolerance_rad: float, limits: JointLimits
) -> Iterator[None]:
    """Copy a slot into a path and verify it: a generator that does a piece at each step. Real-time safe.

    Velocities and accelerations beyond the limits can be caught on the way; a joint stop ahead can not.

    Args:
        start: where the motion has to begin, shape (dof,), rad.
        limits: whose positions no motion may leave.

    Raises:
        RefusedError: at any step.
    """
    segments = _read_head(path, slot, motion_id)
    times = path._times[: segments + 1]
    checksum = 0
    for begin in range(0, segments + 1, PIECE_TIMES):
        piece = times[begin : begin + PIECE_TIMES]
        piece[:] = slot.breakpoints_s[begin : begin + len(piece)]
        checksum = zlib.crc32(piece.data, checksum)
        increasing = (np.diff(times[max(begin - 1, 0) : begin + len(piece)]) > 0.0).all()
        if not np.isfinite(piece).all() or not increasing or times[0] != 0.0:
            raise RefusedError("the trajectory's breakpoints do not start at 0 and increase")
        yield
    for begin in range(0, segments, PIECE_SEGMENTS):
        piece = path._coefficients[begin : min(begin + PIECE_SEGMENTS, segments)]
        piece[:] = slot.coefficients[begin : begin + len(piece)]
        checksum = zlib.crc32(piece.data, checksum)
        if not np.isfinite(piece).all():
            raise RefusedError("the trajectory has a coefficient that is not finite")
        _check_positions(piece, times[begin : begin + len(piece) + 1], limits)
        yield
    if checksum != int(slot.head.data["checksum"]):
        raise RefusedError("the trajectory's checksum is wrong")
    path.duration_s = float(times[-1])
    path._segments = segments
    _check_ends(path, start, tolerance_rad)


def _read_head(path: Path, slot: Slot, motion_id: int) -> int:
    """The number of segments."""
    if not slot.head.try_read():
        raise RefusedError("the trajectory slot is inconsistent")
    segments, found = int(slot.head.data["segments"]), int(slot.head.data["motion_id"])
    if found != motion_id:
        raise RefusedError(f"the slot holds motion {found}, not {motion_id}")
    if not 1 <= segments <= len(path._coefficients):
        raise RefusedError(
            f"the trajectory has {segments} segments, possible are 1 to {len(path._coefficients)}"
        )
    return segments


def _check_positions(piece: Array, times_s: Array, limits: JointLimits) -> None:
    """No joint beyond its stops, at `PLACES` in each segment."""
    powers = (np.diff(times_s)[:, None, None] * PLACES[:, None]) ** np.arange(ORDER)  # segment, place, power
    positions = np.matmul(powers, piece.transpose(0, 2, 1))  # segment, place, joint
    beyond = np.maximum(positions - limits.max_position, limits.min_position - positions)
    if beyond.max() <= POSITION_TOLERANCE_RAD:
        return
    segment, place, joint = np.unravel_index(beyond.argmax(), beyond.shape)
    time_s = times_s[segment] + PLACES[place] * (times_s[segment + 1] - times_s[segment])
    position = positions[segment, place, joint]
    raise RefusedError(
        f"{time_s:.3f} s into the motion {limits.names[joint]} would be at {position:.4f} rad, "
        f"allowed is {limits.min_position[joint]:g} to {limits.max_position[joint]:g} rad"
    )


def _check_ends(path: Path, start: Array, tolerance_rad: float) -> None:
    """Both ends at rest, the start where the arm is; leaves the path at its start."""
    found = np.zeros((3, len(start)))
    for where, index, path_time_s in (("end", path._segments - 1, path.duration_s), ("start", 0, 0.0)):
        path._turn_to(index)
        path.evaluate(path_time_s, 1.0, 0.0, found)
        if not np.abs(found[1:]).max() <= REST_TOLERANCE:
            raise RefusedError(f"the trajectory is not at rest at its {where}")
    off = np.abs(found[0] - start)
    joint = int(off.argmax())
    if not off[joint] <= tolerance_rad:
        raise RefusedError(
            f"the trajectory starts {off[joint]:.4f} rad from where joint {joint + 1} is, "
            f"allowed are {tolerance_rad} rad"
        )
