"""Makes the arm ready for commands: switches on the power, releases the brakes, and starts cobot's program on
the controller.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator, Mapping
from functools import partial
from typing import Any

from rtloop.backends import BackendError
from rtloop.backends.ur.dashboard import Dashboard
from rtloop.backends.ur.fields import RuntimeState, UrRobotMode
from rtloop.backends.ur.options import UrOptions
from rtloop.backends.ur.program import MotionProgram
from rtloop.backends.ur.robot_api import MIN_VERSION, RobotApi
from rtloop.backends.ur.transport import ByteStream, UrTransport
from rtloop.backends.ur.words import LOCAL, SWITCH_ON, UNLOCKABLE, hindrance, mode_in_words

PRIMARY_PORT = 30001
POLYSCOPE_X = (10,)
"""First software version of PolyScope X, which has no dashboard server."""
SAFETY_S = 2.0
"""Timeout for a safety mode to end after its cause has been reset, s."""
MIN_REMOTE = (5, 6)
"""First software version whose dashboard server reports remote control."""
_ROBOT_MESSAGE, _ERROR_CODE, _KEY, _EXCEPTION = 20, 6, 7, 10
State = Callable[[], Mapping[str, Any]]


class Enabling:
    """Performs the steps that make the arm ready. Packets are read and answered between the steps."""

    def __init__(
        self, transport: UrTransport, options: UrOptions, program: MotionProgram, period_s: float
    ) -> None:
        self._transport, self._options, self._program = transport, options, program
        self._period_s = period_s
        self._operator: Dashboard | RobotApi | None = None
        self._primary: ByteStream | None = None
        self._heard = b""
        self._answer, self._in_time = "", False

    def steps(
        self, state: State, version: tuple[int, ...], local: Callable[[], str]
    ) -> Generator[None, None, None]:
        """
        Args:
            state: the newest RTDE data.
            version: version of the controller's software.
            local: address of this computer on the connection.

        Raises:
            BackendError: the arm cannot be made ready; the error gives the reason.
        """
        try:
            self._operator = self._operator_of(version)
            yield from self._require_remote(version)
            yield from self._become_safe(state)
            yield from self._switch_on(state)
            yield from self._end_programs(state)
            yield from self._run_program(state, local)
        finally:
            self.close()

    def _operator_of(self, version: tuple[int, ...]) -> Dashboard | RobotApi | None:
        """Return the interface that switches the arm on with this version; None if a person does so."""
        options = self._options
        if not options.dashboard or POLYSCOPE_X <= version[:2] < MIN_VERSION:
            return None
        if version < POLYSCOPE_X:
            return Dashboard(self._transport, options.address)
        return RobotApi(self._transport, options.address, options.robot_api_port)

    def close(self) -> None:
        if self._operator is not None:
            self._operator.close()
        if self._primary is not None:
            self._primary.close()
        self._primary = None

    def _ask(self, request: str) -> Generator[None, None, None]:
        assert self._operator is not None
        self._answer = ""
        self._operator.ask(request)
        while (answer := self._operator.poll()) is None:
            yield
        self._answer = answer

    def _until(self, happened: Callable[[], bool], timeout_s: float) -> Generator[None, None, None]:
        """Wait until `happened` returns true or the timeout has passed. `self._in_time` then states which."""
        until_s = self._transport.clock() + timeout_s
        while not happened() and self._transport.clock() < until_s:
            yield
        self._in_time = happened()

    def _require_remote(self, version: tuple[int, ...]) -> Generator[None, None, None]:
        if self._operator is None or version[:2] < MIN_REMOTE:
            return
        yield from self._ask("is in remote control")
        if self._answer.lower() == "false":
            raise BackendError(LOCAL)

    def _become_safe(self, state: State) -> Generator[None, None, None]:
        if state()["safety_mode"] == UNLOCKABLE and self._operator is not None:
            yield from self._ask("close safety popup")
            yield from self._ask("unlock protective stop")
            if "releasing" not in self._answer.lower():
                raise BackendError(
                    f"{hindrance(UNLOCKABLE)}. The controller does not unlock it: {self._answer}"
                )
        yield from self._until(lambda: not _hindered(state()), SAFETY_S)
        if reason := _hindered(state()):
            raise BackendError(reason)

    def _switch_on(self, state: State) -> Generator[None, None, None]:
        for modes, request, goal in (
            ((UrRobotMode.POWER_OFF,), "power on", (UrRobotMode.IDLE, UrRobotMode.RUNNING)),
            ((UrRobotMode.POWER_ON,), "", (UrRobotMode.IDLE, UrRobotMode.RUNNING)),
            ((UrRobotMode.IDLE,), "brake release", (UrRobotMode.RUNNING,)),
        ):
            mode = state()["robot_mode"]
            if mode not in modes:
                continue
            if self._operator is None:
                raise BackendError(SWITCH_ON[mode])
            if request:
                yield from self._ask(request)
            answer = self._answer
            yield from self._until(partial(_has_mode, state, goal), self._options.enable_s)
            if reason := _hindered(state()):
                raise BackendError(reason)
            if not self._in_time:
                raise BackendError(
                    f"{request or 'starting'} has not finished within {self._options.enable_s:g} s (the "
                    f"controller "
                    f"answered {answer!r}); the robot mode is: {mode_in_words(state()['robot_mode'])}"
                )
        mode = state()["robot_mode"]
        if mode != UrRobotMode.RUNNING:
            raise BackendError(SWITCH_ON.get(mode) or f"the robot mode is: {mode_in_words(mode)}")

    def _end_programs(self, state: State) -> Generator[None, None, None]:
        """Wait until no program is running. A cobot program that is still running is ended; any other is an
        error.
        """

        def stopped() -> bool:
            return bool(state()["runtime_state"] == RuntimeState.STOPPED)

        if not stopped() and self._program.started and self._operator is not None:
            yield from self._ask("stop")
        yield from self._until(stopped, SAFETY_S)
        if not self._in_time and not self._program.started:
            runtime = RuntimeState(state()["runtime_state"]).name.lower()
            raise BackendError(
                f"another program is {runtime} on the controller: stop it at the teach pendant"
            )

    def _run_program(self, state: State, local: Callable[[], str]) -> Generator[None, None, None]:
        """Upload the program and wait for its connection."""
        self._program.open()
        text = self._program.text(local(), self._period_s)
        self._heard = b""
        where = f"port {PRIMARY_PORT} of {self._options.address}"
        try:
            self._primary = self._transport.connect(self._options.address, PRIMARY_PORT)
            until_s = self._transport.clock() + self._options.connect_s
            while not self._primary.is_connected():
                if self._transport.clock() > until_s:
                    raise TimeoutError(f"no connection within {self._options.connect_s:g} s")
                yield
            self._primary.send(text.encode())
        except OSError as exc:
            raise BackendError(
                f"the program cannot be sent to {where}: {exc.strerror or exc}; is the primary interface "
                "switched off (Settings, Security, Services)?"
            ) from exc
        yield from self._until(self._is_running, self._options.enable_s)
        if self._in_time:
            yield from self._until(
                lambda: state()["runtime_state"] == RuntimeState.PLAYING, self._options.enable_s
            )
        if not self._in_time:
            if reason := _hindered(state()):
                raise BackendError(reason)
            raise BackendError(
                f"cobot's program was sent to {where}, but does not connect to {self._program.place} within "
                f"{self._options.enable_s:g} s{self._said}. Either the controller rejects it (is it in "
                "Remote Control?), or it cannot reach this computer (firewall, robot.backend.callback)"
            )

    def _is_running(self) -> bool:
        if self._primary is not None:
            try:
                self._heard = (self._heard + self._primary.receive())[-65_536:]
            except OSError:
                self._primary.close()
                self._primary = None
        if said := self._said:
            self._program.drop()
            raise BackendError(f"the controller rejects cobot's program{said}")
        return self._program.is_connected

    @property
    def _said(self) -> str:
        """Return the controller's error messages since the upload."""
        return "".join(f"; it reports: {each}" for each in error_messages(self._heard))


