"""A simulated controller and a backend in one process, stepped period by period without a network."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cobot.config import Settings
from cobot.robot.srdf import load_named_positions
from cobot.types import Array, JointLimits
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.lockstep import EVERY, LockStepRig
from rtloop.backends.ur import dashboard, enabling, robot_api, rtde
from rtloop.backends.ur.backend import UrBackend
from rtloop.backends.ur.checks import CB3_PERIOD_S
from rtloop.backends.ur.fields import SafetyMode
from rtloop.backends.ur.program import decode_position, decode_torque
from rtloop.backends.ur.simulator.controller import UrController
from rtloop.backends.ur.simulator.dashboard_session import DashboardSession
from rtloop.backends.ur.simulator.network import DataNetwork
from rtloop.backends.ur.simulator.options import UrControllerOptions
from rtloop.backends.ur.simulator.primary_session import PrimarySession
from rtloop.backends.ur.simulator.robot_api_session import RobotApiSession
from rtloop.backends.ur.simulator.rtde_session import RtdeSession
from rtloop.backends.ur.simulator.session import UrSession
from rtloop.backends.ur.transport import ByteListener, ByteStream
from rtloop.contract import FAULTS

SLIDER = 0.99
"""Speed slider at the start. It is below 1 so that the contract can raise it by one per cent."""
HERE = "127.0.0.1"
TORQUE_SOFTWARE = (5, 25, 1, 0)
"""Version of the simulated controller's software for a backend with the option `torque`."""
MESSAGE_BYTES = 32


class _Pipe:
    """One end of a connection within this process. Data is kept while the cable is disconnected, unless the
    sender gives up the connection.
    """

    def __init__(self, lock_step: UrLockStep) -> None:
        self._lock_step = lock_step
        self.received = bytearray()
        self.other: _Pipe | None = None
        self.is_closed = False
        self.sent: list[bytes] | None = None

    @property
    def local(self) -> str:
        return HERE

    def is_connected(self) -> bool:
        return not self._lock_step.off

    def receive(self) -> bytes:
        if self._lock_step.off:
            return b""
        data = bytes(self.received)
        self.received.clear()
        if not data and self.other is not None and self.other.is_closed:
            raise ConnectionResetError("the other end has closed the connection")
        return data

    def send(self, data: bytes) -> None:
        if self.is_closed or self.other is None or self.other.is_closed:
            raise ConnectionResetError("the other end has closed the connection")
        if self.sent is not None:
            self.sent.append(data)
        self.other.received += data

    def close(self) -> None:
        self.is_closed = True

    def abort(self) -> None:
        if self._lock_step.off and self.other is not None:
            self.other.received.clear()
        self.close()


def _pipe(lock_step: UrLockStep) -> tuple[_Pipe, _Pipe]:
    here, there = _Pipe(lock_step), _Pipe(lock_step)
    here.other, there.other = there, here
    return here, there


class _Listener:
    def __init__(self, port: int, lock_step: UrLockStep) -> None:
        self.port, self._lock_step = port, lock_step
        self.waiting: list[_Pipe] = []
        self.is_closed = False

    def accept(self) -> ByteStream | None:
        return self.waiting.pop(0) if self.waiting and not self._lock_step.off else None

    def close(self) -> None:
        self.is_closed = True


class UrLockStep:
    """The `UrTransport` for the backend. Each wait runs the controller's next control periods.

    Attributes:
        controller: the simulated controller.
        network: network of the data packages.
        off: whether the cable is disconnected.
        busy: whether every `EVERY`-th wait finds two packages instead of one, as on a busy computer.
        positions: joint positions that were sent to the program.
        torques: joint torques that were sent to the program.
    """

    def __init__(
        self, make: Callable[[UrLockStep], UrController], network: DataNetwork | None = None
    ) -> None:
        self.network = network or DataNetwork()
        self.off = self.busy = False
        self._waits = 0
        self._listener: _Listener | None = None
        self._sessions: list[tuple[UrSession, _Pipe]] = []
        self._messages: list[bytes] = []
        self.controller = make(self)
        self.inner = _ProgramSide(self)

    @property
    def positions(self) -> list[Array]:
        joints = map(decode_position, self._messages)
        return [np.array(each) for each in joints if each is not None]

    @property
    def torques(self) -> list[Array]:
        torques = map(decode_torque, self._messages)
        return [np.array(each) for each in torques if each is not None]

    def clock(self) -> float:
        return self.controller.time_s

    def connect(self, host: str, port: int) -> ByteStream:
        sessions: dict[int, Callable[[], UrSession]] = {
            rtde.PORT: lambda: RtdeSession(self.controller, self.network),
            enabling.PRIMARY_PORT: lambda: PrimarySession(self.controller),
        }
        if self.controller.options.series == "x":
            sessions[robot_api.PORT] = lambda: RobotApiSession(self.controller)
        else:
            sessions[dashboard.PORT] = lambda: DashboardSession(self.controller)
        if port not in sessions:
            raise ConnectionRefusedError(f"nothing listens at port {port}")
        here, there = _pipe(self)
        self._sessions.append((sessions[port](), there))
        return here

    def listen(self, port: int) -> ByteListener:
        self._listener = _Listener(port, self)
        return self._listener

    def call_back(self) -> ByteStream:
        """Connect a program on the controller to the backend."""
        if self._listener is None or self._listener.is_closed:
            raise ConnectionRefusedError("nothing listens there")
        here, there = _pipe(self)
        there.sent = None
        here.sent = self._messages
        self._listener.waiting.append(here)
        return there

    def forget_clients(self) -> None:
        """End all connections, as if the backend's process had been killed."""
        for session, pipe in self._sessions:
            session.close()
            pipe.close()
        self._sessions = []
        if self._listener is not None:
            self._listener.close()

    def wait(self, streams: Sequence[ByteStream], timeout_s: float) -> None:
        until_s = self.clock() + timeout_s - 1e-9
        self._waits += 1
        pause = 1 if self.busy and self._waits % EVERY == 0 else 0
        while True:
            self.pass_period()
            ready = not self.off and any(isinstance(each, _Pipe) and each.received for each in streams)
            if pause and ready:
                pause -= 1
                continue
            if ready or self.clock() >= until_s:
                return

    def pass_period(self) -> None:
        """Run one control period of the controller."""
        for session, pipe in list(self._sessions):
            try:
                session.feed(pipe.receive())
            except OSError:
                session.close()
                pipe.close()
                self._sessions.remove((session, pipe))
        self.controller.advance()
        for session, pipe in list(self._sessions):
            session.tick()
            if session.out:
                data = bytes(session.out)
                session.out.clear()
                try:
                    pipe.send(data)
                except OSError:
                    continue
            if session.is_over:
                pipe.close()


