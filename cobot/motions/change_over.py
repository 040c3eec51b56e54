"""A motion whose goal has changed while it is running. For planning processes and the service."""

from __future__ import annotations

from dataclasses import dataclass

from cobot.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class ChangeOver:
    """The remaining part of a motion whose goal has been changed. Picklable.

    Attributes:
        trajectory: the new trajectory, which equals the current one bit for bit until the change.
        offset_s: path time of the current trajectory at which the new one begins.
        begin_s, end_s: path times of the new trajectory. At `begin_s` the arm leaves the current path; from
            `end_s` on it executes only the new motion.
    """

    trajectory: Trajectory
    offset_s: float
    begin_s: float
    end_s: float
