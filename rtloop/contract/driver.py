"""Runs rtloop's cycle around a backend in this process, in robot time, without waiting for a clock."""

from __future__ import annotations

import contextlib
import itertools
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from cobot.config import Settings
from cobot.contract_checks import ContractError
from cobot.ipc.layout import RING, Ack, Command, MotionResult, text
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import RobotDescription
from cobot.trajectory import CHANGE_PEAKS, Trajectory, from_hermite
from cobot.types import Array, LoopMode
from rtloop.backends import Backend, BackendError, Measured
from rtloop.backends.trajectory_driver import as_backend
from rtloop.clock import FastClock
from rtloop.contract.rig import Around, ContractRig, wire_of
from rtloop.loop import ControlLoop
from rtloop.results import ACCEPTED, Accepted, Rejected

SEGMENTS = 64
PATIENCE_S = 20.0
"""Timeout for an expected event, s of robot time."""
ATTEMPTS = 20
"""Maximum number of attempts to reset a fault, 0.1 s apart. The first ones may fail because the arm is still
moving.
"""
SHARE = 0.5
"""Speed, acceleration and jerk of a test motion, as a share of the joint limits."""
_numbers = itertools.count()


@dataclass(slots=True)
class CallRecord:
    """The record of calls between the cycle and the backend.

    Attributes:
        calls: names of methods, without immediate repetitions.
        measured: the last position read, shape (dof,), rad.
        commands: the written commands, each with the last position read before it.
        durations_s: for each cycle, the total duration of `read` and `write`.
    """

    calls: list[str] = field(default_factory=list)
    measured: Array = field(default_factory=lambda: np.zeros(0))
    commands: list[tuple[Array, Array]] = field(default_factory=list)
    durations_s: list[float] = field(default_factory=list)


class Listening(Around):
    """A wrapper that records the calls to a backend."""

    def __init__(self, inner: Backend, heard: CallRecord) -> None:
        super().__init__(inner)
        self._heard = heard
        self._reading_s = 0.0

    def open(self, initial_position: Array) -> None:
        self._note("open")
        super().open(initial_position)

    def enable(self) -> None:
        self._note("enable")
        super().enable()

    def read(self, measured: Measured) -> None:
        self._note("read")
        begun = time.perf_counter()
        super().read(measured)
        self._reading_s = time.perf_counter() - begun
        self._heard.measured = measured.position.copy()

    def write(self, command: Array) -> None:
        self._note("write")
        self._heard.commands.append((command.copy(), self._heard.measured))
        begun = time.perf_counter()
        super().write(command)
        self._heard.durations_s.append(self._reading_s + time.perf_counter() - begun)

    def disable(self) -> None:
        self._note("disable")
        super().disable()

    def close(self) -> None:
        self._note("close")
        super().close()

    def _note(self, call: str) -> None:
        if not self._heard.calls or self._heard.calls[-1] != call:
            self._heard.calls.append(call)


