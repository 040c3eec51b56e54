"""Claims: the exclusive right of one motion or one sequence to move the arm.

`app.services.rights.ownership` decides which caller gets a claim.
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
from app.services.rights.speed_override import MAX_PAUSE_S, SpeedOverride
from app.services.rights.stop_reason import StopReason
from cobot.clock import Clock
from cobot.errors import ExecutionError, MotionTimeout
from cobot.motions.requests import MotionRequest
from cobot.trajectory import Trajectory

Result = TypeVar("Result")
MAX_WAIT_S = 3600.0
"""Maximum wait before the timeout is checked again, s. It is limited because the timeout itself may be
infinite.
"""


@dataclass(frozen=True, slots=True)
class Caller:
    """The originator of a request for a motion.

    Attributes:
        name: displayed name.
        token: the token of the sequence that sent the request; None if another client sent it.
        stops: `Ownership.stops` when the request arrived. If it has changed since, the motion is stopped.
        timeout_s: timeout for the end of the motion, s.
        gone: event that is set when the client disconnects, which stops the arm.
        job: the job of the motion; None if the caller needs the claim for something else.
        waits: whether a client is waiting for the motion to end. If not, `timeout_s` applies only until the
            motion begins.
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
    """The exclusive right of one motion to move the arm.

    Attributes:
        name: see `Caller`.
        stops: the link's count of stops when the claim was made.
        speed_override: speed override of the motion.
        since_s: time when the claim was made, on `clock`.
        client: the client that holds the claim.
        job: see `Caller`.
        timeout_s, left_s: timeout of the motion, and the remaining time, s.
        motion_id: number of the motion, once it is running.
        trajectory: trajectory of the motion, once it is running.
        goal: the goal of a single motion; None for all others.
        interruption: the reason to end the motion early. The event `interrupted` is set at the same time.
        ended: event that is set when the claim has ended.
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
    goal: MotionRequest | None = None
    interruption: ExecutionError | None = None
    interrupted: asyncio.Event = field(default_factory=asyncio.Event)
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    def interrupt(self, cause: ExecutionError) -> None:
        """Interrupt this motion. Only the cause from the first call is kept."""
        if self.interruption is None:
            self.interruption = cause
            self.interrupted.set()

    def accept(self) -> None:
        """Record that all checks before planning have passed, so that the request is accepted."""
        if self.job is not None:
            self.job.accepted.set()

    def fail(self, error: BaseException) -> None:
        """Record why the motion failed. Needed only for errors that are not raised inside
        `Ownership.claim`.
        """
        if self.job is not None:
            self.job.fail(error)

    def time_out(self) -> None:
        """Interrupt the motion, because its timeout has passed."""
        done = "begun" if self.motion_id is None else "arrived"
        self.interrupt(MotionTimeout(f"the motion has not {done} within {self.timeout_s:g} s"))

    def proceed(self) -> None:
        """Raise the cause of the interruption, if the motion was interrupted.

        Also checks the timeout, which may have passed unnoticed while this process was suspended.
        """
        if self.left_s() <= 0.0:
            self.time_out()
        if self.interruption is not None:
            raise self.interruption

    async def run_interruptibly(self, work: Coroutine[Any, Any, Result]) -> Result:
        """Return the result of `work`. If the claim is interrupted, cancel `work` and raise the cause."""
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
    """The exclusive right of a sequence to move the arm.

    Attributes:
        token: token of the sequence's requests.
        since_s: time when the claim was made, on the service's clock.
        fraction: speed override before the sequence, which is restored at its end.
        lease: the lease when the claim was made. If it has ended since, the speed override is not restored.
        job: job of the sequence.
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
    """While the context is open, interrupt the motion or its planning if the client disconnects or the
    timeout passes.

    The timeout is for full speed, and is extended while the motion is slowed down or paused, and in the slow
    motion of a simulation.
    """
    begun_s, before_s = claim.clock.now_s(), claim.speed_override.delays_s()

    def left_s() -> float:
        paused_s, slowed_s, _ = claim.speed_override.delays_s()
        longer_s = min(paused_s - before_s[0], MAX_PAUSE_S) + slowed_s - before_s[1]
        return begun_s + caller.timeout_s + longer_s - claim.clock.now_s()

    async def watch() -> None:
        while not caller.gone.is_set() and left_s() > 0.0:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(caller.gone.wait(), min(max(left_s(), 0.01), MAX_WAIT_S))
        if caller.gone.is_set():
            claim.interrupt(StopReason("the client has disconnected", "client_left").error)
        else:
            claim.time_out()

    claim.timeout_s, claim.left_s = caller.timeout_s, left_s
    watcher = asyncio.create_task(watch())
    try:
        yield
    finally:
        watcher.cancel()
