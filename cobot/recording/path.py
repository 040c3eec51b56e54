"""The path of the arm and the events in a recording, which a planning process reads for the service."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.types import Array


@dataclass(frozen=True, slots=True)
class Marked:
    """An event of a recording. `time_s` counts from the recording's first cycle."""

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
        poses: poses of the TCP in the base frame, shape (n, 7): m, then w, x, y, z; empty until they are
            computed.
    """

    times_s: Array
    joints: Array
    velocities: Array
    events: list[Marked]
    poses: Array | None = None
