"""rtloop without processes: the real cycle, called step by step in robot time."""

from __future__ import annotations

import time

import numpy as np
from running import unique_name

from cobot.config import Settings
from cobot.layout import RING, Ack, Command, MotionResult
from cobot.robot import Robot
from cobot.shm import RobotMemory, text
from cobot.trajectory import Trajectory
from cobot.types import Array, Mode
from rtloop.backends import Backend, BackendError
from rtloop.backends.mujoco import MujocoBackend
from rtloop.clock import FastClock
from rtloop.loop import ControlLoop

CAPACITY = 2000


class Loopback:
    """The backend that is always where it is told to be; its faults are plain attributes."""

    def __init__(self, dof: int) -> None:
        self.measured = np.zeros((3, dof))
        self.offset = np.zeros(dof)
        self.fail_read = self.fail_write = self.fail_enable = ""

    def open(self, initial_position: Array) -> None:
        self.measured[0] = initial_position

    def enable(self) -> None:
        if self.fail_enable:
            raise BackendError(self.fail_enable)

    def read(self, measured: Array) -> None:
        if self.fail_read:
            raise BackendError(self.fail_read)
        measured[:] = self.measured
        measured[0] += self.offset

    def write(self, command: Array) -> None:
        if self.fail_write:
            raise BackendError(self.fail_write)
        self.measured[:2] = command[:2]

    def disable(self) -> None: ...

    def close(self) -> None: ...


class Rig:
    """A loop, its shared memory, and the service's side of it."""

    def __init__(
        self,
        settings: Settings,
        robot: Robot,
        *,
        simulated: bool = False,
        memory: RobotMemory | None = None,
        start: Array | None = None,
    ) -> None:
        rt = settings.rt.model_copy(update={"trajectory_capacity": CAPACITY})
        self.settings = settings.model_copy(update={"rt": rt})
        self.robot = robot
        self.limits = robot.limits
        self.memory = memory or RobotMemory.create(unique_name(), robot.limits.dof, rt.period_s, CAPACITY)
        self.loopback = Loopback(robot.limits.dof)
        self.simulation = MujocoBackend(self.settings, robot.limits)
        backend: Backend = self.simulation if simulated else self.loopback
        self.loop = ControlLoop(self.settings, robot.model, self.memory, backend, FastClock(rt.period_s))
        self.home = np.array(robot.positions["home"].joints)
        self.loop.open(self.home if start is None else start)
        self.commanded: list[Array] = []
        self.path_times: list[float] = []
        self._command = int(self.memory.head.data["id"])
        self._motion = 0
        self.beat()

    def close(self) -> None:
        self.memory.unlink()
        self.memory.close()

    @property
    def mode(self) -> Mode:
        return self.loop.controller.mode

    @property
    def reason(self) -> str:
        return self.loop.controller.reason

    @property
    def result(self) -> MotionResult:
        return self.loop.controller.motion_result

    @property
    def interventions(self) -> list[int]:
        return self.loop.controller.safety.interventions.tolist()

    def beat(self, ahead_s: float = 1e6) -> None:
        """A sign of life of the service, by default one that lasts for the whole test."""
        self.memory.heartbeat.data["monotonic_ns"] = time.monotonic_ns() + int(ahead_s * 1e9)
        self.memory.heartbeat.publish()

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        for _ in range(cycles):
            self.loop.step(late_ns)
            self.commanded.append(self.loop.controller.safety.position.copy())
            self.path_times.append(self.loop.controller.clock.path_time_s)

    def run(self, limit_cycles: int = 60_000) -> None:
        """Until nothing moves."""
        for _ in range(limit_cycles):
            self.step()
            if not self.loop.controller.moving:
                return
        raise AssertionError(f"still moving after {limit_cycles} cycles")

    def send(self, kind: int, **fields: float) -> int:
        """Post a command; its number."""
        self._command += 1
        command = self.memory.commands[self._command % RING]
        command.data["id"], command.data["kind"] = self._command, kind
        command.data["stops"] = self.memory.requests.data["stops"]
        for name, value in fields.items():
            command.data[name] = value
        command.publish()
        self.memory.head.data["id"] = self._command
        self.memory.head.publish()
        return self._command

    def answer(self, number: int, cycles: int = 3000) -> str:
        """What rtloop says to a command: "" when it accepts."""
        ack = self.memory.acks[number % RING]
        for _ in range(cycles):
            if int(ack.data["id"]) == number:
                return "" if int(ack.data["result"]) == Ack.ACCEPTED else text(ack.data["message"])
            self.step()
        raise AssertionError("no answer")

    def start(self, trajectory: Trajectory, slot: int = 0) -> str:
        """Have a motion started; "" or why not."""
        self._motion += 1
        self.memory.slots[slot].write(self._motion, trajectory)
        return self.answer(self.send(Command.START, slot=slot, motion_id=self._motion))

    def request(self, what: str = "stops") -> None:
        """A stop, or an e-stop."""
        self.memory.requests.data[what] += 1
        self.memory.requests.publish()

    def rates(self) -> tuple[Array, Array, Array]:
        """Velocity, acceleration and jerk of all that was commanded, as shares of the limits, (n, dof)."""
        period_s = self.settings.rt.period_s
        positions = np.array(self.commanded)
        bounds = self.limits.max_velocity, self.limits.max_acceleration, self.limits.max_jerk
        velocity, acceleration, jerk = (
            np.abs(np.diff(positions, order, axis=0)) / period_s**order / bound
            for order, bound in enumerate(bounds, start=1)
        )
        return velocity, acceleration, jerk
