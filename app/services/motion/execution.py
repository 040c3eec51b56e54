"""How a motion goes from request to arrival."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from app.services.motion.ownership import Caller, Claim, Ownership, watching
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import PlanRequest, joined
from app.services.motion.tool_and_limits import compose
from app.services.state.link import ACKNOWLEDGE_S, POLL_S, RobotLink
from app.services.state.robot_state import RobotState
from cobot import logs
from cobot.config import PlanningSection
from cobot.errors import (
    CobotError,
    CollisionError,
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
    MotionTimeout,
    PlanningError,
    PlanningTimeout,
    UnavailableError,
)
from cobot.ipc.layout import MotionResult
from cobot.motions.constraints import Constraints
from cobot.motions.fence import Fence
from cobot.motions.requests import (
    ANY_SPEED,
    Arc,
    Blended,
    MotionRequest,
    TcpSpeed,
    check_arc,
    check_synchronization,
    check_tcp_speed,
    check_through,
    check_via,
)
from cobot.robot.description import RobotDescription
from cobot.robot.frames import pose_from_abc, rotation_matrix
from cobot.robot.limits import check_positions
from cobot.trajectory import Trajectory
from cobot.types import (
    RRT_CONNECT,
    Algorithm,
    Array,
    LoopMode,
    PlannerName,
    Pose,
    Scaling,
    Synchronization,
)

Join = Callable[[RobotDescription], Blended]
TOOL = "tool"
"""The frame_id of what is given in the TCP's frame."""
REST_TIMEOUT_S = 5.0
"""How long a motion that was told to stop is waited for."""
STATE_TIMEOUT_S = 1.5
"""How long a motion waits for a sign of rtloop before it gives up: less than the two seconds in which
a client shall know."""
LATEST_ANSWER_S = ACKNOWLEDGE_S + STATE_TIMEOUT_S + REST_TIMEOUT_S + 1.0
"""How long after its timeout a motion may be answered: all its waits, and the way to the client."""
WHERE = {
    MotionResult.STOPPED: "on its path",
    MotionResult.STOPPED_ASIDE: "beside its path, which left no room to slow down within the limits,",
}


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a motion request ended. `error` is None when the arm has arrived and settled.

    `note` is the trajectory's.
    """

    error: CobotError | None
    motion_id: int | None
    duration_s: float
    planning_time_s: float
    note: str = ""


@dataclass(frozen=True, slots=True)
class Goal:
    """Where to go, and how: see `MotionRequest`."""

    target: Array | Pose
    scaling: Scaling
    planner: PlannerName = PlannerName.PTP
    via: Array | None = None
    algorithm: Algorithm = RRT_CONNECT
    synchronization: Synchronization = Synchronization.TIME
    arc: Arc | None = None
    through: tuple[Pose, ...] = ()
    radius_m: float = 0.0
    tcp_speed: TcpSpeed = ANY_SPEED
    constraints: Constraints | None = None
    in_tool: bool = False
    """All poses and points are given in the TCP's frame, as it is where the motion begins."""

    def placed(self, frame: Pose) -> Goal:
        """The same in the base frame, of what is given in a frame whose pose there is `frame`."""
        via = None if self.via is None else _point(frame, self.via)
        arc = self.arc
        if arc is not None:
            axis = None if arc.axis is None else rotation_matrix(frame.quaternion) @ arc.axis
            arc = replace(arc, centre=_point(frame, arc.centre), axis=axis)
        through = tuple(compose(frame, pose) for pose in self.through)
        target = compose(frame, self.target) if isinstance(self.target, Pose) else self.target
        return replace(self, target=target, via=via, arc=arc, through=through, in_tool=False)


