"""Logs the interventions of the safety layer."""

from __future__ import annotations

import logging
from datetime import UTC, datetime

from app.services.state.robot_state import RobotState
from cobot.clock import SYSTEM, Clock, WallTime
from cobot.ipc.layout import Intervention

EPISODE_S = 1.0
"""Duration of an episode, s. Interventions of one kind within this time belong to one episode."""

log = logging.getLogger("cobot.interventions")


class InterventionLog:
    """Logs the first intervention of each kind in each episode, with its time."""

    def __init__(self, label: str = "", clock: Clock = SYSTEM) -> None:
        self._label = label
        self._wall_time = WallTime(clock)
        self._counts: list[int] = []
        self._last_ns = [0] * len(Intervention)

    def look(self, state: RobotState) -> None:
        """Log interventions since the last call. Those before the first call are not logged."""
        for kind, before in zip(Intervention, self._counts, strict=False):
            count, moment_ns = state.interventions[kind], state.intervened_ns[kind]
            if count <= before:
                continue
            if moment_ns - self._last_ns[kind] > EPISODE_S * 1e9:
                moment = datetime.fromtimestamp(self._wall_time.at(moment_ns) * 1e-9, UTC).astimezone()
                when = moment.isoformat(timespec="milliseconds")
                name = kind.name.lower()
                log.warning("%sintervention %s at %s, %d so far", self._label, name, when, count)
            self._last_ns[kind] = moment_ns
        self._counts = state.interventions
