"""Passes force control's wrench to the servo sessions that use it."""

from __future__ import annotations

import contextlib

import numpy as np

from app.services.streaming.force import ForceService, ForceSettings
from app.services.streaming.sessions import StreamSession
from cobot.errors import CobotError
from cobot.ipc.layout import Stream, setpoint_dtype


class ServoWrench:
    """Passes force control's wrench to the session whenever it changes."""

    def __init__(self, force: ForceService, dof: int) -> None:
        self._force = force
        self._setpoint_dtype = setpoint_dtype(dof)
        self._told: ForceSettings | None = None
        self._sequence = 0

    def begin(self, session: StreamSession) -> None:
        """Send the wrench to a session that has just begun."""
        self._told = settings = self._force.settings
        if session.stream is not Stream.CARTESIAN:
            return
        setpoint = np.zeros((), self._setpoint_dtype)
        setpoint["wrench"] = settings.wrench if settings.enabled else 0.0
        self._sequence += 1
        with contextlib.suppress(CobotError):  # the session has just ended
            session.take_setpoint(self._sequence, setpoint)

    def update(self, session: StreamSession) -> None:
        """Send the wrench again if the settings have changed."""
        if self._force.settings is not self._told:
            self.begin(session)
