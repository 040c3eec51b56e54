"""rtloop without processes: the real cycle, called step by step in robot time."""

from __future__ import annotations

import os
import threading
import time
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np
from cobot_run import WAIT_S, unique_name

from cobot.access.authentication import Authenticator
from cobot.access.tokens import TokenFile
from cobot.config import Settings
from cobot.ipc.layout import RING, Ack, Command, Interpolation, Intervention, MotionResult, Stream, text
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.shm import RobotMemory
from cobot.motions.fence import Fence
from cobot.motions.signals import NO_PLACED, Placed
from cobot.reasons import Reason
from cobot.robot.description import RobotDescription
from cobot.robot.tool import BARE, Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, LoopMode
from rtloop.backends import Backend, BackendError, Impedance, Measured
from rtloop.backends.mujoco import MujocoBackend
from rtloop.clock import CycleClock, FastClock
from rtloop.loop import ControlLoop

CAPACITY = 2000


def no_tokens() -> Authenticator:
    """For services that give out tokens, and know no others."""
    return Authenticator(TokenFile(Path("/nowhere/tokens.json")))


class Loopback:
    """The backend that is always where it is told to be; its faults are plain attributes."""

    def __init__(self, dof: int) -> None:
        self.measured = Measured(dof)
        self.offset = np.zeros(dof)
        self.fail_read = self.fail_write = self.fail_enable = ""
        self.nominal_stiffness = np.full(dof, 5000.0)
        self.nominal_cartesian_stiffness = np.array([10000.0] * 3 + [1000.0] * 3)
        self.impedance: Impedance | None = None

    def open(self, initial_position: Array) -> None:
        self.measured.position[:] = initial_position

    def enable(self) -> None:
        if self.fail_enable:
            raise BackendError(self.fail_enable)

    def read(self, measured: Measured) -> None:
        if self.fail_read:
            raise BackendError(self.fail_read)
        measured.values[:] = self.measured.values
        measured.position += self.offset

    def write(self, command: Array) -> None:
        if self.fail_write:
            raise BackendError(self.fail_write)
        self.measured.joints[:2] = command[:2]

    def set_impedance(self, impedance: Impedance | None) -> None:
        self.impedance = impedance

    def disable(self) -> None: ...

    def close(self) -> None: ...


