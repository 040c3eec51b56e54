"""One motion: planned, handed to rtloop, and followed until it has ended."""

from __future__ import annotations

import asyncio
import math

from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import PlanRequest
from app.services.rights.claims import Claim
from app.services.state.commands import ACKNOWLEDGE_S
from app.services.state.link import POLL_S, RobotLink
from app.services.state.robot_state import RobotState
from cobot import logs
from cobot.errors import (
    CollisionError,
    ConflictError,
    ExecutionError,
    MotionStopped,
    MotionTimeout,
    PlanningTimeout,
    UnavailableError,
)
from cobot.ipc.layout import MotionResult
from cobot.motions.fence import Fence
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import LoopMode

REST_TIMEOUT_S = 5.0
"""Timeout for a motion to stop, s."""
STATE_TIMEOUT_S = 1.5
"""Timeout for a sign of rtloop during a motion, s: less than the two seconds within which a client must be
informed."""
LATEST_ANSWER_S = ACKNOWLEDGE_S + STATE_TIMEOUT_S + REST_TIMEOUT_S + 1.0
"""How long after its timeout a motion may be answered: all its waits, and the way to the client."""
WHERE = {
    MotionResult.STOPPED: "on its path",
    MotionResult.STOPPED_ASIDE: "off its path, which left no room to slow down within the limits,",
}


class MotionService:
    """Has motions planned and executed, for the owner of the right to move.

    Attributes:
        scene_changed_s: when the scene was changed last, on the link's clock.
    """

    def __init__(self, robot: RobotDescription, link: RobotLink, planning: PlanningService) -> None:
        self._robot = robot
        self._link = link
        self._planning = planning
        self.scene_changed_s = -math.inf

    async def ready(self) -> RobotState:
        """A state from which a motion may start.

        Raises:
            UnavailableError: see `RobotLink.ready_state`.
            ConflictError: the arm still executes a motion whose client is gone.
        """
        state = await self._link.ready_state(STATE_TIMEOUT_S)
        if state.mode is not LoopMode.HOLD:
            raise ConflictError(f"the arm still moves: motion {state.motion_id} is in mode {state.mode.name}")
        return state

    async def plan(self, claim: Claim, request: PlanRequest, timeout_s: float) -> Trajectory | None:
        """Plan on behalf of a claim; an interruption kills the planner."""
        try:
            return await claim.run_interruptibly(self._planning.plan(request, timeout_s))
        except MotionTimeout as exc:
            raise PlanningTimeout.after(timeout_s, f"not planned within {timeout_s:g} s") from exc

    async def start(self, claim: Claim, trajectory: Trajectory, fence: Fence | None = None) -> None:
        """Hand the motion to rtloop; it sees to it that the TCP does not leave the fence.

        Raises:
            ExecutionError, UnavailableError, InputError: see `Commands.start`.
            CollisionError: the scene has changed since it was planned.
        """
        if claim.speed_override.paused:
            await claim.run_interruptibly(claim.speed_override.opened.wait())
        await self.require_free_since(claim.since_s, trajectory)  # it may have been planned before
        claim.proceed()
        tool = self._robot.model.carried.version  # it cannot change while there is a claim
        claim.motion_id = await self._link.commands.start(trajectory, claim.stops, tool, fence)
        claim.trajectory = trajectory
        logs.bind(motion=claim.motion_id)
        if claim.job is not None:
            claim.job.started(claim.motion_id, trajectory)
        await claim.speed_override.begin_motion()

    async def replace(self, claim: Claim, trajectory: Trajectory, offset_s: float, planned_s: float) -> None:
        """Have the motion under way go on with another trajectory, see `Commands.replace`.

        Args:
            planned_s: when it was planned, on the link's clock.

        Raises:
            ExecutionError, UnavailableError, InputError: see `Commands.replace`.
            CollisionError: the scene has changed since; the motion goes on as it was.
        """
        checked_s = planned_s
        if planned_s <= self.scene_changed_s:
            checked_s = self._link.clock.now_s()
            await self._require_free(trajectory)
        claim.proceed()
        await self._link.commands.replace(
            trajectory, offset_s, claim.stops, self._robot.model.carried.version
        )
        claim.trajectory = trajectory
        if claim.job is not None:
            claim.job.prolonged(trajectory)
        if checked_s <= self.scene_changed_s:  # the scene may have been checked against the trajectory before
            try:
                await self._require_free(trajectory)
            except CollisionError as exc:
                claim.interrupt(MotionStopped(str(exc)))

    async def require_free_since(self, since_s: float, trajectory: Trajectory) -> None:
        """Check a motion again if the scene has changed since this time, on the link's clock.

        Raises:
            CollisionError: it touches something now.
        """
        if since_s <= self.scene_changed_s:
            await self._require_free(trajectory)

    async def _require_free(self, trajectory: Trajectory) -> None:
        checker = await asyncio.to_thread(self._robot.collision.among, self._robot.collision.scene)
        await asyncio.to_thread(checker.check_trajectory, trajectory)

    async def arrival(self, claim: Claim) -> None:
        """Wait until the motion has ended.

        Raises:
            ExecutionError: it did not arrive; its class and text say why.
            UnavailableError: rtloop is gone.
        """
        state = await self._await_end(claim)
        if state.motion_result in WHERE:
            share = 100.0 * state.path_time_s / state.path_duration_s
            cause = claim.interruption or MotionStopped(state.reason)
            where = WHERE[state.motion_result]
            raise type(cause)(f"{cause}: the arm came to rest {where} after {share:.0f} % of it")
        if state.motion_result is not MotionResult.ARRIVED:
            raise ExecutionError(state.reason)

    async def _await_end(self, claim: Claim) -> RobotState:
        """The first state after the motion; an interruption has it stopped."""
        clock, give_up_s = self._link.clock, math.inf
        begun_s = clock.now_s()
        while True:
            try:
                state = await self._link.fresh_state(STATE_TIMEOUT_S)
            except UnavailableError:
                self._link.request_stop()  # rtloop must not continue a motion that no client owns
                raise
            if state.motion_id != claim.motion_id:
                # Of the cycle before the acknowledgement; or rtloop has died before it could publish one.
                if state.published_s > begun_s:
                    raise ExecutionError("rtloop was restarted; the motion has not begun")
            elif state.motion_result is not MotionResult.RUNNING:
                return state
            if claim.interruption is not None and give_up_s == math.inf:
                self._link.request_stop()
                give_up_s = clock.now_s() + REST_TIMEOUT_S
            if clock.now_s() > give_up_s:
                raise ExecutionError(
                    f"{claim.interruption}; the arm has not come to rest within {REST_TIMEOUT_S:.0f} s"
                )
            await asyncio.sleep(POLL_S)
