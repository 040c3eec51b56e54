"""Where the arm was in a recording, and what happened: data that a planning process reads for the service."""

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
    """Some of the cycles of a recording, evenly, its first and its last one among them.

    Attributes:
        times_s: since the first cycle, on the clock by which it was recorded, shape (n,).
        joints, velocities: measured, rad and rad/s, shape (n, dof).
        poses: of the TCP in the base frame, shape (n, 7): m, then w, x, y, z; none before they are computed.
    """

    times_s: Array
    joints: Array
    velocities: Array
    events: list[Marked]
    poses: Array | None = None