class Rig:
    """A loop, its shared memory, and the service's side of it."""

    def __init__(
        self,
        settings: Settings,
        robot: RobotDescription,
        *,
        simulated: bool = False,
        memory: RobotMemory | None = None,
        start: Array | None = None,
        recording: RecordingMemory | None = None,
        backend: Backend | None = None,
        acknowledged: bool = True,
        clock: CycleClock | None = None,
        tool: Tool = BARE,
    ) -> None:
        """
        Args:
            backend: in place of the loopback and the simulation.
            acknowledged: whether somebody has acknowledged the first contact with it.
            clock: in place of robot time.
            tool: what the arm carries from the start.
        """
        capacity = CAPACITY if memory is None else len(memory.slots[0].coefficients)
        rt = settings.rt.model_copy(update={"trajectory_capacity": capacity})
        self.settings = settings.model_copy(update={"rt": rt})
        self.robot = robot
        self.limits = robot.limits
        self.memory = memory or RobotMemory.create(unique_name(), robot.limits.dof, rt.period_s, CAPACITY)
        self.loopback = Loopback(robot.limits.dof)
        backend = backend or (self.simulation if simulated else self.loopback)
        self.clock = clock or FastClock(rt.period_s)
        self.loop = ControlLoop(self.settings, robot.model, self.memory, backend, self.clock, recording)
        self.home = np.array(robot.positions["home"].joints)
        self.loop.open(self.home if start is None else start, tool)
        if acknowledged:
            self.loop.controller.acknowledge()
        self.commanded: list[Array] = []
        self.path_times: list[float] = []
        self._command = int(self.memory.head.data["id"])
        self._motion = 0
        self.beat()

    @cached_property
    def simulation(self) -> MujocoBackend:
        """For who needs it: MuJoCo compiles its model."""
        return MujocoBackend(self.settings, self.robot.limits)

    def close(self) -> None:
        self.memory.unlink()
        self.memory.close()

    @property
    def mode(self) -> LoopMode:
        return self.loop.controller.mode

    @property
    def reason(self) -> Reason:
        return self.loop.controller.reason

    @property
    def result(self) -> MotionResult:
        return self.loop.controller.motion_result

    @property
    def interventions(self) -> list[int]:
        return self.loop.controller.safety.interventions.tolist()

    def beat(self, ahead_s: float = 1e6) -> None:
        """A heartbeat of the service, by default one that lasts for the whole test."""
        self.memory.heartbeat.data["monotonic_ns"] = time.monotonic_ns() + int(ahead_s * 1e9)
        self.memory.heartbeat.publish()

    def describe(self, stiffness: Array | float = 500.0) -> None:
        """Publish what sessions begin with, in the record that the loop publishes again and again."""
        info = self.memory.info
        info.data["stiffness"], info.data["cartesian_stiffness"] = stiffness, [3000.0] * 3 + [200.0] * 3
        info.data["min_position"], info.data["max_position"] = (
            self.limits.min_position,
            self.limits.max_position,
        )
        info.publish()

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
        if kind == Command.RESET:
            estops = int(self.memory.requests.data["estops"]) + self.memory.outside_estops.value
            command.data["stops"] = (int(command.data["stops"]) + estops) % 2**64
        command.data["tool"] = 0
        command.data["scene"] = 0
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
            self.await_surroundings()
        raise AssertionError("no answer")

    def await_surroundings(self) -> None:
        """Robot time stands still while a thread, in the computer's time, reads the scene and the tool."""
        if self.loop.controller.tool_and_scene.surroundings.busy:
            for thread in threading.enumerate():
                if thread.name == "surroundings":
                    thread.join(WAIT_S)

    def start(
        self,
        trajectory: Trajectory,
        slot: int = 0,
        fence: Fence | None = None,
        tool: int = 0,
        signals: Placed = NO_PLACED,
    ) -> str:
        """Start a motion that was planned with this version of the tool; "" or why it is refused."""
        self._motion += 1
        self.memory.slots[slot].write(self._motion, trajectory, fence, signals)
        return self.answer(self.send(Command.START, slot=slot, motion_id=self._motion, tool=tool))

    def stream(self, stream: Stream = Stream.JOINT_IMPEDANCE, **fields: object) -> str:
        """Open a session as a client would; "" or why not."""
        session = self.memory.session.data
        session["number"] += 1
        session["open"], session["pid"], session["stream"] = 1, os.getpid(), stream
        session["stops"] = self.loop.controller.commands.stops
        session["interpolation"], session["decimation"] = Interpolation.LINEAR, 10
        session["stiffness"], session["damping_ratio"] = 500.0, 0.7
        session["cartesian_stiffness"][:3], session["cartesian_stiffness"][3:] = 3000.0, 200.0
        session["cartesian_damping_ratio"] = 0.7
        session["max_contact_torque"], session["max_contact_wrench"] = np.inf, np.inf
        session["force_axes"], session["force_velocity"] = 0.0, 1.0
        session["force_frame"] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        session["posture"] = np.nan
        session["servo_mode"] = 0
        for name, value in fields.items():
            session[name] = value
        self.memory.session.publish()
        self.step()
        ack = self.memory.session_ack
        assert ack.try_read()
        assert ack.data["session"] == session["number"]
        return "" if ack.data["result"] == Ack.ACCEPTED else text(ack.data["message"])

    def aim(self, **values: object) -> None:
        """Write a target, or another of the fields of the setpoint."""
        setpoint = self.memory.setpoint.data
        setpoint["session"] = self.memory.session.data["number"]
        if not {"move", "cancel"} & set(values):
            setpoint["number"] += 1
        for name, value in values.items():
            setpoint[name] = value
        self.memory.setpoint.publish()

    def end_stream(self) -> None:
        self.memory.session.data["open"] = 0
        self.memory.session.publish()

    def counted(self) -> dict[str, int]:
        """The interventions so far, those that were."""
        return {kind.name: n for kind, n in zip(Intervention, self.interventions, strict=True) if n}

    def request(self, what: str = "stops") -> None:
        """A stop, or an e-stop."""
        self.memory.requests.data[what] += 1
        self.memory.requests.publish()

    def floor_force(self) -> float:
        """What presses on anything in the simulation, as MuJoCo computes it, N."""
        model, data = self.simulation._model, self.simulation._data
        total, one = 0.0, np.zeros(6)
        for index in range(data.ncon):
            mujoco.mj_contactForce(model, data, index, one)
            total += one[0]
        return total

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
