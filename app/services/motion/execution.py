"""Executes one motion: plans it, sends it to rtloop, and follows it to its end."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeVar

from app.services.motion.force_zero import ForceZero
from app.services.motion.improvement import plan_within_budget
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import PlanRequest, plan_motion
from app.services.motion.signal_follower import CommandGripper, FollowsSignals, SignalFollower
from app.services.rights.claims import Claim
from app.services.rights.job import Job
from app.services.rights.stop_reason import StopReason
from app.services.state.commands import ACKNOWLEDGE_S
from app.services.state.link import POLL_S, RobotLink
from app.services.state.robot_state import RobotState
from cobot import logs
from cobot.errors import (
    CollisionError,
    ConditionNotMet,
    ConflictError,
    ExecutionError,
    InputError,
    MotionTimeout,
    NotSupportedError,
    PlanningError,
    PlanningTimeout,
    UnavailableError,
)
from cobot.ipc.layout import MotionResult
from cobot.motions.fence import Fence
from cobot.motions.improving import Improving, Planned
from cobot.motions.requests import MotionRequest
from cobot.motions.signal_places import TcpWay, resting
from cobot.motions.signals import NO_PLACED, Placed
from cobot.motions.stretches import Leg
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, LoopMode, PlannerName

REST_TIMEOUT_S = 5.0
"""Timeout for the arm to stop when a motion is stopped, s."""
STATE_TIMEOUT_S = 1.5
"""Timeout for a new state from rtloop during a motion, s. It is below two seconds, within which the client
must learn of a problem.
"""
LATEST_ANSWER_S = ACKNOWLEDGE_S + STATE_TIMEOUT_S + REST_TIMEOUT_S + 1.0
"""Maximum delay of the answer after the motion's timeout, s: the sum of all waits, and the time for
sending.
"""
MAX_BUDGET_SHARE = 0.5
"""Largest share of a motion's timeout that its planning budget may use."""
Result = TypeVar("Result")
WHERE = {
    MotionResult.STOPPED: "on its path",
    MotionResult.STOPPED_ASIDE: "off its path, which left no room to slow down within the limits,",
}


