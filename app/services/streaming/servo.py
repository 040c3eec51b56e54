"""Servo sessions: points that clients send one by one, followed in one of seven modes.

`cobot.servo.protocol` has the protocol's rules, rtloop the modes; this is what lies between: who owns
the arm, sessions that begin and end, inverse kinematics, the queue of points. A long module, because a
session that ends while the next one begins is one state.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from app.services.motion.tool_and_limits import RobotSettings
from app.services.state.link import RobotLink
from app.services.streaming.force import ForceService, ForceSettings
from app.services.streaming.sessions import Session, StreamService
from cobot.errors import (
    CobotError,
    ConflictError,
    InputError,
    LimitError,
    TornReadError,
    UnreachableError,
)
from cobot.ipc.layout import POINTS, Interpolation, ServoMode, Stream, setpoint_dtype
from cobot.ipc.session_rules import nominal_session
from cobot.ipc.stream_writer import PointWriter
from cobot.robot.description import RobotDescription
from cobot.robot.frames import pose_from_abc
from cobot.robot.inverse_kinematics import continued
from cobot.servo.fields import BrokenRule, Refusal
from cobot.servo.protocol import FjtControl, Point, ServoRules, SetMode, Stop
from cobot.types import Array

NAME = "a servo session"
OPEN_TIMEOUT_S = 2.0
PATIENCE_S = 0.5
"""How long a session waits for a motion that has just arrived to let go of the arm."""
RETRY_S = 0.02
FAILURE_COST = 4.0
"""After inverse kinematics that have failed, none is tried for so many times as long as that took: a stream
of points out of reach must not keep the service busy."""
FORCE_MODES = (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)

log = logging.getLogger("cobot.servo")


class ServoService:
    """One robot's servo sessions: one at a time, and while there is one it owns the motion.

    Attributes:
        rules: the protocol's state and counts.
        reason: why the last session has ended, or could not begin; "" while one is under way.
    """

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        streams: StreamService,
        force: ForceService,
        settings: RobotSettings,
    ) -> None:
        limits = robot.limits
        self.rules = ServoRules(limits.min_position.tolist(), limits.max_position.tolist(), streams.period_s)
        self.reason = ""
        self._robot = robot
        self._link = link
        self._streams = streams
        self._force = force
        self._settings = settings
        self._writer = PointWriter(link.memory)
        self._session: Session | None = None  # rtloop's, until the arm rests
        self._belongs_to = 0  # the generation that it was begun for
        self._generation = 0  # of what was asked for
        self._task: asyncio.Task[None] | None = None
        self._followers: set[asyncio.Task[None]] = set()
        self._waiting: deque[tuple[Sequence[float], Point]] = deque()
        self._last: Array | None = None
        self._no_inverse_before_s = 0.0
        self._pressed: ForceSettings | None = None
        self._presses = 0

    @property
    def active(self) -> bool:
        """Whether points are taken."""
        return self.rules.active

    @property
    def session(self) -> int:
        """The number of what was asked for last."""
        return self._generation

    def holds(self, session: int) -> bool:
        """Whether this session is still the one that takes points."""
        return self.rules.active and self._generation == session

    async def handle(self, text: str) -> None:
        """One message of /{robot}/joint_cmd; what is refused is counted, see `feedback`."""
        self.receive(text)

    def receive(self, text: str) -> None:
        """The same, at once. A session begins in the background; points that come meanwhile wait for it."""
        message = self.rules.read(text)
        match message:
            case SetMode():
                self._request(message)
            case Stop():
                self._leave("stopped by servo_control", at_once=False)
            case FjtControl():
                self.rules.fjt = message
            case Point():
                with contextlib.suppress(BrokenRule):
                    self._take(message)

    async def begin(
        self,
        mode: int,
        watchdog_s: float = 0.0,
        send_period_s: float = 0.0,
        *,
        stops: int | None = None,
        owner: str = "",
    ) -> int:
        """Begin a session, after the one before has ended at rest; mode 0 only ends that.

        Args:
            watchdog_s: without a point for so long, the session ends; 0 for 0.5 s.
            send_period_s: how often points come; 0 for the control period.
            stops: `RobotLink.stops` when the session was asked for, if that was not now.
            owner: who alone sends its points; "" for anybody.

        Returns:
            what `holds` asks for.

        Raises:
            InputError: no such mode, or a time out of range.
            ConflictError: somebody else moves the arm, or a stop has overtaken it.
            NotReadyError, ExecutionError, UnavailableError: see `StreamService.open`.
        """
        try:
            request = self.rules.request(mode, watchdog_s, send_period_s)
        except BrokenRule as exc:
            raise InputError(str(exc)) from None
        if request.mode is ServoMode.NONE:
            await self.end()
            return self._generation
        task = self._request(request, stops, owner)
        number = self._generation
        await asyncio.shield(task)
        return number

    async def end(self, reason: str = "ended by its owner") -> None:
        """End the session; returns when the arm rests."""
        session = self._session
        self._leave(reason)
        if self._task is not None:
            await asyncio.wait({self._task})
        if session is not None:
            await asyncio.shield(session.ended)

    async def point(
        self,
        position: Sequence[float],
        *,
        cartesian: bool = False,
        time_s: float = 0.0,
        lookahead_s: float = 0.0,
        gain: float = 0.0,
        owner: str = "",
    ) -> None:
        """A point of the session: joints in rad, or [x, y, z, rx, ry, rz]; 0 is the default for the rest.

        Args:
            owner: see `begin`.

        Raises:
            ConflictError: there is no session, or the buffer is full.
            LimitError, UnreachableError, InputError: it cannot be a target, and why.
        """
        try:
            point = self.rules.point(
                position, cartesian=cartesian, time_s=time_s, lookahead_s=lookahead_s, gain=gain, owner=owner
            )
        except BrokenRule as exc:
            self.rules.refuse(exc.kind, str(exc))
            raise _error(exc) from None
        try:
            self._take(point)
        except BrokenRule as exc:
            raise _error(exc) from None

    def feedback(self) -> dict[str, Any]:
        """What the session is doing, and what was refused since it began; counts without a session stay."""
        rules = self.rules
        counts = dict.fromkeys(("points_taken", "points_dropped", "points_buffered", "underruns"), 0)
        with contextlib.suppress(TornReadError):
            record = self._link.memory.state.read()
            counts = {name: int(record[name]) for name in counts}
        refused = {str(kind): count for kind, count in rules.refused.items()}
        return {
            "state": self._phase(),
            "mode": int(rules.mode) if rules.active else 0,
            "active": rules.active,
            "session_id": rules.session_id or 0,
            "point_id": rules.point_id or 0,
            "watchdog_timeout": rules.watchdog_s,
            "send_period": rules.send_period_s,
            "points_received": rules.received,
            "points_accepted": rules.accepted,
            "points_refused": rules.refused.total(),
            "refused": refused,
            "last_refusal": rules.last_refusal,
            "points_taken": counts["points_taken"],
            "jumps": counts["points_dropped"],
            "buffered": counts["points_buffered"] + len(self._waiting),
            "underruns": counts["underruns"],
            "overruns": rules.refused[Refusal.OVERRUN],
            "reason": self.reason,
        }

    def close(self) -> None:
        """Let go; rtloop ends the session with this process."""
        for task in (self._task, *self._followers):
            if task is not None:
                task.cancel()

    def _phase(self) -> str:
        if not self.rules.active:
            return "idle" if self._session is None else "closing"
        return "opening" if self._current is None else "active"

    @property
    def _current(self) -> Session | None:
        """The session that was asked for last, once it has begun; not one that comes to its end."""
        return self._session if self._belongs_to == self._generation else None

    def _request(self, request: SetMode, stops: int | None = None, owner: str = "") -> asyncio.Task[None]:
        """Leave the session, and begin another unless that is mode 0."""
        before, session = self._task, self._session
        ends = request.mode is ServoMode.NONE
        self._leave("ended by mode 0" if ends else "another session was asked for")
        if not ends:
            self.rules.begin(request, owner)
            self.reason = ""
        stops = self._link.stops if stops is None else stops
        work = self._open(request, self._generation, stops, before, session)
        self._task = asyncio.create_task(work, name="servo session")
        self._task.add_done_callback(_seen)
        return self._task

    def _leave(self, reason: str, *, at_once: bool = True) -> None:
        """No points are taken any more, and the arm comes to rest: at once, or after the points it has."""
        self._generation += 1
        self._waiting.clear()
        if self.rules.active:
            self.reason = reason
        self.rules.end()
        if self._session is not None and at_once:
            self._session.end(reason)
        elif self._session is not None:
            self._session.finish(reason)

    async def _open(
        self,
        request: SetMode,
        generation: int,
        stops: int,
        before: asyncio.Task[None] | None,
        last: Session | None,
    ) -> None:
        if before is not None:
            await asyncio.wait({before})
        last = self._session or last
        if last is not None:
            await asyncio.shield(last.ended)
        if request.mode is ServoMode.NONE or generation != self._generation:
            return
        try:
            session = await self._begun(request, stops)
        except CobotError as exc:
            if generation == self._generation:
                self._fail(str(exc))
            log.warning("%sservo mode %d was refused: %s", self._link.label, request.mode, exc)
            raise
        follower = asyncio.create_task(self._follow(session, generation, request.mode))
        self._followers.add(follower)
        follower.add_done_callback(self._followers.discard)
        self._session, self._belongs_to = session, generation
        if generation != self._generation:
            session.end("another session was asked for, or none")
            raise ConflictError("the servo session was ended while it began")
        self._writer.begin(session.number)
        self._press()
        while self._waiting:
            self._pass_on(*self._waiting.popleft())

    async def _begun(self, request: SetMode, stops: int) -> Session:
        """Ask rtloop, which refuses what a stop has overtaken; who is about to let go is waited for."""
        deadline_s = self._link.clock.now_s() + PATIENCE_S
        if request.mode in FORCE_MODES:
            await self._force.lend()
        try:
            while True:
                self._last = None
                try:
                    return await self._streams.open(
                        self._session_request(request), NAME, OPEN_TIMEOUT_S, stops
                    )
                except ConflictError:
                    if self._link.clock.now_s() > deadline_s:
                        raise
                await asyncio.sleep(RETRY_S)
        except CobotError:
            with contextlib.suppress(CobotError):
                await self._force.take_back()
            raise

    def _session_request(self, request: SetMode) -> np.ndarray:
        asked = nominal_session(self._streams.info)
        asked["servo_mode"], asked["watchdog_s"] = request.mode, request.watchdog_s
        asked["interpolation"], asked["decimation"] = Interpolation.NONE, 1
        asked["stream"] = Stream.JOINT_IMPEDANCE
        if request.mode in FORCE_MODES:
            asked["stream"] = Stream.CARTESIAN
            settings = self._force.settings
            if settings.enabled:
                settings.describe(asked)
            else:
                replace(settings, axes=(False,) * 6).describe(asked)
        return asked

    def _fail(self, reason: str) -> None:
        """The session could not begin: what has waited for it is refused."""
        self.reason = reason
        self.rules.end()
        lost = len(self._waiting)
        self._waiting.clear()
        self.rules.accepted -= lost
        self.rules.refuse(Refusal.REJECTED, reason, 1 + lost)

    async def _follow(self, session: Session, generation: int, mode: ServoMode) -> None:
        reason = await asyncio.shield(session.ended)
        if self._session is session:
            self._session = None
        if generation == self._generation:
            self.rules.end()
            self.reason = reason
        log.info("%sservo mode %d has ended: %s", self._link.label, mode, reason)
        if not self.rules.active:  # nobody has asked for another session
            with contextlib.suppress(CobotError):
                await self._force.take_back()

    def _take(self, point: Point) -> None:
        """Pass a point on, or have it wait for the session.

        Raises:
            BrokenRule: it is refused, and counted.
        """
        try:
            session = self._current
            if session is not None and session.over:
                raise BrokenRule(Refusal.NOT_ACTIVE, f"the servo session is over: {session.over}")
            joints = self._joints(point)
            if session is None:
                if len(self._waiting) >= POINTS:
                    raise BrokenRule(Refusal.OVERRUN, f"{POINTS} points wait for the session to begin")
                self._waiting.append((joints, point))
            else:
                self._put(joints, point)
        except BrokenRule as exc:
            self.rules.refuse(exc.kind, str(exc))
            raise
        self._last = np.array(joints)
        self.rules.accept(point)

    def _pass_on(self, joints: Sequence[float], point: Point) -> None:
        """A point that has waited, and was accepted."""
        try:
            self._put(joints, point)
        except BrokenRule as exc:
            self.rules.accepted -= 1
            self.rules.refuse(exc.kind, str(exc))

    def _put(self, joints: Sequence[float], point: Point) -> None:
        if self._force.settings is not self._pressed:
            self._press()
        if not self._writer.put(joints, point.time_s, point.lookahead_s, point.gain):
            raise BrokenRule(Refusal.OVERRUN, f"the buffer is full: {POINTS} points wait in it")

    def _joints(self, point: Point) -> Sequence[float]:
        if not point.cartesian:
            return point.position
        begun_s = self._link.clock.now_s()
        if begun_s < self._no_inverse_before_s:
            raise BrokenRule(
                Refusal.INVERSE_KINEMATICS, "not tried: the inverse kinematics of the point before has failed"
            )
        x, y, z, rx, ry, rz = point.position
        try:
            near = self._link.state().commanded_position if self._last is None else self._last
            pose = self._settings.tcp(pose_from_abc(x, y, z, rz, ry, rx))
            joints: list[float] = continued(self._robot.model, pose, near).tolist()
            return joints
        except CobotError as exc:
            now_s = self._link.clock.now_s()
            self._no_inverse_before_s = now_s + FAILURE_COST * (now_s - begun_s)
            raise BrokenRule(Refusal.INVERSE_KINEMATICS, str(exc)) from None

    def _press(self) -> None:
        """Tell rtloop the wrench, in the modes that exert one."""
        self._pressed = settings = self._force.settings
        session = self._current
        if session is None or session.stream is not Stream.CARTESIAN:
            return
        setpoint = np.zeros((), setpoint_dtype(self._link.memory.dof))
        setpoint["wrench"] = settings.wrench if settings.enabled else 0.0
        self._presses += 1
        with contextlib.suppress(CobotError):  # the session has just ended
            session.take_setpoint(self._presses, setpoint)


def _error(broken: BrokenRule) -> CobotError:
    """What a caller of `ServoService.point` understands."""
    match broken.kind:
        case Refusal.NOT_ACTIVE | Refusal.OVERRUN:
            return ConflictError(str(broken))
        case Refusal.LIMIT:
            return LimitError(str(broken))
        case Refusal.INVERSE_KINEMATICS:
            return UnreachableError(str(broken))
    return InputError(str(broken))


def _seen(task: asyncio.Task[None]) -> None:
    """Its error was told already."""
    if not task.cancelled():
        task.exception()
