"""A stand-in for pylibfranka: a robot that executes commands and, on request, loses packets and stops.

It provides the part of the package that the backend uses. Like a Franka, it rejects settings while it is
under control, and control while it is not ready. Each exchange of packets is one period; there is no clock.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from cobot.types import Array
from rtloop.backends import BackendError
from rtloop.backends.franka.stand_in_library import (
    CommandException,
    ControlException,
    ControllerMode,
    Duration,
    FrankaException,
    InvalidOperationException,
    JointPositions,
    NetworkException,
    RealtimeConfig,
    RealtimeException,
    RobotMode,
    State,
    Torques,
)

PERIOD_S = 0.001
START = (0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854)
REFERENCE_OFF_RAD = 2e-4
"""Distance between the robot's reference and the measured position, rad."""
LOST = 20
"""One in this many packets is lost while packets are lost on request."""


class FrankaStandIn:
    """A stand-in for the robot. Its state survives a lost connection.

    Attributes (set by tests):
        lose: number of packets that are lost before the next state arrives.
        fail: exception that the next exchange raises.
        faults: lasting faults, as names of `rtloop.contract.FAULTS`.
        refuses: kind of control that the robot rejects, "positions" or "torques".
        real_time: whether the computer has a real-time kernel.
        positions, torques: commands since control began, cycle by cycle. While packets are lost, they are the
            robot's own continuation.
        wire: all commanded positions.
    """

    def __init__(self) -> None:
        self.mode, self.errors = RobotMode.Idle, set[str]()
        self.lose = 0
        self.fail: FrankaException | None = None
        self.faults: set[str] = set()
        self.refuses = ""
        self.real_time = True
        self.q = np.array(START)
        self.q_d = self.q + REFERENCE_OFF_RAD
        self.positions: list[Array] = []
        self.torques: list[Array] = []
        self.wire: list[Array] = []
        self.told: dict[str, Any] = {}
        self.recovered = self.cycles = 0
        self.controlled = ""
        self.connection: StandInConnection | None = None
        self._frozen: State | None = None

    @property
    def library(self) -> SimpleNamespace:
        """Return the object that replaces the imported module `pylibfranka`."""
        kinds = (
            FrankaException,
            ControlException,
            NetworkException,
            CommandException,
            InvalidOperationException,
            RealtimeException,
            RobotMode,
            RealtimeConfig,
            ControllerMode,
            JointPositions,
            Torques,
        )
        return SimpleNamespace(Robot=self.connect, **{kind.__name__: kind for kind in kinds})

    def connect(self, address: str, realtime: RealtimeConfig = RealtimeConfig.kEnforce) -> StandInConnection:
        """Create a new connection. It ends the previous connection and its control."""
        if realtime is RealtimeConfig.kEnforce and not self.real_time:
            raise RealtimeException("libfranka: Running kernel does not have realtime capabilities.")
        if "disconnect" in self.faults:
            raise NetworkException("libfranka: Connection error: No route to host")
        self.let_go()
        self.connection = StandInConnection(self)
        return self.connection

    def knock(self, address: str) -> FrankaStandIn:
        """Stands in for `rtloop.backends.franka.link.Knock`."""
        return self

    def await_answer(self, wait_s: float = 0.0) -> bool:
        if "disconnect" in self.faults:
            raise BackendError("no answer")
        return True

    def stop_by(self, *errors: str) -> None:
        """Simulate a reflex that stops the robot."""
        self.let_go()
        self.errors, self.mode = set(errors), RobotMode.Reflex
        listed = ", ".join(f'"{each}"' for each in errors)
        self.fail = ControlException(f"libfranka: Move command aborted: motion aborted by reflex! [{listed}]")

    def press_stop(self) -> None:
        """Press the user stop."""
        self.let_go()
        self.mode = RobotMode.UserStopped
        self.fail = ControlException("libfranka: Move command aborted: User Stop pressed!")

    def let_go(self) -> None:
        """End the control."""
        if self.controlled:
            self.controlled, self.mode = "", RobotMode.Idle

    def begin(self, kind: str) -> None:
        """Begin control of positions or torques."""

    def turn(self, torque: Array) -> None:
        """Run one period under torque control. The arm does not move, as if a person held it."""

    def move(self, position: Array) -> None:
        self.positions.append(position)
        self.wire.append(position)
        self.q_d, self.q = position, position - REFERENCE_OFF_RAD

    def extrapolate(self) -> None:
        """Continue at constant acceleration, as a robot does after a lost command."""
        if self.controlled == "positions" and len(self.positions) >= 3:
            a, b, c = self.positions[-3:]
            self.move(c + (c - b) + ((c - b) - (b - a)))

    def state(self) -> State:
        if "frozen" in self.faults and self._frozen is not None:
            return self._frozen
        errors = {name: name in self.errors for name in ("joint_reflex", "cartesian_reflex", *self.errors)}
        self._frozen = State(
            q=[float("nan"), *self.q[1:]] if "nan" in self.faults else self.q.tolist(),
            dq=self.velocity(),
            q_d=self.q_d.tolist(),
            tau_J=[1.0] * 7,
            tau_J_d=self.torques[-1].tolist() if self.torques else [0.5] * 7,
            tau_ext_hat_filtered=[0.25] * 7,
            O_F_ext_hat_K=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
            robot_mode=self.mode,
            current_errors=SimpleNamespace(**errors),
            control_command_success_rate=0.99,
            time=Duration(self.cycles * PERIOD_S),
        )
        return self._frozen

    def velocity(self) -> list[float]:
        if self.controlled != "positions" or len(self.positions) < 2:
            return [0.0] * len(self.q)
        velocity: list[float] = ((self.positions[-1] - self.positions[-2]) / PERIOD_S).tolist()
        return velocity


