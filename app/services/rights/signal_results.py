"""Results of a motion's actions and conditions, in the form that answers and job records have."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ActionOutcome:
    """An action on the path.

    Attributes:
        action: field of the action in the request.
        does: description of the action.
        at: description of its place.
        planned_s: path time at which it was planned to fire.
        fired: whether it has fired; None if the service has not seen the end of the motion.
        path_time_s, robot_time_s: times of the cycle in which it fired.
        position: position of the TCP in the base frame, measured in that cycle, m.
        problem: reason why it had no effect; "" if it had one, or has not fired.
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
        position, quaternion: pose of the TCP in the base frame, m and (x, y, z, w).
        force, torque: at the TCP in the base frame, N and N·m, relative to the zero.
        value: value of the quantity that the condition compares.
        path_time_s, robot_time_s: times of the cycle.
        overshoot_m: distance that the TCP moved after the contact until it was at rest, m; None while it
            moves.
        retracted_m: distance that it moved back afterwards, m.
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
    """All results of one motion.

    Attributes:
        waits_for: the condition for which the motion waits, in words; "" for none.
        stopped_by: the condition that has ended the motion; "" if none has.
    """

    actions: tuple[ActionOutcome, ...] = ()
    waits_for: str = ""
    stopped_by: str = ""
    contact: ContactOutcome | None = None


NO_RESULTS = SignalResults()
