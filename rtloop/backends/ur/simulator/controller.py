"""A simulated controller: its modes, its arm, its inputs and outputs, and the program that runs on it.

docs/ur.md describes the simulated behaviour for which Universal Robots publishes no figures.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from cobot.orientations import Quaternion
from cobot.types import Array
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.reflexes import LIMIT_RAD, VELOCITY_SHARE, check_command
from rtloop.backends.ur.fields import AXES, OUTPUTS, RuntimeState, SafetyMode, UrRobotMode
from rtloop.backends.ur.simulator.functions import ProgramContext
from rtloop.backends.ur.simulator.options import UrControllerOptions
from rtloop.backends.ur.simulator.urscript import Script, ScriptError
from rtloop.backends.ur.transport import UrTransport
from rtloop.results import Rejected

START_S = 0.1
"""Time from `power on` until the arm is idle, and from `brake release` until its brakes are released, s."""
BRAKE_RAD_S2 = 15.0
"""Deceleration of stops that the controller itself executes, rad/s²."""
CURRENT_NOISE_NM = 1e-3
"""Standard deviation of the measured motor currents, as torques, N·m."""
MAX_EVENTS = 200
STOPPING = {
    SafetyMode.PROTECTIVE_STOP,
    SafetyMode.SAFEGUARD_STOP,
    SafetyMode.RECOVERY,
    SafetyMode.AUTOMATIC_MODE_SAFEGUARD_STOP,
}
"""Safety modes in which the arm is stopped with its drives on. In all other modes, except normal and reduced,
the drives are off.
"""
MOVING = {SafetyMode.NORMAL, SafetyMode.REDUCED}


class UrController:
    """The simulated controller.

    Attributes:
        time_s: time since the controller was switched on, s.
        robot_mode, safety, runtime: modes and program state as RTDE reports them.
        events: event descriptions, newest last.
        owners: sessions that have claimed RTDE inputs, by the names of these inputs.
        messages: error messages that are still to be sent over the primary interface.
        blocked: reason why a protective stop cannot be unlocked; "" if nothing prevents it.
    """

    def __init__(self, arm: ControllerArm, options: UrControllerOptions, transport: UrTransport) -> None:
        if arm.limits.dof != AXES:
            raise ValueError(
                f"an arm of Universal Robots has {AXES} joints, but the model has {arm.limits.dof}"
            )
        self.arm, self.options, self.transport = arm, options, transport
        self.period_s = options.period_s
        self.steps = 0
        self.robot_mode = UrRobotMode.RUNNING if options.is_on else UrRobotMode.POWER_OFF
        self.safety, self.runtime = SafetyMode.NORMAL, RuntimeState.STOPPED
        self.is_remote = options.is_remote
        self.slider = options.slider
        self.blocked = ""
        self.digital_in = self.digital_out = 0
        self.analog_in, self.analog_out = [0.0] * 4, [0.0] * 2
        self.analog_types = 0b1111
        self.registers: dict[str, Any] = {}
        self.payload, self.centre = 0.0, [0.0, 0.0, 0.0]
        self.tcp = [0.0] * 6
        self.events: deque[str] = deque(maxlen=MAX_EVENTS)
        self.messages: list[tuple[int, int, str]] = []
        self.owners: dict[str, object] = {}
        self.wire: list[Array] | None = None
        self._noise = np.random.default_rng(0)
        self._velocity = np.zeros(AXES)
        self._acceleration = np.zeros(AXES)
        self._script: Script | None = None
        self._context = ProgramContext(self)
        self._is_released = self._exerts = False
        self._secondary: list[Script] = []
        self._next_mode: tuple[float, UrRobotMode] | None = None
        self.program_name = ""

    @property
    def time_s(self) -> float:
        return self.steps * self.period_s

    @property
    def velocity(self) -> Array:
        return self._velocity

    @property
    def is_running(self) -> bool:
        return self.runtime in (RuntimeState.PLAYING, RuntimeState.PAUSED)

    # Actions of a person, the dashboard and the safety system

    def power_on(self) -> None:
        if self.robot_mode == UrRobotMode.POWER_OFF:
            self.robot_mode = UrRobotMode.POWER_ON
            self._next_mode = (self.time_s + START_S, UrRobotMode.IDLE)

    def power_off(self) -> None:
        self.stop_program("the arm was switched off")
        self.robot_mode, self._next_mode = UrRobotMode.POWER_OFF, None

    def release_brakes(self) -> None:
        if self.robot_mode == UrRobotMode.POWER_OFF:
            self.power_on()
        if self.robot_mode in (UrRobotMode.IDLE, UrRobotMode.POWER_ON):
            self._next_mode = (self.time_s + START_S, UrRobotMode.RUNNING)

    def unlock(self) -> str:
        """Unlock a protective stop. Returns "", or the reason if this is impossible."""
        if self.safety == SafetyMode.PROTECTIVE_STOP:
            if self.blocked:
                return self.blocked
            self.safety = SafetyMode.NORMAL
        return ""

    def set_safety(self, safety: SafetyMode, why: str = "") -> None:
        """Change the safety mode, as a button, a safeguard or the safety system would."""
        if safety == self.safety:
            return
        self.safety = safety
        self.events.append(f"safety mode {safety.name}{': ' + why if why else ''}")
        if safety in MOVING:
            return
        if safety == SafetyMode.PROTECTIVE_STOP and self.is_running:
            self.runtime = RuntimeState.PAUSED
        elif safety in STOPPING:
            if self.is_running:
                self.runtime = RuntimeState.PAUSED
        else:
            self.power_off()

    def stop_program(self, why: str) -> None:
        if self._script is not None:
            self.events.append(f"program {self._script.name} stopped: {why}")
        self._script = None
        self._context.close()
        self.runtime = RuntimeState.STOPPED

    def pause_program(self) -> bool:
        if self.runtime != RuntimeState.PLAYING:
            return False
        self.runtime = RuntimeState.PAUSED
        return True

    def play_program(self) -> bool:
        if self.runtime != RuntimeState.PAUSED or self.safety not in MOVING:
            return False
        self.runtime = RuntimeState.PLAYING
        return True

    def upload(self, text: str) -> None:
        """Accept a program from the primary, secondary or real-time interface."""
        if not self.is_remote:
            self.events.append("a program was rejected: the controller is in Local Control")
            return
        context = ProgramContext(self)
        try:
            script = Script(text, context.functions())
        except ScriptError as exc:
            self.events.append(f"a program was rejected: {exc}")
            self.messages.append((*_place(exc), f"compile_error:{exc}"))
            return
        if script.is_secondary:
            self._secondary = [*self._secondary, script][-8:]
            return
        if self.robot_mode != UrRobotMode.RUNNING or self.safety not in MOVING:
            self.events.append(f"program {script.name} was not started: the arm is {self.robot_mode.name}")
            return
        self.stop_program("another was uploaded")
        self._script, self._context, self.runtime = script, context, RuntimeState.PLAYING
        self.program_name = script.name
        self.events.append(f"program {script.name} started")

    # Its control period

    def advance(self) -> None:
        """Run one control period."""
        self.steps += 1
        if self._next_mode is not None and self.time_s >= self._next_mode[0]:
            mode, self._next_mode = self._next_mode[1], None
            self.robot_mode = mode
        self._context.begin_period()
        self._run_programs()
        plays = self.runtime == RuntimeState.PLAYING
        self._context.is_guided &= plays
        torque = self._context.torque if plays else None
        self._switch_drives(self._context.is_guided, torque is not None)
        if torque is not None:
            self._exert(torque)
        elif self._is_released:
            self._drift()
        else:
            self._move(self._context.goal if plays else None)

    def _run_programs(self) -> None:
        self._secondary = [each for each in self._secondary if self._step(each)]
        if self._script is None or self.runtime != RuntimeState.PLAYING:
            return
        if not self._step(self._script):
            self.stop_program("it has ended")

    def _step(self, script: Script) -> bool:
        try:
            return script.step()
        except ScriptError as exc:
            self.events.append(f"program {script.name}: {exc}")
            self.messages.append((*_place(exc), f"runtime_error:{exc}"))
            return False

    def _switch_drives(self, released: bool, exerts: bool) -> None:
        """Release the arm for freedrive, let it follow torques, or return to position control."""
        if (released, exerts) == (self._is_released, self._exerts):
            return
        if exerts != self._exerts:
            self.events.append(f"direct torque {'begins' if exerts else 'ends'}")
        self._is_released, self._exerts = released, exerts
        if exerts:
            self.arm.loosen()
        elif released:
            self.arm.release()
        else:
            self.arm.hold()

    def _drift(self) -> None:
        """Simulate an arm that a person guides, within the limits of the reflexes."""
        self.arm.drift(round(1e3 * self.period_s))
        self._check_free_motion("was guided")

    def _exert(self, torque: Array) -> None:
        """Exert torques, within the limits of the reflexes."""
        limits = self.arm.limits
        over = np.abs(torque) / limits.max_effort
        joint = int(over.argmax())
        if over[joint] > 1.0 + 1e-9:
            self.set_safety(
                SafetyMode.PROTECTIVE_STOP,
                f"{limits.names[joint]} is commanded a torque of {torque[joint]:.6g} N·m, but its limit "
                f"is {limits.max_effort[joint]:g} N·m",
            )
            torque = np.zeros(AXES)
        self.arm.exert(torque, round(1e3 * self.period_s))
        self._check_free_motion("was moved by torques")

    def _check_free_motion(self, what: str) -> None:
        """Check the arm while it moves freely: take over its measured velocity, and trigger a protective stop
        if it is beyond a limit.
        """
        measured, limits = self.arm.measured, self.arm.limits
        self._velocity, self._acceleration = measured.velocity.copy(), np.zeros(AXES)
        past = np.maximum(limits.min_position - measured.position, measured.position - limits.max_position)
        if past.max() > LIMIT_RAD:
            name = limits.names[int(past.argmax())]
            self.set_safety(SafetyMode.PROTECTIVE_STOP, f"{name} {what} beyond its limit")
        speed = np.abs(measured.velocity) / limits.max_velocity
        if speed.max() > VELOCITY_SHARE:
            name = limits.names[int(speed.argmax())]
            self.set_safety(SafetyMode.PROTECTIVE_STOP, f"{name} {what} too fast")

    def _move(self, goal: Array | None) -> None:
        """Move to a goal if the reflexes permit it; otherwise decelerate."""
        arm, period_s = self.arm, self.period_s
        if goal is not None:
            velocity = (goal - arm.setpoint) / period_s
            result = check_command(arm, goal, velocity, self._velocity, period_s)
            if isinstance(result, Rejected):
                self.set_safety(SafetyMode.PROTECTIVE_STOP, result.reason)
                goal = None
        if goal is None:
            most = self._context.brake_rad_s2 * period_s
            velocity = self._velocity - np.clip(self._velocity, -most, most)
            goal = arm.setpoint + velocity * period_s
        self._acceleration = (velocity - self._velocity) / period_s
        arm.advance(goal, velocity, round(1e3 * period_s))
        self._velocity = velocity

    # RTDE

    def set_inputs(self, values: Mapping[str, Any]) -> None:
        """Apply a data package of a client."""
        get = values.get
        if get("speed_slider_mask"):
            share = float(values["speed_slider_fraction"])
            if math.isfinite(share):
                self.slider = min(max(share, 0.0), 1.0)
        for name, first, count in (
            ("standard_digital_output", 0, 8),
            ("configurable_digital_output", 8, 8),
            ("tool_digital_output", 16, 2),
        ):
            mask = int(get(f"{name}_mask", 0)) & (1 << count) - 1
            self.digital_out = self.digital_out & ~(mask << first) | (int(get(name, 0)) & mask) << first
        mask = int(get("standard_analog_output_mask", 0))
        for index in range(2):
            if mask >> index & 1:
                domain = int(values["standard_analog_output_type"]) >> index & 1
                self.set_analog(index, float(values[f"standard_analog_output_{index}"]), domain)
        self.registers.update({name: value for name, value in values.items() if "register" in name})

    def set_analog(self, index: int, share: float, domain: int) -> None:
        """Set an analog output of the controller.

        Args:
            domain: 0 for current, 1 for voltage.
        """
        share = min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
        self.analog_types = self.analog_types & ~(4 << index) | domain << 2 + index
        self.analog_out[index] = 10.0 * share if domain else 0.004 + 0.016 * share

    def values(self) -> dict[str, Any]:
        """Return the current value of each RTDE output."""
        measured, arm = self.arm.measured, self.arm
        pose = self.pose()
        scaling = 1.0 if self.runtime == RuntimeState.PLAYING or not self.is_running else 0.0
        found: dict[str, Any] = dict(_ZEROS)
        found.update(self.registers)
        found.update(
            timestamp=self.time_s,
            target_q=arm.setpoint.tolist(),
            target_qd=self._velocity.tolist(),
            target_qdd=self._acceleration.tolist(),
            target_moment=measured.desired_effort.tolist(),
            actual_current_as_torque=(
                measured.effort + self._noise.normal(0.0, CURRENT_NOISE_NM, AXES)
            ).tolist(),
            actual_q=measured.position.tolist(),
            actual_qd=measured.velocity.tolist(),
            actual_TCP_pose=pose,
            target_TCP_pose=pose,
            actual_TCP_force=measured.wrench.tolist(),
            ft_raw_wrench=measured.wrench.tolist(),
            actual_digital_input_bits=self.digital_in,
            actual_digital_output_bits=self.digital_out,
            joint_temperatures=[30.0] * AXES,
            robot_mode=int(self.robot_mode),
            joint_mode=[253 if self.robot_mode == UrRobotMode.RUNNING else 239] * AXES,
            safety_mode=min(int(self.safety), int(SafetyMode.SAFEGUARD_STOP))
            if self.safety > SafetyMode.UNDEFINED_SAFETY_MODE
            else int(self.safety),
            safety_status=int(self.safety),
            speed_scaling=scaling,
            target_speed_fraction=self.slider,
            actual_main_voltage=48.0,
            actual_robot_voltage=48.0 if self.robot_mode >= UrRobotMode.IDLE else 0.0,
            runtime_state=int(self.runtime),
            robot_status_bits=(self.robot_mode >= UrRobotMode.POWER_ON) | (self.is_running << 1),
            safety_status_bits=self.safety_bits(),
            analog_io_types=self.analog_types,
            standard_analog_input0=self.analog_in[0],
            standard_analog_input1=self.analog_in[1],
            standard_analog_output0=self.analog_out[0],
            standard_analog_output1=self.analog_out[1],
            tool_analog_input0=self.analog_in[2],
            tool_analog_input1=self.analog_in[3],
            tcp_force_scalar=float(np.linalg.norm(measured.wrench[:3])),
            payload=self.payload,
            payload_cog=self.centre,
        )
        return found

    def safety_bits(self) -> int:
        safety = self.safety
        bits = {
            SafetyMode.NORMAL: 1,
            SafetyMode.REDUCED: 1 << 1,
            SafetyMode.PROTECTIVE_STOP: 1 << 2,
            SafetyMode.RECOVERY: 1 << 3,
            SafetyMode.SAFEGUARD_STOP: 1 << 4,
            SafetyMode.SYSTEM_EMERGENCY_STOP: 1 << 5 | 1 << 7,
            SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7,
            SafetyMode.VIOLATION: 1 << 8,
            SafetyMode.FAULT: 1 << 9,
        }
        return bits.get(safety, 0) | (0 if safety in MOVING else 1 << 10)

    def pose(self) -> list[float]:
        """Return the flange pose in the base frame: the position in m, and a rotation vector in rad."""
        x, y, z, *turn = self.arm.pose()
        return [1e-3 * x, 1e-3 * y, 1e-3 * z, *_rotation_vector((turn[0], turn[1], turn[2], turn[3]))]


def _rotation_vector(turn: Quaternion) -> list[float]:
    w, *vector = turn if turn[0] >= 0.0 else tuple(-each for each in turn)
    sine = math.hypot(*vector)
    factor = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return [factor * each for each in vector]


def _place(error: ScriptError) -> tuple[int, int]:
    """Return the line and the column of an error."""
    words = str(error).split(":")[0].split()
    return (int(words[1]) if words[0] == "line" and len(words) > 1 and words[1].isdigit() else 1), 0


_SIZES = {"VECTOR3D": 3, "VECTOR6D": 6, "VECTOR6INT32": 6, "VECTOR6UINT32": 6}
_ZEROS: dict[str, Any] = {
    name: [0] * _SIZES[kind] if kind in _SIZES else (False if kind == "BOOL" else 0)
    for name, kind in OUTPUTS.items()
}
