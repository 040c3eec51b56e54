"""Motions with force: press, follow, search and insert, as jobs.

Each of these motions is a Cartesian session with force control along the push direction. rtloop controls the
force and checks its maximum in every cycle. The service commands the TCP pose and the force a hundred times a
second, as calculated by the stages in `force_stages`. During a pause, the TCP holds its position and keeps
the contact.

Forces are relative to those at the beginning of the motion, so a small error in the payload has no effect.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial

import numpy as np

from app.services.motion.goals import Goals
from app.services.motion.planning import PlanningService
from app.services.motion.planning_tasks import plan_motion
from app.services.rights.claims import Caller
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from app.services.streaming.force_run import PERIOD_S, ForceOutcome, ForceRun, TouchPoint, outcome_word
from app.services.streaming.force_stages import (
    NotMet,
    Push,
    Stage,
    approach,
    follow,
    hold,
    insert,
    search,
)
from app.services.streaming.sessions import StreamService, StreamSession
from cobot.errors import (
    CobotError,
    ConditionNotMet,
    ConflictError,
    InputError,
    MotionTimeout,
    NotSupportedError,
    UnavailableError,
)
from cobot.ipc.layout import Interpolation, Stream
from cobot.ipc.session_rules import decimation, force_gain, nominal_session
from cobot.motions.force_bodies import AnyForceMotion, FollowMotion, InsertMotion, PressMotion, SearchMotion
from cobot.motions.requests import MotionRequest
from cobot.motions.signals import Condition
from cobot.pose import Pose
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array

ANSWER_S = 2.0
"""Timeout for rtloop's answer when a session begins, s."""
MIN_ROOM_N = 20.0
"""Minimum difference between the default of `max_force` and `force`, N."""
MOVED_RAD = 1e-3
"""Maximum permitted motion of a joint while the path is being planned, rad."""
INSERT_SHARE = 0.2
"""TCP stiffness across the push during an insertion, as a share of the nominal stiffness. With a higher
stiffness, the peg would turn in the hand when its edge touches the hole.
"""
LET_GO = "the motion with force has ended"


