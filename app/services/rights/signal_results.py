"""What became of the actions and conditions of a motion, as answers and records of jobs report it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ActionOutcome:
    """An action on the path.

    Attributes:
        action: its field in the request.
        does: what it does, for people.
        at: its place, for people.
        planned_s: path time at which it was planned to fire.
        fired: whether it has fired; None of a motion whose end the service has not seen.
        path_time_s, robot_time_s: of the cycle in which it fired.
        position: of the TCP in the base frame, measured in that cycle, m.
        problem: why it did nothing; "" if it did, or has not fired.
    """

    action: str
    does: str
    at: str
    planned_s: float
    fired: bool | None = False
    path_time_s: float | None = None
    robot_time_s: float | None = None
    position: tuple[float, ...] | None = None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class ContactOutcome:
    """The moment at which `until` was met.

    Attributes:
        position, quaternion: of the TCP in the base frame, m and (x, y, z, w).
        force, torque: at the TCP in the base frame, N and N·m, relative to the zero.
        value: of what the condition compares.
        path_time_s, robot_time_s: of the cycle.
        overshoot_m: how far the TCP moved on until it rested; None while it moves.
        retracted_m: how far it went back afterwards.
    """

    position: tuple[float, ...]
    quaternion: tuple[float, ...]
    force: tuple[float, ...]
    torque: tuple[float, ...]
    value: float
    path_time_s: float
    robot_time_s: float
    overshoot_m: float | None = None
    retracted_m: float = 0.0


@dataclass(frozen=True, slots=True)
class SignalResults:
    """All of a motion.

    Attributes:
        waits_for: the condition that holds the motion up, for people; "" for none.
        stopped_by: the condition that has ended the motion; "" if none has.
    """

    actions: tuple[ActionOutcome, ...] = ()
    waits_for: str = ""
    stopped_by: str = ""
    contact: ContactOutcome | None = None


NO_RESULTS = SignalResults()
