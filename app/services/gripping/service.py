"""Gripper commands as jobs. Only one command runs at a time, and a new command replaces the current one.

The arm may move at the same time. A stop ends the command, but the gripper continues to hold an object,
unless `on_stop` is `open`.
"""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import logging
from collections.abc import Callable, Coroutine
from dataclasses import replace
from typing import Any

from app.services.clients import CLIENT
from app.services.devices.gripper_worker import GripperWorker, Reading, RobotPort
from app.services.gripping.checks import check_command
from app.services.gripping.commands import GripperOutcome, GripperReport, Running, missed, shortfall
from app.services.gripping.following import follow
from app.services.gripping.held import HeldService
from app.services.rights.claims import Caller
from app.services.rights.job import Job
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from app.services.rights.stopping import StopService
from app.services.state.link import RobotLink
from cobot.config import Settings
from cobot.errors import (
    CobotError,
    DeviceError,
    MotionStopped,
    NotReadyError,
    NotSupportedError,
    UnavailableError,
)
from cobot.grippers import GripperState, HeldObject, make_gripper
from cobot.grippers.registry import gripper_options, gripper_section
from cobot.motions.gripper_bodies import (
    AnyGripperCommand,
    GripperGrasp,
    GripperHome,
    GripperMove,
    GripperRelease,
    GripperRequest,
)
from cobot.types import LoopMode

WATCH_S = 0.01
STOP_S = 4.0
"""Timeout for the driver to accept a stop, s. It is less than the timeout of the endpoint."""
OPEN_S = 10.0
"""Timeout for the fingers to open after a stop, if `on_stop` is `open`, s."""
NONE_CONFIGURED = (
    "this robot has no gripper: set robot.gripper in the settings, such as "
    "{type: robotiq, device: /dev/ttyUSB0}; `cobot gripper list` shows the types, and docs/grippers.md "
    "explains the options of each"
)

log = logging.getLogger("cobot.gripper")


