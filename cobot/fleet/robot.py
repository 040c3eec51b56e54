"""One robot of a cell: its state, its commands, and its recordings."""

from __future__ import annotations

import contextlib
import io
import logging
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

from cobot.access.roles import Role
from cobot.audit import record_beside
from cobot.config import Settings
from cobot.errors import CobotError, UnavailableError
from cobot.fleet.bundles import BundlesCell
from cobot.fleet.commands import CommandBook
from cobot.fleet.executing import ServiceCommands
from cobot.fleet.messages import (
    KEPT_EVENTS,
    MAX_DRIFT,
    MAX_PROBLEMS,
    FleetCommand,
    FleetState,
    HubTime,
    RobotEvent,
    StopArm,
)
from cobot.fleet.recordings import GivenRecordings
from cobot.fleet.watching import ArmWatch, ServiceWatch
from cobot.launch.stop import stop

UNCHANGED_S = 1.0
"""Interval at which a state is published again if it does not change, in seconds."""
WORKERS = 8
"""Maximum number of commands in progress for a robot: the first try, and retries that wait for its result."""
FROM = "fleet"

log = logging.getLogger("cobot.fleet")


class RobotsCell(BundlesCell, Protocol):
    """The part of a cell that its robots use."""

    name: str
    facts: dict[str, Any]

    def ask_time(self) -> HubTime | None: ...


class FleetRobot:
    """One robot of the cell in the fleet."""

    def __init__(self, cell: RobotsCell, settings: Settings, url: str, token: str) -> None:
        self.name = settings.robot.name
        self.settings = settings
        self.events: deque[RobotEvent] = deque(maxlen=KEPT_EVENTS)
        self.book = CommandBook(cell.name, self.name, cell.ask_time)
        self._facts = cell.facts
        self._arm = ArmWatch(self.name, settings.web.stale_after_s)
        self._service = ServiceWatch(url, self.name, token) if url else None
        self._commands = ServiceCommands(url, settings, token, cell) if url else None
        self._published_s = 0.0
        self.recordings = GivenRecordings(settings.recording_folder) if settings.fleet.recordings else None
        self.files = ThreadPoolExecutor(1)  # for reading a large file while commands run
        self.workers = ThreadPoolExecutor(WORKERS)  # a separate one, so that a moving arm delays no other arm
        self.state = self._read_state()

    def _read_state(self) -> FleetState:
        found: dict[str, Any] = self._arm.read()
        service: dict[str, Any] = {} if self._service is None else self._service.found
        if found["state"] in ("ready", "moving") and self._service is not None and self._service.paused:
            found["state"] = "paused"
        if self._commands is not None:
            bundles = self._commands.bundles
            versions = {each["id"]: each["version"] for each in self.programs}
            drift = bundles.drift(versions) if versions else []
            found |= {"bundle": bundles.title, "drift": drift[:MAX_DRIFT]}
            restart = [bundles.restart[:2000]] if bundles.restart else []
            service = service | {"problems": [*restart, *service["problems"]][:MAX_PROBLEMS]}
        return FleetState(robot=self.name, **self._facts, **service, **found)

    @property
    def programs(self) -> list[dict[str, Any]]:
        """The stored programs as in the last answer from the service: `id`, `label` and `version`."""
        return [] if self._service is None else self._service.programs

    def update(self) -> FleetState | None:
        """The new state if it must be published now; otherwise None."""
        state, now_s = self._read_state(), time.monotonic()
        if state == self.state and now_s - self._published_s < UNCHANGED_S:
            return None
        self.state, self._published_s = state, now_s
        return state

    def stop(self, who: str, command: str) -> str:
        """Stop the arm through shared memory, as `cobot stop` does, and add the stop to the cell's audit.

        Raises:
            UnavailableError: the arm is not known to be at rest.
        """
        said = io.StringIO()
        at_rest = stop([self.name], latched=False, out=said)
        outcome = "ok" if at_rest else "not known to be at rest"
        record_beside(self.settings, who, FROM, f"stop {self.name}", outcome, command=command)
        log.warning("%s has stopped %s through the fleet: %s", who, self.name, outcome)
        if not at_rest:
            raise UnavailableError(said.getvalue().strip())
        return said.getvalue().strip()

    def execute(self, command: FleetCommand, who: str) -> str:
        """Execute a command, and add it to the cell's audit.

        Args:
            who: the name for the audit.

        Raises:
            CobotError: the command was not executed, or the arm is not known to be at rest.
        """
        if isinstance(command.action, StopArm):
            return self.stop(who, command.id)
        outcome = "error"
        try:
            if self._commands is None:
                raise UnavailableError("this cell runs without its web service; set web.enabled to true")
            said = self._commands.run(command.action, Role[command.role.upper()])
            outcome = "ok"
            return said
        except CobotError as exc:
            outcome = exc.code
            raise
        finally:
            record_beside(self.settings, who, FROM, self.wish(command), outcome, command=command.id)

    def picture(self, _question: bytes) -> bytes:
        """A picture of the arm, as PNG.

        Raises:
            CobotError: the service does not return a picture.
        """
        if self._commands is None:
            raise UnavailableError("this cell runs without its web service; set web.enabled to true")
        return self._commands.picture()

    def recover(self) -> None:
        """Roll back a bundle whose activation was interrupted, as soon as the service answers."""
        if self._commands is not None:
            with contextlib.suppress(CobotError):
                self._commands.recover()

    def wish(self, command: FleetCommand) -> str:
        """Describe a command for the audit."""
        action = command.action.model_dump(exclude_defaults=True)
        return " ".join(str(each) for each in (action.pop("kind"), self.name, *action.values()))

    def close(self) -> None:
        if self._service is not None:
            self._service.end()
        if self._commands is not None:
            self._commands.close()
        self.workers.shutdown(wait=False, cancel_futures=True)
        self.files.shutdown(wait=False, cancel_futures=True)
        self._arm.close()
