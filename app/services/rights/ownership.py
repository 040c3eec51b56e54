"""The exclusive right to move the arm, called a claim. Only one caller at a time holds it."""

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
from app.services.rights.stop_reason import StopReason
from app.services.state.link import RobotLink
from cobot import logs
from cobot.errors import ConflictError, ExecutionError, MotionStopped
from cobot.trajectory import Trajectory

BY_STOP = "stopped by POST /stop"
COMMAND = "cobot stop"
BY_COMMAND = f"stopped by {COMMAND}"
"""Reason for a stop by `cobot stop`, which requests it through shared memory. The audit log names the
user.
"""


class Ownership:
    """Gives the claim on the arm to one request at a time.

    A running sequence holds the claim from its start to its end, and requests with its token may move the
    arm. If a sequence or the holder of a lease has set a speed override, the override ends with the sequence
    or the lease.

    Attributes:
        stops: number of calls of POST /stop so far.
        speed_override: speed override of all motions.
        lease: the control lease. While a client holds it, other clients cannot move the arm.
        jobs: the jobs of all motions.
        on_sequence_end: function that is called with the token of each sequence that has ended.
        before_motion: function that waits for work that must be finished before a motion claims the arm.
    """

    def __init__(self, link: RobotLink, jobs: JobBook | None = None) -> None:
        self._link = link
        self.jobs = jobs or JobBook(link)
        self._claim: Claim | None = None
        self._sequence: SequenceClaim | None = None
        self._fraction = 1.0  # the speed override that applies without a lease or a sequence
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
        """Description of the request that is moving the arm; None if there is none."""
        if self._claim is not None:
            return str(self._claim)
        return self._sequence.name if self._sequence else self._link.streamer()

    @property
    def moving(self) -> Claim | SequenceClaim | None:
        """The claim of the current motion or, without one, of the current sequence."""
        return self._claim or self._sequence

    @property
    def motion(self) -> tuple[int, Trajectory] | None:
        """The number and trajectory of the current motion; None if the arm is not following a planned
        path.
        """
        claim = self._claim
        if claim is None or claim.motion_id is None or claim.trajectory is None:
            return None
        return claim.motion_id, claim.trajectory

    def claim_of(self, job: Job) -> Claim | None:
        """Return the claim of a job; None if the job does not hold the claim now."""
        return self._claim if self._claim is not None and self._claim.job is job else None

    @property
    def in_motion(self) -> bool:
        """Whether a motion or a streaming session is running. False for a sequence between its motions."""
        return self._claim is not None or self._link.streamer() is not None

    @property
    def speed_fraction(self) -> float:
        """Speed at which a motion would begin now, as a share of its planned speed."""
        _ = self.lease.current  # ends an expired lease, and thereby its speed override
        return self.speed_override.fraction

    @property
    def sequence_job(self) -> Job | None:
        """The job of the current sequence."""
        return None if self._sequence is None else self._sequence.job

    def new_job(self, kind: JobKind, request: str = "", number: str | None = None) -> Job:
        """Create a new job for a `Caller`. If a sequence sends the request, the sequence's job is the
        parent of the new one.

        Args:
            number: job id; None to make a new id.
        """
        sequence = self._sequence
        own = sequence is not None and sequence.token == CLIENT.get().sequence
        parent = sequence.job.id if sequence is not None and own else None
        return self.jobs.new(kind, request, parent, number)

    def claim_for_sequence(self, name: str, token: str, kind: JobKind = JobKind.SEQUENCE) -> None:
        """Claim the arm for a sequence, whose requests carry `token`.

        Args:
            name: displayed name.

        Raises:
            ConflictError: another client is moving the arm or has control.
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
        """End the claim of the current sequence.

        Args:
            error: reason why the sequence was not completed; `MotionStopped` if it was stopped.
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
        """Check that a request with this token may move the arm.

        Raises:
            ConflictError: another client is moving the arm or has control.
        """
        client = CLIENT.get()
        self.lease.require_not_lost(client)
        if self._claim is not None or (self._sequence is not None and self._sequence.token != token):
            raise ConflictError(
                f"the robot is in use by {self.owner}; wait for it, or POST /stop",
                details={"cause": "in_use"},
            )
        streamer = self._link.streamer()
        if streamer is not None:
            raise ConflictError(
                f"the robot is in use by {streamer}; wait until it ends, or POST /stop",
                details={"cause": "in_use"},
            )
        if token is not None and self._sequence is None:
            raise ConflictError("the sequence of this request has ended")
        if self._sequence is None:
            self.lease.require(client)

    def require_control(self) -> None:
        """Check, for a running sequence, that no other client has the lease.

        Raises:
            ConflictError: another client has the lease.
        """
        client = CLIENT.get()
        if self._sequence is None or self._sequence.token != client.sequence:
            self.lease.require(client)

    def require_mover(self, what: str) -> None:
        """Check that no other client is moving the arm or has control.

        Args:
            what: the action that needs the check, for the error message.

        Raises:
            ConflictError: another client is moving the arm or has control.
        """
        self.require_control()
        client, moving = CLIENT.get(), self.moving
        own = self._sequence is not None and self._sequence.token == client.sequence
        if moving is not None and not own and not moving.client.same(client):
            raise ConflictError(
                f"the robot is in use by {self.owner} of {moving.client}, and only that client can {what}",
                details={"cause": "mover", "by": str(moving.client)},
            )

    async def set_speed_fraction(self, fraction: float) -> None:
        """Set the speed override for the current motion and all later ones.

        Raises:
            ConflictError: another client is moving the arm or has control, or a streaming session is running.
            LimitError, UnavailableError: see `SpeedOverride.set_fraction`.
        """
        self.require_control()
        if self._link.streamer() is not None and not self.speed_override.follows_stream:
            raise ConflictError(
                f"{self.owner}: the speed of a streaming session cannot be overridden, because it has no path"
            )
        self.require_mover("change the speed")
        await self.speed_override.set_fraction(fraction)
        if self._sequence is None and self.lease.current is None:
            self._fraction = fraction

    def _restore_speed(self) -> None:
        self.speed_override.restore(self._fraction)

    def end(self, job: Job, error: BaseException | None = None, *, stopped: bool = False) -> None:
        """End a job. `error` is the reason for a failure. `stopped` is true if the job was stopped on
        request.
        """
        if error is not None:
            job.fail(error)
        if job.error is None:
            job.end(JobState.FINISHED)
        elif self.jobs.ending or isinstance(error, asyncio.CancelledError):
            job.end(JobState.INTERRUPTED)
        else:
            job.end(JobState.CANCELLED if stopped else JobState.FAILED)

    def _tell_lease(self, what: str, lease: Lease) -> None:
        """Report a change of the lease and the client that caused it.

        For a new lease, this client is its holder. A lease may also end during a request of another client.
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
        """Wait for `before_motion`. Then check that the holder of this token may begin a motion; see
        `require_free`.
        """
        await self.before_motion()
        self.require_free(token)

    async def claim_motion(self, caller: Caller) -> contextlib.AbstractContextManager[Claim]:
        """Claim the arm for a motion, once `before_motion` has attached a grasped object; see `claim`."""
        await self.before_motion()
        return self.claim(caller)

    @contextlib.contextmanager
    def claim(self, caller: Caller) -> Iterator[Claim]:
        """Claim the arm while the context is open. If a stop has been requested since the request for this
        motion began to arrive, the claim is interrupted at once.

        Raises:
            ConflictError: another client is moving the arm.
            UnavailableError: see `Heartbeat.require_awake`.
        """
        self.require_free(caller.token)
        self._link.heartbeat.require_awake()
        clock, override, job = self._link.clock, self.speed_override, caller.job
        claim = Claim(caller.name, self._link.stops, override, clock, clock.now_s(), CLIENT.get(), job)
        if self.stops != caller.stops:
            claim.interrupt(StopReason("a stop was requested while this request was being read", by="").error)
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
                if self._sequence is None:  # a pause of this job must not delay the next motion
                    self.speed_override.reset()
            self.lease.renew()
            claim.ended.set()
            logs.bind(motion=None)

    def stops_before(self, begun_s: float | None) -> int:
        """Return the value that `stops` had when a request began to arrive at `begun_s`; None means now. A
        stop after that time also ends the request's motion.
        """
        return self.stops - (begun_s is not None and begun_s <= self._stopped_s)

    def stop(self, reason: StopReason | None = None) -> Claim | None:
        """Interrupt the motion whose request is being read, planned or executed. Returns the claim that will
        end; None if there was nothing to interrupt.
        """
        self.stops += 1
        self._stopped_s = self._link.clock.now_s()
        return self.interrupt((reason or StopReason(BY_STOP)).error)

    def cancel(self, job: Job, cause: MotionStopped) -> None:
        """Interrupt this job's motion. Does nothing if the motion has ended or is ending."""
        if self._claim is not None and self._claim.job is job:
            self.interrupt(cause)

    def interrupt(self, cause: ExecutionError) -> Claim | None:
        """Interrupt the current claim, but not the requests that are still being read."""
        self.speed_override.reset()
        if self._claim is not None:
            self._claim.interrupt(cause)
        return self._claim


async def _do_nothing() -> None: ...
