"""A driver that makes a `Backend` of a device that executes whole motions. rtloop's cycle never waits for the
device.

A thread polls the device's position and progress several times a second. Between two polls it enables the
device and sends motions and stops to it. The cycle reads the device's last answer.
"""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np

from cobot.foreign import plain_error, plain_text
from cobot.launch.process import leave_real_time
from cobot.robot.device import DeviceStatus
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.types import Array
from rtloop.backends.compiled import Measured
from rtloop.backends.driven_io import DrivenIo
from rtloop.backends.protocols import (
    Backend,
    BackendError,
    CarriesTool,
    HasIo,
    Reporting,
    TrajectoryDevice,
    capabilities_of,
    require_accepted,
)
from rtloop.backends.threaded_enabling import ThreadedEnabling
from rtloop.results import ACCEPTED, Accepted, Rejected

log = logging.getLogger("cobot.rtloop")

STATE_PERIOD_S, POINT_PERIOD_S = 0.05, 0.02
"""Default values of a device's `state_period_s` and `point_period_s`, s."""
SILENCE_S = 2.0
"""Time without an answer after which the connection to the device is lost, s."""
LAST_CALL_S, LAST_CALL_LOG_S = 4.0, 1.0
"""Timeout for the last call to the device when rtloop ends, and the time after which a pending call is
logged, s. A test checks that the supervisor waits longer before it kills the process.
"""
TURN_S = 0.5
"""Maximum wait for the end of a poll, before a call that the cycle itself must make, s."""
REST_S, REST_RAD = 3.0, 1e-4
"""Timeout for the arm to stop if it is moving at `open`, s, and the maximum motion between two polls of an
arm at rest, rad.
"""
FROZEN_ASKED = 5
"""Maximum number of consecutive polls that return the same measured values while the device reports
progress.
"""
FROZEN_RAD = 1e-3
MAX_REPEATS = 2
"""Maximum number of consecutive polls without a new position for which the calculated velocity is kept."""
NEAREST = 0.1
"""Minimum time between two points of a motion, as a share of the point period."""
END_S = 1e-9


def as_backend(made: object, dof: int, period_s: float, *, threaded: bool = True) -> Backend:
    """Return a backend unchanged. For a device that executes whole motions, return a driver around it."""
    if isinstance(made, TrajectoryDevice):
        return TrajectoryDriver(made, dof, period_s, threaded=threaded)
    return cast(Backend, made)


@dataclass(frozen=True, slots=True)
class PollAnswer:
    """The device's answer to a poll.

    Attributes:
        values: the measured values, in the form of `Measured.values`.
        motion: number of the motion whose progress is `done_s`, in path time.
        halted: number of the last motion for which a stop was sent before this poll; 0 before the first stop.
        result: ACCEPTED, or the reason why the answer cannot be used.
        time_s: time of the answer, on this computer's clock.
    """

    values: Array
    motion: int = 0
    done_s: float = 0.0
    halted: int = 0
    result: Accepted | Rejected = ACCEPTED
    time_s: float = 0.0


class Motion:
    """A path for the device, slowed down to `share` of its speed."""

    def __init__(self, number: int, breakpoints_s: Array, coefficients: Array, share: float) -> None:
        self.number = number
        self._parts, self._share = (breakpoints_s, coefficients), share
        self.duration_s = float(breakpoints_s[-1])

    def points(self, period_s: float) -> tuple[Array, Array]:
        """Return sample times, and the positions, velocities and accelerations at each. Shapes: (n,) and (3,
        n, dof).

        The times are at most `period_s` apart. They include the times where the polynomials of the path meet,
        so that a device that uses quintics between the points keeps the path and its jerk.
        """
        slowed = Trajectory(*self._parts).stretched(1.0 / self._share)
        times_s = _point_times(slowed.breakpoints_s, period_s)
        return times_s, np.array([slowed.sample(times_s, order) for order in range(3)])

    def position(self, done_s: float) -> Array:
        return np.asarray(Trajectory(*self._parts).sample([done_s])[0])

    def done_s(self, progress_s: float) -> float:
        done_s = progress_s * self._share
        return self.duration_s if done_s >= self.duration_s - END_S else max(done_s, 0.0)


def _point_times(breakpoints_s: Array, period_s: float) -> Array:
    """Return the breakpoints, with evenly spaced times inserted between them. Breakpoints that are too close
    to the previous one or to the end are left out.
    """
    nearest_s, end_s = NEAREST * period_s, float(breakpoints_s[-1])
    times_s = [0.0]
    for mark_s in [*breakpoints_s[1:-1], end_s]:
        if mark_s == end_s or nearest_s <= mark_s - times_s[-1] <= end_s - times_s[-1] - nearest_s:
            steps = max(math.ceil((mark_s - times_s[-1]) / period_s), 1)
            times_s.extend(np.linspace(times_s[-1], mark_s, steps + 1)[1:])
    return np.array(times_s)


