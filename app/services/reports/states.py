"""The newest state of a robot as text, which is rendered once for all clients that need it at about the same
time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from app.services.events.ring import Events
from app.services.state.link import RobotLink
from app.services.state.robot_state import RobotState
from cobot.errors import UnavailableError
from cobot.ipc.layout import MotionResult
from cobot.types import Array, JointLimits

SHARED_S = 0.004
"""Maximum age of a text that is shared with further clients, s."""
DIGITS = 6
"""Number of decimal places: micrometres and microradians. More would only make the text longer."""


class StateTexts:
    """Creates the events of type `state` for one robot, as JSON texts."""

    def __init__(self, events: Events, link: RobotLink, limits: JointLimits) -> None:
        self.robot = link.memory.robot
        self._events, self._link, self._limits = events, link, limits
        self._made_s = -np.inf
        self._text = ""

    def text(self) -> str:
        """Return the newest state as an event of type `state`, in JSON."""
        now_s = self._link.clock.now_s()
        if now_s - self._made_s > SHARED_S:
            self._made_s = now_s
            self._text = self._events.rendered("state", self.robot, self._data())
        return self._text

    def _data(self) -> dict[str, Any]:
        try:
            state = self._link.state()
        except UnavailableError as exc:
            return {"mode": None, "problem": str(exc)}
        limits = self._limits
        return {
            "mode": state.mode.name,
            "reason": state.reason,
            "settled": state.settled,
            "age_s": round(state.age_s, DIGITS),
            "joints": _list(state.position),
            "velocities": _list(state.velocity),
            "efforts": _list(state.effort),
            "tcp": _pose(state.tcp),
            "motion": _motion(state),
            "session": state.session or None,
            "utilisation": {
                "velocity": _share(state.velocity, limits.max_velocity),
                "effort": _share(state.effort, limits.max_effort),
            },
        }


def _motion(state: RobotState) -> dict[str, Any] | None:
    if state.motion_result is not MotionResult.RUNNING:
        return None
    return {
        "id": state.motion_id,
        "path_time_s": round(state.path_time_s, DIGITS),
        "duration_s": round(state.path_duration_s, DIGITS),
        "rate": round(state.path_rate, DIGITS),
    }


def _pose(tcp: Array) -> dict[str, float]:
    x, y, z, qw, qx, qy, qz = _list(tcp)
    return {"x": x, "y": y, "z": z, "qx": qx, "qy": qy, "qz": qz, "qw": qw}


def _share(values: Array, most: Array) -> float:
    """Return the largest value as a share of its joint's limit."""
    return round(float(np.max(np.abs(values) / most)), 4)


def _list(values: Array) -> list[float]:
    rounded: list[float] = np.round(values, DIGITS).tolist()
    return rounded
