"""What the service can do. Routers call one of these; only these touch shared memory."""

from __future__ import annotations

from dataclasses import dataclass

from app.services.health import HealthService
from app.services.link import RobotLink
from app.services.motion import MotionService
from app.services.ownership import Ownership
from app.services.sequences import SequenceService
from app.services.stopping import StopService
from app.services.streams import StreamService
from app.services.trajectories import TrajectoryService
from cobot.robot import Robot


@dataclass(frozen=True, slots=True)
class Services:
    """All services of one robot."""

    robot: Robot
    link: RobotLink
    ownership: Ownership
    motion: MotionService
    trajectories: TrajectoryService
    sequences: SequenceService
    stopping: StopService
    health: HealthService
    streams: StreamService