class MotionService:
    """Plans motions and has them executed, for who owns the right to move.

    Attributes:
        scene_changed_s: when the scene was changed last, on the link's clock.
    """

    scene_changed_s = -math.inf

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        ownership: Ownership,
        planning: PlanningService,
        settings: PlanningSection,
    ) -> None:
        self._robot = robot
        self._link = link
        self._ownership = ownership
        self._planning = planning
        self._settings = settings

    def named(
        self,
        name: str,
        scaling: Scaling,
        synchronization: Synchronization = Synchronization.TIME,
        *,
        checked: bool = True,
    ) -> Goal:
        """The goal of a named position; see `joints`.

        Raises:
            InputError: there is no such position; lists the valid ones.
        """
        position = self._robot.positions.get(name)
        if position is None:
            valid = ", ".join(self._robot.positions)
            raise InputError(f"there is no named position {name!r}; valid are: {valid}")
        return self.joints(list(position.joints), scaling, synchronization, checked=checked)

    def joints(
        self,
        angles: list[float],
        scaling: Scaling,
        synchronization: Synchronization = Synchronization.TIME,
        *,
        checked: bool = True,
    ) -> Goal:
        """The goal of joint angles, rad.

        Args:
            checked: against the limits, which planning does too.

        Raises:
            InputError: another number of joints than the robot has.
            LimitError: beyond joint_limits.yaml.
        """
        limits = self._robot.limits
        if len(angles) != limits.dof:
            raise InputError(f"joints must have {limits.dof} angles, got {len(angles)}")
        target = np.array(angles, dtype=np.float64)
        if checked:
            check_positions(limits, target, share=1.0)
        return Goal(target, scaling, synchronization=synchronization)

    def pose(
        self,
        position: list[float],
        abc: list[float],
        frame: str,
        planner: str,
        scaling: Scaling,
        via: list[float] | None,
        synchronization: Synchronization = Synchronization.TIME,
        arc: Arc | None = None,
        through: Sequence[Pose] = (),
        radius_m: float = 0.0,
        tcp_speed: TcpSpeed = ANY_SPEED,
    ) -> Goal:
        """The goal of a TCP pose: m, KUKA angles in rad.

        Raises:
            InputError: a frame that is unknown or moves, or fields that do not fit the planner.
        """
        name = PlannerName(planner)
        check_via(name, via, arc)
        check_arc(arc)
        check_synchronization(name, synchronization)
        check_through(name, through, radius_m)
        check_tcp_speed(name, tcp_speed, self._robot.cartesian_limits)
        goal = Goal(
            pose_from_abc(*position, *abc),
            scaling,
            name,
            None if via is None else np.array(via),
            synchronization=synchronization,
            arc=arc,
            through=tuple(through),
            radius_m=radius_m,
            tcp_speed=tcp_speed,
        )
        return self.in_frame(goal, frame)

    def arc(self, arc: Arc, frame: str, scaling: Scaling, tcp_speed: TcpSpeed) -> Goal:
        """The goal of an arc by an angle, which ends wherever that leads.

        Raises:
            InputError: a frame that is unknown or moves, or a speed beyond the limits.
        """
        return self.pose([0.0] * 3, [0.0] * 3, frame, "circ", scaling, None, arc=arc, tcp_speed=tcp_speed)

    def in_frame(self, goal: Goal, frame: str) -> Goal:
        """A goal that is given in a frame: the base's, the TCP's where the motion begins (tool), or one that
        no joint moves.

        Raises:
            InputError: there is no such frame, or it moves.
        """
        if (frame or self._settings.default_frame) == TOOL:
            return replace(goal, in_tool=True)
        place = self.frame(frame)
        return goal if place is None else goal.placed(place)

    def placed(self, pose: Pose, frame: str) -> Pose:
        """A pose of a frame in the base frame; raises as `frame` does."""
        place = self.frame(frame)
        return pose if place is None else compose(place, pose)

    def frame(self, frame: str) -> Pose | None:
        """Where a frame is that does not move with the joints; None for the base frame itself.

        Raises:
            InputError: there is no such frame, or it moves.
        """
        base, model = self._robot.base_frame, self._robot.model
        name = frame or self._settings.default_frame
        if name == base:
            return None
        fixed = model.fixed_frames
        if name in fixed:
            return fixed[name]
        named = self._robot.collision.scene.frames
        if name in named:
            pose = np.array(named[name])
            return Pose(pose[:3], pose[3:])
        valid = (
            ", ".join([base, TOOL, *sorted((set(fixed) | set(named)) - {base})]) + f", or empty for {base}"
        )
        if name in model.frame_names or name == TOOL:
            raise InputError(f"frame_id: {name!r} moves with the joints; valid are: {valid}")
        raise InputError(f"frame_id: there is no frame {name!r}; valid are: {valid}")

    def request(self, goal: Goal, start: Array) -> MotionRequest:
        """What the planner is asked for, from where the arm stands, rad."""
        if goal.in_tool:
            goal = goal.placed(self._robot.model.forward(start))
        return MotionRequest(
            start,
            goal.target,
            goal.planner,
            goal.scaling,
            goal.via,
            timeout_s=self._settings.timeout_s,
            algorithm=goal.algorithm,
            synchronization=goal.synchronization,
            arc=goal.arc,
            through=goal.through,
            radius_m=goal.radius_m,
            tcp_speed=goal.tcp_speed,
            constraints=goal.constraints,
        )

    async def move(self, goal: Goal, caller: Caller) -> Outcome:
        """Plan, go, and return when the arm has arrived and settled, or why it has not.

        Raises:
            ConflictError, UnavailableError, InputError: nothing has moved.
        """

        async def planned(claim: Claim, start: Array) -> Trajectory | None:
            return await self.plan(claim, self.request(goal, start), caller.timeout_s)

        return await self._move(planned, caller)

    async def move_sequence(self, goals: Sequence[Goal], radii_m: Sequence[float], caller: Caller) -> Outcome:
        """Plan all of them, and go through them as one motion; see `move`.

        Args:
            radii_m: for each goal but the last: how far from it the TCP may leave its path; none: it stops.
        """
        check_radii(goals, radii_m)

        async def planned(claim: Claim, start: Array) -> Trajectory | None:
            async def plan(request: MotionRequest) -> Trajectory | None:
                return await self.plan(claim, request, caller.timeout_s)

            async def join(work: Join) -> Blended:
                return await claim.unless_interrupted(self._planning.compute(work, caller.timeout_s))

            return await self.sequence(goals, radii_m, start, plan, join)

        return await self._move(planned, caller)

    async def sequence(
        self,
        goals: Sequence[Goal],
        radii_m: Sequence[float],
        start: Array,
        plan: Callable[[MotionRequest], Awaitable[Trajectory | None]],
        join: Callable[[Join], Awaitable[Blended]],
    ) -> Trajectory | None:
        """Several motions as one; None if the arm is there already.

        Args:
            start: where the first begins, shape (dof,), rad.
            plan: plans one.
            join: has a planning process join them.

        Raises:
            PlanningError, InputError: saying which motion.
        """
        requests: list[MotionRequest] = []
        motions: list[Trajectory] = []
        radii: list[float] = []
        for number, (goal, radius) in enumerate(zip(goals, [*radii_m, *[0.0] * len(goals)], strict=False), 1):
            request = self.request(goal, start)
            try:
                motion = await plan(request)
            except (PlanningError, InputError) as exc:
                error = exc.said(f"motion {number}: {exc}")
                if exc.explanation is not None:
                    error.explanation = replace(exc.explanation, motion=number)
                raise error from exc
            if motion is not None:
                requests.append(request)
                motions.append(motion)
                radii.append(radius)
                start = motion.end
            elif radii:  # It ends where the one before does: who wants to be there, stops.
                radii[-1] = min(radii[-1], radius)
        if not motions:
            return None
        blended = await join(partial(joined, requests=requests, motions=motions, radii_m=radii[:-1]))
        return blended.trajectory

    async def _move(
        self, planned: Callable[[Claim, Array], Awaitable[Trajectory | None]], caller: Caller
    ) -> Outcome:
        begun_s = self._link.clock.now_s()
        planned_s, note = begun_s, ""
        with self._ownership.claim(caller) as claim, contextlib.ExitStack() as watch:
            watch.enter_context(watching(claim, caller))
            error: CobotError | None = None
            try:
                state = await self.ready()
                claim.accept()
                trajectory = await planned(claim, state.commanded_position)
                planned_s = self._link.clock.now_s()
                if trajectory is not None:
                    note = trajectory.note
                    await self.start(claim, trajectory)
                    if not caller.waits:
                        watch.close()
                    await self.arrival(claim)
            except (PlanningError, ExecutionError) as exc:
                error = exc
                claim.fail(exc)
            now_s = self._link.clock.now_s()
            planning_s = (planned_s if planned_s > begun_s else now_s) - begun_s
            return Outcome(error, claim.motion_id, now_s - begun_s, planning_s, note)

    async def run(
        self,
        trajectory: Trajectory | None,
        require: Callable[[Array], None],
        caller: Caller,
        fence: Fence | None = None,
    ) -> Outcome:
        """Run what was planned before, and return when the arm has arrived, or why it has not.

        Args:
            trajectory: None if there is nothing to move.
            require: raises if the commanded joints, shape (dof,), rad, are not where the motion begins, or
                anything else is not as when it was planned. Called by who owns the right to move.
            fence: that the TCP may not leave.

        Raises:
            ConflictError, UnavailableError, InputError: nothing has moved.
        """
        begun_s = self._link.clock.now_s()
        with self._ownership.claim(caller) as claim, contextlib.ExitStack() as watch:
            watch.enter_context(watching(claim, caller))
            error: CobotError | None = None
            try:
                require((await self.ready()).commanded_position)
                claim.accept()
                if trajectory is not None:
                    await self.start(claim, trajectory, fence)
                    if not caller.waits:
                        watch.close()
                    await self.arrival(claim)
            except ExecutionError as exc:
                error = exc
                claim.fail(exc)
            note = "" if trajectory is None else trajectory.note
            return Outcome(error, claim.motion_id, self._link.clock.now_s() - begun_s, 0.0, note)

    async def ready(self) -> RobotState:
        """A state from which a motion may start.

        Raises:
            UnavailableError: see `RobotLink.ready_state`.
            ConflictError: the arm still moves for somebody who is gone.
        """
        state = await self._link.ready_state(STATE_TIMEOUT_S)
        if state.mode is not LoopMode.HOLD:
            raise ConflictError(f"the arm still moves: motion {state.motion_id} is in mode {state.mode.name}")
        return state

    async def plan(self, claim: Claim, request: PlanRequest, timeout_s: float) -> Trajectory | None:
        """Plan on behalf of a claim; an interruption kills the planner."""
        try:
            return await claim.unless_interrupted(self._planning.plan(request, timeout_s))
        except MotionTimeout as exc:
            raise PlanningTimeout.after(timeout_s, f"not planned within {timeout_s:g} s") from exc

    async def start(self, claim: Claim, trajectory: Trajectory, fence: Fence | None = None) -> None:
        """Hand the motion to rtloop; it sees to it that the TCP does not leave the fence.

        Raises:
            ExecutionError, UnavailableError, InputError: see `RobotLink.start`.
            CollisionError: the scene has changed since it was planned.
        """
        if claim.speed_override.paused:
            await claim.unless_interrupted(claim.speed_override.opened.wait())
        if claim.since_s <= self.scene_changed_s:  # it may have been planned before
            await self._require_free(trajectory)
        claim.proceed()
        tool = self._robot.model.carried.version  # it cannot change while somebody has a claim
        claim.motion_id = await self._link.start(trajectory, claim.stops, tool, fence)
        logs.bind(motion=claim.motion_id)
        if claim.job is not None:
            claim.job.started(claim.motion_id, trajectory)
        await claim.speed_override.begun()

    async def replace(self, claim: Claim, trajectory: Trajectory, offset_s: float, planned_s: float) -> None:
        """Have the motion under way go on with another trajectory, see `RobotLink.replace`.

        Args:
            planned_s: when it was planned, on the link's clock.

        Raises:
            ExecutionError, UnavailableError, InputError: see `RobotLink.replace`.
            CollisionError: the scene has changed since; the motion goes on as it was.
        """
        checked_s = planned_s
        if planned_s <= self.scene_changed_s:
            checked_s = self._link.clock.now_s()
            await self._require_free(trajectory)
        claim.proceed()
        await self._link.replace(trajectory, offset_s, claim.stops, self._robot.model.carried.version)
        if claim.job is not None:
            claim.job.prolonged(trajectory)
        if checked_s <= self.scene_changed_s:  # who has changed it may have looked at the one before
            try:
                await self._require_free(trajectory)
            except CollisionError as exc:
                claim.interrupt(MotionStopped(str(exc)))

    async def _require_free(self, trajectory: Trajectory) -> None:
        checker = await asyncio.to_thread(self._robot.collision.among, self._robot.collision.scene)
        await asyncio.to_thread(checker.check_trajectory, trajectory)

    async def arrival(self, claim: Claim) -> None:
        """Wait until the motion has ended.

        Raises:
            ExecutionError: it did not arrive; its class and text say why.
            UnavailableError: rtloop is gone.
        """
        give_up_s = float("inf")
        begun_s = self._link.clock.now_s()
        while True:
            try:
                state = await self._link.fresh_state(STATE_TIMEOUT_S)
            except UnavailableError:
                self._link.request_stop()  # if rtloop goes on after all, then not with a motion of nobody's
                raise
            if state.motion_id != claim.motion_id:
                # Of the cycle before the acknowledgement; or rtloop has died before it could publish one.
                if state.published_s > begun_s:
                    raise ExecutionError("rtloop was restarted; the motion has not begun")
            elif state.motion_result is not MotionResult.RUNNING:
                break
            if claim.interruption is not None and give_up_s == float("inf"):
                self._link.request_stop()
                give_up_s = self._link.clock.now_s() + REST_TIMEOUT_S
            if self._link.clock.now_s() > give_up_s:
                raise ExecutionError(
                    f"{claim.interruption}; the arm has not come to rest within {REST_TIMEOUT_S:.0f} s"
                )
            await asyncio.sleep(POLL_S)
        if state.motion_result in WHERE:
            share = 100.0 * state.path_time_s / state.path_duration_s
            cause = claim.interruption or MotionStopped(state.reason)
            where = WHERE[state.motion_result]
            raise type(cause)(f"{cause}: the arm came to rest {where} after {share:.0f} % of it")
        if state.motion_result is not MotionResult.ARRIVED:
            raise ExecutionError(state.reason)


def check_radii(goals: Sequence[Goal], radii_m: Sequence[float]) -> None:
    """There is a radius for each corner, or none at all, and none beside constraints.

    Raises:
        InputError: it is not so.
    """
    if radii_m and len(radii_m) != len(goals) - 1:
        raise InputError(
            f"radii: {len(goals)} motions need {len(goals) - 1}, one for each but the last; "
            f"got {len(radii_m)}"
        )
    for number, radius in enumerate(radii_m):
        if radius > 0.0 and any(goal.constraints for goal in goals[number : number + 2]):
            raise InputError(f"radii[{number}]: a round corner would not keep the constraints; use 0")


def _point(frame: Pose, point: Array) -> Array:
    """A point of a frame in the base frame."""
    return np.asarray(frame.position + rotation_matrix(frame.quaternion) @ point)
