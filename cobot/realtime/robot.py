"""The real-time client: one arm, its state, and the sessions in which it is streamed to."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from cobot.client import Client
from cobot.errors import CobotError, ConflictError, InputError, NotReadyError, UnavailableError
from cobot.layout import Interpolation, Stream, session_dtype
from cobot.realtime import modes
from cobot.realtime.controls import (
    CartesianMotionForceControl,
    Control,
    JointImpedanceControl,
    JointTorqueControl,
)
from cobot.realtime.modes import SWITCHES, CoordType, Mode
from cobot.realtime.primitives import Run, primitive
from cobot.realtime.remote import WebSocketTransport
from cobot.realtime.states import RobotInfo, RobotStates, robot_info, robot_states
from cobot.realtime.transport import SharedMemoryTransport, Transport
from cobot.shm import text
from cobot.types import Array, vector
from cobot.types import Mode as LoopMode

log = logging.getLogger("cobot.realtime")

BEGIN_S = 15.0
"""How long a plan is waited for until it moves the arm: its planning included."""
POLL_S = 0.005
DAMPING_RATIO = 0.7
NO_FRAME = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
STREAMING = {
    LoopMode.JOINT_IMPEDANCE: Mode.RT_JOINT_IMPEDANCE,
    LoopMode.CARTESIAN: Mode.RT_CARTESIAN_MOTION_FORCE,
    LoopMode.JOINT_TORQUE: Mode.RT_JOINT_TORQUE,
}


class Robot:
    """An arm that `cobot run` serves on this computer, or, by the URL of its service, on another one.

        with Robot("iiwa") as robot:
            robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
            with robot.start_joint_impedance_control() as control:
                control.set_target_joints(control.get_state().q)

    Every method has a name in snake_case; those that a libpyflexiv script calls have that name too.

    Args:
        serial_number: the robot's name (`robot.name` in its settings), or http://HOST:PORT.
        network_whitelist: accepted; the operating system chooses the way.
        connect_retries: how often to try again when there is no such robot yet.
        retry_interval_sec: between tries.
        verbose: log the connection.
        lite: accepted; there is nothing to leave out.

    Raises:
        UnavailableError: there is no such robot, or its rtloop does not answer.
        LayoutError: it is served by another version of cobot.
    """

    def __init__(
        self,
        serial_number: str,
        network_whitelist: Sequence[str] = (),
        connect_retries: int = 3,
        retry_interval_sec: float = 1.0,
        verbose: bool = True,
        lite: bool = False,
    ) -> None:
        self._transport = _connect(serial_number, connect_retries, retry_interval_sec)
        self._info = robot_info(self._transport.robot, self._transport.info)
        self._flange = self._transport.info["flange"].tolist()
        self._chosen = Mode.IDLE
        self._control: Control[Any] | None = None
        self._plan: threading.Thread | None = None
        self._plan_error: CobotError | None = None
        self._closed = False
        dof = self._transport.dof
        self._wish = np.zeros((), session_dtype(dof))
        nominal = self._transport.info
        self._wish["stiffness"], self._wish["cartesian_stiffness"] = (
            nominal["stiffness"],
            nominal["cartesian_stiffness"],
        )
        self._wish["damping_ratio"], self._wish["cartesian_damping_ratio"] = DAMPING_RATIO, DAMPING_RATIO
        self._wish["max_contact_torque"], self._wish["max_contact_wrench"] = np.inf, np.inf
        self._wish["force_velocity"] = 1.0
        self._wish["force_frame"] = NO_FRAME
        self._wish["posture"] = np.nan
        if verbose:
            log.info("connected to %s (%s, %d joints)", serial_number, self._info.model_name, dof)

    def __enter__(self) -> Robot:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    # Lifecycle

    def enable(self) -> None:
        """See that the arm may move: its drives are on from the start.

        Raises:
            NotReadyError: an e-stop or a fault is latched, with the reason and the way out.
            UnavailableError: rtloop does not answer.
        """
        self._require_ready(self._state())

    def stop(self) -> None:
        """End the session, the plan and any other motion of the arm, wait until it rests, and be IDLE.

        Raises:
            UnavailableError: the robot does not answer.
        """
        control, self._control = self._control, None
        if control is not None:
            control.stop()
        if self._transport.url:
            with Client(self._transport.url) as client:
                client.stop()
        self._chosen = Mode.IDLE

    def close(self) -> None:
        """Stop what this object has begun and let go of the robot. May be called again."""
        if self._closed:
            return
        self._closed = True
        try:
            if self._control is not None or self.busy():
                self.stop()
        except UnavailableError as exc:
            log.warning("closing: %s", exc)
        finally:
            self._transport.close()

    def clear_fault(self, timeout: float = 5) -> bool:
        """Leave an e-stop or a fault, once its cause is gone; whether the arm may move then.

        Raises:
            NotReadyError: the cause persists, with the reason.
            UnavailableError: the service does not answer, or the arm does not rest within `timeout`, s.
        """
        deadline_s = time.monotonic() + timeout
        with self._client() as client:
            while True:
                try:
                    client.reset()
                    break
                except NotReadyError:
                    if time.monotonic() > deadline_s:
                        raise
                    time.sleep(0.1)
        self._chosen = Mode.IDLE
        return self.operational()

    def switch_mode(self, mode: Mode) -> None:
        """Choose what the arm is used for.

        Raises:
            InputError: no such mode, or one that cannot be chosen.
            ConflictError: the arm moves, or is streamed to: stop it first.
            NotReadyError: see `enable`.
        """
        if mode not in SWITCHES[self.mode()]:
            valid = ", ".join(sorted(other.name for other in SWITCHES[self.mode()]))
            raise InputError(f"mode {self.mode().name} does not go over to {mode!r}; valid are: {valid}")
        state = self._state()
        self._require_ready(state)
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
        """Whether a plan, a primitive or another planned motion is under way."""
        planning = self._plan is not None and self._plan.is_alive()
        return planning or int(self._state()["mode"]) == LoopMode.TRAJECTORY

    def stopped(self) -> bool:
        """Whether the arm rests."""
        return bool(self._state()["settled"])

    def estop_released(self) -> bool:
        """Whether no e-stop is latched."""
        return int(self._state()["mode"]) != LoopMode.ESTOP

    def reduced(self) -> bool:
        """Whether the arm is slowed down by a safety input; this controller has none: False."""
        return False

    def recovery(self) -> bool:
        """Whether a joint stands beyond its limits, so that it can only be moved back."""
        position, info = self._state()["position"], self._transport.info
        return bool(((position < info["min_position"]) | (position > info["max_position"])).any())

    def mode(self) -> Mode:
        """What the arm is used for; UNKNOWN while rtloop does not answer."""
        state = self._quiet_state()
        if state is None:
            return Mode.UNKNOWN
        return STREAMING.get(LoopMode(int(state["mode"])), self._chosen)

    def clock_s(self) -> float:
        """The robot's clock, for `set_chunk`: s."""
        return float(self._state()["robot_time_s"])

    def info(self) -> RobotInfo:
        """What stays as it is."""
        return self._info

    def states(self) -> RobotStates:
        """All that is measured.

        Raises:
            UnavailableError: rtloop does not answer.
        """
        return robot_states(self._state(), self._flange)

    # Plans and primitives

    def execute_plan(self, name: str, **options: str | float) -> None:
        """Begin a plan and return when the arm moves.

        Args:
            name: "PLAN-Home" or "home" for a named position, or the path of a sequence file (*.json).
            options: of the motion or the sequence, see docs/api.md: speed, ...

        Raises:
            ConflictError: the mode is not NRT_PLAN_EXECUTION, or somebody else moves the arm.
            CobotError: the plan cannot be carried out, or the one before has failed.
        """
        self._require_mode(Mode.NRT_PLAN_EXECUTION)
        if name.endswith(".json"):
            with self._client() as client:
                client.start_sequence(Path(name), **options)
            return
        position = name.removeprefix("PLAN-")
        with self._client() as client:
            names = [str(item["name"]) for item in client.positions()]
        known = next((each for each in names if each.lower() == position.lower()), None)
        if known is None:
            plans = ", ".join(f"PLAN-{each.capitalize()}" for each in names)
            raise InputError(f"there is no plan {name!r}; valid are: {plans}, and sequence files (*.json)")
        self._begin_motion(primitive("MoveNamed", {"name": known, **options}, self._transport.dof))

    def execute_primitive(self, name: str, params: Mapping[str, Any] | None = None) -> None:
        """Begin a motion and return when the arm moves.

        Args:
            name: one of `cobot.realtime.primitives.PRIMITIVES`.
            params: its parameters, and `speed` and `accel_scale`.

        Raises:
            InputError: no such primitive, or wrong parameters; with the valid ones.
            ConflictError, CobotError: as `execute_plan`, with NRT_PRIMITIVE_EXECUTION.
        """
        self._require_mode(Mode.NRT_PRIMITIVE_EXECUTION)
        self._begin_motion(primitive(name, params or {}, self._transport.dof))

    # What a session shall be like: fixed when it begins

    def set_joint_impedance(self, K_q: Sequence[float], Z_q: Sequence[float] | None = None) -> None:
        """Stiffness (N·m/rad, up to `info().K_q_nom`) and damping ratio (0.3 to 1) of the joints.

        Raises:
            InputError: wrong numbers, with what is allowed.
        """
        self._set_impedance("", K_q, Z_q, "K_q", "Z_q")

    def set_cartesian_impedance(self, K_x: Sequence[float], Z_x: Sequence[float] | None = None) -> None:
        """Stiffness (N/m, N·m/rad, up to `info().K_x_nom`) and damping ratio (0.3 to 1) of the TCP.

        Raises:
            InputError: wrong numbers, with what is allowed.
        """
        self._set_impedance("cartesian_", K_x, Z_x, "K_x", "Z_x")

    def set_max_contact_wrench(self, wrench: Sequence[float]) -> None:
        """The external force and torque at the TCP beyond which a session ends: N, N·m, above 0."""
        self._wish["max_contact_wrench"] = _positive(wrench, 6, "wrench")

    def set_max_contact_torque(self, torques: Sequence[float]) -> None:
        """The external joint torques beyond which a session ends: N·m, above 0."""
        self._wish["max_contact_torque"] = _positive(torques, self._transport.dof, "torques")

    def set_force_control_axis(
        self, axes: Sequence[bool], max_vel: Sequence[float] = (1.0, 1.0, 1.0)
    ) -> None:
        """Along which axes of the force frame the wrench counts, not the pose.

        Args:
            axes: x, y, z, rx, ry, rz.
            max_vel: the fastest that force control moves along x, y, z: m/s.
        """
        if len(axes) != 6 or not all(isinstance(axis, bool | np.bool_) for axis in axes):
            raise InputError(f"axes must be 6 times True or False, got {list(axes)}")
        self._wish["force_velocity"][:3] = _positive(max_vel, 3, "max_vel")
        self._wish["force_axes"] = axes

    def set_force_control_frame(self, coord: CoordType, T: Sequence[float] = NO_FRAME) -> None:
        """The frame of the force axes: x, y, z in m, w, x, y, z, in the world or in the TCP's frame.

        In the world its orientation counts: its axes go through the TCP.
        """
        frame = vector(T, 7, name="T")
        if abs(float(np.linalg.norm(frame[3:])) - 1.0) > 1e-3:
            raise InputError(f"the quaternion of T must have length 1, got {frame[3:].tolist()}")
        self._wish["force_in_tcp"] = CoordType(coord) is CoordType.TCP
        self._wish["force_frame"] = frame

    def set_null_space_posture(self, ref_pos: Sequence[float]) -> None:
        """The joint angles (rad) that the arm keeps near to as far as the TCP leaves it free."""
        posture = vector(ref_pos, self._transport.dof, name="ref_pos")
        low, high = self._transport.info["min_position"], self._transport.info["max_position"]
        if not ((posture >= low) & (posture <= high)).all():
            raise InputError(
                f"ref_pos must be from {low.tolist()} to {high.tolist()}, got {posture.tolist()}"
            )
        self._wish["posture"] = posture

    # Sessions

    def start_joint_impedance_control(
        self,
        inner_control_hz: float = 1000,
        interpolate_cmds: bool = True,
        interpolation: str | None = None,
    ) -> JointImpedanceControl:
        """Begin to stream joint positions.

        Args:
            inner_control_hz: how often a new target is taken, 1 to 1000: the rate of who sends them.
            interpolate_cmds: go to each target at constant velocity, within one period of that rate.
            interpolation: another way to go: none, linear, quintic or ruckig.

        Raises:
            ConflictError: the mode is not RT_ or NRT_JOINT_IMPEDANCE, or somebody else streams.
            ExecutionError: rtloop refuses, with its reason.
        """
        self._prepare(Stream.JOINT_IMPEDANCE, inner_control_hz, interpolate_cmds, interpolation)
        self._require_mode(*modes.JOINT_STREAMS)
        control = JointImpedanceControl(self._transport, self._wish)
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
            ConflictError: the mode is not RT_ or NRT_CARTESIAN_MOTION_FORCE, or somebody else streams.
            ExecutionError: rtloop refuses, with its reason.
        """
        self._prepare(Stream.CARTESIAN, inner_control_hz, interpolate_cmds, interpolation)
        self._require_mode(*modes.CARTESIAN_STREAMS)
        control = CartesianMotionForceControl(self._transport, self._wish)
        self._control = control
        return control

    def start_joint_torque_control(self) -> JointTorqueControl:
        """Begin to stream joint torques.

        Raises:
            ConflictError: the mode is not RT_JOINT_TORQUE, or somebody else streams.
            ExecutionError: rtloop refuses, with its reason.
        """
        self._prepare(Stream.JOINT_TORQUE, 1000, False, None)
        self._require_mode(Mode.RT_JOINT_TORQUE)
        control = JointTorqueControl(self._transport, self._wish)
        self._control = control
        return control

    def _prepare(self, stream: Stream, rate_hz: float, interpolate: bool, interpolation: str | None) -> None:
        if not 1 <= rate_hz <= 1000:
            raise InputError(f"inner_control_hz must be from 1 to 1000, got {rate_hz}")
        name = interpolation or ("linear" if interpolate else "none")
        valid = [kind.name.lower() for kind in Interpolation]
        if name not in valid:
            raise InputError(f"there is no interpolation {name!r}; valid are: {', '.join(valid)}")
        self._wish["stream"] = stream
        self._wish["interpolation"] = Interpolation[name.upper()]
        self._wish["decimation"] = round(1000 / rate_hz)

    def _set_impedance(
        self, prefix: str, stiffness: Sequence[float], damping: Sequence[float] | None, *names: str
    ) -> None:
        nominal = self._transport.info[f"{prefix}stiffness"]
        values = vector(stiffness, len(nominal), name=names[0])
        if not ((values > 0.0) & (values <= nominal)).all():
            raise InputError(
                f"{names[0]} must be above 0 and at the most {nominal.tolist()}, got {values.tolist()}"
            )
        ratios = vector(
            [DAMPING_RATIO] * len(nominal) if damping is None else damping, len(nominal), name=names[1]
        )
        if not ((ratios >= 0.3) & (ratios <= 1.0)).all():
            raise InputError(f"{names[1]} must be from 0.3 to 1, got {ratios.tolist()}")
        self._wish[f"{prefix}stiffness"], self._wish[f"{prefix}damping_ratio"] = values, ratios

    def _begin_motion(self, run: Run) -> None:
        """Have a motion carried out in a thread; return when it moves the arm, or raise why it does not."""
        self._raise_plan_error()
        before = int(self._state()["motion_id"])

        def work() -> None:
            try:
                with self._client() as client:
                    run(client)
            except CobotError as exc:
                self._plan_error = exc

        plan = self._plan = threading.Thread(target=work, daemon=True)
        plan.start()
        deadline_s = time.monotonic() + BEGIN_S
        while plan.is_alive() and int(self._state()["motion_id"]) == before and time.monotonic() < deadline_s:
            time.sleep(POLL_S)
        if not plan.is_alive():
            self._raise_plan_error()

    def _raise_plan_error(self) -> None:
        error, self._plan_error = self._plan_error, None
        if error is not None:
            raise error

    def _client(self) -> contextlib.AbstractContextManager[Client]:
        if not self._transport.url:
            raise UnavailableError(f"robot {self._transport.robot!r} has no service: web.enabled is false")
        return Client(self._transport.url)

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
                f"the robot is in mode {mode.name}: {text(state['reason'])}; see to it, then clear_fault()"
            )

    def _require_mode(self, *valid: Mode) -> None:
        self._require_ready(self._state())
        mode = self.mode()
        if mode not in valid:
            names = " or ".join(sorted(other.name for other in valid))
            raise ConflictError(f"the mode is {mode.name}, this takes {names}: switch_mode first")

    Enable, Stop, ClearFault, SwitchMode = enable, stop, clear_fault, switch_mode
    ExecutePlan, ExecutePrimitive = execute_plan, execute_primitive
    SetJointImpedance, SetCartesianImpedance = set_joint_impedance, set_cartesian_impedance
    SetMaxContactWrench, SetMaxContactTorque = set_max_contact_wrench, set_max_contact_torque
    SetForceControlAxis, SetForceControlFrame = set_force_control_axis, set_force_control_frame
    SetNullSpacePosture = set_null_space_posture


def _connect(serial_number: str, retries: int, interval_s: float) -> Transport:
    remote = serial_number.startswith(("http://", "https://"))
    for attempt in range(retries + 1):
        try:
            return WebSocketTransport(serial_number) if remote else SharedMemoryTransport(serial_number)
        except UnavailableError:
            if attempt == retries:
                raise
            time.sleep(interval_s)
    raise InputError(f"connect_retries must be 0 or more, got {retries}")


def _positive(values: Sequence[float], size: int, name: str) -> Array:
    numbers = vector(values, size, name=name)
    if not (numbers > 0.0).all():
        raise InputError(f"{name} must be above 0, got {numbers.tolist()}")
    return numbers
