"""A simulated arm in this process, whose time advances only while a caller sleeps.

It runs the same cycles as the simulation of `cobot run`, but at the speed of the computer. An episode takes
as long as its computations, and the same commands give the same results on every run.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable

import numpy as np

from cobot.cell import Hand, load_cell
from cobot.client import Robot
from cobot.client.fingers import FollowedWidth
from cobot.clock import Ticks
from cobot.config import Settings
from cobot.errors import NotSupportedError
from cobot.grippers import GripperState
from cobot.grippers.simulated import SimulatedGripper
from cobot.ipc.gripper_record import fill_gripper
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.backends.cell import CellBackend
from rtloop.backends.mujoco import MujocoBackend
from rtloop.clock import FastClock
from rtloop.loop import ControlLoop
from rtloop.main import describe

CAPACITY = 1000
"""Maximum number of segments of a planned motion. Episodes do not use planned motions."""
FOREVER_NS = 10**16
_numbers = itertools.count()


class StepClock:
    """The `cobot.clock.Clock` of a simulation. A call that sleeps runs the cycles of the simulation."""

    def __init__(self, step: Callable[[int], None], period_ns: int) -> None:
        self._step, self._period_ns = step, period_ns
        self._begun_ns, self._wall_ns = time.monotonic_ns(), time.time_ns()
        self.cycles = 0

    def now_ns(self) -> int:
        return self._begun_ns + self.cycles * self._period_ns

    def now_s(self) -> float:
        return self.now_ns() * 1e-9

    def wall_ns(self) -> int:
        return self._wall_ns + self.cycles * self._period_ns

    def sleep(self, seconds: float) -> None:
        count = max(1, round(seconds * 1e9 / self._period_ns))
        self.cycles += count
        self._step(count)

    def ticker(self, rate_hz: float, on_tick: Callable[[int], None]) -> Ticks:
        raise NotSupportedError(
            "this simulation advances only by step(), so it has no event loop for a ticker"
        )


class SimulatedFingers:
    """The hand of a simulated cell, used without a service.

    Attributes:
        width_m: see `cobot.client.fingers.WidthFollower`.
    """

    def __init__(self, hand: Hand, backend: CellBackend) -> None:
        self._driver = SimulatedGripper(hand, CellPort(backend))
        self.width_m = (0.0, hand.stroke_m)
        self._driver.connect()
        self._followed = FollowedWidth(self.width_m)

    @classmethod
    def of(cls, settings: Settings, backend: MujocoBackend) -> SimulatedFingers | None:
        """The fingers of the simulated cell; None if the cell has no hand."""
        hand = hand_of(settings)
        return cls(hand, backend) if hand is not None and isinstance(backend, CellBackend) else None

    def aim(self, width: float) -> None:
        """See `cobot.client.fingers.WidthFollower`."""
        self._followed.follow(width, lambda target: self._driver.move(target, None, None))

    def state(self) -> GripperState:
        return self._driver.state()


class CellPort:
    """The inputs and outputs of a simulated cell, in the form of `cobot.grippers.protocol.IoPort`."""

    def __init__(self, backend: CellBackend) -> None:
        self._backend = backend

    def read(self, name: str) -> float:
        return self._backend.read_input(name)

    def set(self, name: str, value: float) -> None:
        self._backend.set_output(name, value)


def hand_of(settings: Settings) -> Hand | None:
    """The hand in the cell of the settings; None if the cell has no hand."""
    return None if settings.robot.cell is None else load_cell(settings.robot.cell).hand


class Simulation:
    """One simulated arm.

    Attributes:
        robot: client of the arm, which streams like a client of a running service.
        clock: clock whose time advances only while a caller sleeps.
        fingers: the hand in the cell of the settings; None if the cell has no hand.
    """

    def __init__(self, settings: Settings, description: RobotDescription, start: Array) -> None:
        """
        Args:
            description: the robot. It carries the hand in the cell of the settings, if there is one.
            start: joint positions of the arm at rest, shape (dof,), rad.
        """
        period_s = settings.rt.period_s
        name = f"learning_{os.getpid()}_{next(_numbers)}"
        self._memory = RobotMemory.create(name, description.limits.dof, period_s, CAPACITY)
        try:
            simulate = MujocoBackend if settings.robot.cell is None else CellBackend
            backend = simulate(settings, description.limits)
            self.fingers = SimulatedFingers.of(settings, backend)
            self._loop = ControlLoop(
                settings, description.model, self._memory, backend, FastClock(period_s), None
            )
            self._loop.open(start, description.model.tool)
            describe(self._memory, description, backend)
            heartbeat = self._memory.heartbeat
            heartbeat.data["monotonic_ns"] = (
                time.monotonic_ns() + FOREVER_NS
            )  # there is no service that sends a heartbeat
            heartbeat.publish()
            self.clock = StepClock(self._step, round(period_s * 1e9))
            self.clock.sleep(period_s)
            self.robot = Robot(name, connect_retries=0, verbose=False, clock=self.clock)
        except BaseException:
            self._forget()
            raise

    def close(self) -> None:
        """Remove the arm and its memory. This may be called again."""
        if self._memory is not None:
            self.robot.close()
            self._loop.close()
            self._forget()

    def _forget(self) -> None:
        self._memory.unlink()
        self._memory.close()
        self._memory = None  # type: ignore[assignment]

    def _step(self, count: int) -> None:
        with np.errstate(all="ignore"):  # comparisons find non-finite values and report them
            for _ in range(count):
                self._loop.step()
        state = self._memory.state
        if self.fingers is not None:
            fill_gripper(state.data, self.fingers.state(), self.clock.now_ns())
        state.data["monotonic_ns"] = self.clock.now_ns()  # so that the state is never too old
        state.publish()
