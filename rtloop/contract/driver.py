"""rtloop's own cycle around a backend, in this process and in robot time: nothing here waits for a clock."""

from __future__ import annotations

import contextlib
import itertools
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from cobot.config import Settings
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

SEGMENTS = 64
PATIENCE_S = 20.0
"""Robot time in which everything that is waited for has happened."""
ATTEMPTS = 20
"""To reset a fault, 0.1 s apart: the arm has to be at rest."""
SHARE = 0.5
"""A move uses this share of the joints' limits."""
_numbers = itertools.count()


class ContractError(Exception):
    """A backend does not keep the contract; the text says where."""


@dataclass(slots=True)
class Heard:
    """What has passed between the cycle and the backend.

    Attributes:
        calls: names of methods, without repetitions of the same one in a row.
        measured: the position that was read last, shape (dof,), rad.
        commands: each with the position that was read last before it.
        durations_s: of each read and write together.
    """

    calls: list[str] = field(default_factory=list)
    measured: Array = field(default_factory=lambda: np.zeros(0))
    commands: list[tuple[Array, Array]] = field(default_factory=list)
    durations_s: list[float] = field(default_factory=list)


class Listening(Around):
    """A backend around another one, which notes down what it is asked."""

    def __init__(self, inner: Backend, heard: Heard) -> None:
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
    """A backend that is driven, and the service's side of rtloop's memory.

    Attributes:
        backend: what the cycle drives, since the last `start`.
        heard: since then.
    """

    def __init__(self, settings: Settings, robot: RobotDescription, rig: ContractRig) -> None:
        self.rig, self.limits, self.period_s = rig, robot.limits, settings.rt.period_s
        rt = settings.rt.model_copy(update={"trajectory_capacity": SEGMENTS, "clock": "fast"})
        self._settings = settings.model_copy(update={"rt": rt})
        self._robot = robot
        self.memory = RobotMemory.create(
            f"contract_{os.getpid()}_{next(_numbers)}", self.limits.dof, self.period_s, SEGMENTS
        )
        self.heard = Heard()
        self.backend: Backend
        self._loop: ControlLoop | None = None
        self._paced = False
        self._command = self._motion = 0
        self.memory.heartbeat.data["monotonic_ns"] = time.monotonic_ns() + 10**15
        self.memory.heartbeat.publish()

    def start(self) -> None:
        """Begin, or begin anew as after a crash of rtloop.

        Raises:
            BackendError: the device cannot be opened.
        """
        self.heard = Heard()
        made = as_backend(self.rig.backend(), self.limits.dof, self.period_s, threaded=False)
        backend: Backend = Listening(made, self.heard)
        self._paced = hasattr(backend, "wait")
        loop = ControlLoop(self._settings, self._robot.model, self.memory, backend, FastClock(self.period_s))
        home = self._robot.positions[self._settings.robot.start_position].joints
        loop.controller.acknowledge()  # nobody is there to be told of a first contact
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
        """Cycles; a device that gives the beat is asked for it in each."""
        for _ in range(cycles):
            if self._paced:
                self.loop.beat()
            self.loop.step()

    def run(self, time_s: float) -> None:
        self.step(max(1, round(time_s / self.period_s)))

    def until(self, what: str, happened: Callable[[], bool]) -> None:
        """Raises ContractError: it has not happened."""
        for _ in range(round(PATIENCE_S / self.period_s)):
            if happened():
                return
            self.step()
        raise ContractError(
            f"{what}: not in {PATIENCE_S:g} s; the mode is {self.mode.name}"
            + (f": {self.reason}" if self.reason else "")
        )

    def send(self, kind: int, **fields: int) -> str:
        """A command for rtloop; "" when it accepts, or why not."""
        self.ask(kind, **fields)
        return self.answered()

    def ask(self, kind: int, **fields: int) -> None:
        """A command that rtloop finds in its next cycle."""
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

    def answered(self) -> str:
        """Wait until rtloop has answered the last command; "" when it accepts, or why not."""
        ack = self.memory.acks[self._command % RING]
        self.until("rtloop answers a command", lambda: int(ack.data["id"]) == self._command)
        return "" if int(ack.data["result"]) == Ack.ACCEPTED else text(ack.data["message"])

    def stop(self) -> None:
        self.memory.requests.data["stops"] += 1
        self.memory.requests.publish()

    def begin_move(self) -> None:
        """Each joint a bit towards the middle of its range, from rest to rest."""
        self.ask_move()
        refusal = self.answered()
        if refusal:
            raise ContractError(f"a motion is refused: {refusal}")

    def ask_move(self) -> None:
        """The same, which rtloop finds in its next cycle, and begins to load."""
        if not self.heard.commands:
            self.first_command(0)
        start = self.heard.commands[-1][0][0]
        self._motion += 1
        self.memory.slots[0].write(self._motion, self._trajectory(start), None)
        self.ask(Command.START, slot=0, motion_id=self._motion)

    def move(self) -> None:
        """A whole motion.

        Raises:
            ContractError: it does not arrive.
        """
        self.begin_move()
        self.until("a motion ends", lambda: self.loop.controller.motion_result != MotionResult.RUNNING)
        result = self.loop.controller.motion_result
        if result != MotionResult.ARRIVED:
            raise ContractError(f"a motion ended as {result.name}: {self.reason}")

    def reset(self, attempts: int = ATTEMPTS) -> str:
        """Leave a fault, at rest; "" or the last refusal."""
        refusal = ""
        for _ in range(attempts):
            refusal = self.send(Command.RESET)
            if not refusal:
                return ""
            self.run(0.1)
        return refusal

    def first_command(self, before: int) -> tuple[Array, Array]:
        """The first one after so many, and the position measured then."""
        self.until("a command is written", lambda: len(self.heard.commands) > before)
        command, measured = self.heard.commands[before]
        return command[0], measured

    @contextlib.contextmanager
    def fault(self, name: str) -> Iterator[None]:
        """It lasts as long."""
        self.rig.inject(name)
        try:
            yield
        finally:
            self.rig.clear(name)

    @property
    def wire(self) -> list[Array] | None:
        """What has been sent to the device, if the rig says."""
        return wire_of(self.rig)

    @property
    def middle(self) -> Array:
        """Of each joint's range, rad."""
        with np.errstate(invalid="ignore"):  # of a joint that turns without end
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