class StandInConnection:
    """The interface of pylibfranka's `Robot`, and of the object that controls it."""

    def __init__(self, arm: FrankaStandIn) -> None:
        self._arm = arm

    # Settings

    def set_collision_behavior(self, *thresholds: list[float]) -> None:
        if [len(each) for each in thresholds] != [7, 7, 6, 6]:
            raise InvalidOperationException("libfranka: thresholds of wrong sizes")
        self._tell("set_collision_behavior", *thresholds)

    def set_joint_impedance(self, stiffness: list[float]) -> None:
        self._tell("set_joint_impedance", stiffness)

    def set_load(self, mass: float, centre: list[float], inertia: list[float]) -> None:
        if (len(centre), len(inertia)) != (3, 9):
            raise InvalidOperationException("libfranka: a load of wrong sizes")
        self._tell("set_load", mass, centre, inertia)

    def automatic_error_recovery(self) -> None:
        self._require_network()
        arm = self._arm
        if arm.mode is RobotMode.UserStopped or "protective_stop" in arm.faults:
            raise CommandException("libfranka: Automatic error recovery command rejected")
        arm.mode, arm.errors = RobotMode.Idle, set()
        arm.recovered += 1

    def _tell(self, name: str, *values: Any) -> None:
        self._require_network()
        if self._arm.controlled:
            raise CommandException(f"libfranka: {name} command rejected: not possible in this mode")
        self._arm.told[name] = values

    # Control

    def start_joint_position_control(self, mode: ControllerMode) -> StandInConnection:
        return self._start("positions")

    def start_torque_control(self) -> StandInConnection:
        return self._start("torques")

    def _start(self, kind: str) -> StandInConnection:
        self._require_network()
        arm = self._arm
        if arm.mode is not RobotMode.Idle or arm.refuses == kind:
            raise CommandException(f"libfranka: Move command rejected: mode {arm.mode.name}")
        arm.controlled, arm.mode = kind, RobotMode.Move
        arm.positions, arm.torques = [], []
        arm.begin(kind)
        return self

    def read_once(self) -> SimpleNamespace:
        arm = self._arm
        self._require_network()
        if arm.fail is not None:
            failure, arm.fail = arm.fail, None
            arm.let_go()
            raise failure
        arm.cycles += 1
        return arm.state()

    def readOnce(self) -> tuple[SimpleNamespace, Duration]:  # noqa: N802 - theirs
        arm = self._arm
        lost, arm.lose = arm.lose, 0
        if {"loss", "reorder", "pile_up"} & arm.faults and arm.cycles % LOST == 0:
            lost = 1  # overtaken packets are also lost, because libfranka does not accept an older state
        for _ in range(lost):
            arm.extrapolate()
        arm.cycles += lost
        return self.read_once(), Duration((1 + lost) * PERIOD_S)

    def writeOnce(self, command: JointPositions | Torques) -> None:  # noqa: N802 - theirs
        arm = self._arm
        self._require_network()
        if arm.fail is not None:
            self.read_once()
        if isinstance(command, Torques) != (arm.controlled == "torques") or not arm.controlled:
            raise InvalidOperationException(f"libfranka: {arm.controlled or 'nothing'} is controlled")
        if isinstance(command, Torques):
            arm.torques.append(np.array(command.tau_J))
            arm.turn(arm.torques[-1])
        else:
            arm.move(np.array(command.q))
        if command.motion_finished:
            arm.let_go()

    def _require_network(self) -> None:
        arm = self._arm
        if "disconnect" in arm.faults:
            arm.connection = None
            arm.let_go()
        if arm.connection is not self:
            raise NetworkException("libfranka: UDP receive: Timeout")