class Driver:
    """Runs a backend with rtloop's cycle, and acts as the service in rtloop's shared memory.

    Attributes:
        backend: the backend that the last `start` opened.
        heard: record of the calls since the last `start`.
    """

    def __init__(self, settings: Settings, robot: RobotDescription, rig: ContractRig) -> None:
        self.rig, self.limits, self.period_s = rig, robot.limits, settings.rt.period_s
        rt = settings.rt.model_copy(update={"trajectory_capacity": SEGMENTS, "clock": "fast"})
        self._settings = settings.model_copy(update={"rt": rt})
        self._robot = robot
        self.memory = RobotMemory.create(
            f"contract_{os.getpid()}_{next(_numbers)}", self.limits.dof, self.period_s, SEGMENTS
        )
        self.heard = CallRecord()
        self.backend: Backend
        self._loop: ControlLoop | None = None
        self._paced = False
        self._command = self._motion = 0
        self.memory.heartbeat.data["monotonic_ns"] = time.monotonic_ns() + 10**15
        self.memory.heartbeat.publish()

    def start(self) -> None:
        """Open the device. A second call simulates a new start of rtloop after a crash.

        Raises:
            BackendError: the device cannot be opened.
        """
        self.heard = CallRecord()
        made = as_backend(self.rig.backend(), self.limits.dof, self.period_s, threaded=False)
        backend: Backend = Listening(made, self.heard)
        self._paced = hasattr(backend, "wait")
        loop = ControlLoop(self._settings, self._robot.model, self.memory, backend, FastClock(self.period_s))
        home = self._robot.positions[self._settings.robot.start_position].joints
        loop.controller.acknowledge()  # there is no user to acknowledge the first contact
        try:
            loop.open(np.array(home))
        except BackendError:
            with contextlib.suppress(BackendError):
                loop.close()
            raise
        self._loop, self.backend = loop, backend

    def end(self) -> None:
        """Close the device."""
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.close()

    def close(self) -> None:
        with contextlib.suppress(BackendError):
            self.end()
        self.memory.unlink()
        self.memory.close()

    @property
    def loop(self) -> ControlLoop:
        if self._loop is None:
            raise ContractError("the device is not open")
        return self._loop

    @property
    def mode(self) -> LoopMode:
        return self.loop.controller.mode

    @property
    def reason(self) -> str:
        return str(self.loop.controller.reason)

    def step(self, cycles: int = 1) -> None:
        """Run cycles. If the device is externally clocked, each cycle waits for it."""
        for _ in range(cycles):
            if self._paced:
                self.loop.beat()
            self.loop.step()

    def run(self, time_s: float) -> None:
        self.step(max(1, round(time_s / self.period_s)))

    def until(self, what: str, happened: Callable[[], bool]) -> None:
        """Run cycles until a condition is met. Raises ContractError if it is not met in time."""
        for _ in range(round(PATIENCE_S / self.period_s)):
            if happened():
                return
            self.step()
        raise ContractError(
            f"not reached within {PATIENCE_S:g} s: {what}; the mode is {self.mode.name}"
            + (f": {self.reason}" if self.reason else "")
        )

    def send(self, kind: int, **fields: int) -> Accepted | Rejected:
        """Send a command to rtloop and wait for its answer."""
        self.ask(kind, **fields)
        return self.await_answer()

    def ask(self, kind: int, **fields: int) -> None:
        """Write a command for rtloop's next cycle."""
        self._command += 1
        command = self.memory.commands[self._command % RING]
        command.data["id"], command.data["kind"] = self._command, kind
        command.data["stops"] = self.memory.requests.data["stops"]
        if kind == Command.RESET:
            command.data["stops"] += self.memory.requests.data["estops"]
        command.data["tool"] = command.data["scene"] = 0
        for name, value in fields.items():
            command.data[name] = value
        command.publish()
        self.memory.head.data["id"] = self._command
        self.memory.head.publish()

    def await_answer(self) -> Accepted | Rejected:
        """Wait for rtloop's answer to the last command."""
        ack = self.memory.acks[self._command % RING]
        self.until("rtloop answers a command", lambda: int(ack.data["id"]) == self._command)
        accepted = int(ack.data["result"]) == Ack.ACCEPTED
        return ACCEPTED if accepted else Rejected(text(ack.data["message"]))

    def stop(self) -> None:
        self.memory.requests.data["stops"] += 1
        self.memory.requests.publish()

    def begin_move(self) -> None:
        """Begin a motion that moves each joint a little towards the middle of its range, from rest to
        rest.
        """
        self.ask_move()
        result = self.await_answer()
        if isinstance(result, Rejected):
            raise ContractError(f"a motion is rejected: {result.reason}")

    def ask_move(self) -> None:
        """Request the motion of `begin_move`. rtloop begins to load it in its next cycle."""
        if not self.heard.commands:
            self.first_command(0)
        start = self.heard.commands[-1][0][0]
        self._motion += 1
        self.memory.slots[0].write(self._motion, self._trajectory(start), None)
        self.ask(Command.START, slot=0, motion_id=self._motion)

    def move(self) -> None:
        """Execute the motion of `begin_move` to its end.

        Raises:
            ContractError: the arm does not reach its target.
        """
        self.begin_move()
        self.until("a motion ends", lambda: self.loop.controller.motion_result != MotionResult.RUNNING)
        result = self.loop.controller.motion_result
        if result != MotionResult.ARRIVED:
            raise ContractError(f"a motion ended as {result.name}: {self.reason}")

    def reset(self, attempts: int = ATTEMPTS) -> Accepted | Rejected:
        """Reset a fault. If the reset fails, try again a few times. Returns the result of the last
        attempt.
        """
        result: Accepted | Rejected = ACCEPTED
        for _ in range(attempts):
            result = self.send(Command.RESET)
            if result == ACCEPTED:
                break
            self.run(0.1)
        return result

    def first_command(self, before: int) -> tuple[Array, Array]:
        """Return the command that follows the first `before` commands, and the position measured in the same
        cycle.
        """
        self.until("a command is written", lambda: len(self.heard.commands) > before)
        command, measured = self.heard.commands[before]
        return command[0], measured

    @contextlib.contextmanager
    def fault(self, name: str) -> Iterator[None]:
        """Inject a fault for the duration of the context."""
        self.rig.inject(name)
        try:
            yield
        finally:
            self.rig.clear(name)

    @property
    def wire(self) -> list[Array] | None:
        """The commands sent to the device; None if the rig does not record them."""
        return wire_of(self.rig)

    @property
    def middle(self) -> Array:
        """Return the middle of each joint's range, rad."""
        with np.errstate(invalid="ignore"):  # inf - inf, for a joint without position limits
            middle: Array = (self.limits.min_position + self.limits.max_position) / 2.0
        return middle

    def _trajectory(self, start: Array) -> Trajectory:
        low, high = self.limits.min_position, self.limits.max_position
        goal = start + np.where(start < self.middle, 0.2, -0.2) * np.minimum(1.0, (high - low) / 4.0)
        bounds = self.limits.max_velocity, self.limits.max_acceleration, self.limits.max_jerk
        duration_s = max(
            float(((peak * np.abs(goal - start) / (SHARE * bound)) ** (1.0 / order)).max())
            for order, (peak, bound) in enumerate(zip(CHANGE_PEAKS, bounds, strict=True), start=1)
        )
        still = np.zeros((2, self.limits.dof))
        return from_hermite(np.array([0.0, duration_s]), np.array([start, goal]), still, still)
