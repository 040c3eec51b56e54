"""`cobot check`: finds the errors that can be found before anything moves."""

from __future__ import annotations

import os
import socket
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TextIO

from cobot.access.authentication import authentication_required, ros_access
from cobot.access.tls import check_certificate
from cobot.access.tokens import TokenFile
from cobot.cell import cell_of
from cobot.cell.plant import check_cell
from cobot.config import Settings, WebSection
from cobot.errors import CobotError, CollisionError, ConfigError
from cobot.foreign import plain_lines
from cobot.launch.endpoints import check_endpoints
from cobot.launch.fleet_extra import require_zenoh
from cobot.launch.process import RUN_MODULE
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.geometry.visuals import has_visuals, visuals_of
from cobot.robot.holding import attach_tool_and_objects, check_holds, examine
from cobot.robot.limits import check_positions
from cobot.types import PlannerName, Scaling, vector


@dataclass(frozen=True, slots=True)
class Checked:
    """The result for one item: the findings, or the error."""

    item: str
    good: bool
    found: str


def check(settings: Settings, config: Path | None, out: TextIO) -> list[Checked]:
    """Validate the configuration, and print one line for each item.

    The items are the endpoints file, the address, the folders, the model with its limits, whether the drives
    can hold the arm in every posture, the backend, and the named positions. For each named position, the
    check covers the limits, self-collision, whether the drives can hold it, and whether a ptp motion from the
    start position reaches it.

    Args:
        config: the settings file, which the real-time process needs.

    Returns:
        All items.
    """
    report = _Report(out)
    report.item(
        "endpoints",
        lambda: f"{len(check_endpoints(settings.web.endpoints))} changed in {settings.web.endpoints}",
    )
    report.item("address", lambda: _address(settings.web))
    report.item("access", lambda: _access(settings))
    report.item("fleet", lambda: _fleet(settings, config))
    report.item("logs", lambda: _log(settings))
    report.item("recordings", lambda: _folder(settings.sequences.recordings))
    for name, each in settings.each.items():
        if settings.robots:
            report.about = f"{name}: "
        report.item("recording", partial(_folder, each.recording_folder))
        _check_robot(report, each, config)
    return report.items


def _fleet(settings: Settings, config: Path | None) -> str:
    if not settings.fleet.connect:
        return "none"
    require_zenoh("fleet.connect")
    return _said_by("cobot.fleet.cell", config)


def _check_robot(report: _Report, settings: Settings, config: Path | None) -> None:
    robots: list[RobotDescription] = []

    def load() -> str:
        robots.append(load_robot(settings))
        return f"{robots[0].limits.dof} joints, {settings.robot.model}, limits {settings.web.joint_limits}"

    report.item("core", lambda: _core(settings.rt.cpu))
    report.item("robot", load)
    for robot in robots:
        if has_visuals(robot.model_file):
            report.item("visuals", partial(_visuals, robot))
        report.item("efforts", partial(_efforts, robot, settings))
        if cell_of(settings) is not None:
            report.item("cell", partial(check_cell, robot, settings))
        report.item("backend", lambda: _backend(settings, config))
        for name in robot.positions:
            report.item(f"position {name}", partial(_position, robot, name, settings))


class _Report:
    def __init__(self, out: TextIO) -> None:
        self.items: list[Checked] = []
        self.about = ""
        self._out = out

    def item(self, name: str, examine: Callable[[], str]) -> None:
        try:
            checked = Checked(f"{self.about}{name}", True, examine())
        except CobotError as exc:
            checked = Checked(f"{self.about}{name}", False, str(exc))
        self.items.append(checked)
        verdict = "ok     " if checked.good else "FAILED "
        print(f"{verdict} {plain_lines(f'{checked.item}: {checked.found}')}", file=self._out)


def _address(web: WebSection) -> str:
    """Check that the address belongs to this computer. The port may be in use, because cobot itself may be
    running.
    """
    _resolve(web)
    return f"{web.host} port {web.port}"


