"""Universal Robots arms over RTDE. A cobot program on the controller follows joint positions or torques.

This module is long because it contains all methods of this device that the cycle calls.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import replace
from enum import Enum, auto
from typing import TYPE_CHECKING, Any

import numpy as np

from cobot.config import Settings
from cobot.robot.io_points import IoPoint
from cobot.robot.model import RobotModel
from cobot.robot.tool import BARE, Tool
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, Capabilities, DeviceStatus, Impedance, Measured
from rtloop.backends.beat import Beat, CommandTransition
from rtloop.backends.protocols import require_accepted
from rtloop.backends.ur.base_frame import BaseFrame
from rtloop.backends.ur.checks import check_entry, check_period, checks_of_program, checks_of_state
from rtloop.backends.ur.enabling import Enabling
from rtloop.backends.ur.fields import AXES
from rtloop.backends.ur.link import RtdeLink
from rtloop.backends.ur.options import UrOptions
from rtloop.backends.ur.points import GROUPS, READ, UrOutputs, points
from rtloop.backends.ur.program import MotionProgram
from rtloop.backends.ur.report import status_of
from rtloop.backends.ur.torques import (
    MOTOR_TORQUE,
    REST_RAD_S,
    SPEED_SHARE,
    TORQUE_PERIOD_S,
    ExertedTorques,
    check_version,
)
from rtloop.backends.ur.transport import TcpTransport, UrTransport
from rtloop.results import ACCEPTED, Accepted, Rejected, first_rejection

if TYPE_CHECKING:
    from rtloop.contract import ContractRig

PERIODS_S = (0.002, 0.004, 0.008)
NEEDED = (
    "timestamp",
    "actual_q",
    "actual_qd",
    "target_q",
    "target_moment",
    "actual_TCP_force",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "speed_scaling",
    "target_speed_fraction",
    "actual_digital_input_bits",
    "actual_digital_output_bits",
)
USEFUL = (
    "safety_status",
    "robot_status_bits",
    "actual_TCP_pose",
    *(each for each in READ if "analog" in each),
)
REST_S = 2.0
"""Timeout for the arm to come to rest at the start, s."""
SETTING_UP_S = 0.01
"""Interval between two polls while a connection is set up, s."""
POSE_S = 0.1
"""Time that the controller takes to report the pose of the TCP that the program has set, s."""


class _Hand(Enum):
    """The state of hand guiding. After guiding, commands are ignored until rtloop has registered the arm at
    rest.
    """

    OFF = auto()
    GUIDES = auto()
    ENDED = auto()


class UrBackend:
    """An externally clocked `Backend` for the controller. It also implements `Paced`, `Reporting`,
    `Stepwise`, `CarriesTool`, `GuidedByHand` and `HasIo`. It has the attributes of `ImpedanceControlled` only
    with the option `torque`.
    """

    set_impedance: Callable[[Impedance | None], None]
    nominal_stiffness: Array
    nominal_cartesian_stiffness: Array

    Options = UrOptions
    capabilities = Capabilities(
        periods_s=PERIODS_S,
        measured=frozenset({"position", "velocity", "desired_effort", "wrench"}),
        freedrive=True,
        payload=True,
        io=True,
        stops={2: False},  # the controller switches the drives
        hardware=True,
    )

    def __init__(
        self, settings: Settings, limits: JointLimits, *, transport: UrTransport | None = None
    ) -> None:
        """
        Args:
            transport: replacement for the network and its clock, for tests.
        """
        if limits.dof != AXES:
            raise BackendError(
                f"an arm of Universal Robots has {AXES} joints, but this robot has {limits.dof}: select "
                "the configuration of your arm with --config"
            )
        options = settings.backend_options(UrOptions)
        if options is None:
            raise BackendError(
                "robot.backend: type ur needs address, the IP address or name of the controller"
            )
        self._options, self._limits, self._robot = options, limits, settings.robot
        self.capabilities = replace(type(self).capabilities, freedrive=options.freedrive)
        self._period_s = settings.rt.period_s
        self._torques = self._make_torques(settings) if options.torque else None
        self._transport: UrTransport = transport or TcpTransport()
        self._link = RtdeLink(
            self._transport,
            options.address,
            1.0 / self._period_s,
            NEEDED,
            (*USEFUL, MOTOR_TORQUE) if options.torque else USEFUL,
            GROUPS if options.outputs else (),
        )
        self._program = MotionProgram(self._transport, options, limits)
        self._making_ready = Enabling(self._transport, options, self._program, self._period_s)
        self._outputs = UrOutputs(self._link.send)
        self._beat = Beat[dict[str, Any]](limits.dof, self._period_s)
        self._transition = CommandTransition(limits.dof, self._period_s)
        self._tool = BARE
        self._model: RobotModel | None = None
        self._first_s: float | None = None
        self._heard_s = 0.0
        self._steps: Generator[None, None, None] | None = None
        self._enabled = False
        self._answered = True
        self._periods = 1
        self._begun = False
        self._unconnected = 0  # number of packages since the program ended
        self._hand = _Hand.OFF
        self._begins_at_rest = False  # after torques, commands begin at the arm's position
        self._base = BaseFrame()
        self._last_motion: Accepted | Rejected = ACCEPTED  # why the arm does not move until a reset

    # Backend

    def open(self, initial_position: Array) -> None:
        robot = self._robot
        self._model = (
            RobotModel.load(robot.model, self._limits, base=robot.base_frame, tcp=robot.tcp)
            if self._torques is None
            else self._torques.robot
        )
        until_s = self._transport.clock() + self._options.connect_s
        while not self.wait(self._options.silence_s):
            if self._link.lasting or self._transport.clock() > until_s:
                raise BackendError(self._link.problem or "the controller sends no data")
        require_accepted(self._check_period())
        require_accepted(self._check_torque())
        self._await_rest()

    def enable(self) -> None:
        """Enable the arm. If it fails at the start, the first command raises an error with the reason, and a
        reset tries again.
        """
        starts = not self._begun
        self._begun = True
        self.recover_step()
        try:
            while not self.enable_step():
                self.wait(self._options.silence_s)
        except BackendError as exc:
            if not starts:
                raise
            self._enabled, self._last_motion = True, Rejected(str(exc))

    def enable_step(self) -> bool:
        if self._enabled:
            return True
        if self._steps is None:
            self._steps = self._make_ready()
        try:
            next(self._steps)
        except StopIteration:
            self._steps, self._enabled = None, True
            return True
        except BackendError:
            self._steps = None
            self._program.drop()
            raise
        return False

    def recover_step(self) -> bool:
        """Stop the program and any unfinished attempt. `enable_step` then begins a new one."""
        self._enabled, self._last_motion = False, ACCEPTED
        self._abandon()
        return True

    def read(self, measured: Measured) -> None:
        data = self._beat.newest
        silence_s = self._silence_s
        if data is None or silence_s > self._options.silence_s:
            raise BackendError(
                f"no data from the controller for {silence_s:.2f} s: "
                f"{self._link.problem or 'the controller is silent'}"
            )
        measured.position = self._beat.position
        measured.velocity = data["actual_qd"]
        measured.desired_effort = data["target_moment"]
        measured.wrench = self._base.wrench_in_model(data["actual_TCP_force"])
        if self._torques is not None:
            require_accepted(self._check_torque())
            measured.effort = motor = np.array(data[MOTOR_TORQUE])
            measured.external_effort = self._torques.estimate(
                self._beat.position, np.array(data["actual_qd"]), motor
            )

    def write(self, command: Array) -> None:
        data = self._beat.newest
        if data is None:
            return
        self._periods += 1
        if self._beat.due or self._answered:
            return
        self._answered = True
        self._unconnected = 0 if self._program.is_connected else self._unconnected + 1
        self._outputs.follow(data, self._transport.clock())
        if not self._enabled:
            return
        result = first_rejection(self._checks_of_a_command(data))
        if result is ACCEPTED and self._unconnected:
            return
        torques = self._torques if self._torques is not None and self._torques.is_on else None
        if result is ACCEPTED and torques is not None:
            velocity, motor = np.array(data["actual_qd"]), np.array(data[MOTOR_TORQUE])
            result = torques.check(self._beat.position, velocity, motor)
        follows = self._hand is _Hand.OFF and torques is None
        if result is ACCEPTED and follows and self._transition.sent is None:
            result = self._begin(data, command[0])
        if isinstance(result, Rejected):
            self._last_motion = result
            self._abandon()
            raise BackendError(f"the robot does not accept commands: {result.reason}")
        if torques is not None:
            torque = torques.find(command, self._beat.position, np.array(data["actual_qd"]))
            self._program.send_torque(torque.tolist())
            return
        if not follows:
            self._program.send_hand(guided=self._hand is _Hand.GUIDES)
            return
        position = self._transition.follow(command[0])
        for _ in range(self._periods):
            self._transition.pass_period()
        self._program.send_position(position.tolist(), self._periods)
        self._periods = 0

    def disable(self) -> None:
        """End the program. The controller then holds the arm; its drives are switched off at the teach
        pendant.
        """
        self._enabled = False
        self._abandon()

    def close(self) -> None:
        self._abandon()
        self._program.close()
        self._link.close()

    # Paced, Reporting, CarriesTool, GuidedByHand, HasIo

    def wait(self, timeout_s: float) -> bool:
        """Wait for the controller's next packet. Return at once if a cycle is still due for a packet that was
        lost or has accumulated.
        """
        deadline_s = self._transport.clock() + timeout_s
        while not self._hear():
            left_s = deadline_s - self._transport.clock()
            if left_s <= 0.0:
                return False
            most_s = left_s if self._link.is_streaming else SETTING_UP_S
            self._transport.wait(self._link.streams, min(left_s, most_s))
        self._beat.advance()
        return True

    def status(self) -> DeviceStatus:
        data = self._beat.newest
        if data is None:
            return DeviceStatus(connection="no data yet", text=self._link.problem)
        is_silent = self._silence_s > self._options.silence_s
        return status_of(data, self._texts(is_silent), is_silent=is_silent, packages_lost=self._beat.lost)

    def set_tool(self, tool: Tool) -> None:
        """Send the mass and the centre of mass to the controller, which compensates gravity itself."""
        self._tool = tool
        if self._torques is not None:
            self._torques.robot.carry(tool)
        if self._enabled:
            self._program.send_tool(tool)

    def begin_guiding(self) -> None:
        if not self._options.freedrive:
            raise BackendError("robot.backend.freedrive is false: set it to true to guide this arm by hand")
        self._hand = _Hand.GUIDES
        self._transition.forget()
        if self._torques is not None:  # the controller itself releases the arm without springs
            self._torques.is_on = False

    def end_guiding(self) -> None:
        if self._hand is _Hand.GUIDES:
            self._hand = _Hand.ENDED

    def follow_commands(self) -> None:
        self._hand = _Hand.OFF

    def io(self) -> list[IoPoint]:
        return points(self._newest)

    def set_output(self, name: str, value: float) -> None:
        if not self._options.outputs:
            raise BackendError(f"{name} cannot be set: robot.backend.outputs is false")
        if self._silence_s > self._options.silence_s:
            raise BackendError(f"{name} cannot be set: {self._link.problem or 'the controller is silent'}")
        self._outputs.set(self._newest, name, value, self._transport.clock())

    # ImpedanceControlled, with the option `torque`

    def _make_torques(self, settings: Settings) -> ExertedTorques:
        if self._period_s != TORQUE_PERIOD_S:
            raise BackendError(
                "robot.backend.torque needs the period of the controller; rt.period_s is "
                f"{self._period_s:g} s; set it to {TORQUE_PERIOD_S:g}"
            )
        torques = ExertedTorques(settings, self._limits)
        self.set_impedance = self._set_impedance
        self.nominal_stiffness = torques.nominal_stiffness
        self.nominal_cartesian_stiffness = torques.nominal_cartesian_stiffness
        able = self.capabilities
        measured = able.measured | {"effort", "external_effort"}
        self.capabilities = replace(able, impedance=True, torque=True, measured=measured)
        return torques

    def _set_impedance(self, impedance: Impedance | None) -> None:
        """Switch between positions and torques. The arm must be at rest when torques begin."""
        torques = self._torques
        assert torques is not None
        if impedance is not None and torques.is_needed(impedance):
            speed = float(np.abs(self._newest["actual_qd"]).max())
            if not (torques.is_on or speed <= REST_RAD_S):
                raise BackendError(
                    f"the arm is moving at {speed:.3g} rad/s, allowed: {REST_RAD_S} rad/s; torques begin "
                    "only at rest, so wait until the arm has stopped"
                )
            torques.begin(impedance)
            self._transition.forget()
        elif torques.is_on:
            torques.is_on = False
            self._begins_at_rest = True

    # Private methods

    @staticmethod
    def contract_rig(settings: Settings, limits: JointLimits) -> ContractRig:
        """Create a rig with the backend and a simulated controller in one process."""
        from rtloop.backends.ur.simulator.lockstep import UrRig

        return UrRig(settings, limits)

    def _await_rest(self) -> None:
        """Wait until the program of a killed process has stopped the arm, because cobot continues from the
        position that it reads here.
        """
        until_s = self._transport.clock() + REST_S
        while self._transport.clock() < until_s:
            if not np.abs(self._newest["actual_qd"]).max() > REST_RAD_S:
                return
            self.wait(self._options.silence_s)

    def _make_ready(self) -> Generator[None, None, None]:
        require_accepted(self._check_period())
        require_accepted(self._check_torque())
        assert self._link.version is not None
        yield from self._making_ready.steps(
            lambda: self._newest, self._link.version, lambda: self._link.local
        )
        until_s = self._transport.clock() + POSE_S
        while self._transport.clock() < until_s:
            yield
        data = self._newest
        actual, target = np.array(data["actual_q"]), np.array(data["target_q"])
        require_accepted(self._check_entry(actual, target, "is"))
        if self._options.check_pose and self._model is not None:
            require_accepted(self._base.check(self._model, data))
        self._program.send_tool(self._tool)

    def _abandon(self) -> None:
        """End the program, or any attempt to start it."""
        if self._steps is not None:
            self._steps.close()
            self._steps = None
        self._making_ready.close()
        self._program.drop()
        self._transition.forget()
        self._hand, self._begins_at_rest = _Hand.OFF, False
        if self._torques is not None:
            self._torques.is_on = False

    def _begin(self, data: Mapping[str, Any], command: Array) -> Accepted | Rejected:
        """Begin to send commands, from the position at which the controller holds the arm. The first command
        must be near this position. After torque control, the controller's target is valid only now, because
        the arm is at rest.
        """
        here = self._beat.position if self._begins_at_rest else np.array(data["target_q"])
        self._begins_at_rest = False
        result = self._check_entry(command, here, "is commanded")
        if isinstance(result, Rejected):
            return result
        self._transition.begin(here, command)
        self._periods = 1
        return ACCEPTED

    def _checks_of_a_command(self, data: Mapping[str, Any]) -> Iterator[Accepted | Rejected]:
        yield self._last_motion
        yield self._check_torque()
        yield from checks_of_state(data, is_released=self._hand is not _Hand.OFF)
        yield from checks_of_program(data, self._unconnected, self._causes_of_its_own())

    def _causes_of_its_own(self) -> str:
        """Return possible reasons why cobot's program has ended on its own."""
        if self._torques is None or not self._torques.is_on:
            return f"commands were missing for {self._options.timeout_s:g} s"
        return (
            f"commands were missing for {self._options.torque_timeout_s:g} s, or a joint was faster than "
            f"{SPEED_SHARE:g} times its velocity limit"
        )

    def _check_period(self) -> Accepted | Rejected:
        return check_period(self._link.version, self._link.version_text, self._period_s)

    def _check_entry(self, here: Array, held: Array, what: str) -> Accepted | Rejected:
        return check_entry(self._limits.names, here, held, self._options.entry_rad, what)

    def _check_torque(self) -> Accepted | Rejected:
        version = self._link.version
        if self._torques is None or version is None:
            return ACCEPTED
        return check_version(version, self._link.version_text, has_torque=MOTOR_TORQUE in self._newest)

    def _texts(self, is_silent: bool) -> Iterator[str]:
        if is_silent:
            yield f"no data for {self._silence_s:.1f} s: {self._link.problem or 'the controller is silent'}"
        elif self._enabled and isinstance(self._last_motion, Rejected):
            yield self._last_motion.reason
        yield f"software {self._link.version_text}"
        yield self._outputs.problem
        if self._hand is _Hand.GUIDES:
            yield "a person guides the arm by hand"

    @property
    def _silence_s(self) -> float:
        return self._transport.clock() - self._heard_s

    @property
    def _newest(self) -> dict[str, Any]:
        if self._beat.newest is None:
            raise BackendError(self._link.problem or "the controller sends no data")
        return self._beat.newest

    def _hear(self) -> bool:
        """Read the packages that have arrived, unless a cycle is already due. Returns whether a cycle is
        due.
        """
        if not self._beat.due:
            for data in self._link.poll():
                self._take(data)
            self._program.poll()
        return self._beat.due > 0

    def _take(self, data: dict[str, Any]) -> None:
        if self._first_s is None:
            self._first_s = data["timestamp"]
        passed_s = data["timestamp"] - self._first_s
        sequence = round(passed_s / self._period_s) if math.isfinite(passed_s) else 0
        if self._beat.take(data, sequence % (1 << 32), data["actual_q"]):
            self._answered, self._heard_s = False, self._transport.clock()
