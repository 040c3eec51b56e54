"""Executes the commands of a fleet through the cell's own service. Stops are executed elsewhere."""

from __future__ import annotations

import contextlib
import threading

from cobot.access.roles import FLEET, Role
from cobot.addresses import address
from cobot.client.rest import Client
from cobot.config import Settings
from cobot.errors import ConflictError
from cobot.fleet.bundles import BundlesCell, RobotBundles
from cobot.fleet.messages import (
    NOT_ENDED,
    ActivateBundle,
    FleetAction,
    PauseProgram,
    ReleaseFleetControl,
    ResumeProgram,
    RollBackBundle,
    SetSpeed,
    StageBundle,
    StartProgram,
    TakeFleetControl,
)

CONTROL_S = 600.0
"""Time without a motion after which the fleet loses control, s."""
LEASE = "explicit"
"""The service's value for control that was taken explicitly, as a lease."""
NEWEST = 20
PROGRAM = "sequence"


class ServiceCommands:
    """Sends commands for one robot to the cell's service, one at a time. Thread safe.

    Args:
        cell: gives access to bundles and settings.
    """

    def __init__(self, url: str, settings: Settings, token: str, cell: BundlesCell) -> None:
        self._client = Client(address(url, settings.robot.name), token=token or None)
        self.bundles = RobotBundles(settings, self._client, cell)
        self._control = contextlib.ExitStack()
        self._looks_for_left_control = True
        self._lock = threading.Lock()
        self._staging = threading.Lock()

    def run(self, action: FleetAction, role: Role) -> str:
        """Execute an action. Returns a sentence about the result.

        Args:
            role: role that the person has at the hub.

        Raises:
            CobotError: the error that the service reports.
        """
        if isinstance(action, StageBundle):  # takes long and changes nothing, so a pause does not wait for it
            with self._staging:
                return self.bundles.stage(action.bundle, role)
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
                    self._release()
                    taking = self._client.control(timeout_s=CONTROL_S, force=action.force)
                    self._control.enter_context(taking)
                    return f"the fleet has control, until nothing has moved for {CONTROL_S:g} s"
                case ReleaseFleetControl():
                    self._release()
                    return "the fleet does not have control"
                case ActivateBundle():
                    return self.bundles.activate(action.bundle, role)
                case RollBackBundle():
                    return self.bundles.roll_back(action.bundle, role)
                case _:
                    raise AssertionError(f"{action.kind} does not need the service")

    def picture(self) -> bytes:
        """A picture of the arm, as PNG. A command in progress does not delay it.

        Raises:
            CobotError: the error that the service reports.
        """
        return self._client.picture()

    def recover(self) -> None:
        """Undo the effects of an earlier process that was killed: release its control, and roll back an
        interrupted activation.

        Raises:
            CobotError: the service does not answer yet, or a job is running.
        """
        with self._lock:
            if self._looks_for_left_control:
                self._release()
                self._looks_for_left_control = False
            self.bundles.recover()

    def close(self) -> None:
        """Release control, and close the connection."""
        with self._lock:
            self._control.close()
            self._client.close()

    def _release(self) -> None:
        """Release control. This works even if a killed process has taken control and its token is lost.

        Raises:
            ConflictError: a job is running under that control, and would end.
        """
        self._control.close()
        state = self._client.who_controls()
        if (state["how"], state["holder"]) != (LEASE, FLEET):
            return
        running = self._client.jobs(1, *NOT_ENDED)
        if running:
            raise ConflictError(f"{running[0]['request']} runs under the fleet's control; stop it first")
        with self._client.control(force=True):
            pass  # control was taken with a new token, and is released again

    def _start(self, action: StartProgram) -> str:
        version = self._client.program(action.program, action.version)["version"]
        self._client.run_program(action.program, version=version)
        return f"started {action.program}, version {version}"

    def _job(self, state: str) -> str:
        """The id of the program in this state. Without a program, the id of the single motion.

        Raises:
            ConflictError: neither a program nor a motion is in this state.
        """
        jobs = self._client.jobs(NEWEST, state)
        found = [job for job in jobs if job["kind"] == PROGRAM] or jobs
        if not found:
            raise ConflictError(f"nothing is {state}")
        return str(found[0]["id"])