def _resolve(web: WebSection) -> str:
    """The address that the service listens on."""
    try:
        family, _, _, _, address = socket.getaddrinfo(web.host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as listener:
            listener.bind(address)
    except (OSError, ValueError) as exc:  # ValueError: not a valid host name
        raise ConfigError(f"web.host: cannot listen on {web.host!r}: {exc}") from exc
    return str(address[0])


def _access(settings: Settings) -> str:
    web = settings.web
    tokens = TokenFile(web.tokens).read()
    needed = authentication_required(web, _resolve(web))
    scheme = "https" if check_certificate(web) else "http"
    made = f"{len(tokens)} in {web.tokens}"
    return f"{scheme}, tokens {'needed' if needed else 'not needed'}, {made}; {ros_access(settings.ros, web)}"


def _core(cpu: int | None) -> str:
    cores = os.sched_getaffinity(0)
    if cpu is None or cpu in cores:
        return "left to the system" if cpu is None else str(cpu)
    raise ConfigError(f"rt.cpu: there is no core {cpu}; valid cores: {', '.join(map(str, sorted(cores)))}")


def _folder(folder: Path) -> str:
    """Check that files can be written to a folder.

    The folder is not created, because it would belong to the user who runs the check, and the service may run
    as another user.
    """
    try:
        there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
        with tempfile.TemporaryFile(dir=there):
            return str(folder)
    except OSError as exc:
        raise ConfigError(f"{folder}: cannot be written to: {exc.strerror}") from exc


def _log(settings: Settings) -> str:
    _folder(settings.logs)
    if settings.kept:
        _folder(settings.kept)
    try:
        if settings.log_file.exists():
            settings.log_file.open("a").close()
    except OSError as exc:
        raise ConfigError(f"{settings.log_file}: cannot be written to: {exc.strerror}") from exc
    return str(settings.log_file)


def _backend(settings: Settings, config: Path | None) -> str:
    """Check that a real-time process, started as `cobot run` starts it, can create the backend."""
    return _said_by("rtloop", config, "--robot", settings.robot.name)


def _said_by(module: str, config: Path | None, *options: str) -> str:
    """The last line that a cobot process prints with --check.

    Raises:
        ConfigError: the process has found an error.
    """
    command = [*RUN_MODULE, module, "--check", *options]
    command += ["--config", str(config)] if config else []
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = (done.stdout + done.stderr).strip().splitlines()
        raise ConfigError(said[-1] if said else f"{module} ends with status {done.returncode}")
    return done.stdout.strip().splitlines()[-1]


def _visuals(robot: RobotDescription) -> str:
    """The number of visuals of the robot. This also checks that all their meshes can be read."""
    found = visuals_of(robot.model_file)
    size = sum(len(found.read_mesh(number)) for number in range(len(found.meshes)))
    return f"{len(found.visuals)}, with {len(found.meshes)} meshes of {size / 1e6:.1f} MB"


def _efforts(robot: RobotDescription, settings: Settings) -> str:
    """Check that the drives can hold the arm with its tool in all collision-free postures."""
    attach_tool_and_objects(robot, settings)
    holding = examine(robot.model, robot.collision, robot.limits)
    carried = robot.model.carried.mass
    load = f" with {carried:g} kg" if carried else ""
    if failing := holding.failing:
        raise ConfigError(
            f"the drives hold the arm{load} in {holding.percent} of its postures: "
            f"{'; '.join(hold.placed() for hold in failing)}. Correct max_effort or the masses of the "
            "model, or narrow the position limits"
        )
    hardest = holding.hardest[0]
    return (
        f"hold the arm{load} in every posture; {hardest.joint} needs most, {100.0 * hardest.share:.0f} % of "
        "its max_effort"
    )


def _position(robot: RobotDescription, name: str, settings: Settings) -> str:
    joints = vector(robot.positions[name].joints)
    check_positions(robot.limits, joints)
    contacts = robot.collision.contacts(joints)
    if contacts:
        raise CollisionError(f"{contacts[0].first} touches {contacts[0].second}")
    check_holds(robot.model, robot.limits, joints, "the position")
    start = vector(robot.positions[settings.robot.start_position].joints)
    timeout_s = settings.planning.timeout_s
    plan(robot, MotionRequest(start, joints, PlannerName.PTP, Scaling(speed=1.0), None, timeout_s=timeout_s))
    x, y, z = robot.model.forward(joints).position.round(3) + 0.0  # no "-0.000"
    return (
        f"within limits, free, held, reachable; TCP at x {x:.3f} y {y:.3f} z {z:.3f} m in {robot.base_frame}"
    )