class _ProgramSide:
    """The `UrTransport` for programs on the controller."""

    def __init__(self, lock_step: UrLockStep) -> None:
        self._lock_step = lock_step

    def clock(self) -> float:
        return self._lock_step.clock()

    def connect(self, host: str, port: int) -> ByteStream:
        return self._lock_step.call_back()

    def listen(self, port: int) -> ByteListener:
        raise OSError("a program on the simulated controller cannot listen on a port")

    def wait(self, streams: Sequence[ByteStream], timeout_s: float) -> None:
        """No-op: programs wait for their period."""


class _Later:
    """A `UrTransport` that forwards to a lock step. The controller can use it before the lock step is
    complete.
    """

    def __init__(self, lock_step: UrLockStep) -> None:
        self._lock_step = lock_step

    def clock(self) -> float:
        return self._lock_step.inner.clock()

    def connect(self, host: str, port: int) -> ByteStream:
        return self._lock_step.inner.connect(host, port)

    def listen(self, port: int) -> ByteListener:
        return self._lock_step.inner.listen(port)

    def wait(self, streams: Sequence[ByteStream], timeout_s: float) -> None:
        """No-op: programs wait for their period."""


def joined(settings: Settings, limits: JointLimits, options: UrControllerOptions | None = None) -> UrLockStep:
    """Create a controller with the arm in the settings, and a connection to it."""
    names = settings.robot
    start = load_named_positions(names.srdf, limits.names, names.group)[names.start_position].joints
    arm = ControllerArm(settings, limits, np.array(start))
    made = options or UrControllerOptions(slider=SLIDER)
    return UrLockStep(lambda lock_step: UrController(arm, made, _Later(lock_step)))


class UrRig(LockStepRig[UrLockStep]):
    """A `ContractRig` with the `ur` backend and a simulated controller. It cannot simulate a change of the
    operation mode, which RTDE does not report.
    """

    faults = frozenset(FAULTS) - {"operation_mode"}

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        series = "cb3" if settings.rt.period_s == CB3_PERIOD_S else "e"
        backend = settings.robot.backend
        options = {"address": HERE, **(backend.options or {})}
        backend = backend.model_copy(update={"options": options})
        robot = settings.robot.model_copy(update={"backend": backend})
        self.settings, self._limits = settings.model_copy(update={"robot": robot}), limits
        software = TORQUE_SOFTWARE if options.get("torque") else None
        made = UrControllerOptions(series=series, slider=SLIDER, software=software)
        self._channel = joined(settings, limits, made)

    @property
    def wire(self) -> list[Array]:
        """Return the positions that were sent."""
        return self._channel.positions

    def backend(self) -> UrBackend:
        self._channel.forget_clients()
        return UrBackend(self.settings, self._limits, transport=self._channel)

    def _set_controller(self, fault: str, *, active: bool) -> None:
        controller = self._channel.controller
        if fault == "e_stop":
            mode = SafetyMode.ROBOT_EMERGENCY_STOP if active else SafetyMode.NORMAL
            controller.set_safety(mode, f"its button is {'pressed' if active else 'released'}")
        else:
            controller.blocked = "Cannot unlock protective stop until 5s after occurrence." if active else ""
            if active:
                controller.set_safety(SafetyMode.PROTECTIVE_STOP, "by the contract")
