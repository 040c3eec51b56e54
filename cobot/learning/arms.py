"""The arms of environments: a simulated arm on a virtual clock, or the arm of a running service."""

from __future__ import annotations

import contextlib
from typing import Protocol

from cobot.cell.surroundings import hand_as_tool
from cobot.client import Client, JointImpedanceControl, Mode, Robot
from cobot.client.fingers import ServedFingers
from cobot.clock import Clock
from cobot.config import Settings
from cobot.errors import CobotError, ExecutionError
from cobot.learning.simulation import Simulation, hand_of
from cobot.robot.description import RobotDescription
from cobot.types import Array

INTERPOLATION = "quintic"


class EpisodeArm(Protocol):
    """An arm for an environment.

    Attributes:
        robot: client of the arm.
        clock: clock of the arm.
        control: the current streaming session, which `restart` begins.
        width_m: the smallest and the largest width between the fingers, m; None if there is no gripper.
        max_force_n: largest force at the fingers, N.
    """

    robot: Robot
    clock: Clock
    control: JointImpedanceControl
    width_m: tuple[float, float] | None
    max_force_n: float

    def restart(self, start: Array) -> None:
        """Move the arm to `start`, where it stops, and begin a session.

        Raises:
            CobotError: the arm does not reach `start`.
        """
        ...

    def aim(self, width: float) -> None:
        """Move the fingers to a width, m, without waiting.

        Raises:
            CobotError: the gripper rejects the command.
        """
        ...

    def close(self) -> None:
        """Release the arm. This may be called again."""
        ...


class SimulatedArm:
    """A simulated arm. Each episode uses a new simulation, so that nothing remains from the previous one."""

    robot: Robot
    clock: Clock
    control: JointImpedanceControl

    def __init__(self, settings: Settings, description: RobotDescription, rate_hz: float) -> None:
        self._settings, self._description, self._rate_hz = settings, description, rate_hz
        self._simulation: Simulation | None = None
        hand = hand_of(settings)
        self.width_m = None if hand is None else (0.0, hand.stroke_m)
        self.max_force_n = 0.0 if hand is None else hand.max_force_n
        if hand is not None:
            description.model.carry(hand_as_tool(hand))

    def aim(self, width: float) -> None:
        assert self._simulation is not None
        assert self._simulation.fingers is not None
        self._simulation.fingers.aim(width)

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
    """The arm of a running service. It moves to the start of an episode with an ordinary motion.

    Args:
        url: service URL, or of one of its robots.
        rate_hz: rate of the targets.
        speed: speed of the motion to the start, as a share of the limits.
        clock, client: see `Robot`.
    """

    control: JointImpedanceControl

    def __init__(self, robot: Robot, client: Client, rate_hz: float, speed: float, clock: Clock) -> None:
        self.robot, self.clock = robot, clock
        self._client, self._rate_hz, self._speed = client, rate_hz, speed
        self._closed = False
        self._fingers = ServedFingers.of(client.gripper)
        self.width_m = None if self._fingers is None else self._fingers.width_m
        self.max_force_n = 0.0 if self._fingers is None else self._fingers.max_force_n

    def aim(self, width: float) -> None:
        assert self._fingers is not None
        self._fingers.aim(width)

    def restart(self, start: Array) -> None:
        self.robot.stop()
        outcome = self._client.move_joints(start.tolist(), speed=self._speed)
        if not outcome["success"]:
            raise ExecutionError(f"the arm did not reach the start of the episode: {outcome['message']}")
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
