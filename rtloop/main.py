"""The command line of rtloop, and the start of the control loop."""

from __future__ import annotations

import argparse
import json
import logging
import os
import signal
import time
from dataclasses import asdict
from pathlib import Path
from types import FrameType

import numpy as np

from cobot.cell import cell_of
from cobot.cell.surroundings import scene_file, tool_file
from cobot.config import RtSection, Settings, load_settings
from cobot.errors import CobotError, ConfigError
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.shm import MemoryRole, RobotMemory, encoded
from cobot.launch.process import Niceness, set_niceness
from cobot.logs import start_logging
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.device import LESS
from cobot.robot.load import carrying
from cobot.robot.tool import Tool
from rtloop.backends import Backend, BackendError, ImpedanceControlled, capabilities_of, make_backend
from rtloop.clock import CycleClock, FastClock, RealtimeClock
from rtloop.device_limits import device_limits, differences
from rtloop.loop import ControlLoop
from rtloop.realtime import Permissions, freeze_garbage, prepare
from rtloop.time_factor import time_factor_refusal

INFO_LIMITS = ("min_position", "max_position", "max_velocity", "max_acceleration", "max_jerk", "max_effort")

log = logging.getLogger("cobot.rtloop")


def main() -> int:
    """Run until SIGTERM or SIGINT. Return the exit status: 0, or 2 if the real-time loop could not start."""
    parser = argparse.ArgumentParser(prog="python -m rtloop", description=__doc__)
    parser.add_argument("--config", type=Path, help="settings file (default: the one that comes with cobot)")
    parser.add_argument("--robot", help="name of one of the `robots` (default: the default robot)")
    parser.add_argument("--clock", choices=("realtime", "fast"), help="clock to use instead of rt.clock")
    parser.add_argument("--check", action="store_true", help="only check that the backend can be made")
    parser.add_argument(
        "--permissions",
        action="store_true",
        help="only print the permissions that the system grants, as JSON",
    )
    arguments = parser.parse_args()
    asked = arguments.check or arguments.permissions  # another program or a person reads the output
    if not asked:
        start_logging("rtloop")
    try:
        if arguments.permissions:
            rt = load_settings(arguments.config).of(arguments.robot).rt
            print(json.dumps(asdict(prepare(rt.priority, rt.cpu, rt.cpu_latency_us))))
        elif arguments.check:
            settings = load_settings(arguments.config).of(arguments.robot)
            limits = load_robot(settings).limits
            backend = make_backend(settings, limits)
            clock_of(backend, arguments.clock or settings.rt.clock, 1.0, settings.rt.time_factor)
            words = f"{settings.robot.backend.type}: {capabilities_of(backend).words}"
            theirs = device_limits(backend, limits)
            less = differences(limits, theirs) if theirs is not None else []
            print(f"{words}; {LESS}: {', '.join(less)}" if less else words)
        else:
            settings = load_settings(arguments.config).of(arguments.robot)
            start_logging("rtloop", settings.logging)
            _run(settings, arguments.clock)
    except (CobotError, BackendError) as exc:
        problem = f"robot.backend: {exc}" if isinstance(exc, BackendError) else str(exc)
        if asked:
            print(problem, flush=True)
        else:
            log.error("%s", problem)
        return 2
    return 0


def _run(settings: Settings, clock_name: str | None) -> None:
    rt = settings.rt
    clock_name = clock_name or rt.clock
    ending: list[str] = []

    def end(number: int, frame: FrameType | None) -> None:
        ending.append("cobot is shutting down")

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    np.seterr(all="ignore")  # no warnings: comparisons find and report values that are not finite
    robot = load_robot(settings)
    memory = RobotMemory.attach(settings.robot.name, MemoryRole.RTLOOP)
    backend = make_backend(settings, robot.limits)
    clock = clock_of(backend, clock_name, rt.period_s, rt.time_factor)
    loop = ControlLoop(settings, robot.model, memory, backend, clock, _recording(settings.robot.name))
    granted: list[Permissions] = []

    def prepare_timing() -> None:
        """Complete all slow preparations before the device is connected. A connected device may expect
        answers on time.
        """
        loop.controller.tool_and_scene.watch_scene()
        granted.append(_permissions(rt, clock_name))
        freeze_garbage()

    tool = _load_tool(settings, robot)
    loop.open(np.array(robot.positions[settings.robot.start_position].joints), tool, prepare_timing)
    try:
        _introduce(memory, settings, clock_name, granted[0])
        describe(memory, robot, backend)
        loop.run(ending)
    finally:
        loop.close()
        memory.close()


