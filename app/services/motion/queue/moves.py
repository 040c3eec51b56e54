"""Moves in the queue: the request, the planned move, and its remainder after a stop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from itertools import accumulate
from typing import TypeVar

from app.services.motion.execution import MotionService
from app.services.motion.goals import check_radii
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import LegRequest, begin_stretch, extend_stretch, leg
from app.services.motion.queue.signals import MoveSignals
from app.services.motion.tool_and_limits import RobotSettings
from app.services.rights.claims import Claim
from app.services.rights.job import Job
from cobot.clock import Clock
from cobot.errors import CobotError, CollisionError, InputError, PlanningError
from cobot.motions.requests import MotionRequest
from cobot.motions.signal_places import REST_S
from cobot.motions.stretches import Leg, Stretch
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array

PLAN_TIMEOUT_S = 20.0

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class QueueRequest:
    """A request to the queue.

    Attributes:
        name: displayed name.
        parts: one function for each motion in the move. It is called with the start of the motion, and
            returns the request to the planner or the planned motion; None means that the arm is already at
            the goal.
        radius_m: blend radius at the end, m, if another move follows in time.
        inner_radii_m: blend radius at the end of each part except the last, m.
        job: the job of the move; None for the vendor services, whose moves together are one job.
        exact: whether the move is a plan, which is run unchanged. The arm stops before and after it.
        anywhere: whether the goal is independent of the start: true for a pose, false for an angle about an
            axis.
        midway: whether the move can be resumed partway along its path. True for a line, false for an arc.
        count: number of motions in the move, for the capacity of the queue.
        require_valid: function that raises `ConflictError` if the preconditions of the move have changed
            since it was queued.
        signals: the actions and conditions of the move, with their results.
    """

    name: str
    parts: Sequence[Callable[[Array], LegRequest | Leg | None]]
    radius_m: float
    inner_radii_m: Sequence[float] = ()
    job: Job | None = None
    exact: bool = False
    anywhere: bool = True
    midway: bool = True
    count: int = 1
    require_valid: Callable[[], None] = lambda: None
    signals: MoveSignals = field(default_factory=MoveSignals)


def queue_request(
    name: str,
    goals: Sequence[MotionRequest],
    plan: Callable[[MotionRequest, Array], LegRequest],
    radius_m: float,
    inner_radii_m: Sequence[float] = (),
    job: Job | None = None,
) -> QueueRequest:
    """Create the request to queue one move through several consecutive goals.

    Args:
        plan: function that returns the request to the planner for a goal and a start, shape (dof,), rad.
        radius_m, inner_radii_m: see `QueueRequest`. If there are no inner radii, the arm stops after each
            part.

    Raises:
        InputError: see `check_radii`.
    """
    check_radii(goals, inner_radii_m)
    first = goals[0]
    return QueueRequest(
        name,
        [partial(plan, goal) for goal in goals],
        radius_m,
        inner_radii_m or [0.0] * (len(goals) - 1),
        job,
        anywhere=not first.is_relative,
        midway=not first.is_relative and len(goals) == 1 and not first.traits.one_piece,
        count=len(goals),
        signals=MoveSignals([goal.signals for goal in goals]),
    )


@dataclass(frozen=True, slots=True)
class QueuedMove:
    """A planned move.

    Attributes:
        legs: the planned motions; empty if the arm is already at the goal.
        radii_m: blend radius at the end of each leg, m.
        since_s: time at which the move was planned.
        parts: number of legs up to the end of each motion in the request.
    """

    number: int
    request: QueueRequest
    legs: tuple[Leg, ...]
    radii_m: tuple[float, ...]
    since_s: float
    parts: tuple[int, ...] = ()

    @property
    def signals(self) -> MoveSignals:
        """The actions and conditions of the move, with their results."""
        return self.request.signals

    @property
    def _rests(self) -> bool:
        """Whether the move has actions or conditions although the arm is already at the goal."""
        return bool(self.signals and self.legs) and self.duration_s <= REST_S

    @property
    def begins_motion(self) -> bool:
        """Whether the arm must settle before this move, because this move cannot be joined to the previous
        one.
        """
        return self._rests or self.signals.placed.start_when is not None

    @property
    def ends_motion(self) -> bool:
        """Whether the arm must settle after this move, because this move cannot be joined to the next one."""
        return self._rests or self.signals.placed.until is not None

    @property
    def name(self) -> str:
        return self.request.name

    @property
    def duration_s(self) -> float:
        """Duration of the move at full speed, without blends, s."""
        return sum((leg.motion.duration_s for leg in self.legs), 0.0)

    @property
    def stops_before(self) -> bool:
        """Whether the arm must stop before this move."""
        return not self.legs or self.request.exact


def passed(move: QueuedMove) -> QueuedMove:
    """Create a replacement for a move whose end the arm has passed. It has no path, and its remaining actions
    fire at the arm's position.
    """
    move.signals.make_due()
    request = replace(move.request, parts=[lambda start: None], inner_radii_m=(), anywhere=True, exact=False)
    return replace(move, request=request, legs=(), radii_m=(), parts=(0,))


@dataclass(frozen=True, slots=True)
class Left:
    """The remaining part of a motion that was interrupted.

    Attributes:
        moves: the remaining moves, in execution order.
        begun: the move during which the arm stopped; None if none of the remaining moves has begun.
        start: position of the arm at rest, shape (dof,), rad.
    """

    moves: list[QueuedMove]
    begun: QueuedMove | None
    start: Array


class MovePlanner:
    """Plans the moves of one robot's queue, first individually and then joined."""

    def __init__(
        self, clock: Clock, motion: MotionService, planning: PlanningService, settings: RobotSettings
    ) -> None:
        self._clock = clock
        self._motion = motion
        self._planning = planning
        self._settings = settings

    async def plan_move(self, claim: Claim, number: int, request: QueueRequest, start: Array) -> QueuedMove:
        """Plan a move that begins at `start`.

        Raises:
            CobotError: see `PlanningService.compute`. If the move has several parts, the error gives the
                number of the part.
        """
        legs: list[Leg] = []
        radii: list[float] = []
        parts: list[int] = []
        radii_m = (*request.inner_radii_m, request.radius_m)
        for part, (make, radius_m) in enumerate(zip(request.parts, radii_m, strict=True), start=1):
            try:
                found = await self._leg(claim, make(start))
            except (PlanningError, InputError) as exc:
                if len(radii_m) == 1:
                    raise
                raise exc.with_message(f"motion {part}: {exc}") from exc
            if found is not None:
                legs.append(found)
                radii.append(radius_m)
                start = found.motion.end
            # this motion ends where the previous one ends, so its radius replaces the previous one
            elif radii:
                radii[-1] = min(radii[-1], radius_m)
            parts.append(len(legs))
        if request.signals and not legs:
            legs, radii = [self._motion.resting_leg(start)], [0.0]
        move = QueuedMove(number, request, tuple(legs), tuple(radii), self._clock.now_s(), tuple(parts))
        if request.signals:
            await self._place(move)
        return move

    async def _place(self, move: QueuedMove) -> None:
        """Determine the path times of a move's actions, before the move is joined with others.

        Raises:
            InputError: see `place_signals`.
            ConflictError: see `ForceZero.applied`.
        """
        whole = reduce(Trajectory.followed_by, (leg.motion for leg in move.legs))
        times_s = (0.0, *accumulate(leg.motion.duration_s for leg in move.legs))
        ends_s = [times_s[count] for count in move.parts]
        placed = move.signals.place(move.number, 0.0, ends_s, await self._motion.way(whole))
        self._motion.force_zero.applied(placed)
        job = move.request.job
        move.signals.follow(placed, lambda: self._motion.follower(placed, 0, job))
        if job is not None:
            job.follow_signals(lambda: move.signals.results)

    async def valid(self, chain: Sequence[QueuedMove]) -> list[QueuedMove]:
        """Return the moves of a chain before the first one that has become impossible since the chain was
        planned.

        Raises:
            ConflictError, CollisionError: the first move of the chain has become impossible.
        """
        for index, move in enumerate(chain):
            try:
                await self._require_valid(move)
            except CobotError:
                if index == 0:
                    raise
                return list(chain[:index])
        return list(chain)

    async def _require_valid(self, move: QueuedMove) -> None:
        move.request.require_valid()
        for each in move.legs:
            try:
                await self._motion.require_free_since(move.since_s, each.motion)
            except CollisionError as exc:
                raise exc.with_message(f"the scene has changed since the move was queued: {exc}") from exc

    async def begin_stretch(self, claim: Claim, legs: Sequence[Leg], radii_m: Sequence[float]) -> Stretch:
        """See `planning_tasks.begin_stretch`; raises the errors of `PlanningService.compute`."""
        envelope = self._settings.envelope
        return await self._compute(
            claim, partial(begin_stretch, legs=legs, radii_m=radii_m, envelope=envelope)
        )

    async def prolong(
        self,
        claim: Claim,
        under_way: Stretch,
        legs: Sequence[Leg],
        radii_m: Sequence[float],
        times_s: tuple[float, float],
    ) -> Stretch:
        """See `planning_tasks.extend_stretch`; raises the errors of `PlanningService.compute`."""
        work = partial(
            extend_stretch,
            under_way=under_way,
            legs=legs,
            radii_m=radii_m,
            times_s=times_s,
            envelope=self._settings.envelope,
        )
        return await self._compute(claim, work)

    async def _leg(self, claim: Claim, made: LegRequest | Leg | None) -> Leg | None:
        if made is None or isinstance(made, Leg):
            return made
        return await self._compute(claim, partial(leg, request=made, envelope=self._settings.envelope))

    async def _compute(self, claim: Claim, work: Callable[[RobotDescription], Result]) -> Result:
        return await claim.run_interruptibly(self._planning.compute(work, PLAN_TIMEOUT_S))