class GripperService:
    """The gripper service of one robot. For a robot without a gripper, it rejects every request.

    Attributes:
        on_reading: function that is called after each report from the driver.
    """

    def __init__(
        self,
        settings: Settings,
        link: RobotLink,
        ownership: Ownership,
        stopping: StopService,
        held: HeldService,
    ) -> None:
        self._link = link
        self._ownership = ownership
        self._stopping = stopping
        self._held = held
        self._running: Running | None = None
        self._holds = self._seen = False
        self._lost = False
        self._tasks: set[asyncio.Task[None]] = set()
        self._worker: GripperWorker | None = None
        self.on_reading: list[Callable[[], None]] = []
        section = gripper_section(settings)
        if section is None:
            return
        self.type = section.type
        self._options = gripper_options(settings)
        port = RobotPort()
        self._worker = GripperWorker(make_gripper(settings, port), port, link, self._look)
        self._spawn(self._watch(self._worker))

    def close(self) -> None:
        """Close the gripper's connection. A held object stays held."""
        for task in self._tasks:
            task.cancel()
        self._held.close()
        if self._worker is not None:
            self._worker.close()

    @property
    def exists(self) -> bool:
        """Whether the robot has a gripper."""
        return self._worker is not None

    @property
    def problem(self) -> str:
        """The gripper's problem, for /health; "" if there is no problem or no gripper."""
        if self._worker is None:
            return ""
        state = self._worker.reading.state
        found = self._worker.problem or (state.fault if state is not None else "")
        return f"gripper {self.type}: {found}" if found else ""

    def report(self) -> GripperReport:
        """Report the current state of the gripper.

        Raises:
            NotSupportedError: the robot has no gripper.
        """
        worker = self._require()
        reading = worker.reading
        return GripperReport(
            self.type,
            worker.gripper.capabilities,
            worker.problem,
            None if reading.state is None else self._shown(reading.state),
            self._link.clock.now_s() - reading.read_s,
            "" if self._running is None else self._running.name,
            self._held.name,
        )

    async def run(self, name: str, command: AnyGripperCommand, caller: Caller) -> GripperOutcome:
        """Execute a command, and return when it has ended. This ends the current command.

        Args:
            name: move, grasp, release or home.

        Raises:
            NotSupportedError: the robot has no gripper, or the gripper does not support this command.
            LimitError: a value is out of range.
            NotReadyError: an e-stop or a fault is latched.
            MotionStopped: a stop was requested after the command.
        """
        worker = self.check(command)
        self.require_ready(command, caller)
        stops, latched = self._ownership.stops, self._is_latched(False)
        running = Running(name, command, caller.job, stops, latched)
        if self._running is not None:
            self._running.interrupt(StopReason(f"preempted by {name} of {CLIENT.get()}", "replaced").error)
        self._running, self._lost = running, False
        self._held.context = contextvars.copy_context()
        error: BaseException | None = None
        if caller.job is not None:
            caller.job.begin(self._ownership.speed_override)
            caller.job.start()
            caller.job.accepted.set()
        try:
            state = await self._follow(worker, running, caller)
            error = shortfall(command, state, worker.gripper.capabilities)
            self._note(command, state, good=error is None)
            await self._held.follow()
        except CobotError as exc:
            error = exc
        except BaseException as exc:
            error = exc
            self._halt(worker, running)
            raise
        finally:
            if self._running is running:
                self._running = None
            if caller.job is not None:
                self._ownership.end(caller.job, error, stopped=isinstance(error, MotionStopped))
        assert worker.reading.state is not None or error is not None
        last = worker.reading.state or GripperState(None, None, moving=False)
        return GripperOutcome(error, self._shown(last), self._held.name)

    async def run_plan(self, request: GripperRequest, caller: Caller) -> CobotError | None:
        """Run the gripper command of a plan. Returns the reason if it fails, otherwise None. Raises the same
        errors as `run`, and `ConflictError` while another client has control.
        """
        self._ownership.require_control()
        return (await self.run(request.name, request.command, caller)).error

    async def stop(self) -> GripperReport:
        """Stop the fingers where they are, and end the current command. A held object stays held.

        Raises:
            NotSupportedError: the robot has no gripper.
            DeviceError: the gripper does not accept the stop.
        """
        worker = self._require()
        if self._running is not None:
            self._running.interrupt(StopReason(f"stopped by {CLIENT.get()}", "cancelled").error)
        asked = worker.tell(lambda gripper: gripper.stop())
        await asyncio.wait({asked}, timeout=STOP_S)
        if not asked.done():
            raise DeviceError(
                f"gripper {self.type}: the driver has not accepted the stop within {STOP_S:g} s: "
                f"{worker.problem}; it gets the stop as soon as the current call returns"
            )
        if (problem := asked.exception()) is not None:
            raise DeviceError(f"gripper {self.type}: {problem}") from problem
        return self.report()

    def cancel(self, job: Job, cause: MotionStopped) -> bool:
        """End the command of the given job. Return whether the job is a gripper command."""
        if self._running is None or self._running.job is not job:
            return False
        self._running.interrupt(cause)
        return True

    def check(self, command: AnyGripperCommand) -> GripperWorker:
        """Check that the gripper supports a command with the given values.

        Raises:
            NotSupportedError: the robot has no gripper, or the gripper does not support this command.
            LimitError: a value is out of range.
        """
        worker = self._require()
        check_command(self.type, worker.gripper.capabilities, command)
        return worker

    def require_ready(self, command: AnyGripperCommand, caller: Caller) -> None:
        """Check that a command may begin now.

        Raises:
            NotReadyError: an e-stop or a fault is latched.
            MotionStopped: a stop was requested after the command.
        """
        if self._ownership.stops != caller.stops:
            raise StopReason("a stop was requested while the request was being read", by="").error
        if isinstance(command, GripperRelease):
            return  # a jammed object must always be releasable
        if self._is_latched(False):
            state = self._link.state()
            raise NotReadyError(
                f"mode {state.mode.name}: {state.reason}; remove the cause, then reset the robot"
            )

    def _require(self) -> GripperWorker:
        if self._worker is None:
            raise NotSupportedError(NONE_CONFIGURED)
        return self._worker

    async def _follow(self, worker: GripperWorker, running: Running, caller: Caller) -> GripperState:
        """Start a command and wait until it has ended. If it ends early, the fingers stop."""
        try:
            return await follow(worker, running, caller, self._link.clock, self.type)
        except CobotError as exc:
            if not isinstance(exc, DeviceError):
                self._halt(worker, running)
            raise

    def _halt(self, worker: GripperWorker, running: Running) -> None:
        """Stop the fingers after a command that ends early, unless another command is already moving them."""
        if self._running is running:
            worker.tell(lambda gripper: gripper.stop())

    def _note(self, command: AnyGripperCommand, state: GripperState, *, good: bool) -> None:
        """Publish that a finished command has grasped or released an object."""
        if isinstance(command, GripperGrasp):
            if good and missed(state) is None:
                self._note_grasp(state)
        elif isinstance(command, GripperMove):
            if good and state.object is not None and state.object.is_held:
                self._note_grasp(state)
        elif state.object is None and self._holds and isinstance(command, GripperRelease | GripperHome):
            self._holds = False  # this gripper does not detect whether it holds an object
            self._note_release()

    def _note_grasp(self, state: GripperState) -> None:
        self._holds, self._lost = True, False
        held = self._held.grasp(state)
        self._link.events.publish(
            "gripper", what="grasped", object=held, width=state.width, force=state.force
        )

    def _tell(self, what: str, **data: Any) -> None:
        self._link.events.publish("gripper", what=what, **data)

    def _shown(self, state: GripperState) -> GripperState:
        return replace(state, object=HeldObject.LOST) if self._lost else state

    def _look(self, reading: Reading) -> None:
        """Evaluate a new reading. It may show the progress of a command, or that an object is held, released
        or lost.
        """
        if self._running is not None:
            self._running.news.set()
        for tell in self.on_reading:
            tell()
        state = reading.state
        if reading.problem or state is None:
            return
        if not self._seen:
            self._seen = True
            self._adopt(state)
        if state.object is not None:
            self._watch_object(state, state.object)
        self._link.publish_gripper(self._shown(state), round(reading.read_s * 1e9))

    def _watch_object(self, state: GripperState, held: HeldObject) -> None:
        holds = held.is_held
        if self._holds and not holds:
            if self._running is None:
                self._lose()
            else:
                self._note_release()
        elif holds and not self._holds and self._running is None:
            self._note_grasp(state)  # grasped for a service that was then killed
        self._holds = holds

    def _adopt(self, state: GripperState) -> None:
        """Note an object that was already in the gripper when an earlier run of the service ended."""
        if state.object is None:
            self._holds = self._held.name is not None
        elif not state.object.is_held:
            self._held.forget()
        else:
            self._holds = self._held.name is not None

    def _note_release(self) -> None:
        name = self._held.release()
        self._tell("released", object=name)

    def _lose(self) -> None:
        """Report that an object is gone although no command has released it."""
        self._lost = True
        name = self._held.release()
        self._tell("lost", object=name, stops=self._options.on_loss == "stop")
        if self._options.on_loss == "stop" and self._ownership.in_motion:
            self._spawn(self._stop_arm(f"the gripper has lost {name or 'its object'}"))

    async def _stop_arm(self, why: str) -> None:
        with contextlib.suppress(CobotError):
            await self._stopping.stop_motion(StopReason(why, "gripper"))

    async def _watch(self, worker: GripperWorker) -> None:
        """Watch for stops and e-stops from any source. If one occurs, end the current command."""
        stops, latched = self._ownership.stops, False
        while True:
            await asyncio.sleep(WATCH_S)
            now_latched = self._is_latched(latched)
            if self._ownership.stops != stops or (now_latched and not latched):
                self._heed_stop(worker, "the mode is ESTOP or FAULT" if now_latched else "stopped by a stop")
            stops, latched = self._ownership.stops, now_latched

    def _is_latched(self, before: bool) -> bool:
        try:
            return self._link.state().mode in (LoopMode.ESTOP, LoopMode.FAULT)
        except UnavailableError:
            return before

    def _heed_stop(self, worker: GripperWorker, why: str) -> None:
        running = self._running
        stopped = running is None or running.stops != self._ownership.stops
        if not stopped and running is not None and (running.latched or not self._is_latched(False)):
            return  # requested after the stop
        if running is not None:
            running.interrupt(StopReason(why, "robot" if self._is_latched(False) else "stop", "").error)
        if self._options.on_stop == "open":
            self._running = None
            self._spawn(self._open(worker))

    async def _open(self, worker: GripperWorker) -> None:
        stops = self._ownership.stops
        running = self._running = Running("open", GripperRelease(width=None), None, stops, latched=True)
        try:
            await self._follow(worker, running, Caller("stop", None, 0, OPEN_S, asyncio.Event()))
        except CobotError as exc:
            log.warning("%sgripper: it has not opened after a stop: %s", self._link.label, exc)
        finally:
            if self._running is running:
                self._running = None

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work, name="gripper service")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
