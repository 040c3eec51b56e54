"""What the service can do. Routers call one of these; only these touch shared memory."""

from __future__ import annotations

from dataclasses import dataclass

from app.actions.fjt import FollowJointTrajectory
from app.services.devices.equipment import Equipment
from app.services.motion.execution import MotionService
from app.services.motion.ownership import Ownership
from app.services.motion.planning import PlanningService
from app.services.motion.queue import MotionQueue
from app.services.motion.stopping import StopService
from app.services.motion.synchronous import SyncService
from app.services.motion.tool_and_limits import RobotSettings
from app.services.motion.trajectories import TrajectoryService
from app.services.programs.programs import ProgramService
from app.services.programs.sequences import SequenceService
from app.services.state.health import HealthService
from app.services.state.link import RobotLink
from app.services.streaming.force import ForceService
from app.services.streaming.servo import ServoService
from app.services.streaming.sessions import StreamService
from cobot.robot.description import RobotDescription


@dataclass(frozen=True, slots=True)
class Services:
    """All services of one robot."""

    robot: RobotDescription
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