class MotionService:
    """Plans and executes motions for the holder of a claim.

    Attributes:
        scene_changed_s: time of the last change of the scene, on the link's clock.
        force_zero: the zero point of forces and torques.
        command_gripper: function that starts the gripper command of an action.
    """

    def __init__(self, robot: RobotDescription, link: RobotLink, planning: PlanningService) -> None:
        self._robot = robot
        self._link = link
        self._planning = planning
        self.scene_changed_s = -math.inf
        self.force_zero = ForceZero(robot, link)
        self.command_gripper: CommandGripper = _no_gripper

    async def require_ready(self) -> RobotState:
        """Wait until the arm may start a motion, and return its state.

        Raises:
            UnavailableError: see `RobotLink.await_ready_state`.
            ConflictError: the arm is still executing the motion of a client that has disconnected.
        """
        state = await self._link.await_ready_state(STATE_TIMEOUT_S)
        if state.mode is not LoopMode.HOLD:
            raise ConflictError(
                f"the arm is still moving: motion {state.motion_id} is in mode {state.mode.name}",
                details={"cause": "in_use"},
            )
        return state

    async def plan(self, claim: Claim, request: PlanRequest, timeout_s: float) -> Trajectory | None:
        """Plan a motion for a claim. If the claim is interrupted, the planning process is killed."""
        try:
            work = partial(plan_motion, request=request)
            return await claim.run_interruptibly(self._planning.compute(work, timeout_s))
        except MotionTimeout as exc:
            raise PlanningTimeout.after(timeout_s, f"not planned within {timeout_s:g} s") from exc

    async def plan_goal(
        self, claim: Claim, request: MotionRequest, timeout_s: float
    ) -> tuple[Trajectory | None, Planned]:
        """Plan a motion for a claim within the request's time budget, see `plan_within_budget`. If the claim
        is interrupted, planning ends and the plans made so far are discarded.
        """
        budget_s = min(request.budget_s, MAX_BUDGET_SHARE * timeout_s)
        if budget_s <= 0.0:
            motion = await self.plan(claim, request, timeout_s)
            return motion, Planned.of(request, motion)

        async def compute(work: Callable[[RobotDescription], Result]) -> Result:
            return await claim.run_interruptibly(self._planning.compute(work, timeout_s))

        plan_first = partial(self.plan, claim, request, timeout_s)
        found = await plan_within_budget(
            self._planning, self._link.clock, compute, request, plan_first, budget_s
        )
        motion = found.best if isinstance(found, Improving) else found
        return motion, Planned.of(request, found)

    async def way(self, trajectory: Trajectory) -> TcpWay:
        """Return the TCP path along a trajectory, with the current tool."""
        return await asyncio.to_thread(TcpWay, trajectory, self._robot.model.chain)

    def follower(self, signals: Placed, motion_id: int, job: Job | None) -> SignalFollower:
        """Create a follower for the signals of a whole motion or of a part of it."""
        name = "" if job is None else job.id
        return SignalFollower(self._link, signals, motion_id, self.command_gripper, name)

    def resting_leg(self, joints: Array) -> Leg:
        """Create a motion of zero length for an arm that is already at the goal, because actions and
        conditions need a path.
        """
        return Leg(resting(joints), self._robot.limits, None)

    async def start(
        self,
        claim: Claim,
        trajectory: Trajectory,
        fence: Fence | None = None,
        signals: Placed = NO_PLACED,
        followed: Callable[[int], None] | None = None,
    ) -> SignalFollower | None:
        """Start the motion in rtloop, which keeps the TCP within the fence and fires the actions. Returns a
        follower for the motion's signals; None if there are no signals or the caller follows them itself.

        Args:
            followed: function that is called with the motion's number, for a caller that follows the signals
                itself.

        Raises:
            ExecutionError, UnavailableError, InputError: see `Commands.start`.
            CollisionError: the scene has changed since the motion was planned, and the motion now collides.
            ConflictError: see `ForceZero.applied`.
        """
        signals = self.force_zero.applied(signals)
        if claim.speed_override.paused:
            await claim.run_interruptibly(claim.speed_override.opened.wait())
        changed_s = self.scene_changed_s
        await self.require_free_since(claim.since_s, trajectory)  # the motion may have been planned earlier
        claim.proceed()
        tool = self._robot.model.carried.version  # the tool cannot change while there is a claim
        claim.motion_id = await self._link.commands.start(trajectory, claim.stops, tool, fence, signals)
        claim.trajectory = trajectory
        logs.bind(motion=claim.motion_id)
        if followed is not None:
            followed(claim.motion_id)
        alone = followed is None and signals is not NO_PLACED
        follower = self.follower(signals, claim.motion_id, claim.job) if alone else None
        if claim.job is not None:
            if follower is not None:
                claim.job.follow_signals(lambda: follower.results)
            claim.job.start(claim.motion_id, trajectory)
        await claim.speed_override.begin_motion()
        if self.scene_changed_s != changed_s:  # the scene may have changed while the motion waited for rtloop
            await self._interrupt_on_contact(claim, trajectory)
        return follower

    async def replace(
        self,
        claim: Claim,
        trajectory: Trajectory,
        offset_s: float,
        planned_s: float,
        signals: Placed = NO_PLACED,
    ) -> None:
        """Make the current motion continue on a new trajectory, see `Commands.replace`.

        Args:
            planned_s: time at which the trajectory was planned, on the link's clock.
            signals: actions and conditions on the trajectory.

        Raises:
            ExecutionError, UnavailableError, InputError: see `Commands.replace`.
            CollisionError: the scene has changed since planning, and the new trajectory collides. The motion
                continues unchanged.
        """
        signals, checked_s = self.force_zero.applied(signals), planned_s
        if planned_s <= self.scene_changed_s:
            checked_s = self._link.clock.now_s()
            await self._require_free(trajectory)
        claim.proceed()
        await self._link.commands.replace(
            trajectory, offset_s, claim.stops, self._robot.model.carried.version, signals
        )
        claim.trajectory = trajectory
        if claim.job is not None:
            claim.job.prolong(trajectory)
        # the trajectory may already have been checked with the current scene
        if checked_s <= self.scene_changed_s:
            await self._interrupt_on_contact(claim, trajectory)

    async def require_free_since(self, since_s: float, trajectory: Trajectory) -> None:
        """Check a motion again if the scene has changed since `since_s`, a time on the link's clock.

        Raises:
            CollisionError: the motion now collides with an object.
        """
        if since_s <= self.scene_changed_s:
            await self._require_free(trajectory)

    async def _interrupt_on_contact(self, claim: Claim, trajectory: Trajectory) -> None:
        """Interrupt a motion if it collides in the current scene, which has changed while the motion was
        being sent to rtloop.
        """
        try:
            await self._require_free(trajectory)
        except CollisionError as exc:
            claim.interrupt(StopReason(str(exc), "scene").error)

    async def _require_free(self, trajectory: Trajectory) -> None:
        checker = await asyncio.to_thread(self._robot.collision.among, self._robot.collision.scene)
        await asyncio.to_thread(checker.check_trajectory, trajectory)

    async def arrival(self, claim: Claim, signals: FollowsSignals | None = None) -> None:
        """Wait until the motion has ended, at its goal or by its condition `until`.

        Args:
            signals: signals of the motion.

        Raises:
            ExecutionError: the arm did not reach the goal. The error's class and text give the reason.
            ConditionNotMet: the arm reached the goal, but the condition `until`, which should have ended the
                motion, was not met.
            UnavailableError: rtloop no longer publishes.
        """
        state, waits_for = await self._await_end(claim, signals)
        stopped = state.motion_result is MotionResult.MET and claim.interruption is not None
        if state.motion_result in WHERE or stopped:
            share = 100.0 * state.path_time_s / state.path_duration_s
            cause = claim.interruption or StopReason(state.reason, "robot", "").error
            why = state.reason.fields() if claim.interruption is None else {}
            where = WHERE.get(state.motion_result, WHERE[MotionResult.STOPPED])
            waited = f"; it waited for {waits_for}" if waits_for else ""
            details = {**cause.details, **why, "share": share / 100.0}
            raise type(cause)(
                f"{cause}: the arm stopped {where} after {share:.0f} % of the motion{waited}",
                details=details,
            )
        if state.motion_result not in (MotionResult.ARRIVED, MotionResult.MET):
            raise ExecutionError(state.reason, details=state.reason.fields())
        if state.motion_result is MotionResult.ARRIVED and signals is not None and signals.is_missed:
            raise ConditionNotMet(f"the arm is at its goal, but the condition was not met: {signals.until}")

    async def retract(
        self,
        claim: Claim,
        trajectory: Trajectory,
        signals: SignalFollower,
        timeout_s: float,
        fence: Fence | None = None,
        begin_s: float = 0.0,
    ) -> None:
        """Move back in a straight line after a motion that was ended by its `until` condition.

        Args:
            begin_s: path time of the trajectory at which the motion began.

        Raises:
            ExecutionError: the arm cannot retract, or has not reached the end of the retraction.
        """
        contact = signals.contact
        assert contact is not None
        way = await self.way(trajectory)
        contact_m = way.length_m(begin_s + contact.path_time_s)
        there_m = max(contact_m - signals.retract_m, 0.0)
        joints = trajectory.sample([way.path_time_s(there_m)])[0]
        start = (await self.require_ready()).commanded_position
        pose = self._robot.model.forward(joints)
        back = MotionRequest(start, pose, PlannerName.LIN, signals.retract_scaling, end_joints=joints)
        direct = MotionRequest(start, joints, PlannerName.PTP, signals.retract_scaling)
        try:
            try:
                motion = await self.plan(claim, back, timeout_s)
            except (
                PlanningError,
                InputError,
            ):  # the TCP is no longer on the path, or is in contact with an object
                motion = await self.plan(claim, direct, timeout_s)
        except (PlanningError, InputError) as exc:
            raise ExecutionError(f"stopped by its condition, but cannot move back: {exc}") from exc
        if motion is not None:
            await self.start(claim, motion, fence)
            await self.arrival(claim)
        signals.note_retraction(contact_m - there_m)

    async def _await_end(self, claim: Claim, signals: FollowsSignals | None) -> tuple[RobotState, str]:
        """Wait for the first state after the motion. Returns it with the condition for which the motion was
        waiting. If the claim is interrupted, the motion is stopped.
        """
        clock, give_up_s = self._link.clock, math.inf
        begun_s, waits_for = clock.now_s(), ""
        while True:
            try:
                state = await self._link.await_fresh_state(STATE_TIMEOUT_S)
            except UnavailableError:
                self._link.request_stop()  # rtloop must not continue a motion that has no client
                raise
            if state.motion_id != claim.motion_id:
                # Ignore states from before the acknowledgement, or from an rtloop that died before it
                # published a newer one.
                if state.published_s > begun_s:
                    raise ExecutionError("rtloop was restarted; the motion has not begun")
            elif state.motion_result is not MotionResult.RUNNING:
                if signals is not None:
                    signals.rest(state.tcp)
                return state, waits_for
            if signals is not None:
                signals.look()
                waits_for = signals.results.waits_for
            if claim.interruption is not None and give_up_s == math.inf:
                self._link.request_stop()
                give_up_s = clock.now_s() + REST_TIMEOUT_S
            if clock.now_s() > give_up_s:
                raise ExecutionError(
                    f"{claim.interruption}; the arm has not stopped within {REST_TIMEOUT_S:.0f} s"
                )
            await asyncio.sleep(POLL_S)


def _no_gripper(command: Mapping[str, Any]) -> None:
    raise NotSupportedError("there is no gripper")