def _has_mode(state: State, modes: tuple[UrRobotMode, ...]) -> bool:
    return state()["robot_mode"] in modes


def _hindered(state: Mapping[str, Any]) -> str:
    return hindrance(state.get("safety_status", state["safety_mode"]))


def error_messages(stream: bytes) -> list[str]:
    """Return the last errors in the data from the primary interface: compiler errors, errors of a running
    program, and error codes.
    """
    found, begin = [], 0
    while len(stream) - begin >= 5:
        length, kind = struct.unpack_from(">iB", stream, begin)
        if length < 5 or begin + length > len(stream):
            break
        package = stream[begin : begin + length]
        begin += length
        if kind != _ROBOT_MESSAGE or length < 15:
            continue
        message, rest = package[14], package[15:]
        if message == _EXCEPTION and len(rest) > 8:
            line, column = struct.unpack_from(">ii", rest)
            found.append(f"line {line}, column {column}: {_text(rest[8:])}")
        elif message == _ERROR_CODE and len(rest) > 20 and rest[8:12] >= b"\0\0\0\2":
            code, argument = struct.unpack_from(">ii", rest)
            found.append(f"C{code}A{argument} {_text(rest[20:])}")
    return found[-3:]


def _text(raw: bytes) -> str:
    return "".join(c if c.isprintable() else " " for c in raw.decode(errors="replace"))[:200].strip()