class ForceMotionService:
    """Executes the force motions of one robot."""

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        ownership: Ownership,
        streams: StreamService,
        goals: Goals,
        planning: PlanningService,
    ) -> None:
        self._robot = robot
        self._link = link
        self._ownership = ownership
        self._streams = streams
        self._goals = goals
        self._planning = planning

    async def run(
        self,
        body: AnyForceMotion,
        goal: MotionRequest | None,
        caller: Caller,
        until: Condition | None = None,
    ) -> ForceOutcome:
        """Run a motion with force. Returns when the arm is at rest.

        Args:
            goal: goal of the path, for a `FollowMotion`; otherwise None.
            until: condition on an input that ends a search; None for none.

        Raises:
            InputError: the path length is zero, or the fields of the request are invalid.
            NotSupportedError: the backend has no force control or measures no force. The error names it.
            ConflictError, NotReadyError, ExecutionError, UnavailableError: the session cannot begin; nothing
                has moved. See `StreamService.open`.
            PlanningError: the path cannot be planned.
        """
        self._require_able()
        direction = _unit(body)
        path = None if goal is None else await self._plan(goal, caller)
        state = self._link.state()
        start = self._robot.model.forward(state.commanded_position)
        if path is not None and np.abs(path.start - state.commanded_position).max() > MOVED_RAD:
            raise ConflictError("the arm has moved while the path was being planned; send the request again")
        in_tool = body.frame == "tool"
        axis = start.rotation @ direction if in_tool else direction
        most_n = _max_force(body)
        gain = force_gain(self._stiffness(body))
        approach_n = min(body.speed / gain, 0.5 * (body.force + most_n)) if gain else body.force
        push = Push(start, axis, body.force, approach_n, body.max_distance)
        work = ForceRun(self._link, self._ownership, push, body, caller)
        request = self._request(body, direction, axis, work.free_n)
        session = await self._streams.open(request, caller.name, ANSWER_S, caller=caller)
        return await self._carry_out(session, work, path, until)

    async def _carry_out(
        self, session: StreamSession, work: ForceRun, path: Trajectory | None, until: Condition | None
    ) -> ForceOutcome:
        job, override = work.caller.job, self._ownership.speed_override
        begun_s = self._link.clock.now_s()
        error: CobotError | None = None
        override.follows_stream = True
        try:
            if job is not None:
                job.start()
            await work.drive(session, self._stages(work, path, until))
        except NotMet as exc:
            work.outcome.stopped_by = exc.by
            if work.body.if_not_met == "error":
                error = MotionTimeout(str(exc)) if exc.by == "max_time" else ConditionNotMet(str(exc))
        except CobotError as exc:
            work.outcome.stopped_by, error = exc.code, exc
        finally:
            if error is not None and job is not None:
                job.fail(error)
            session.end(LET_GO)
            override.follows_stream = False
        await asyncio.shield(session.ended)
        outcome = work.outcome
        outcome.error, outcome.duration_s = error, self._link.clock.now_s() - begun_s
        if outcome.held:
            outcome.force_n = float(np.mean(outcome.held))
        return outcome

    def _stages(self, work: ForceRun, path: Trajectory | None, until: Condition | None) -> Stage:
        """Run all stages of a motion, as one generator."""
        body, push, outcome = work.body, work.push, work.outcome
        felt = outcome.held.append
        touched = yield from approach(push)
        outcome.contact = TouchPoint(touched.pose, push.distance_m(touched.pose), touched.force_n)
        last = touched
        if isinstance(body, PressMotion):
            last = yield from hold(push, body.duration_s, felt)
            outcome.stopped_by = "duration"
        elif isinstance(body, FollowMotion) and path is not None:
            along = self._poses(path)
            last = yield from follow(push, touched, along, path.duration_s, body.max_deviation, felt)
            outcome.stopped_by = "path_end"
        elif isinstance(body, SearchMotion):
            last = yield from search(push, touched, body, self._input_holds(until), outcome_word(outcome))
            if isinstance(body, InsertMotion):
                last = yield from insert(push, touched, last, body)
                outcome.stopped_by = "depth"
        return last

    def _input_holds(self, until: Condition | None) -> Callable[[], bool]:
        """Create a function that returns whether the input has the value that the condition requires."""

        def holds() -> bool:
            if until is None:
                return False
            report = self._link.io()
            points = () if report is None else report.points
            value = next((each.value for each in points if each.name == until.name), None)
            if value is None:
                raise UnavailableError(f"until: the device no longer reports the input {until.name}")
            return until.low < value < until.high

        return holds

    def _poses(self, path: Trajectory) -> Callable[[float], Pose]:
        return lambda path_s: self._robot.model.forward(path.sample([path_s])[0])

    async def _plan(self, goal: MotionRequest, caller: Caller) -> Trajectory:
        await self._ownership.await_free(caller.token)
        start = (await self._link.await_ready_state(ANSWER_S)).commanded_position
        work = partial(plan_motion, request=self._goals.request(goal, start))
        path = await self._planning.compute(work, caller.timeout_s)
        if path is None:
            raise InputError("motion: the TCP is already at the end, so there is no path to follow")
        return path

    def _require_able(self) -> None:
        named = self._link.device()
        if named is None:
            raise UnavailableError("the capabilities of the robot's backend cannot be read")
        backend, device = named
        able = device.capabilities
        refusal = able.lacks(backend, "a motion with force", "impedance", "wrench") or able.does_not_measure(
            backend, "a motion with force", "wrench"
        )
        if refusal:
            raise NotSupportedError(refusal)

    def _request(self, body: AnyForceMotion, direction: Array, axis: Array, free_n: Array) -> np.ndarray:
        request = nominal_session(self._streams.info)
        request["stream"], request["interpolation"] = Stream.CARTESIAN, Interpolation.LINEAR
        request["decimation"] = decimation(1.0 / PERIOD_S, self._streams.period_s)
        request["force_axes"] = (0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        request["force_velocity"][:3] = body.speed
        # the push direction turns with the tool
        turns = isinstance(body, FollowMotion) and body.frame == "tool"
        request["force_in_tcp"] = turns
        request["force_frame"][3:] = _frame_along(direction if turns else axis)
        request["max_contact_wrench"][:3] = _max_force(body) + np.abs(free_n)
        request["cartesian_stiffness"] = self._stiffness(body)
        return request

    def _stiffness(self, body: AnyForceMotion) -> Array:
        """Return the TCP stiffness, shape (6,), N/m and N·m/rad."""
        stiffness: Array = self._streams.info["cartesian_stiffness"].copy()
        if isinstance(body, InsertMotion):
            stiffness[:3] *= INSERT_SHARE
            stiffness[3:] *= body.compliance
        return stiffness


def _max_force(body: AnyForceMotion) -> float:
    """Return the force above which rtloop stops the arm, N."""
    return body.max_force or max(2.0 * body.force, body.force + MIN_ROOM_N)


def _unit(body: AnyForceMotion) -> Array:
    direction = np.array([body.direction.x, body.direction.y, body.direction.z])
    unit: Array = direction / np.linalg.norm(direction)
    return unit


def _frame_along(axis: Array) -> Array:
    """Return the quaternion (w, x, y, z) of a frame whose z axis points along a unit vector."""
    w = 1.0 + float(axis[2])
    if w < 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.array([w, -axis[1], axis[0], 0.0])
    unit: Array = quaternion / np.linalg.norm(quaternion)
    return unit
