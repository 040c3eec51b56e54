"""The real-time client: one arm, its state, and its streaming sessions.

This module is long because its single class contains every method that users of an arm need.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cobot.client import Client, modes
from cobot.client.controls import (
    CartesianMotionForceControl,
    Control,
    JointImpedanceControl,
    JointTorqueControl,
)
from cobot.client.gripper import GripperCommands
from cobot.client.modes import SWITCHES, Mode
from cobot.client.plans import BackgroundPlan, Run
from cobot.client.primitives import primitive
from cobot.client.session_settings import SessionSettings
from cobot.client.states import RobotInfo, RobotStates, robot_info, robot_states
from cobot.client.tls import Verify
from cobot.client.transport import Transport, local_transport
from cobot.client.websocket import WebSocketTransport
from cobot.clock import SYSTEM, Clock
from cobot.errors import ConflictError, InputError, NotReadyError, UnavailableError
from cobot.ipc.layout import Intervention, Stream, text
from cobot.pose import Pose
from cobot.types import LoopMode

log = logging.getLogger("cobot.realtime")

STREAMING = {
    LoopMode.JOINT_IMPEDANCE: Mode.RT_JOINT_IMPEDANCE,
    LoopMode.CARTESIAN: Mode.RT_CARTESIAN_MOTION_FORCE,
    LoopMode.JOINT_TORQUE: Mode.RT_JOINT_TORQUE,
}

LATE_S = 0.5
"""Maximum delay of states over the network, in seconds. They may arrive this much later than a REST answer
that reports that a motion has ended.
"""


class Robot(SessionSettings):
    """An arm that `cobot run` serves on this computer. With the service URL, the arm may be on a different
    computer.

        with Robot("iiwa") as robot:
            robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
            with robot.start_joint_impedance_control() as control:
                control.set_target_joints(control.get_state().q)

    Every method has a name in snake_case. Methods that scripts for libpyflexiv call also have the names that
    libpyflexiv uses.

    Args:
        serial_number: the robot's name (`robot.name` in its settings), or a URL: http://HOST:PORT, or
            http://HOST:PORT/robots/NAME for one of several robots.
        network_whitelist: accepted and ignored; the operating system chooses the network interface.
        connect_retries: number of further attempts to connect if the robot does not exist yet.
        retry_interval_sec: pause between attempts.
        verbose: log the connection.
        lite: accepted and ignored.
        clock: the robot's clock.
        client: creates a service client from its URL; by default a `Client`.
        token, verify: see `Client`. They apply to the robot's service, not to its shared memory.

    Raises:
        UnavailableError: the robot does not exist, or its rtloop does not answer.
        LayoutError: a different version of cobot serves the robot.
        NotSupportedError: a name was given, but the service is not installed on this computer; use a URL
            instead.
    """

    # The many parameters are those that users of libpyflexiv know; additional ones are keyword-only.
    def __init__(
        self,
        serial_number: str,
        network_whitelist: Sequence[str] = (),
        connect_retries: int = 3,
        retry_interval_sec: float = 1.0,
        verbose: bool = True,
        lite: bool = False,
        *,
        clock: Clock = SYSTEM,
        client: Callable[[str], Client] | None = None,
        token: str | None = None,
        verify: Verify = True,
    ) -> None:
        self._clock = clock
        self._make_client = client or partial(Client, token=token, verify=verify)
        remote = partial(WebSocketTransport, token=token, verify=verify)
        self._transport = _connect(serial_number, connect_retries, retry_interval_sec, clock, remote)
        info = self._transport.info
        self._info = robot_info(self._transport.robot, info)
        self._chosen = Mode.IDLE
        self._control: Control[Any] | None = None
        self._plan = BackgroundPlan(clock)
        self._closed = False
        self._commanding: Client | None = None
        super().__init__(info)
        if verbose:
            log.info("connected to %s (%s, %d joints)", serial_number, self._info.model_name, self._info.DoF)

    def __enter__(self) -> Robot:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # Lifecycle

    def enable(self) -> None:
        """Check that the arm may move. Its drives are on from the start.

        Raises:
            NotReadyError: an e-stop or a fault is latched; the message gives the reason and the remedy.
            UnavailableError: rtloop does not answer.
        """
        self._require_ready(self._state())

    def stop(self) -> None:
        """End the session, the plan and any other motion, and wait until the arm has stopped. The mode is
        then IDLE.

        Raises:
            UnavailableError: the robot does not answer.
        """
        control, self._control = self._control, None
        if control is not None:
            control.stop()
        if self._transport.url:
            with self._make_client(self._transport.url) as client:
                client.stop()
        self._chosen = Mode.IDLE

    def close(self) -> None:
        """Stop everything that this object has begun, and disconnect from the robot. May be called again."""
        if self._closed:
            return
        try:
            if self._control is not None or self._plan.running:
                self.stop()
        except UnavailableError as exc:
            log.warning("closing: %s", exc)
        finally:
            self._closed = True
            self._transport.close()
            if self._commanding is not None:
                self._commanding.close()

    def clear_fault(self, timeout: float = 5) -> bool:
        """Clear an e-stop or a fault whose cause is gone. Returns whether the arm may then move.

        Raises:
            NotReadyError: the cause is still present; the message gives the reason.
            UnavailableError: the service does not answer, or the arm does not stop within `timeout`, s.
        """
        deadline_s = self._clock.now_s() + timeout
        with self._client() as client:
            while True:
                try:
                    client.reset()
                    break
                except NotReadyError:
                    if self._clock.now_s() > deadline_s:
                        raise
                    self._clock.sleep(0.1)
        self._chosen = Mode.IDLE
        while (
            not self.operational() and self._clock.now_s() < deadline_s
        ):  # the state may be older than the answer
            self._clock.sleep(0.001)
        return self.operational()

    def switch_mode(self, mode: Mode) -> None:
        """Select the mode of the arm.

        Raises:
            InputError: the mode is unknown or cannot be selected.
            ConflictError: the arm is moving or has a streaming session; stop it first.
            NotReadyError: see `enable`.
        """
        state = self._state()
        if mode not in SWITCHES[self.mode()]:
            valid = ", ".join(sorted(other.name for other in SWITCHES[self.mode()]))
            raise InputError(f"mode {self.mode().name} cannot change to {mode!r}; valid modes: {valid}")
        self._require_ready(state)
        deadline_s = self._clock.now_s() + LATE_S
        while int(state["mode"]) != LoopMode.HOLD and self._clock.now_s() < deadline_s:
            self._clock.sleep(0.001)
            state = self._state()
        if LoopMode(int(state["mode"])) is not LoopMode.HOLD:
            raise ConflictError(f"the arm is in mode {LoopMode(int(state['mode'])).name}: stop it first")
        self._chosen = Mode(mode)

    # State

    def connected(self) -> bool:
        """Whether rtloop answers."""
        return self._quiet_state() is not None

    def operational(self) -> bool:
        """Whether the arm may move."""
        state = self._quiet_state()
        return state is not None and int(state["mode"]) not in (LoopMode.ESTOP, LoopMode.FAULT)

    def fault(self) -> bool:
        """Whether a fault is latched."""
        return int(self._state()["mode"]) == LoopMode.FAULT

    def busy(self) -> bool:
        """Whether a plan, a primitive or any other planned motion is running."""
        return self._plan.running or int(self._state()["mode"]) == LoopMode.TRAJECTORY

    def stopped(self) -> bool:
        """Whether the arm is at rest."""
        return bool(self._state()["settled"])

    def estop_released(self) -> bool:
        """Whether no e-stop is latched."""
        return int(self._state()["mode"]) != LoopMode.ESTOP

    def reduced(self) -> bool:
        """Whether a safety input reduces the arm's speed. This is always False, because this controller has
        no such input.
        """
        return False

    def recovery(self) -> bool:
        """Whether a joint is beyond its limits, so that it can only be moved back."""
        position, info = self._state()["position"], self._transport.info
        return bool(((position < info["min_position"]) | (position > info["max_position"])).any())

    def mode(self) -> Mode:
        """The mode; UNKNOWN while rtloop does not answer."""
        state = self._quiet_state()
        if state is None:
            return Mode.UNKNOWN
        return STREAMING.get(LoopMode(int(state["mode"])), self._chosen)

    def interventions(self) -> dict[str, int]:
        """Number of interventions of rtloop, by kind. `jump` counts the targets that it rejected."""
        counts = self._state()["interventions"].tolist()
        return {kind.name.lower(): count for kind, count in zip(Intervention, counts, strict=True)}

    def clock_s(self) -> float:
        """The time on the robot's clock, in seconds, for `set_chunk`."""
        return float(self._state()["robot_time_s"])

    def info(self) -> RobotInfo:
        """Constant facts about the robot."""
        return self._info

    def states(self) -> RobotStates:
        """All measured values.

        Raises:
            UnavailableError: rtloop does not answer.
        """
        state = self._state()
        return robot_states(state, Pose.from_numbers(self._transport.info["flange"]))

    def commanded_position(self) -> list[float]:
        """The commanded joint positions, rad."""
        commanded: list[float] = self._state()["commanded_position"].tolist()
        return commanded

    @property
    def gripper(self) -> GripperCommands:
        """The commands of the gripper, which go through the service.

        Raises:
            UnavailableError: the robot has no service.
        """
        if self._commanding is None:
            self._commanding = self._client()
        return self._commanding.gripper

    # Plans and primitives

    def execute_plan(self, name: str, **options: str | float) -> None:
        """Start a plan, and return when the arm begins to move.

        Args:
            name: "PLAN-Home" or "home" for a named position, or the path of a sequence file (*.json).
            options: fields of the motion or the sequence, such as `speed`; see docs/motions.md. By default, a
                sequence runs once.

        Raises:
            ConflictError: the mode is not NRT_PLAN_EXECUTION, or another client is moving the arm.
            CobotError: the plan cannot be executed, or the previous one has failed.
        """
        self._require_mode(Mode.NRT_PLAN_EXECUTION)
        if name.endswith(".json"):
            with self._client() as client:
                client.start_sequence(Path(name), **{"n_iterations": 1, **options})
            return
        position = name.removeprefix("PLAN-")
        with self._client() as client:
            names = [str(item["name"]) for item in client.positions()]
        known = next((each for each in names if each.lower() == position.lower()), None)
        if known is None:
            plans = ", ".join(f"PLAN-{each.capitalize()}" for each in names)
            raise InputError(f"there is no plan {name!r}; valid names: {plans}, and sequence files (*.json)")
        self._begin(primitive("MoveNamed", {"name": known, **options}, self._transport.dof))

    def execute_primitive(self, name: str, params: Mapping[str, Any] | None = None) -> None:
        """Start a motion, and return when the arm begins to move.

        Args:
            name: one of `cobot.client.primitives.PRIMITIVES`.
            params: parameters of the primitive, and fields of its motion such as `speed`.

        Raises:
            InputError: the primitive is unknown or its parameters are wrong; the message lists the valid
                ones.
            ConflictError, CobotError: see `execute_plan`; the required mode is NRT_PRIMITIVE_EXECUTION.
        """
        self._require_mode(Mode.NRT_PRIMITIVE_EXECUTION)
        self._begin(primitive(name, params or {}, self._transport.dof))

    # Sessions

    def start_joint_impedance_control(
        self,
        inner_control_hz: float = 1000,
        interpolate_cmds: bool = True,
        interpolation: str | None = None,
    ) -> JointImpedanceControl:
        """Begin to stream joint positions.

        Args:
            inner_control_hz: rate at which rtloop reads a new target, 1 to 1000 Hz. Use the rate at which
                targets are sent.
            interpolate_cmds: whether the arm moves to each target at constant velocity, within one period of
                this rate.
            interpolation: the interpolation to use instead of `interpolate_cmds`: none, linear, quintic or
                ruckig.

        Raises:
            ConflictError: the mode is not RT_ or NRT_JOINT_IMPEDANCE, or another client has a session.
            ExecutionError: rtloop rejects the session; the message gives the reason.
        """
        self._describe(Stream.JOINT_IMPEDANCE, inner_control_hz, interpolate_cmds, interpolation)
        self._require_mode(*modes.JOINT_STREAMS)
        control = JointImpedanceControl(self._transport, self._request)
        self._control = control
        return control

    def start_cartesian_control(
        self,
        inner_control_hz: float = 1000,
        interpolate_cmds: bool = True,
        interpolation: str | None = None,
    ) -> CartesianMotionForceControl:
        """Begin to stream poses and wrenches; see `start_joint_impedance_control`.

        Raises:
            ConflictError: the mode is not RT_ or NRT_CARTESIAN_MOTION_FORCE, or another client has a session.
            ExecutionError: rtloop rejects the session; the message gives the reason.
        """
        self._describe(Stream.CARTESIAN, inner_control_hz, interpolate_cmds, interpolation)
        self._require_mode(*modes.CARTESIAN_STREAMS)
        control = CartesianMotionForceControl(self._transport, self._request)
        self._control = control
        return control

    def start_joint_torque_control(self) -> JointTorqueControl:
        """Begin to stream joint torques.

        Raises:
            ConflictError: the mode is not RT_JOINT_TORQUE, or another client has a session.
            ExecutionError: rtloop rejects the session; the message gives the reason.
        """
        self._describe(Stream.JOINT_TORQUE, 1000, False, None)
        self._require_mode(Mode.RT_JOINT_TORQUE)
        control = JointTorqueControl(self._transport, self._request)
        self._control = control
        return control

    def _begin(self, run: Run) -> None:
        self._plan.begin(run, self._client, lambda: int(self._state()["motion_id"]))

    def _client(self) -> Client:
        if not self._transport.url:
            raise UnavailableError(
                f"robot {self._transport.robot!r} has no service, because web.enabled is false; enable it "
                "in the settings"
            )
        return self._make_client(self._transport.url)

    def _state(self) -> np.ndarray:
        if self._closed:
            raise InputError("this Robot has been closed")
        return self._transport.state()

    def _quiet_state(self) -> np.ndarray | None:
        try:
            return self._state()
        except (UnavailableError, InputError):
            return None

    def _require_ready(self, state: np.ndarray) -> None:
        mode = LoopMode(int(state["mode"]))
        if mode in (LoopMode.ESTOP, LoopMode.FAULT):
            raise NotReadyError(
                f"the robot is in mode {mode.name}: {text(state['reason'])}; remove the cause, then "
                "call clear_fault()"
            )

    def _require_mode(self, *valid: Mode) -> None:
        self._require_ready(self._state())
        mode = self.mode()
        if mode not in valid:
            names = " or ".join(sorted(other.name for other in valid))
            raise ConflictError(
                f"the mode is {mode.name}, but this call needs {names}; call switch_mode first"
            )

    Enable, Stop, ClearFault, SwitchMode = enable, stop, clear_fault, switch_mode
    ExecutePlan, ExecutePrimitive = execute_plan, execute_primitive


def _connect(
    serial_number: str,
    retries: int,
    interval_s: float,
    clock: Clock,
    remote: Callable[[str, Clock], Transport],
) -> Transport:
    far = serial_number.startswith(("http://", "https://"))
    for attempt in range(retries + 1):
        try:
            return (remote if far else local_transport)(serial_number, clock)
        except UnavailableError:
            if attempt == retries:
                raise
            clock.sleep(interval_s)
    raise InputError(f"connect_retries must be 0 or more, got {retries}")
