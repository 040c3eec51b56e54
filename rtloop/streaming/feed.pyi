import numpy as np

from cobot.types import Array
from rtloop.inboxes.point_queue import PointQueue
from rtloop.inboxes.stream import StreamInbox
from rtloop.safety.limiter import Safety
from rtloop.sources.servo_base import ServoSource
from rtloop.sources.source import Source
from rtloop.streaming.collision_monitor import CollisionMonitor

class Feed:
    @property
    def holding(self) -> bool: ...
    @property
    def not_finite(self) -> bool: ...
    @property
    def problem(self) -> int: ...
    @property
    def source(self) -> Source: ...
    def __init__(
        self,
        source: Source,
        safety: Safety,
        monitor: CollisionMonitor,
        box: StreamInbox,
        period_s: float,
    ) -> None: ...
    def advance(self, external_effort: Array, wrench: Array, robot_time_s: float) -> None: ...
    def watch_surroundings(self) -> None: ...

class TargetFeed(Feed):
    def __init__(
        self,
        source: Source,
        safety: Safety,
        monitor: CollisionMonitor,
        box: StreamInbox,
        period_s: float,
        request: np.ndarray,
        timeout_cycles: int,
    ) -> None: ...
    @property
    def setpoint_seen(self) -> int: ...
    @property
    def move_seen(self) -> int: ...
    @property
    def chunk_seen(self) -> int: ...
    @property
    def move_running(self) -> bool: ...

class PointFeed(Feed):
    def __init__(
        self,
        source: Source,
        points: ServoSource,
        safety: Safety,
        monitor: CollisionMonitor,
        box: StreamInbox,
        queue: PointQueue,
        period_s: float,
        request: np.ndarray,
    ) -> None: ...
    @property
    def points(self) -> ServoSource: ...
    @property
    def watchdog_s(self) -> float: ...
