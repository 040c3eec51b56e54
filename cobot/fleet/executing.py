"""What a cell does with the commands of a fleet that are not stops: it asks its own service."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable

from cobot.addresses import address
from cobot.client.rest import Client
from cobot.config import Settings
from cobot.errors import ConflictError
from cobot.fleet.bundles import RobotBundles
from cobot.fleet.messages import (
    ActivateBundle,
    FleetAction,
    PauseProgram,
    ReleaseFleetControl,
    ResumeProgram,
    RollBackBundle,
    SetSpeed,
    StageBundle,
    StartProgram,
    StopArm,
    TakeFleetControl,
)

CONTROL_S = 600.0
"""Time without a motion after which the fleet loses control."""
NEWEST = 20
PROGRAM = "sequence"


class ServiceCommands:
    """Commands to one robot of the cell's service, from any thread, one at a time.

    Args:
        fetch: see `RobotBundles`.
    """

    def __init__(
        self, url: str, settings: Settings, token: str, fetch: Callable[[str], bytes | None]
    ) -> None:
        self._client = Client(address(url, settings.robot.name), token=token or None)
        self.bundles = RobotBundles(settings, self._client, fetch)
        self._control = contextlib.ExitStack()
        self._lock = threading.Lock()

    def run(self, action: FleetAction) -> str:
        """Execute an action. Returns a sentence about the result.

        Raises:
            CobotError: the service's error.
        """
        with self._lock:
            match action:
                case StartProgram():
                    return self._start(action)
                case PauseProgram():
                    job = self._job("running")
                    self._client.job(job).pause()
                    return f"paused {job}"
                case ResumeProgram():
                    job = self._job("paused")
                    self._client.job(job).resume()
                    return f"resumed {job}"
                case SetSpeed():
                    fraction = self._client.set_speed_override(action.fraction)
                    return f"the speed override is {100.0 * fraction:g} %"
                case TakeFleetControl():
                    self._control.close()
                    self._control.enter_context(self._client.control(timeout_s=CONTROL_S, force=action.force))
                    return f"the fleet has control, until nothing has moved for {CONTROL_S:g} s"
                case ReleaseFleetControl():
                    self._control.close()
                    return "the fleet does not have control"
                case StageBundle():
                    return self.bundles.stage(action.bundle)
                case ActivateBundle():
                    return self.bundles.activate(action.bundle)
                case RollBackBundle():
                    return self.bundles.roll_back(action.bundle)
                case StopArm():
                    raise AssertionError("a stop does not need the service")

    def recover(self) -> None:
        """See `RobotBundles.recover`."""
        with self._lock:
            self.bundles.recover()

    def close(self) -> None:
        """Give control back, and close the connection."""
        with self._lock:
            self._control.close()
            self._client.close()

    def _start(self, action: StartProgram) -> str:
        version = self._client.program(action.program, action.version)["version"]
        self._client.run_program(action.program, version=version)
        return f"started {action.program}, version {version}"

    def _job(self, state: str) -> str:
        """The id of the program in this state, or else of the single motion.

        Raises:
            ConflictError: there is none.
        """
        jobs = self._client.jobs(NEWEST, state)
        found = [job for job in jobs if job["kind"] == PROGRAM] or jobs
        if not found:
            raise ConflictError(f"nothing is {state}")
        return str(found[0]["id"])
