"""Results of a motion's actions and conditions, in the form of answers and job records."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ActionOutcome:
    """The result of an action on the path.

    Attributes:
        action: field of the action in the request.
        does: description of the action.
        at: description of the action's place.
        planned_s: path time at which the action was planned to fire, s.
        fired: whether the action has fired; None if the service has not seen the motion end.
        path_time_s, robot_time_s: path time and robot time of the cycle in which the action fired, s.
        position: TCP position in the base frame, measured in this cycle, m.
        problem: reason why the action had no effect; "" if it had an effect or has not fired.
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
    """The state of the arm when the condition `until` was met.

    Attributes:
        position, quaternion: TCP pose in the base frame, m and (x, y, z, w).
        force, torque: force and torque at the TCP in the base frame, N and N·m, relative to the zero point.
        value: value of the quantity that the condition compares.
        path_time_s, robot_time_s: path time and robot time of the cycle, s.
        overshoot_m: distance that the TCP moved after the contact until it was at rest, m; None while the TCP
            is moving.
        retracted_m: distance that the TCP moved back afterwards, m.
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
        waits_for: the condition that the motion is waiting for, in words; "" if it is not waiting.
        stopped_by: the condition that has ended the motion; "" if the motion was not ended by a condition.
    """

    actions: tuple[ActionOutcome, ...] = ()
    waits_for: str = ""
    stopped_by: str = ""
    contact: ContactOutcome | None = None


NO_RESULTS = SignalResults()
