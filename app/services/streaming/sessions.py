"""Streaming sessions of remote clients. Only one is open at a time, and it holds the claim on the arm."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable, Iterator

import numpy as np

from app.services.clients import CLIENT
from app.services.motion.execution import STATE_TIMEOUT_S, MotionService
from app.services.rights.claims import Caller, Claim
from app.services.rights.ownership import BY_STOP, Ownership
from app.services.state.link import POLL_S, RobotLink
from cobot import audit, logs
from cobot.clock import Clock
from cobot.config import StreamingSection
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
    TornReadError,
    UnavailableError,
)
from cobot.ipc.first_target import FirstTarget
from cobot.ipc.layout import Stream, setpoint_dtype, text
from cobot.ipc.session_rules import check_chunk, check_session, check_setpoint
from cobot.ipc.stream_writer import StreamWriter
from cobot.reasons import Reason
from cobot.types import RESTING, LoopMode

MAX_CONNECTIONS = 32
SHOWN_CYCLES = 2
"""Number of cycles within which the state must show an accepted session, unless it has already ended."""

log = logging.getLogger("cobot.streams")


class StreamSession:
    """One session, from its acceptance by rtloop until the arm is at rest.

    Attributes:
        number, stream: number and kind of the session in rtloop.
        name: the client's displayed name.
        setpoint: the newest accepted setpoint.
        refused: number of frames that arrived out of order.
        over: reason why the arm no longer follows targets; "" while it follows them.
        ended: future that is done when the arm is at rest. Its result is the reason why the session ended.
        tell: function that is called once with a message if the first target is too far from the arm.
    """

    def __init__(
        self, number: int, stream: Stream, name: str, dof: int, writer: StreamWriter, first: FirstTarget
    ) -> None:
        self.number = number
        self.stream = stream
        self.name = name
        self.setpoint = np.zeros((), setpoint_dtype(dof))
        self.refused = 0
        self.over = ""
        self.ended: asyncio.Future[Reason] = asyncio.get_running_loop().create_future()
        self.tell: Callable[[str], None] = lambda words: None
        self._sequence = 0
        self._writer = writer
        self._first = first

    def take_setpoint(self, sequence: int, setpoint: np.ndarray) -> None:
        """Make the arm follow this setpoint.

        Args:
            sequence: number of the client's frame, which must increase.
            setpoint: record of `cobot.ipc.layout.setpoint_dtype`.

        Raises:
            InputError: the setpoint is invalid. Nothing has changed.
            MotionStopped: the session is over; the error gives the reason.
        """
        self._require_next(sequence)
        check_setpoint(setpoint, self.stream)
        setpoint["session"] = self.number
        self._sequence = sequence
        self.setpoint = setpoint
        self._writer.setpoint(setpoint)
        self._first.note(setpoint)

    def report_refusal(self, state: np.ndarray) -> None:
        """If the state shows that the session's first target was rejected, inform the client. `state` is a
        record of `cobot.ipc.state_fields.state_dtype`.
        """
        refusal = self._first.refusal(self.number, state)
        if refusal:
            log.warning("session %d: %s", self.number, refusal)
            self.tell(refusal)

    def take_chunk(self, sequence: int, chunk: np.ndarray) -> None:
        """Like `take_setpoint`, with a record of `cobot.ipc.layout.chunk_dtype`."""
        self._require_next(sequence)
        check_chunk(chunk, self.stream)
        chunk["session"] = self.number
        self._sequence = sequence
        self._writer.chunk(chunk)

    def estop(self) -> None:
        """Latch an e-stop, which stops the arm."""
        if self.ended.done():
            raise ConflictError(
                "the session has ended, and only the streaming client may request an e-stop here; use "
                "POST /stop"
            )
        self._writer.estop()

    def end(self, reason: str = "the client has ended the session") -> None:
        """End the session, which stops the arm. `ended` is done when the arm is at rest. Does nothing if the
        session is over.
        """
        if not self.ended.done():
            self.over = self.over or reason
            self._writer.end()

    def finish(self, reason: str) -> None:
        """End a servo session after the points that are already waiting, but within a second."""
        if not self.ended.done():
            self.over = self.over or reason
            self._writer.finish()

    def _require_next(self, sequence: int) -> None:
        if self.over:
            raise MotionStopped(f"the session is over: {self.over}")
        if sequence <= self._sequence:
            self.refused += 1
            raise InputError(f"sequence must increase: {sequence} comes after {self._sequence}")


class StreamService:
    """Starts sessions and monitors each one until it ends, even if its client dies.

    Attributes:
        session: the current session; None while no session is running.
    """

    def __init__(
        self, link: RobotLink, ownership: Ownership, motion: MotionService, section: StreamingSection
    ) -> None:
        self._link = link
        self._ownership = ownership
        self._motion = motion
        self._writer = StreamWriter(link.memory)
        self._tasks: set[asyncio.Task[None]] = set()
        self._connections = 0
        self.section = section
        self.session: StreamSession | None = None
        self._info_sequence = 0
        self._info = np.zeros((), link.memory.info.data.dtype)

    @property
    def info(self) -> np.ndarray:
        """The last robot description from rtloop. The flange-to-TCP transform in it changes with the tool.

        It consists of zeros until rtloop has written a description, which may take until after the service
        has started.
        """
        block = self._link.memory.info
        if (sequence := block.sequence) != self._info_sequence:
            with contextlib.suppress(TornReadError):  # The next call will find the description.
                self._info, self._info_sequence = block.read().copy(), sequence
        return self._info

    @property
    def robot(self) -> str:
        return self._link.memory.robot

    @property
    def clock(self) -> Clock:
        return self._link.clock

    @property
    def period_s(self) -> float:
        return self._link.memory.period_s

    @contextlib.contextmanager
    def connection(self) -> Iterator[None]:
        """Count a connection while the context is open. Raises UnavailableError if there are too many
        connections.
        """
        if self._connections >= MAX_CONNECTIONS:
            raise UnavailableError(
                f"{MAX_CONNECTIONS} streaming connections are already open, which is the maximum"
            )
        self._connections += 1
        try:
            yield
        finally:
            self._connections -= 1

    def require_control(self) -> None:
        """See `Ownership.require_control`."""
        self._ownership.require_control()

    def state_since(self, publication: int) -> tuple[int, np.ndarray | None]:
        """See `RobotLink.record_since`."""
        return self._link.record_since(publication)

    async def open(
        self,
        request: np.ndarray,
        name: str,
        timeout_s: float,
        stops: int | None = None,
        caller: Caller | None = None,
    ) -> StreamSession:
        """Begin a session.

        Args:
            request: record of `cobot.ipc.layout.session_dtype`.
            name: the client's displayed name.
            timeout_s: timeout for rtloop's answer, s.
            stops: `RobotLink.stops` at the time of the request; None for its current value.
            caller: the caller, for a session that is a job.

        Raises:
            InputError: the request is invalid.
            ConflictError: another client is moving the arm or streaming. The error names it.
            NotReadyError: the mode is ESTOP or FAULT.
            ExecutionError: rtloop rejects the session; the error gives the reason.
            UnavailableError: rtloop does not answer.
        """
        check_session(request, self.info)
        last = self.session
        if last is not None and self._link.state().session != last.number:
            await asyncio.shield(
                last.ended
            )  # in rtloop the session has ended, and the client knows before the service does
        caller = caller or Caller(name, None, self._ownership.stops, math.inf, asyncio.Event())
        with contextlib.ExitStack() as stack:
            claim = stack.enter_context(await self._ownership.claim_motion(caller))
            await self._motion.require_ready()
            number = self._writer.begin(request, claim.stops if stops is None else stops)
            stack.callback(self._writer.release)
            with contextlib.ExitStack() as undo:
                undo.callback(self._writer.end)
                await self._begin(number, timeout_s)
                undo.pop_all()
            claim.accept()
            stream = Stream(int(request["stream"]))
            first = FirstTarget(
                stream, [text(each) for each in self.info["joint_names"]], self._link.state().record
            )
            session = StreamSession(number, stream, name, self._link.memory.dof, self._writer, first)
            # From here on, the task that follows the session to its end owns the claim and the blocks.
            with logs.add_ids(session=number):
                task = asyncio.create_task(self._follow(session, claim, stack.pop_all()))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        self.session = session
        with logs.add_ids(session=number):
            log.info("%ssession %d: %s", self._link.label, number, name)
        audit.note("session opened", session=number, mode=session.stream.name, client=name)
        return session

    def estop(self, session: StreamSession) -> None:
        """Latch an e-stop on behalf of the streaming client. This stops the arm."""
        session.estop()
        self._link.events.publish("estop", what="asked for", by=str(CLIENT.get()), session=session.number)

    def lose(self, session: StreamSession) -> None:
        """End a session whose client has lost its connection. The arm stops after the usual timeout for
        targets.
        """
        asyncio.get_running_loop().call_later(
            self.section.command_timeout_s, session.end, "the connection to the client was lost"
        )

    def close(self) -> None:
        """Abandon the current session. rtloop ends it when this process ends."""
        for task in self._tasks:
            task.cancel()

    async def _begin(self, number: int, timeout_s: float) -> None:
        """Wait until rtloop has accepted the session and a state shows that it has begun or already ended."""
        deadline_s = self._link.clock.now_s() + timeout_s
        agreed_cycle: int | None = None
        while True:
            answer, state = self._writer.answer(number), self._link.state()
            if answer:
                raise ExecutionError(answer)
            if answer is not None:
                agreed_cycle = state.cycle if agreed_cycle is None else agreed_cycle
                if state.session == number or state.cycle > agreed_cycle + SHOWN_CYCLES:
                    return
            if self._link.clock.now_s() > deadline_s:
                raise UnavailableError(f"rtloop has not answered for {timeout_s:g} s")
            await asyncio.sleep(POLL_S / 2)

    async def _follow(self, session: StreamSession, claim: Claim, belongings: contextlib.ExitStack) -> None:
        reason = "the service is shutting down"
        try:
            with belongings:
                reason = await self._end(session, claim)
        finally:
            self.session = None
            session.over = session.over or reason
            session.ended.set_result(Reason.of_text(reason))
            log.info("%ssession %d has ended: %s", self._link.label, session.number, reason)
            audit.note("session ended", session=session.number, reason=reason)

    async def _end(self, session: StreamSession, claim: Claim) -> str:
        """Wait for the session to end, and return the reason."""
        while True:
            try:
                state = await self._link.await_fresh_state(STATE_TIMEOUT_S)
            except CobotError as exc:
                session.end()  # rtloop must not continue a session that has no client
                return str(exc)
            session.report_refusal(state.record)
            cause = claim.interruption
            if cause is not None and str(cause) != BY_STOP:  # for this case, rtloop has its own message
                code, by = cause.details.get("cause", ""), cause.details.get("by", "")
                session.over = session.over or Reason(str(cause), code, (by,) if by else ())
            if state.session != session.number:
                return session.over or state.reason
            if state.mode in (LoopMode.STOPPING, *RESTING) and not session.over:
                session.over = state.reason
            await asyncio.sleep(POLL_S)