class TrajectoryDriver:
    """A driver that implements `Backend`, `Stepwise`, `MovesByItself` and the optional protocols that its
    device implements.

    Attributes:
        device: the driven device.
    """

    def __init__(self, device: TrajectoryDevice, dof: int, period_s: float, *, threaded: bool = True) -> None:
        """
        Args:
            threaded: whether a thread polls the device. If false, the cycle polls it in robot time, for the
                contract checks.
        """
        self.device, self._dof, self._period_s = device, dof, period_s
        self._state_period_s = float(getattr(device, "state_period_s", STATE_PERIOD_S))
        self._point_period_s = float(getattr(device, "point_period_s", POINT_PERIOD_S))
        self.capabilities = capabilities_of(device)
        self.limits = getattr(device, "limits", None)
        if isinstance(device, Reporting):
            self.status: Callable[[], DeviceStatus] = lambda: self._status
        if isinstance(device, CarriesTool):
            self.set_tool: Callable[[Tool], None] = self._set_tool
        self._io: DrivenIo | None = None
        if isinstance(device, HasIo):
            self._io = DrivenIo(device)
            self.io, self.set_output = self._io.io, self._io.set_output
        self._status = DeviceStatus(connection="not connected")
        self._turn = threading.RLock()  # held by the thread that calls the device
        self._enabling = ThreadedEnabling(self.enable, self._switch_off)
        self._is_disabled = True  # False once `disable` has failed.
        self._off_problem = ""  # Reason why the drives could not be switched off after a reset.
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None
        self._threaded, self._ending = threaded, False
        self._said = self._read = PollAnswer(np.zeros(0))
        self._motion: Motion | None = None
        self._number = 0
        self._loaded = 0  # number of the motion that was sent to the device
        self._halting, self._halted = False, 0
        self._loading: Accepted | Rejected = ACCEPTED  # Whether the device has accepted the motion.
        self._same, self._same_at = 0, np.zeros(dof)
        self._repeats, self._velocity = 0, np.zeros(dof)
        self._cycles = 0

    # Backend

    def open(self, initial_position: Array) -> None:
        with self._turn:
            self.device.open(initial_position)
            self.device.stop()  # an rtloop that crashed may have left the arm moving
            self._ask()
            self._await_rest()
        self.require()
        if self._threaded:
            self._ending = False
            self._thread = threading.Thread(target=self._keep_asking, name="device", daemon=True)
            self._thread.start()

    def enable(self) -> None:
        with self._turn:
            self.device.enable()
            self._loading = ACCEPTED
            self._ask()
        self.require()

    def recover_step(self) -> bool:
        """Make the thread enable the device, which may take seconds."""
        self._enabling.begin()
        self._wake.set()
        return True

    def enable_step(self) -> bool:
        if not self._threaded:
            self._enabling.perform()
        return self._enabling.is_done()

    def read(self, measured: Measured) -> None:
        if not self._threaded:
            self._cycles += 1
            if self._cycles * self._period_s >= self._state_period_s:
                self._cycles = 0
                self._ask()
        self.require()
        self._read = self._said
        measured.values[:] = self._read.values

    def write(self, command: Array) -> None:
        """Do nothing, because the device already has the whole motion."""

    def disable(self) -> None:
        if not self._enabling.cancel():
            self._is_disabled = False
            with self._turn_soon():
                self.device.disable()
            self._is_disabled = True
        elif not self._threaded:
            self._enabling.perform()

    def is_switching_off(self) -> bool:
        return self._enabling.is_switching_off()

    def close(self) -> None:
        self._enabling.cancel()
        self._ending = True
        self._wake.set()
        if self._thread is not None:
            self._await_last_call(self._thread)
        self.device.close()

    # MovesByItself

    def begin(self, breakpoints_s: Array, coefficients: Array, share: float) -> None:
        self._number += 1
        self._halting = False
        self._motion = Motion(self._number, breakpoints_s, coefficients, share)
        self._wake.set()

    def done_s(self) -> float:
        return self._read.done_s if self._read.motion == self._number else 0.0

    def halt(self) -> None:
        self._halting = True
        self._wake.set()

    def is_halted(self) -> bool:
        return self._said.halted == self._number

    # Private methods

    def require(self) -> None:
        """
        Raises:
            BackendError: the state of the device is unknown; the error gives the reason.
        """
        said = self._said
        require_accepted(said.result)
        if said.halted != self._number:
            require_accepted(self._loading)
        silence_s = time.monotonic() - said.time_s
        if self._threaded and silence_s > SILENCE_S + self._state_period_s:
            raise BackendError(f"the device has not answered for {silence_s:.1f} s")

    def _await_rest(self) -> None:
        for _ in range(round(REST_S / self._state_period_s)):
            before = self._said
            if self._threaded:
                time.sleep(self._state_period_s)
            self._ask()
            if self._said.result is not ACCEPTED or before.result is not ACCEPTED:
                return
            moved = np.abs(self._said.values - before.values)[: self._dof]
            if not moved.max() > REST_RAD:
                return

    def _await_last_call(self, thread: threading.Thread) -> None:
        """Wait for the thread, which switches the drives off after a cancelled reset. If `disable` has failed
        because a poll did not return in time, switch the drives off here.
        """
        thread.join(LAST_CALL_LOG_S)
        if thread.is_alive():
            log.error(
                "the device has not answered at the end for %g s; if it does not answer within %g s, its "
                "drives may stay on: check them before you approach the arm",
                LAST_CALL_LOG_S,
                LAST_CALL_S,
            )
            thread.join(LAST_CALL_S - LAST_CALL_LOG_S)
        if not (thread.is_alive() or self._is_disabled):
            self._switch_off()

    @contextlib.contextmanager
    def _turn_soon(self) -> Iterator[None]:
        """
        Raises:
            BackendError: the thread is still waiting for the device.
        """
        if not self._turn.acquire(timeout=TURN_S):
            raise BackendError(f"the device has not answered for {TURN_S:g} s")
        try:
            yield
        finally:
            self._turn.release()

    def _switch_off(self) -> bool:
        """Switch the drives off if `disable` could not. Returns whether it has succeeded."""
        with self._turn:
            try:
                self.device.disable()
            except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
                problem = plain_text(exc)
                if problem != self._off_problem:  # the thread tries this several times a second
                    log.error("the drives could not be switched off after a stop: %s", problem)
                self._off_problem = problem
                return False
        self._off_problem = ""
        return True

    def _set_tool(self, tool: Tool) -> None:
        with self._turn_soon():
            cast(CarriesTool, self.device).set_tool(tool)

    def _keep_asking(self) -> None:
        leave_real_time()
        while not self._ending:
            self._wake.wait(self._state_period_s)
            self._wake.clear()
            self._enabling.perform()
            with self._turn:
                if not self._ending:
                    self._ask()
        self._enabling.perform()  # the last reset may have been cancelled in the meantime

    def _ask(self) -> None:
        """Poll the device: pass on requests, then read its state."""
        found = Measured(self._dof)
        for name in self.capabilities.measured:
            getattr(found, name)[:] = np.nan  # so that values that the device leaves unset are detected
        done_s = self._said.done_s
        result: Accepted | Rejected = ACCEPTED
        try:
            self._pass_on()
            self.device.state(found)
            if self._motion is not None and self._loaded == self._motion.number:
                done_s = self._motion.done_s(self.device.progress())
        except BackendError as exc:
            result = Rejected(plain_text(exc))
        except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
            result = Rejected(plain_error(exc))
        self._ask_status()
        if result is ACCEPTED:
            self._find_velocity(found)
            result = self._check_movement(found, done_s)
        now_s = time.monotonic()
        self._said = PollAnswer(found.values.copy(), self._loaded, done_s, self._halted, result, now_s)

    def _ask_status(self) -> None:
        if self._io is not None:
            self._io.ask()
        if isinstance(self.device, Reporting):
            try:
                self._status = self.device.status()
            except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
                self._status = DeviceStatus(text=plain_text(exc))

    def _pass_on(self) -> None:
        motion = self._motion
        if self._halting:
            self._halted = self._number  # from now on, use the measured position, not the path
            self.device.stop()
            self._halting = False
        elif motion is not None and motion.number not in (self._halted, self._loaded):
            self._loaded, self._same = motion.number, 0
            try:
                self.device.load(*motion.points(self._point_period_s))
                self.device.start()
            except BaseException as exc:
                self._loading = Rejected(f"the device rejects the motion: {plain_text(exc)}")
                raise BackendError(self._loading.reason) from exc

    def _find_velocity(self, found: Measured) -> None:
        """Calculate the velocity if the device does not measure it. An unchanged position does not mean that
        the arm is at rest, because some devices update their values less often than they are polled.
        """
        before = self._said
        if (
            "velocity" in self.capabilities.measured
            or not before.values.size
            or before.result is not ACCEPTED
        ):
            return
        moved = found.position - before.values.reshape(-1)[: self._dof]
        if moved.any() or self._repeats >= MAX_REPEATS:
            self._velocity = moved / (self._state_period_s * (self._repeats + 1))
            self._repeats = 0
        else:
            self._repeats += 1
        found.velocity[:] = self._velocity

    def _check_movement(self, found: Measured, done_s: float) -> Accepted | Rejected:
        """Check that the measured values are plausible: they must change while the device executes a
        motion.
        """
        motion, before = self._motion, self._said
        if not (before.values.size and np.array_equal(found.values, before.values)):
            self._same = 0
        elif self._same < FROZEN_ASKED and motion is not None and motion.number != self._halted:
            there = motion.position(done_s)
            if np.abs(there - self._same_at).max() > FROZEN_RAD:
                self._same += 1
                self._same_at = there
        if self._same >= FROZEN_ASKED:
            return Rejected("the device repeats the same measured values although it is moving")
        return ACCEPTED
