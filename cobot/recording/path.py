"""The path of the arm in a recording, and the recorded events. A planning process reads them for the
service.
"""

from __future__ import annotations

from dataclasses import dataclass

from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Marked:
    """An event in a recording. `time_s` is measured from the first cycle of the recording."""

    time_s: float
    kind: str
    mode: str
    text: str


@dataclass(frozen=True, slots=True)
class RecordedPath:
    """Evenly spaced cycles of a recording, including its first and its last one.

    Attributes:
        times_s: times since the first cycle, on the clock of the recording, shape (n,).
        joints, velocities: measured positions and velocities, rad and rad/s, shape (n, dof).
        poses: TCP poses in the base frame, shape (n, 7): m, then w, x, y, z; empty until they are computed.
    """

    times_s: Array
    joints: Array
    velocities: Array
    events: list[Marked]
    poses: Array | None = None
