"""The right to move the arm, which one caller has at a time."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Awaitable, Callable, Iterator

from app.services.clients import CLIENT
from app.services.rights.claims import Caller, Claim, SequenceClaim
from app.services.rights.job import Job, JobKind, JobState
from app.services.rights.job_book import JobBook
from app.services.rights.lease import ControlLease, Lease
from app.services.rights.speed_override import SpeedOverride
from app.services.state.link import RobotLink
from cobot import logs
from cobot.errors import ConflictError, ExecutionError, MotionStopped
from cobot.trajectory import Trajectory

BY_STOP = "stopped by POST /stop"
BY_COMMAND = "stopped by cobot stop"
"""`cobot stop` adds to the counter of stops in shared memory; the audit names its user."""


class Ownership:
    """Gives the right to move to one request at a time.

    A running sequence has it from its start to its end; requests that carry its token move on its
    behalf. What the holder of the lease or a sequence does to the speed override ends with its control.

    Attributes:
        stops: how often POST /stop was called.
        speed_override: of all motions.
        lease: the control lease; while a client holds it, no other may request motions.
        jobs: the records of all motions.
        on_sequence_end: called with the token of each sequence that has ended.
        before_motion: waits for what has to be done before a motion claims the arm.
    """

    def __init__(self, link: RobotLink, jobs: JobBook | None = None) -> None:
        self._link = link
        self.jobs = jobs or JobBook(link)
        self._claim: Claim | None = None
        self._sequence: SequenceClaim | None = None
        self._fraction = 1.0  # without a lease or a sequence
        self.stops = 0
        self.on_sequence_end: Callable[[str], None] = lambda token: None
        self.before_motion: Callable[[], Awaitable[None]] = _do_nothing
        self._stopped_s = -math.inf
        self.speed_override = SpeedOverride(link, self.jobs.report_pause)
        self.lease = ControlLease(
            link.clock, lambda: bool(self._claim or self._sequence), self._restore_speed, self._tell_lease
        )

    @property
    def owner(self) -> str | None:
        """What moves the arm now, for people; None if nothing does."""
        if self._claim is not None:
            return str(self._claim)
        return self._sequence.name if self._sequence else self._link.streamer()

    @property
    def moving(self) -> Claim | SequenceClaim | None:
        """The motion that is under way, or else the sequence."""
        return self._claim or self._sequence

    @property
    def motion(self) -> tuple[int, Trajectory] | None:
        """What the arm moves along, and its number; None while it follows no planned path."""
        claim = self._claim
        if claim is None or claim.motion_id is None or claim.trajectory is None:
            return None
        return claim.motion_id, claim.trajectory

    @property
    def in_motion(self) -> bool:
        """Whether a motion or a stream is under way; a sequence between its motions is none."""
        return self._claim is not None or self._link.streamer() is not None

    @property
    def speed_fraction(self) -> float:
        """How fast a motion that began now would go, as a share of its planned speed."""
        _ = self.lease.current  # with one that has expired, its fraction has
        return self.speed_override.fraction

    @property
    def sequence_job(self) -> Job | None:
        """The job of the sequence that has the right to move."""
        return None if self._sequence is None else self._sequence.job

    def new_job(self, kind: JobKind, request: str = "", number: str | None = None) -> Job:
        """A job for a `Caller`; one of a sequence's own requests belongs to that.

        Args:
            number: its id; None for a new one.
        """
        sequence = self._sequence
        own = sequence is not None and sequence.token == CLIENT.get().sequence
        parent = sequence.job.id if sequence is not None and own else None
        return self.jobs.new(kind, request, parent, number)

    def claim_for_sequence(self, name: str, token: str, kind: JobKind = JobKind.SEQUENCE) -> None:
        """Reserve the motion for requests with a token.

        Args:
            name: for people.

        Raises:
            ConflictError: another client moves the arm or has control.
            UnavailableError: see `Heartbeat.require_awake`.
        """
        client = CLIENT.get()
        self.lease.require_not_lost(client)
        if self.owner is not None:
            raise ConflictError(f"the robot is in use by {self.owner}")
        self.lease.require(client)
        self._link.heartbeat.require_awake()
        now_s, fraction = self._link.clock.now_s(), self.speed_override.fraction
        job = self.jobs.new(kind, name)
        self._sequence = SequenceClaim(name, token, client, now_s, fraction, self.lease.current, job)
        job.begin(self.speed_override)

    def release_sequence(self, error: BaseException | None = None) -> None:
        """It has ended.

        Args:
            error: why it has not come to its end; `MotionStopped` if it was stopped.
        """
        sequence, self._sequence = self._sequence, None
        if sequence is not None:
            self.end(sequence.job, error, stopped=isinstance(error, MotionStopped))
            self.on_sequence_end(sequence.token)
            same = sequence.lease is self.lease.current
            self.speed_override.restore(sequence.fraction if same else self._fraction)
        self.speed_override.reset()
        self.lease.renew()

    def require_free(self, token: str | None) -> None:
        """See that a request with this token may move the arm.

        Raises:
            ConflictError: another client moves the arm or has control.
        """
        client = CLIENT.get()
        self.lease.require_not_lost(client)
        if self._claim is not None or (self._sequence is not None and self._sequence.token != token):
            raise ConflictError(f"the robot is in use by {self.owner}; wait for it, or POST /stop")
        streamer = self._link.streamer()
        if streamer is not None:
            raise ConflictError(f"the robot is in use by {streamer}; wait for its end, or POST /stop")
        if token is not None and self._sequence is None:
            raise ConflictError("the sequence that this request belongs to has ended")
        if self._sequence is None:
            self.lease.require(client)

    def require_control(self) -> None:
        """Check that no other client has the lease, on behalf of a running sequence.

        Raises:
            ConflictError: another client has it.
        """
        client = CLIENT.get()
        if self._sequence is None or self._sequence.token != client.sequence:
            self.lease.require(client)

    async def set_speed_fraction(self, fraction: float) -> None:
        """Go faster or slower along the path: the motion that runs, and all that follow.

        Raises:
            ConflictError: another client moves the arm or has control; or the arm follows a stream.
            LimitError, UnavailableError: see `SpeedOverride.set_fraction`.
        """
        self.require_control()
        client, moving = CLIENT.get(), self.moving
        if self._link.streamer() is not None and not self.speed_override.follows_stream:
            raise ConflictError(f"{self.owner}: a stream has no path along which it could go slower")
        own = self._sequence is not None and self._sequence.token == client.sequence
        if moving is not None and not own and not moving.client.same(client):
            raise ConflictError(f"the robot is in use by {self.owner}, of {moving.client}: so is its speed")
        await self.speed_override.set_fraction(fraction)
        if self._sequence is None and self.lease.current is None:
            self._fraction = fraction

    def _restore_speed(self) -> None:
        self.speed_override.restore(self._fraction)

    def end(self, job: Job, error: BaseException | None = None, *, stopped: bool = False) -> None:
        """End a job. `error` is why it failed; `stopped` is set if it was stopped on request."""
        if error is not None:
            job.fail(error)
        if not job.failed:
            job.end(JobState.FINISHED)
        elif self.jobs.ending or isinstance(error, asyncio.CancelledError):
            job.end(JobState.INTERRUPTED)
        else:
            job.end(JobState.CANCELLED if stopped else JobState.FAILED)

    def _tell_lease(self, what: str, lease: Lease) -> None:
        """Report a change of the lease, and the client that caused it.

        For a lease that was taken this is its client. A lease that ends may end during another client's
        request.
        """
        client, by = lease.client, CLIENT.get()
        more = {"by": str(by)} if what == "taken over" else {}
        self._link.events.publish(
            "lease",
            what=what,
            holder=client.name,
            address=client.address,
            timeout_s=lease.timeout_s,
            **more,
        )

    async def await_free(self, token: str | None) -> None:
        """See that a motion with this token may begin, after `before_motion`; see `require_free`."""
        await self.before_motion()
        self.require_free(token)

    async def claim_motion(self, caller: Caller) -> contextlib.AbstractContextManager[Claim]:
        """Own the motion once `before_motion` has had a grasped object attached; see `claim`."""
        await self.before_motion()
        return self.claim(caller)

    @contextlib.contextmanager
    def claim(self, caller: Caller) -> Iterator[Claim]:
        """Own the motion for as long as the context lasts; one that a stop has overtaken is interrupted.

        Raises:
            ConflictError: another client moves the arm.
            UnavailableError: see `Heartbeat.require_awake`.
        """
        self.require_free(caller.token)
        self._link.heartbeat.require_awake()
        clock, override, job = self._link.clock, self.speed_override, caller.job
        claim = Claim(caller.name, self._link.stops, override, clock, clock.now_s(), CLIENT.get(), job)
        if self.stops != caller.stops:
            claim.interrupt(MotionStopped("a stop was requested while the request was being read"))
        self._claim = claim
        self.lease.renew()
        error: BaseException | None = None
        try:
            if job is not None:
                job.begin(override)
            yield claim
        except BaseException as exc:
            error = exc
            raise
        finally:
            self._claim = None
            if job is not None:
                self.end(job, error, stopped=isinstance(claim.interruption, MotionStopped))
                if self._sequence is None:  # however it has ended: its pause would hold whatever comes next
                    self.speed_override.reset()
            self.lease.renew()
            claim.ended.set()
            logs.bind(motion=None)

    def stops_before(self, begun_s: float | None) -> int:
        """`stops` when a request began to come in; None: now. A later stop is for its motion too."""
        return self.stops - (begun_s is not None and begun_s <= self._stopped_s)

    def stop(self, reason: str = BY_STOP) -> Claim | None:
        """Interrupt the motion that is read, planned or runs; its claim, which will end, or None."""
        self.stops += 1
        self._stopped_s = self._link.clock.now_s()
        return self.interrupt(MotionStopped(reason))

    def cancel(self, job: Job, cause: MotionStopped) -> None:
        """Interrupt the motion of this job; nothing happens if it has ended, or is about to."""
        if self._claim is not None and self._claim.job is job:
            self.interrupt(cause)

    def interrupt(self, cause: ExecutionError) -> Claim | None:
        """Interrupt the present claim. Requests that still wait to be read are not affected."""
        self.speed_override.reset()
        if self._claim is not None:
            self._claim.interrupt(cause)
        return self._claim


async def _do_nothing() -> None: ...
