"""What the service can do. Routers call one of these; only these touch shared memory."""

from __future__ import annotations

from dataclasses import dataclass

from app.services.equipment import Equipment
from app.services.fjt import FollowJointTrajectory
from app.services.force import ForceService
from app.services.health import HealthService
from app.services.link import RobotLink
from app.services.motion import MotionService
from app.services.motion_queue import MotionQueue
from app.services.ownership import Ownership
from app.services.planning import PlanningService
from app.services.programs import ProgramService
from app.services.robot_settings import RobotSettings
from app.services.sequences import SequenceService
from app.services.servo import ServoService
from app.services.stopping import StopService
from app.services.streams import StreamService
from app.services.sync import SyncService
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
    equipment: Equipment
    force: ForceService
    programs: ProgramService
    sync: SyncService
    planning: PlanningService
    settings: RobotSettings
    queue: MotionQueue
    servo: ServoService
    fjt: FollowJointTrajectory
