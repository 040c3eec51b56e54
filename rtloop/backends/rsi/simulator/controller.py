"""The controller's side of RSI, with the time stamp IPOC, corrections, reflexes and one telegram per period.

The simulated controller counts periods instead of using a clock: tests step it, and a server runs it in real
time. docs/kuka-rsi.md describes the behaviour for which KUKA publishes no figures.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from cobot.types import Array
from rtloop.backends.rsi.simulator.options import ControllerOptions
from rtloop.backends.rsi.telegrams import MICRO, RobState, TelegramLayout, decode_sen, encode_rob
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.reflexes import check_command
from rtloop.results import Rejected

FIRST_IPOC = 123_456
RESTART_MS = 200
"""Time until the operator restarts the program once nothing prevents it, ms."""
BRAKE_RAD_S2 = 10.0
EVENTS = 200
LENIENT_PERIODS = 50
WIRE = 1_000_000


@dataclass(slots=True)
class Counters:
    """
    Attributes:
        answered, late: numbers of telegrams that were answered in time and too late.
        malformed: number of received packets that are not answers.
        wrong_ipoc: number of answers to an earlier telegram than the last one.
        sessions: number of times that RSI was switched on.
    """

    answered: int = 0
    late: int = 0
    malformed: int = 0
    wrong_ipoc: int = 0
    sessions: int = 0


@dataclass(slots=True)
class _Session:
    """A session, from RSI_ON to RSI_OFF.

    Attributes:
        reference: the arm's set position at the beginning of the session, rad.
        correction: current correction, rad.
        values: values of the last valid answer, rad.
        delay, row: number of late answers since RSI_ON, and number of consecutive late answers.
        lenient: number of periods in which changes of velocity are still not checked, because an answer was
            late.
    """

    reference: Array
    correction: Array
    values: Array
    delay: int = 0
    row: int = 0
    is_answered: bool = True  # because nothing has been sent yet
    is_attached: bool = False
    lenient: int = 0
    velocity: Array = field(default_factory=lambda: np.zeros(0))


class RsiController:
    """The simulated controller.

    Attributes:
        arm: the simulated arm.
        options: controller options.
        ipoc: the controller's time stamp, ms.
        is_stopped: whether a safety stop is active. The drives are then off.
        mode: position of the operator's key switch.
        inputs, outputs: values of the inputs and outputs, in the order of the layout.
        starts_again: whether the operator restarts the program as soon as nothing prevents it.
        events: event descriptions, newest last.
        wire: positions that the client has commanded, rad.
    """

    def __init__(
        self, arm: ControllerArm, layout: TelegramLayout, max_correction: Array, options: ControllerOptions
    ) -> None:
        """
        Args:
            max_correction: limits of AXISCORR and AXISCORRMON, degrees or mm, shape (dof,).
        """
        self.arm, self.layout, self.options = arm, layout, options
        self.period_s = options.period_ms * 1e-3
        self.max_correction = max_correction / layout.scale
        self.ipoc = FIRST_IPOC
        self.is_stopped = False
        self.mode: str = options.operation_mode
        self.override = options.override
        self.inputs = [False] * len(layout.inputs)
        self.outputs = [False] * len(layout.outputs)
        self.starts_again = True
        self.events: deque[str] = deque(maxlen=EVENTS)
        self.wire: deque[Array] = deque(maxlen=WIRE)
        self.counters = Counters()
        self._velocity = np.zeros(arm.limits.dof)
        self._restart_ms = 0
        self._session: _Session | None = None

    @property
    def is_on(self) -> bool:
        """Whether RSI is on."""
        return self._session is not None

    @property
    def delay(self) -> int:
        return self._session.delay if self._session is not None else 0

    @property
    def correction(self) -> Array:
        return self._session.correction if self._session is not None else np.zeros(self.arm.limits.dof)

    @property
    def waits_for_answer(self) -> bool:
        return self._session is not None and not self._session.is_answered

    def packet(self) -> bytes:
        """End a period and begin the next one. Return the telegram of the new period; b"" while RSI is
        off.
        """
        if self._session is not None:
            self._count_missing(self._session)
        self._move()
        self.ipoc += self.options.period_ms
        if self._session is None:
            self._start_again()
        session = self._session
        if session is None:
            return b""
        session.is_answered = False
        return encode_rob(self.layout, self._state(session))

    def answer(self, packet: bytes) -> None:
        """Process a packet from a client, valid or not."""
        session = self._session
        if session is None:
            return
        found = decode_sen(packet, self.layout)
        if isinstance(found, str):
            self.counters.malformed += 1
            self.events.append(f"an answer is rejected: {found}")
            return
        if found.ipoc != self.ipoc or session.is_answered:
            self.counters.wrong_ipoc += 1
            return
        session.is_answered = session.is_attached = True
        session.values = np.array(found.corrections) / (MICRO * self.layout.scale)
        session.row = 0
        self.counters.answered += 1
        self.outputs = list(found.outputs)
        self._correct(session)

    def stop_safely(self, *, active: bool) -> None:
        """Press or release the emergency stop. Pressing it ends RSI and switches the drives off."""
        if active != self.is_stopped:
            self.is_stopped = active
            self.events.append("an emergency stop" if active else "the emergency stop is released")
            self.switch_off("an emergency stop")

    def switch_mode(self, mode: str) -> None:
        """Turn the operator's key switch. This ends RSI."""
        if mode != self.mode:
            self.mode = mode
            self.events.append(f"operation mode: {mode}")
            self.switch_off(f"the operation mode was changed to {mode}")

    def switch_off(self, reason: str) -> None:
        """End RSI. The operator then starts the program again."""
        self._restart_ms = RESTART_MS
        if self._session is not None:
            self._session = None
            self.events.append(f"RSI is off: {reason}")

    def _start_again(self) -> None:
        moves = bool(self._velocity.any())
        if self.is_stopped or moves or not self.starts_again:
            self._restart_ms = max(self._restart_ms, RESTART_MS)
            return
        self._restart_ms -= self.options.period_ms
        if self._restart_ms > 0:
            return
        dof = self.arm.limits.dof
        self._session = _Session(
            self.arm.setpoint.copy(), np.zeros(dof), np.zeros(dof), velocity=np.zeros(dof)
        )
        self.counters.sessions += 1
        self.events.append("RSI is on")

    def _count_missing(self, session: _Session) -> None:
        """Count a missing answer, unless the client has never answered: then it is not connected yet."""
        if session.is_answered:
            session.lenient = max(0, session.lenient - 1)
            return
        if not session.is_attached:
            return
        session.lenient = LENIENT_PERIODS
        session.delay += 1
        session.row += 1
        self.counters.late += 1
        counted = session.row if self.options.in_a_row else session.delay
        if counted > self.options.timeout:
            self.switch_off(f"{counted} answers were late, allowed: {self.options.timeout} (Timeout)")
            return
        if self.options.relative and self.options.hold_on:
            self._correct(session)
        elif not self.options.relative and not self.options.hold_on:
            session.values = np.zeros_like(session.values)
            self._correct(session)

    def _correct(self, session: _Session) -> None:
        """Apply the values of an answer within the limits, as the object AXISCORR does."""
        base = session.correction if self.options.relative else 0.0
        wanted = base + session.values
        if not (np.abs(wanted) <= self.max_correction + 1e-9).all():
            axis = self.layout.axes[int(np.argmax(np.abs(wanted) - self.max_correction))]
            self.events.append(f"AXISCORR limits the correction of {axis}")
            wanted = np.clip(wanted, -self.max_correction, self.max_correction)
            session.correction = wanted
            self.switch_off(f"the correction of {axis} has reached its limit (AXISCORRMON)")
            return
        position = session.reference + wanted
        velocity = (position - self.arm.setpoint) / self.period_s
        result = check_command(
            self.arm,
            position,
            velocity,
            velocity if session.lenient else session.velocity,
            self.period_s,
            in_t1=self.mode == "T1",
        )
        if isinstance(result, Rejected):
            self.switch_off(result.reason)
            return
        session.correction, session.velocity = wanted, velocity
        self.wire.append(position)

    def _move(self) -> None:
        """Move the arm to the corrected position, or decelerate."""
        setpoint = self.arm.setpoint
        if self._session is not None:
            target = self._session.reference + self._session.correction
            self._velocity = (target - setpoint) / self.period_s
        else:
            speed = np.maximum(np.abs(self._velocity) - BRAKE_RAD_S2 * self.period_s, 0.0)
            self._velocity = np.sign(self._velocity) * speed
            target = setpoint + self._velocity * self.period_s
        target = np.clip(target, self.arm.limits.min_position, self.arm.limits.max_position)
        self.arm.advance(target, self._velocity, self.options.period_ms)

    def _state(self, session: _Session) -> RobState:
        state = RobState(
            self.ipoc,
            tuple(self.arm.measured.position.tolist()),
            setpoint=tuple(self.arm.setpoint.tolist()),
            delay=session.delay,
            pose=self.arm.kuka_pose(),
            inputs=tuple(self.inputs),
            outputs=tuple(self.outputs),
        )
        if self.options.reports:
            state.correction = tuple(session.correction.tolist())
            state.operation_mode, state.is_ready, state.is_stopped = self.mode, True, self.is_stopped
            state.override = 1e-2 * self.override
            state.mode = "relative" if self.options.relative else "absolute"
        return state
