"""Claims: the right to move, as one motion or one sequence has it.

`app.services.rights.ownership` decides which caller gets one.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

from app.services.clients import RequestClient
from app.services.rights.job import Job
from app.services.rights.lease import Lease
from app.services.rights.speed_override import SpeedOverride
from cobot.clock import Clock
from cobot.errors import ExecutionError, MotionStopped, MotionTimeout
from cobot.trajectory import Trajectory

Result = TypeVar("Result")
MAX_WAIT_S = 3600.0
"""Maximum time of one wait for the client to go away, in seconds: a timeout may be infinite."""


@dataclass(frozen=True, slots=True)
class Caller:
    """The caller that requests a motion.

    Attributes:
        name: the name that other clients see.
        token: the token of the sequence on whose behalf the arm moves, if any.
        stops: `Ownership.stops` when the request came in. A later stop applies to this motion too.
        timeout_s: after which the motion is to end.
        gone: set when the client goes away: the arm then stops.
        job: the job of the motion; None if the caller owns the arm without a motion.
        waits: whether a client waits for the end. If not, `timeout_s` applies to the beginning alone.
    """

    name: str
    token: str | None
    stops: int
    timeout_s: float
    gone: asyncio.Event
    job: Job | None = None
    waits: bool = True


@dataclass
class Claim:
    """The right to move, of one motion.

    Attributes:
        name: see `Caller`.
        stops: the link's count of stops when the claim was made.
        speed_override: of its motion.
        since_s: when it was made, on `clock`.
        client: the client that it is for.
        job: see `Caller`.
        timeout_s, left_s: its time, and how much of it is left, s.
        motion_id: once it runs.
        trajectory: what it runs along, once it does.
        interruption: why it has to end early, once it has to; then `interrupted` is set.
        ended: set when it has.
    """

    name: str
    stops: int
    speed_override: SpeedOverride
    clock: Clock
    since_s: float
    client: RequestClient
    job: Job | None = None
    timeout_s: float = math.inf
    left_s: Callable[[], float] = field(default=lambda: math.inf)
    motion_id: int | None = None
    trajectory: Trajectory | None = None
    interruption: ExecutionError | None = None
    interrupted: asyncio.Event = field(default_factory=asyncio.Event)
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    def interrupt(self, cause: ExecutionError) -> None:
        """End this motion; the first cause counts."""
        if self.interruption is None:
            self.interruption = cause
            self.interrupted.set()

    def accept(self) -> None:
        """Nothing is left to be refused that is known before planning."""
        if self.job is not None:
            self.job.accepted.set()

    def fail(self, error: BaseException) -> None:
        """Note why its motion does not arrive, where that is not raised through `Ownership.claim`."""
        if self.job is not None:
            self.job.fail(error)

    def time_out(self) -> None:
        """Interrupt the motion, because its time is up."""
        done = "begun" if self.motion_id is None else "arrived"
        self.interrupt(MotionTimeout(f"not {done} within {self.timeout_s:g} s"))

    def proceed(self) -> None:
        """Raise what has interrupted it, if something has.

        The timeout may have passed unnoticed, because this process may have been suspended.
        """
        if self.left_s() <= 0.0:
            self.time_out()
        if self.interruption is not None:
            raise self.interruption

    async def run_interruptibly(self, work: Coroutine[Any, Any, Result]) -> Result:
        """The work's result; an interruption cancels it and is raised."""
        task = asyncio.create_task(work)
        interrupted = asyncio.create_task(self.interrupted.wait())
        try:
            await asyncio.wait({task, interrupted}, return_when=asyncio.FIRST_COMPLETED)
            self.proceed()
            return await task
        finally:
            task.cancel()
            interrupted.cancel()

    def __str__(self) -> str:
        number = f", motion {self.motion_id}" if self.motion_id is not None else ""
        return f"{self.name} (for {self.clock.now_s() - self.since_s:.1f} s{number})"


@dataclass(frozen=True, slots=True)
class SequenceClaim:
    """The right to move, of a sequence.

    Attributes:
        token: of its requests.
        since_s: when it was made, on the service's clock.
        fraction: of the speed override, to which it returns.
        lease: that was held when it was made; with this one ends the fraction.
        job: that it is.
    """

    name: str
    token: str
    client: RequestClient
    since_s: float
    fraction: float
    lease: Lease | None
    job: Job


@contextlib.contextmanager
def watching(claim: Claim, caller: Caller) -> Iterator[None]:
    """Interrupt the motion, or what comes before it, when its client goes away or its time is up.

    The time is that of full speed: while motions are slowed down it goes on as slowly, and while they are
    paused not at all.
    """
    override = claim.speed_override
    paused_s, slowed_s = override.paused_s, override.slowed_s
    begun_s = claim.clock.now_s()

    def left_s() -> float:
        longer_s = override.excused_s(paused_s) + override.slowed_s - slowed_s
        return begun_s + caller.timeout_s + longer_s - claim.clock.now_s()

    async def watch() -> None:
        while not caller.gone.is_set() and left_s() > 0.0:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(caller.gone.wait(), min(max(left_s(), 0.01), MAX_WAIT_S))
        if caller.gone.is_set():
            claim.interrupt(MotionStopped("the client went away"))
        else:
            claim.time_out()

    claim.timeout_s, claim.left_s = caller.timeout_s, left_s
    watcher = asyncio.create_task(watch())
    try:
        yield
    finally:
        watcher.cancel()
