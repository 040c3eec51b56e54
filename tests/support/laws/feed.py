"""What `rtloop.streaming.feed` decides, in plain Python.

Source, safety layer, collision monitor, inboxes and point queue are given: they have oracles of their own.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cobot.ipc.layout import Intervention
from cobot.ipc.shm import RobotMemory
from cobot.types import Array
from rtloop.inboxes.point_queue import PointQueue
from rtloop.inboxes.stream import StreamInbox
from rtloop.safety.limiter import Safety
from rtloop.streaming.collision_monitor import CollisionMonitor

CLIENT_ENDED, SERVO_WATCHDOG = 1, 4
PERIODS_TO_TIMEOUT, FINISH_S, DEFAULT_INTERVAL_S = 3, 1.0, 0.01


class Feed:
    """What both kinds of session share."""

    def __init__(
        self,
        source: Any,
        safety: Safety,
        monitor: CollisionMonitor,
        memory: RobotMemory,
        box: StreamInbox,
        period_s: float,
        request: np.ndarray,
    ) -> None:
        self.source, self._safety, self._monitor = source, safety, monitor
        self._memory, self._box, self._period_s = memory, box, period_s
        self._session = int(request["number"])
        self.holding = self.not_finite = self._blocked = self._slowed = False
        self.problem = 0
        self._silent_cycles = 0

    def watch_surroundings(self) -> None:
        safety, monitor = self._safety, self._monitor
        monitor.look(safety.motion)
        near = monitor.share < 1.0
        if near and not self._slowed:
            safety.count(Intervention.PROXIMITY)
        self._slowed = near
        safety.slow_down(monitor.share)
        if monitor.blocked and not self.holding:
            self._blocked = True
            self._hold(Intervention.COLLISION)

    def _judge(self, flaw: Intervention | None) -> None:
        """Follow the target that was just taken, or not."""
        if flaw is Intervention.NOT_FINITE:
            self._safety.count(flaw)
            self.not_finite = True
        elif flaw is not None:
            self._hold(flaw)
        elif self._blocked:
            self._blocked = self._monitor.blocked or not self._monitor.leads_away(
                self._safety.position, self.source.heading
            )
            self.holding = self._blocked
        elif self._monitor.inside:
            self._follow_unless_deeper(self.source.heading)
        else:
            self.holding = False

    def _follow_unless_deeper(self, heading: Array) -> None:
        if self._monitor.leads_deeper(self._safety.position, heading):
            self._blocked = True
            self._hold(Intervention.COLLISION)
        else:
            self.holding = False

    def _hold(self, why: Intervention) -> None:
        if not self.holding:
            self._safety.count(why)
        self.holding = True


class TargetFeed(Feed):
    """The newest setpoint every few cycles, moves to a pose, and chunks of timed targets."""

    def __init__(self, *rest: Any, request: np.ndarray, timeout_cycles: int) -> None:
        super().__init__(*rest, request)
        self._decimation = int(request["decimation"])
        self._patience_cycles = max(timeout_cycles, PERIODS_TO_TIMEOUT * self._decimation)
        self.setpoint_seen = self.move_seen = self.chunk_seen = self._cancel_seen = 0
        self._live = self._target_waits = False
        self._starved = 0
        self._untaken_cycles = self._decimation

    @property
    def move_running(self) -> bool:
        return hasattr(self.source, "move_running") and bool(self.source.move_running)

    def advance(self, external_effort: Array, wrench: Array, robot_time_s: float) -> None:
        self._silent_cycles += 1
        self._untaken_cycles += 1
        self._read_setpoint()
        if self._box.chunk.take_news():
            self._take_chunk(robot_time_s)
        if self._live and self._silent_cycles > self._patience_cycles:
            self._live = False
            self._hold(Intervention.COMMAND_TIMEOUT)
        if not self.holding:
            self.source.advance(external_effort, wrench)
        if hasattr(self.source, "starved") and self.source.starved != self._starved:
            self._starved = self.source.starved
            self._safety.count(Intervention.COMMAND_TIMEOUT)

    def _read_setpoint(self) -> None:
        """Moves at once, a target when it is time for one."""
        box = self._box.setpoint
        if box.take_news():
            self._target_waits = True
            if hasattr(self.source, "start_move") and int(box.data["session"]) == self._session:
                self._take_move(box.data)
        if self._target_waits and box.readable and self._untaken_cycles >= self._decimation:
            self._target_waits = False
            self._take(box.data)

    def _take(self, setpoint: np.ndarray) -> None:
        number = int(setpoint["number"])
        if int(setpoint["session"]) != self._session or number == self.setpoint_seen:
            return
        self._untaken_cycles = 0
        interval_s = max(DEFAULT_INTERVAL_S, self._decimation * self._period_s)
        if self.setpoint_seen:
            interval_s = self._silent_cycles * self._period_s
        self.setpoint_seen = number
        if self.move_running:
            return
        self._silent_cycles = 0
        self._live = True
        self._end_hold()
        self._judge(self.source.take(self._memory.setpoint, interval_s))

    def _take_move(self, setpoint: np.ndarray) -> None:
        source = self.source
        move, cancel = int(setpoint["move"]), int(setpoint["cancel"])
        if move != self.move_seen:
            self.move_seen = move
            self._live = False
            self._end_hold()
            self._judge(source.start_move(setpoint["move_pose"], float(setpoint["move_duration_s"])))
        if cancel != self._cancel_seen:
            self._cancel_seen = cancel
            if cancel == self.move_seen and source.move_running:
                source.cancel_move()
                self.holding = True

    def _take_chunk(self, robot_time_s: float) -> None:
        source, chunk = self.source, self._box.chunk.data
        if int(chunk["session"]) != self._session or not hasattr(source, "take_chunk"):
            return
        self.chunk_seen = int(chunk["number"])
        self._end_hold()
        late = source.late
        flaw = source.take_chunk(self._memory.chunk, robot_time_s)
        if flaw is None or flaw is Intervention.NOT_FINITE:
            self._live = False
            self._judge(flaw)
        if flaw in (Intervention.JUMP, Intervention.LATE) or source.late != late:
            self._safety.count(flaw or Intervention.LATE)  # and the chunk before goes on

    def _end_hold(self) -> None:
        """A target ends the waiting, from wherever the arm is by now."""
        if self.holding:
            self.source.begin(self._safety.command)


class PointFeed(Feed):
    """The points of a servo session, none of which is left out."""

    def __init__(self, source: Any, points: Any, queue: PointQueue, *rest: Any) -> None:
        super().__init__(source, *rest)
        self._points, self._queue = points, queue
        self._watchdog_cycles = round(float(rest[-1]["watchdog_s"]) / self._period_s)
        self._finishing_cycles = self._dropped = self._judged = 0

    def advance(self, external_effort: Array, wrench: Array, robot_time_s: float) -> None:
        finishes = self._box.finishes
        self._silent_cycles += 1
        if self._queue.poll():
            self._silent_cycles = 0
        elif self._silent_cycles > self._watchdog_cycles and not (self.problem or finishes):
            self._safety.count(Intervention.COMMAND_TIMEOUT)
            self.problem = SERVO_WATCHDOG
        news = self._box.setpoint.take_news() and int(self._box.setpoint.data["session"]) == self._session
        if news and hasattr(self.source, "press"):
            self.source.press(self._box.setpoint.data["wrench"])
        if finishes:
            self._finishing_cycles += 1
            waiting = self._queue.waiting or self._points.buffered
            done = not waiting and not self.source.reference[1:].any()
            if done or self._finishing_cycles * self._period_s > FINISH_S:
                self.problem = self.problem or CLIENT_ENDED
        if self._points.fetch(self._queue) is Intervention.NOT_FINITE:
            self._safety.count(Intervention.NOT_FINITE)
            self.not_finite = True
        if self._points.dropped != self._dropped:
            self._dropped = self._points.dropped
            self._safety.count(Intervention.JUMP)
        if self._queue.seen != self._judged and self._monitor.inside and not self.holding:
            self._follow_unless_deeper(self._points.heading)
        self._judged = self._queue.seen
        if not self.holding:
            self.source.advance(external_effort, wrench)
