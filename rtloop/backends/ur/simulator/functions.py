"""The URScript functions that a simulated controller provides, and the state of one program."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from cobot.types import Array
from rtloop.backends.ur.fields import AXES
from rtloop.backends.ur.simulator.urscript import Run
from rtloop.backends.ur.transport import ByteStream

if TYPE_CHECKING:
    from rtloop.backends.ur.simulator.controller import UrController

OPEN_S = 2.0
"""Timeout of `socket_open`, and default timeout of the reading functions, s."""
MAX_NUMBERS = 30
STOP_RAD_S2 = 15.0
AT_REST_RAD_S = 1e-6
DIGITAL = {"standard_": (0, 8), "configurable_": (8, 8), "tool_": (16, 2), "": (0, 18)}
"""First bit and number of the digital inputs and outputs, by the kind that the names of their functions
contain.
"""


class _Socket:
    def __init__(self, stream: ByteStream) -> None:
        self.stream, self.buffer = stream, bytearray()

    def fill(self) -> None:
        """Receive bytes into the buffer. Raises ConnectionError if the connection is closed."""
        self.buffer += self.stream.receive()


class ProgramContext:
    """The commands that the functions of a program give to the controller.

    Attributes:
        goal: joint position for this control period, shape (dof,), rad; None without a goal.
        torque: joint torques for this control period in addition to gravity, shape (dof,), N·m; None without
            torques.
        brake_rad_s2: deceleration while there is no goal, rad/s².
        is_guided: whether the arm is in freedrive.
    """

    def __init__(self, controller: UrController) -> None:
        self._controller = controller
        self._sockets: dict[str, _Socket] = {}
        self.goal: Array | None = None
        self.torque: Array | None = None
        self.brake_rad_s2 = STOP_RAD_S2
        self.is_guided = False

    def begin_period(self) -> None:
        self.goal = self.torque = None

    def close(self) -> None:
        self.is_guided = False
        for each in self._sockets.values():
            each.stream.close()
        self._sockets.clear()

    def functions(self) -> dict[str, Callable[..., Any]]:
        """Return the functions by name; see `Script`."""
        return self._of_arm() | self._of_program() | self._of_signals()

    def _of_arm(self) -> dict[str, Callable[..., Any]]:
        controller, arm = self._controller, self._controller.arm
        torques = {"direct_torque": self._direct_torque} if controller.options.has_torque else {}
        return {
            **torques,
            "get_steptime": lambda: controller.period_s,
            "get_target_joint_positions": lambda: arm.setpoint.tolist(),
            "get_actual_joint_positions": lambda: arm.measured.position.tolist(),
            "get_target_joint_speeds": lambda: controller.velocity.tolist(),
            "get_actual_joint_speeds": lambda: arm.measured.velocity.tolist(),
            "get_actual_tcp_pose": controller.pose,
            "get_tcp_force": lambda: arm.measured.wrench.tolist(),
            "get_target_payload": lambda: controller.payload,
            "servoj": self._servoj,
            "stopj": self._stopj,
            "freedrive_mode": lambda: self._switch_freedrive(True),
            "end_freedrive_mode": lambda: self._switch_freedrive(False),
            "set_tcp": self._set_tcp,
            "set_payload": self._set_payload,
        }

    def _of_program(self) -> dict[str, Callable[..., Any]]:
        events = self._controller.events
        return {
            "sync": self._sync,
            "sleep": self._sleep,
            "textmsg": lambda *words: events.append(" ".join(map(str, words))[:500]),
            "popup": lambda *words, **_: events.append(f"popup: {words[0]}"[:500]),
            "to_str": str,
            "sqrt": math.sqrt,
            "socket_open": self._socket_open,
            "socket_close": self._socket_close,
            "socket_send_int": lambda value, name="socket_0": self._send(struct.pack(">i", int(value)), name),
            "socket_send_string": lambda text, name="socket_0": self._send(str(text).encode(), name),
            "socket_read_binary_integer": self._read_integers,
        }

    def _of_signals(self) -> dict[str, Callable[..., Any]]:
        controller = self._controller
        found: dict[str, Callable[..., Any]] = {
            "set_standard_analog_out": lambda n, f: controller.set_analog(
                n, f, controller.analog_types >> 2 + n & 1
            )
        }
        for kind, place in DIGITAL.items():
            found[f"get_{kind}digital_in"] = partial(self._digital, *place, False)
            found[f"get_{kind}digital_out"] = partial(self._digital, *place, True)
            found[f"set_{kind}digital_out"] = partial(self._set_digital, *place)
        for name, kind in (("integer", "int"), ("float", "double")):
            for way in ("input", "output"):
                found[f"read_{way}_{name}_register"] = partial(self._register, f"{way}_{kind}")
            found[f"write_output_{name}_register"] = partial(self._set_register, kind)
        return found

    def _digital(self, first: int, count: int, is_output: bool, n: int) -> bool:
        _require_index(n, count)
        bits = self._controller.digital_out if is_output else self._controller.digital_in
        return bool(bits >> first + n & 1)

    def _set_digital(self, first: int, count: int, n: int, b: bool) -> None:
        _require_index(n, count)
        bit, bits = 1 << first + n, self._controller.digital_out
        self._controller.digital_out = bits | bit if b else bits & ~bit

    def _register(self, kind: str, address: int) -> Any:
        return self._controller.registers.get(f"{kind}_register_{address}", 0)

    def _set_register(self, kind: str, address: int, value: float) -> None:
        _require_index(address, 48)
        self._controller.registers[f"output_{kind}_register_{address}"] = value

    def _servoj(
        self,
        q: list[float],
        a: float = 0,
        v: float = 0,
        t: float = 0.002,
        lookahead_time: float = 0.1,
        gain: float = 300,
    ) -> Run:
        """Move to a position in the time `t`. The simulated drives use neither the lookahead time nor the
        gain.
        """
        if len(q) != AXES or not 0.03 <= lookahead_time <= 0.2 or not 100 <= gain <= 2000:
            raise ValueError(
                "servoj: 6 joints, lookahead_time 0.03 to 0.2 and gain 100 to 2000 are allowed, "
                f"got {len(q)}, {lookahead_time:g} and {gain:g}"
            )
        if self.is_guided:
            raise ValueError("servoj: the arm is in freedrive; end it with end_freedrive_mode() first")
        begin, goal = self._controller.arm.setpoint.copy(), np.array(q, dtype=float)
        cycles = max(1, round(t / self._controller.period_s))
        for cycle in range(1, cycles + 1):
            self.goal = begin + (goal - begin) * (cycle / cycles)
            yield

    def _direct_torque(
        self,
        torque: list[float],
        viscous_scale: list[float] | None = None,
        coulomb_scale: list[float] | None = None,
        friction_comp: bool = True,
    ) -> Run:
        """Exert torques in this control period. The simulated drives compensate friction."""
        if len(torque) != AXES or not all(map(math.isfinite, torque)):
            raise ValueError(f"direct_torque: {AXES} torques are needed, got {torque}")
        if self.is_guided:
            raise ValueError("direct_torque: the arm is in freedrive; end it with end_freedrive_mode() first")
        self.torque = np.array(torque, dtype=float)
        yield

    def _stopj(self, a: float) -> Run:
        self.brake_rad_s2 = min(max(float(a), 0.1), 100.0)
        while float(np.abs(self._controller.velocity).max()) > AT_REST_RAD_S:
            yield
        self.brake_rad_s2 = STOP_RAD_S2

    def _switch_freedrive(self, guided: bool) -> None:
        if guided != self.is_guided:
            self._controller.events.append(f"freedrive {'begins' if guided else 'ends'}")
        self.is_guided = guided

    def _sync(self) -> Run:
        yield

    def _sleep(self, t: float) -> Run:
        for _ in range(max(1, round(t / self._controller.period_s))):
            yield

    def _set_tcp(self, pose: list[float]) -> None:
        if any(pose):
            raise ValueError("set_tcp: the simulated controller has its TCP at the flange")
        self._controller.tcp = list(pose)

    def _set_payload(self, m: float, cog: list[float] | None = None) -> None:
        if not 0.0 <= m <= 100.0:
            raise ValueError(f"set_payload: {m:g} kg")
        self._controller.payload, self._controller.centre = float(m), list(cog or (0.0, 0.0, 0.0))

    def _socket_open(self, address: str, port: int, name: str = "socket_0") -> Run:
        self._socket_close(name)
        clock = self._controller.transport.clock
        until_s = clock() + OPEN_S
        try:
            stream = self._controller.transport.connect(address, port)
            while not stream.is_connected():
                if clock() > until_s:
                    stream.close()
                    return False
                yield
        except OSError:
            return False
        self._sockets[name] = _Socket(stream)
        return True

    def _socket_close(self, name: str = "socket_0") -> None:
        found = self._sockets.pop(name, None)
        if found is not None:
            found.stream.close()

    def _send(self, data: bytes, name: str) -> bool:
        found = self._sockets.get(name)
        if found is None:
            return False
        try:
            found.stream.send(data)
        except OSError:
            self._socket_close(name)
            return False
        return True

    def _read_integers(self, number: int, socket_name: str = "socket_0", timeout: float = OPEN_S) -> Run:
        """Return a list with the number of values that were read (all or none), followed by the values."""
        if not 0 < number <= MAX_NUMBERS:
            raise ValueError(
                f"socket_read_binary_integer: 1 to {MAX_NUMBERS} numbers are allowed, got {number}"
            )
        nothing = [0] + [-1] * number
        until = self._controller.time_s + timeout
        while (found := self._sockets.get(socket_name)) is not None:
            try:
                found.fill()
            except OSError:
                return nothing
            if len(found.buffer) >= 4 * number:
                values = list(struct.unpack_from(f">{number}i", found.buffer))
                del found.buffer[: 4 * number]
                return [number, *values]
            if self._controller.time_s >= until:
                return nothing
            yield
        return nothing


def _require_index(index: int, count: int) -> None:
    if not 0 <= index < count:
        raise IndexError(f"{index} is not in the range 0 to {count - 1}")
