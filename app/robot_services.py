"""All services of one robot. Routers call only these services, and in this process only they access shared
memory.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path

from app.actions.fjt import FollowJointTrajectory
from app.services.devices.equipment import Equipment
from app.services.devices.simulation import SimulationService
from app.services.events.ring import Events
from app.services.gripping.held import HeldService
from app.services.gripping.on_path import PathCommands
from app.services.gripping.service import GripperService
from app.services.job_control import JobService
from app.services.motion.approvals import Approvals
from app.services.motion.control import ControlService
from app.services.motion.execution import LATEST_ANSWER_S, MotionService
from app.services.motion.goals import Goals
from app.services.motion.moves import MoveService
from app.services.motion.planning import PlanningService
from app.services.motion.plans import PlanService
from app.services.motion.positions import PositionService
from app.services.motion.queue.motion_queue import MotionQueue
from app.services.motion.retarget import RetargetService
from app.services.motion.scene import SceneService
from app.services.motion.synchronous import SyncService
from app.services.motion.tool import ToolService
from app.services.motion.tool_and_limits import RobotSettings
from app.services.motion.trajectories import TrajectoryService
from app.services.programs.programs import ProgramService
from app.services.programs.sequences import SequenceService
from app.services.programs.stored import StoredPrograms
from app.services.programs.studies import StudyService
from app.services.reports.health import HealthService
from app.services.reports.recordings import RecordingService
from app.services.reports.states import StateTexts
from app.services.reports.watch import watching
from app.services.rights.job_book import JobBook
from app.services.rights.ownership import Ownership
from app.services.rights.speed_override import FRACTIONS, MAX_PAUSE_S
from app.services.rights.stopping import StopService
from app.services.state.cell import CellService
from app.services.state.commands import loading_s
from app.services.state.io import IoService
from app.services.state.link import RobotLink
from app.services.streaming.force import ForceService
from app.services.streaming.force_motions import ForceMotionService
from app.services.streaming.freedrive import FreedriveService
from app.services.streaming.hung_clients import watching_clients
from app.services.streaming.servo import ServoService
from app.services.streaming.sessions import StreamService
from cobot.access.authentication import Authenticator
from cobot.addresses import address
from cobot.cell import cell_of
from cobot.cell.surroundings import tool_file
from cobot.clock import Clock
from cobot.config import Settings
from cobot.robot.description import RobotDescription

Planner = Callable[[Path | None, int, str], PlanningService]


@dataclass(frozen=True, slots=True)
class SharedParts:
    """Objects that the services of all robots share; see `app.main.create_app`.

    Attributes:
        slowest_move_s: the longest timeout of a request that moves the arm, s.
        sync: service that moves several robots together.
        several: whether there is more than one robot; log lines and addresses then name the robot.
        tokens: the access tokens of running programs.
        events: the service's events, for its listeners.
        study_turn: lock that is held while a study for any robot is running.
    """

    config: Path | None
    base_url: str
    default_robot: str
    slowest_move_s: float
    clock: Clock
    planner: Planner
    sync: SyncService
    several: bool
    tokens: Authenticator
    events: Events
    study_turn: asyncio.Lock


@dataclass(frozen=True, slots=True, kw_only=True)
class Services:
    """All services of one robot."""

    robot: RobotDescription
    link: RobotLink
    ownership: Ownership
    goals: Goals
    motion: MotionService
    moves: MoveService
    positions: PositionService
    plans: PlanService
    approvals: Approvals
    scene: SceneService
    tool: ToolService
    trajectories: TrajectoryService
    sequences: SequenceService
    stored: StoredPrograms
    studies: StudyService
    stopping: StopService
    control: ControlService
    health: HealthService
    recordings: RecordingService
    streams: StreamService
    equipment: Equipment
    force: ForceService
    force_motions: ForceMotionService
    freedrive: FreedriveService
    io: IoService
    gripper: GripperService
    path_gripper: PathCommands
    cell: CellService
    simulation: SimulationService
    programs: ProgramService
    sync: SyncService
    planning: PlanningService
    settings: RobotSettings
    queue: MotionQueue
    jobs: JobService
    retargeting: RetargetService
    servo: ServoService
    fjt: FollowJointTrajectory
    states: StateTexts


@contextlib.asynccontextmanager
async def serving_robot(
    settings: Settings, robot: RobotDescription, shared: SharedParts
) -> AsyncIterator[Services]:
    """Run the services of one robot while the context is open.

    Raises:
        UnavailableError, ConflictError, LayoutError: see `RobotLink`.
    """
    label = f"{robot.name}: " if shared.several else ""
    link = RobotLink(robot.name, settings.web.stale_after_s, label, shared.clock, shared.events)
    planning = shared.planner(shared.config, settings.planning.workers, robot.name)
    planning.warm_up()
    timeout_s = settings.streaming.client_timeout_s
    async with link.heartbeat.beating(), watching_clients(link, timeout_s):
        services = _services(settings, robot, shared, link, planning)
        watch = watching(link, services.ownership, planning, settings.web.stale_after_s)
        async with watch, services.tool.in_force():
            yield services
        await services.studies.close()
        services.servo.close()
        services.force.close()
        services.freedrive.close()
        services.gripper.close()
        services.equipment.close()
        services.streams.close()
        services.jobs.book.close()
    planning.close()
    link.close()


def _services(
    settings: Settings,
    robot: RobotDescription,
    shared: SharedParts,
    link: RobotLink,
    planning: PlanningService,
) -> Services:
    """Create all services of one robot, each after the services that it depends on."""
    longest_s = loading_s(settings.rt.trajectory_capacity, settings.rt.period_s)
    # The timeout of a motion is for full speed.
    latest_s = shared.slowest_move_s / FRACTIONS[0] + longest_s + LATEST_ANSWER_S + MAX_PAUSE_S
    url = address(shared.base_url, robot.name) if shared.several else shared.base_url
    cell = cell_of(settings)
    tolerance_rad, smoothing_rad = settings.planning.start_tolerance_rad, settings.planning.smoothing_rad
    jobs = JobBook(link, settings.jobs_file)
    ownership = Ownership(link, jobs)
    goals = Goals(robot, settings.planning)
    motion = MotionService(robot, link, planning)
    moves = MoveService(link.clock, ownership, goals, motion, planning)
    sequences = SequenceService(ownership, link, settings.sequences, url, latest_s, shared.tokens)
    streams = StreamService(link, ownership, motion, settings.streaming)
    stopping = StopService(link, ownership, sequences.stop)
    link.heartbeat.on_outside_stop = stopping.follow
    simulated = settings.robot.backend.type == "mujoco"
    equipment = Equipment(link, stopping, ownership.speed_override, simulated=simulated)
    ownership.on_sequence_end = equipment.close_left_open
    tool_and_limits = RobotSettings(robot)
    force = ForceService(robot, link, streams, stopping, equipment.traces.warn)
    servo = ServoService(robot, link, streams, force)
    max_payload_kg = settings.robot.max_payload_kg
    retargeting = RetargetService(link, ownership, goals, motion, planning)
    scene = SceneService(robot, link, goals, motion, planning, stopping, ownership, retargeting, settings)
    held = HeldService(robot, link, ownership, scene, cell)
    gripper = GripperService(settings, link, ownership, stopping, held)
    path_gripper = PathCommands(gripper, ownership)
    motion.command_gripper = path_gripper.begin
    stale_s = settings.web.stale_after_s
    recordings = RecordingService(settings, shared.default_robot)
    queue = MotionQueue(link, ownership, motion, planning, tool_and_limits)
    studies = StudyService(settings, shared.config, ownership, shared.study_turn)
    plans = PlanService(robot, link.clock, goals, motion, moves, planning, settings)
    plans.command_gripper = gripper.run_plan
    cell_service = CellService(link, cell)
    return Services(
        robot=robot,
        link=link,
        ownership=ownership,
        goals=goals,
        motion=motion,
        moves=moves,
        positions=PositionService(robot, link, goals, settings.positions_file),
        scene=scene,
        tool=ToolService(robot, link, ownership, planning, scene, max_payload_kg, tool_file(settings)),
        plans=plans,
        approvals=Approvals(robot, link.clock, plans, settings.mcp),
        trajectories=TrajectoryService(robot.limits, ownership, motion, settings.planning, link.label),
        sequences=sequences,
        stored=StoredPrograms(settings.programs_folder, link, cell.programs if cell else ()),
        studies=studies,
        stopping=stopping,
        health=HealthService(
            settings.robot.name, link, ownership, sequences, streams, planning, recordings, stale_s
        ),
        recordings=recordings,
        control=ControlService(link, ownership, stopping),
        streams=streams,
        equipment=equipment,
        force=force,
        force_motions=ForceMotionService(robot, link, ownership, streams, goals, planning),
        freedrive=FreedriveService(
            robot,
            link,
            streams,
            is_switched_off=settings.robot.backend.options.get("freedrive") is False,
        ),
        io=IoService(link),
        gripper=gripper,
        path_gripper=path_gripper,
        cell=cell_service,
        simulation=SimulationService(link, ownership, cell_service),
        programs=ProgramService(settings.sequences.programs, ownership, sequences, stopping),
        sync=shared.sync,
        planning=planning,
        settings=tool_and_limits,
        queue=queue,
        jobs=JobService(jobs, ownership, stopping, sequences, queue, gripper, studies),
        retargeting=retargeting,
        servo=servo,
        fjt=FollowJointTrajectory(
            robot, link, ownership, motion, servo, settings.ros, tolerance_rad, smoothing_rad
        ),
        states=StateTexts(shared.events, link, robot.limits),
    )
