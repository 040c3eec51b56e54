"""POST /stop: stops the arm before anything else, whatever state the rest of the service is in."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from app.services.clients import CLIENT
from app.services.rights.ownership import BY_COMMAND, BY_STOP, COMMAND, Ownership
from app.services.rights.stop_reason import StopReason
from app.services.state.link import POLL_S, RobotLink
from app.services.state.robot_state import RobotState
from cobot.config import MIN_STOP_S
from cobot.errors import CobotError, ExecutionError, UnavailableError
from cobot.logs import log_context
from cobot.types import RESTING, LoopMode

END_TIMEOUT_S = 2.0
"""Timeout for the task of a stopped motion to end after the arm has stopped, s."""
MOTION_STOP_S = 5.0
"""Timeout for stopping a single motion, s. Stopping takes at most 2.5 s."""
LATCHED = (LoopMode.ESTOP, LoopMode.FAULT)
DRIVES_S = 3.0
"""Timeout for the drives to be switched off once the arm is at rest, s. rtloop allows 2 s for the arm to
settle.
"""
HELD, FAST = 2, 1
"""Stop categories of IEC 60204-1 that `POST /stop` accepts."""
StopPrograms = Callable[[StopReason], Awaitable[str | None]]
"""Type of a function that ends the running sequence or program, with a reason. It returns a description of
the ended one, or None.
"""
UNMEASURED_S = 0.25
"""Maximum age of a measurement, s. If it is older, it is unknown whether the arm is at rest."""


@dataclass(frozen=True, slots=True)
class Stopped:
    """The result of a stop.

    Attributes:
        success: whether everything has ended and the arm is known to be at rest.
        stopped: description of the request that was ended.
        position: measured joint positions, rad; None if rtloop does not answer.
        category: stop category of IEC 60204-1 that was carried out. Category 2 means that the drives hold the
            arm, category 1 that the drives are off.
        confirmed: whether the device itself reports that the arm is at rest. If false, only cobot has
            determined it.
    """

    success: bool
    message: str
    stopped: list[str]
    position: list[float] | None
    at_rest: bool
    duration_s: float
    category: int = HELD
    confirmed: bool = False

    @property
    def confirmed_by(self) -> str | None:
        """The source of the confirmation that the arm is at rest: the device itself or cobot; None if neither
        confirms it.
        """
        if not self.at_rest:
            return None
        return "device" if self.confirmed else "cobot"


def together(stops: dict[str, Stopped]) -> Stopped:
    """Combine the results for several robots, with the position of the first robot. The result for a single
    robot is returned unchanged.
    """
    first = next(iter(stops.values()))
    if len(stops) == 1:
        return first
    return Stopped(
        all(each.success for each in stops.values()),
        "; ".join(f"{name}: {each.message}" for name, each in stops.items()),
        [f"{name}: {item}" for name, each in stops.items() for item in each.stopped],
        first.position,
        all(each.at_rest for each in stops.values()),
        max(each.duration_s for each in stops.values()),
        max(each.category for each in stops.values()),
        all(each.confirmed for each in stops.values()),
    )


class StopService:
    """Stops the arm, without a lock, a queue or control."""

    def __init__(self, link: RobotLink, ownership: Ownership, stop_programs: StopPrograms) -> None:
        self._link = link
        self._ownership = ownership
        self._stop_programs = stop_programs
        self._following: set[asyncio.Task[Stopped]] = set()

    def follow(self) -> None:
        """After a stop from outside this service, end all requests that would move the arm again."""
        task = asyncio.create_task(self.stop(MIN_STOP_S, StopReason(BY_COMMAND, by=COMMAND)))
        self._following.add(task)
        task.add_done_callback(self._following.discard)

    async def stop(self, timeout_s: float, reason: StopReason | None = None, category: int = HELD) -> Stopped:
        """End the sequence, the planning and the motion. Never raises. The result states what could not be
        confirmed.

        Args:
            reason: the reason that is reported to the client whose motion is stopped; None if a client has
                requested the stop.
            category: `HELD` or `FAST`.
        """
        begun_s = self._link.clock.now_s()
        self._link.request_stop(fast=category == FAST)
        reason = reason or StopReason(BY_STOP)
        self._publish(reason, category=category)
        orphan = self._unclaimed_motion()
        claim = self._ownership.stop(reason)
        motion = str(claim) if claim else None
        problems: list[str] = []
        sequence, state = await asyncio.gather(
            self._stop_programs(reason), self._rest(timeout_s - 0.5, problems)
        )
        stopped = [item for item in (sequence, motion or orphan) if item]
        at_rest = state is not None and _idle(state) and state.settled
        if at_rest and claim is not None:  # so that the client that stopped the arm can move it next
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(claim.ended.wait(), END_TIMEOUT_S)
        carried_out, confirmed = await self._confirm_category(category, begun_s + timeout_s - 0.5, problems)
        told = "stopped" if at_rest else "requested to stop:"
        done = f"{told} {' and '.join(stopped)}" if stopped else "nothing was running"
        where = "the arm is at rest" if at_rest else "the arm is NOT known to be at rest"
        return Stopped(
            at_rest,
            "; ".join([done, where, *problems]),
            stopped,
            None if state is None else state.position.tolist(),
            at_rest,
            self._link.clock.now_s() - begun_s,
            carried_out,
            at_rest and confirmed,
        )

    async def _confirm_category(self, category: int, until_s: float, problems: list[str]) -> tuple[int, bool]:
        """Wait for the drives to be switched off. Returns the stop category, and whether the device reports
        it.
        """
        until_s = min(until_s, self._link.clock.now_s() + DRIVES_S)
        while True:
            named = self._link.device()
            if named is None:
                return HELD, False
            backend, device = named
            stops = device.capabilities.stops
            if category == HELD:
                return HELD, stops.get(HELD, False)
            if device.drives_off:
                return FAST, stops.get(FAST, False)
            if FAST not in stops:
                problems.append(f"the drives hold the arm: the backend {backend} has no stop category 1")
                return HELD, stops.get(HELD, False)
            if self._link.clock.now_s() >= until_s:
                problems.append(f"the drives are NOT known to be off: {self._reason()}")
                return HELD, False
            await asyncio.sleep(POLL_S)

    def _reason(self) -> str:
        try:
            return self._link.state().reason
        except UnavailableError as exc:
            return str(exc)

    async def stop_motion(self, reason: StopReason, timeout_s: float = MOTION_STOP_S) -> None:
        """End the current motion, regardless of its client. Returns when the arm is at rest.

        Nothing else ends. A sequence continues after the stopped motion.

        Args:
            reason: the reason that is reported to the client whose motion is stopped.

        Raises:
            ExecutionError: the arm is not known to be at rest; the error gives the reason.
        """
        claim = self._ownership.interrupt(reason.error)
        if claim is None and self._unclaimed_motion() is None:
            return
        self._link.request_stop()
        self._publish(reason)
        problems: list[str] = []
        await self._rest(timeout_s, problems)
        if problems:
            raise ExecutionError("; ".join(problems))
        if claim is not None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(claim.ended.wait(), END_TIMEOUT_S)

    async def reset(self, timeout_s: float) -> None:
        """Leave ESTOP or FAULT. Earlier requests can no longer move the arm. A sequence or program that was
        waiting is ended.

        Raises:
            ConflictError, NotReadyError, UnavailableError: see `Commands.reset`.
        """
        if self._link.state().mode in LATCHED:
            await self._stop_programs(StopReason("stopped"))
        await self._link.commands.reset(timeout_s)
        self._link.events.publish("reset", by=str(CLIENT.get()))

    def _publish(self, reason: StopReason, **more: int) -> None:
        request = log_context.get().get("request", "")
        self._link.events.publish(
            "stop", by=reason.by, reason=reason.text, cause=reason.cause, request=request, **more
        )

    def _unclaimed_motion(self) -> str | None:
        """Describe a motion without a claim, which a local client or an earlier, crashed service has started;
        None if there is none.
        """
        try:
            state = self._link.state()
        except UnavailableError:
            return None
        return self._link.streamer() or (None if _idle(state) else f"motion {state.motion_id}")

    async def _rest(self, timeout_s: float, problems: list[str]) -> RobotState | None:
        """Wait until the arm is at rest. Returns the state at that time, or the last state that was read
        before the timeout.
        """
        deadline_s = self._link.clock.now_s() + timeout_s
        state: RobotState | None = None
        while self._link.clock.now_s() < deadline_s:
            try:
                state = await self._link.await_fresh_state(0.5)
            except CobotError as exc:
                problems.append(str(exc))
                return None
            if state.measured_age_s > UNMEASURED_S and _idle(state):
                problems.append(f"it was measured {state.measured_age_s:.1f} s ago: {state.reason}")
                return state
            if state.stops_seen >= self._link.stops and _idle(state) and state.settled:
                return state
            await asyncio.sleep(POLL_S)
        problems.append(f"the arm is not at rest within {timeout_s:g} s")
        return state


def _idle(state: RobotState) -> bool:
    """Whether neither a motion nor a streaming session is running."""
    return state.mode in RESTING and state.session == 0