def clock_of(backend: Backend, name: str, period_s: float, factor: float = 1.0) -> CycleClock:
    """Return the clock with this name. Real hardware always gets the real-time clock.

    Raises:
        ConfigError: this backend or clock cannot have this time factor.
    """
    hurries = name == "fast" and not capabilities_of(backend).hardware
    clock = FastClock(period_s) if hurries else RealtimeClock(period_s)
    if refusal := time_factor_refusal(backend, clock, factor):
        raise ConfigError(f"rt.time_factor is {factor:g}, but {refusal}")
    clock.scale(factor)
    return clock


def _recording(robot: str) -> RecordingMemory | None:
    """Open the memory for recording. Returns None if it does not exist, because the arm can move without a
    recording.
    """
    try:
        return RecordingMemory.attach(robot, history=False)
    except CobotError as exc:
        log.error("%s", exc)
        return None


def _load_tool(settings: Settings, robot: RobotDescription) -> Tool:
    """Load the tool with the attached objects. Parts of a simulated cell are omitted, because the cell
    returns to its initial state.

    If the scene cannot be read, only the tool is returned. Nothing moves in that case, because neither the
    service nor a session can start.
    """
    model = robot.model
    tool = tool_file(settings).read_checked(settings.robot.max_payload_kg, model.file_gravity)
    try:
        scene = scene_file(settings).read()
    except ConfigError as exc:
        log.error("%s", exc)
        return tool
    cell = cell_of(settings)
    parts = () if cell is None else tuple(cell.parts)
    return carrying(tool, scene.without(parts), model.tcp_in_flange(tool))


def _permissions(rt: RtSection, clock_name: str) -> Permissions:
    if clock_name == "fast":
        # Otherwise states could be published so late that readers would consider this process dead.
        set_niceness(Niceness.PROMPT)
        return Permissions(
            sched_fifo=False, memory_locked=False, refused="not requested: the fast clock does not wait"
        )
    return prepare(rt.priority, rt.cpu, rt.cpu_latency_us)


def _introduce(memory: RobotMemory, settings: Settings, clock_name: str, permissions: Permissions) -> None:
    """Publish the process's properties before the first cycle."""
    data = memory.statistics.data
    data["pid"] = os.getpid()
    data["sched_fifo"] = permissions.sched_fifo
    data["memory_locked"] = permissions.memory_locked
    data["started_ns"] = time.time_ns()
    data["backend"] = encoded(settings.robot.backend.type, 64)
    data["clock"] = encoded(clock_name, 16)
    data["permissions"] = encoded(permissions.refused, 400)
    memory.statistics.publish()


def describe(memory: RobotMemory, robot: RobotDescription, backend: Backend) -> None:
    """Publish the robot's properties."""
    data, limits = memory.info.data, robot.limits
    data["model"] = encoded(robot.model.name, 64)
    data["period_s"] = memory.period_s
    data["joint_names"] = [encoded(name, 64) for name in limits.names]
    for name in INFO_LIMITS:
        data[name] = getattr(limits, name)
    if isinstance(backend, ImpedanceControlled):
        data["stiffness"] = backend.nominal_stiffness
        data["cartesian_stiffness"] = backend.nominal_cartesian_stiffness
    data["flange"] = robot.model.flange_in_tcp().numbers
    data["tool_version"] = robot.model.tool.version
    memory.info.publish()
