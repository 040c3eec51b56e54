"""Planning time, and the straightness of straight lines."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

import numpy as np
import ruckig

from benchmarks.service import reader, service
from benchmarks.table import Row, percentiles, row
from cobot.client import Client
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.ipc.shm import RobotMemory
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array, PlannerName, Pose, Scaling

Result = TypeVar("Result")
LINE_M = 0.25


def planning_time(requests: int) -> Iterator[Row]:
    """ptp and lin in this process, each compared with the least that it must compute."""
    robot = load_robot(load_settings(None))
    random = np.random.default_rng(7)
    ptp, ptp_floor = [], []
    while len(ptp) < requests:
        start, goal = (random.uniform(robot.limits.min_position, robot.limits.max_position) for _ in range(2))
        request = MotionRequest(start, goal, PlannerName.PTP, Scaling(0.5))
        duration_ms, trajectory = _timed(lambda request=request: plan(robot, request))
        if trajectory is None:
            continue
        ptp.append(duration_ms)
        ptp_floor.append(_timed(lambda start=start, goal=goal: _ruckig_alone(robot, start, goal))[0])
    yield row(
        "planning time of ptp, checks included",
        "ms",
        percentiles(ptp),
        "Ruckig alone",
        percentiles(ptp_floor),
    )
    lin, lin_floor = [], []
    home = np.array(robot.positions["home"].joints)
    while len(lin) < requests:
        start = home + random.uniform(-0.4, 0.4, robot.limits.dof)
        request = MotionRequest(start, _shifted(robot, start, random), PlannerName.LIN, Scaling(0.5))
        duration_ms, trajectory = _timed(lambda request=request: plan(robot, request))
        if trajectory is None:
            continue
        lin.append(duration_ms)
        configurations = trajectory.sample(trajectory.breakpoints_s)
        lin_floor.append(_timed(lambda points=configurations: _kinematics(robot, points))[0])
    yield row(
        "planning time of lin, checks included",
        "ms",
        percentiles(lin),
        "forward kinematics and Jacobian at its breakpoints",
        percentiles(lin_floor),
    )


def straightness(lines: int) -> Iterator[Row]:
    """The deviation of the TCP from the line: as planned, in every millisecond, and as measured on the
    simulated arm.
    """
    robot = load_robot(load_settings(None))
    random = np.random.default_rng(11)
    planned: list[float] = []
    executed: list[float] = []
    with service() as run, Client(run.url, motion_timeout_s=30.0) as client:
        memory = reader(run)
        home = np.array(robot.positions["home"].joints)
        while lines > 0:
            goal = _shifted(robot, home, random)
            try:
                trajectory = plan(robot, MotionRequest(home, goal, PlannerName.LIN, Scaling(0.5)))
            except CobotError:
                continue
            times = np.arange(0.0, trajectory.duration_s, 1e-3)
            begin = robot.model.forward(home).position
            points = [robot.model.forward(joints).position for joints in trajectory.sample(times)]
            planned += _off_the_line(np.array(points), begin, goal.position)
            executed += _off_the_line(_drive(client, memory, goal, robot), begin, goal.position)
            client.move_named("home", speed=0.5)
            lines -= 1
    yield row(
        "deviation of lin from the line, planned",
        "mm",
        percentiles(planned),
        "the largest that is accepted",
        (0.05, 0.05, 0.05),
        ratio_of="p99.9",
        aim="0.05 mm",
    )
    yield row(
        "deviation of lin from the line, executed",
        "mm",
        percentiles(executed),
        "planned",
        percentiles(planned),
        ratio_of="p99.9",
    )


def _drive(client: Client, memory: RobotMemory, goal: Pose, robot: RobotDescription) -> Array:
    """The TCP positions that rtloop measured during a lin motion at half speed, shape (n, 3)."""
    positions: list[Array] = []
    ended = threading.Event()

    def watch() -> None:
        while not ended.is_set():
            positions.append(memory.state.read()["tcp"][:3].copy())
            time.sleep(5e-4)

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        a, b, c = goal.abc
        x, y, z = goal.position
        client.move_pose(x=x, y=y, z=z, a=a, b=b, c=c, speed=0.5, planner="lin")
    finally:
        ended.set()
        watcher.join()
    return np.array(positions)


def _off_the_line(points: Array, begin: Array, end: Array) -> list[float]:
    """Distances from the line, mm."""
    direction = (end - begin) / np.linalg.norm(end - begin)
    offset = points - begin
    return list(1e3 * np.linalg.norm(offset - np.outer(offset @ direction, direction), axis=1))


def _shifted(robot: RobotDescription, start: Array, random: np.random.Generator) -> Pose:
    pose = robot.model.forward(start)
    direction = random.normal(size=3)
    return Pose(pose.position + LINE_M * direction / np.linalg.norm(direction), pose.quaternion)


def _timed(call: Callable[[], Result]) -> tuple[float, Result | None]:
    """The time in ms, and the result; None if the request cannot be planned."""
    begun_ns = time.perf_counter_ns()
    try:
        result = call()
    except CobotError:
        result = None
    return (time.perf_counter_ns() - begun_ns) / 1e6, result


def _ruckig_alone(robot: RobotDescription, start: Array, goal: Array) -> ruckig.Trajectory:
    limits = robot.limits.scaled(0.5, 0.5, 0.5)
    problem = ruckig.InputParameter(limits.dof)
    problem.current_position, problem.target_position = start.tolist(), goal.tolist()
    problem.max_velocity = limits.max_velocity.tolist()
    problem.max_acceleration = limits.max_acceleration.tolist()
    problem.max_jerk = limits.max_jerk.tolist()
    trajectory = ruckig.Trajectory(limits.dof)
    ruckig.Ruckig(limits.dof).calculate(problem, trajectory)
    return trajectory


def _kinematics(robot: RobotDescription, configurations: Array) -> None:
    for joints in configurations:
        robot.model.forward_and_jacobian(joints)
