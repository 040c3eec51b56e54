"""What an environment moves: an arm of its own on a virtual clock, or that of a service that runs."""

from __future__ import annotations

import contextlib
from typing import Protocol

from cobot.client import Client, JointImpedanceControl, Mode, Robot
from cobot.clock import Clock
from cobot.config import Settings
from cobot.errors import CobotError, ExecutionError
from cobot.learning.simulation import Simulation
from cobot.robot.description import RobotDescription
from cobot.types import Array

INTERPOLATION = "quintic"


class Arm(Protocol):
    """
    Attributes:
        robot: its client.
        clock: that it goes by.
        control: the session in which it is streamed to, from `restart` on.
    """

    robot: Robot
    clock: Clock
    control: JointImpedanceControl

    def restart(self, start: Array) -> None:
        """Have it stand there, at rest, and begin a session.

        Raises:
            CobotError: it does not get there.
        """
        ...

    def close(self) -> None:
        """Let go of it; may be called again."""
        ...


class SimulatedArm:
    """A new simulation for each episode: nothing of the last one is left in it."""

    robot: Robot
    clock: Clock
    control: JointImpedanceControl

    def __init__(self, settings: Settings, description: RobotDescription, rate_hz: float) -> None:
        self._settings, self._description, self._rate_hz = settings, description, rate_hz
        self._simulation: Simulation | None = None

    def restart(self, start: Array) -> None:
        self.close()
        self._simulation = Simulation(self._settings, self._description, start)
        self.robot, self.clock = self._simulation.robot, self._simulation.clock
        self.control = _session(self.robot, self._rate_hz)

    def close(self) -> None:
        simulation, self._simulation = self._simulation, None
        if simulation is not None:
            simulation.close()


class ServedArm:
    """The arm of a service: it moves to the start of an episode as to any other place.

    Args:
        url: of the service, or of one of its robots.
        rate_hz: of the targets to come.
        speed: on the way to a start, as a share of the limits.
        clock, client: see `Robot`.
    """

    control: JointImpedanceControl

    def __init__(self, robot: Robot, client: Client, rate_hz: float, speed: float, clock: Clock) -> None:
        self.robot, self.clock = robot, clock
        self._client, self._rate_hz, self._speed = client, rate_hz, speed
        self._closed = False

    def restart(self, start: Array) -> None:
        self.robot.stop()
        outcome = self._client.move_joints(start.tolist(), speed=self._speed)
        if not outcome["success"]:
            raise ExecutionError(f"the arm has not got to the start of the episode: {outcome['message']}")
        self.control = _session(self.robot, self._rate_hz)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            with contextlib.suppress(CobotError):
                self.robot.close()
            self._client.close()


def _session(robot: Robot, rate_hz: float) -> JointImpedanceControl:
    robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
    return robot.start_joint_impedance_control(rate_hz, interpolation=INTERPOLATION)
